"""Page of the shipped scenes, made from their files.

python docs/scenes_page.py > docs/reference-scenes.md
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from picktree.world.scene import SceneDescription, load_scene
from picktree.world.scene.scene_loading import scene_names

HEAD = """\
# Shipped scenes

`picktree run MISSION --scene NAME` takes one of these instead of the mission's own; `base: NAME` in a scene
file of your own builds on it. All keys of a scene: [reference-scene.md](reference-scene.md).

| scene | robot | cameras | bins, totes, fixtures with holes | items at the start |
|---|---|---|---|---|
"""


def joined(names: Iterable[object]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def items(scene: SceneDescription) -> str:
    """Return the spawned items by kind; the feed brings more."""
    counts: Counter[str] = Counter()
    for spawn in scene.spawn:
        counts.update(spawn.counts)
    parts = [f"{count} {kind.replace('assortment', 'unknown things')}" for kind, count in counts.items()]
    if scene.deliveries:
        parts.append("more by the feed")
    return ", ".join(parts)


def row(name: str) -> str:
    scene = load_scene(name, Path.cwd())
    places = [*(each.id for each in scene.bins), *(each.id for each in scene.fixtures if each.holes)]
    cameras = joined(each.name for each in scene.cameras)
    return f"| `{name}` | {scene.robot} | {cameras} | {joined(places)} | {items(scene)} |"


if __name__ == "__main__":
    print(HEAD, end="")
    print("\n".join(map(row, scene_names())))
