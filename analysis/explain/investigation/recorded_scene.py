"""The scene file of a run, as far as its log lets it be read: what is where, and what weighs how much."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from ....errors import PicktreeError
from ....world.scene.description import CatalogueEntry, SceneDescription
from ....world.scene.loading.scene_loading import parse_scene

if TYPE_CHECKING:
    from ....logs.run_record import RunRecord


def scene_of(run: RunRecord) -> SceneDescription | None:
    """None when the log holds no scene file, or one that needs files which it does not hold."""
    kept = run.log.attachments
    if "scene.yaml" not in kept:
        return None
    text = run.log.attachment("scene.yaml").decode("utf-8", "replace")
    with tempfile.TemporaryDirectory() as folder:
        for name in (name for name in kept if name.startswith("mesh/")):
            mesh = Path(name).name
            text = re.sub(rf"[^\s,{{}}'\"]*{re.escape(mesh)}", mesh, text)
            (Path(folder) / mesh).write_bytes(run.log.attachment(name))
        try:
            return parse_scene(text, Path(folder) / "scene.yaml")
        except (PicktreeError, OSError):
            return None


def entry_of(scene: SceneDescription | None, kind: str) -> CatalogueEntry | None:
    """What the catalogue says of a kind."""
    return None if scene is None else next((e for e in scene.catalogue if e.kind == kind), None)
