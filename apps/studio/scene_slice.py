"""Scene slice: the scene of a mission in 3-D, by seed, through its cameras, and with fixtures that move."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from pathlib import Path

from starlette.routing import BaseRoute

from ...authoring.editor.pieces import scalar
from ...authoring.editor.syntax import NotEditable, Source
from ...authoring.editor.text_changes import changes
from ...authoring.editor.text_edits import replace_value
from ...files.errors import PicktreeError
from ...world.scene.scene_loading import scene_names
from . import scenes
from .answers import Places, change_values
from .calls import JsonValue, call
from .slice import Studio
from .worker import Worker


class SceneSlice:
    """Calls on scenes. They compute in a process of their own."""

    def __init__(self, studio: Studio) -> None:
        self._workspace = studio.workspace
        self._worker = Worker()

    def routes(self) -> Sequence[BaseRoute]:
        return ()

    async def close(self) -> None:
        await self._worker.close()

    @call("scene.show")
    async def show(self, mission: str, scene: str, seed: int, text: str | None = None) -> JsonValue:
        """Return what a scene holds when a run with a seed begins; `text`: its file's, where not saved."""
        beside = self._beside(mission, scene)
        found = await self._worker.run(scenes.spawned, scene, beside, seed, text)
        return {**found, "file": "" if scene in scene_names() else self._below(beside / scene)}

    @call("scene.robot")
    async def robot(self, mission: str, scene: str, text: str | None = None) -> JsonValue:
        """Return the scene's robot at `home` as a mesh."""
        return await self._worker.run(scenes.robot, scene, self._beside(mission, scene), text)

    @call("scene.camera")
    async def camera(
        self, mission: str, scene: str, seed: int, camera: str, text: str | None = None
    ) -> JsonValue:
        """Return what a camera sees when a run with a seed begins in physics, as data URLs."""
        beside = self._beside(mission, scene)
        return await self._worker.run(scenes.camera_view, scene, beside, seed, camera, text)

    @call("scene.move")
    async def move(self, text: str, fixture: str, x: float, y: float) -> JsonValue:
        """Return the replacements of a scene's text that move a fixture or bin to x, y (m, world)."""
        if not (math.isfinite(x) and math.isfinite(y)):
            raise PicktreeError("a place is two numbers in metres")
        return await asyncio.to_thread(_moved, text, fixture, x, y)

    def _beside(self, mission: str, scene: str) -> Path:
        folder = self._workspace.resolve(mission).parent
        if scene not in scene_names():
            self._below(folder / scene)
        return folder

    def _below(self, place: Path) -> str:
        """Return a place as a path below the folder. Raises PicktreeError for one outside."""
        found = place.resolve()
        if not found.is_relative_to(self._workspace.root):
            raise PicktreeError(f"{place} is not below the folder of the studio")
        return self._workspace.relative(found)


def _moved(text: str, fixture: str, x: float, y: float) -> JsonValue:
    source = Source(text)
    fixtures = source.root.child("fixtures")
    given = fixtures.child(fixture) if fixtures is not None else None
    at = given.child("at") if given is not None else None
    if at is None or at.kind != "list" or len(at.items) < 2:
        raise NotEditable(f"the file has no place 'at: [x, y, z]' for {fixture!r}: it stands in its base")
    new = text
    for index, value in ((1, y), (0, x)):
        new = replace_value(new, ("fixtures", fixture, "at", index), scalar(f"{round(value, 4):g}"))
    return {"changes": change_values(changes(text, new), Places(text)), "text": new}
