"""Scene slice: the scene of a mission in 3-D, by seed, through its cameras, and with fixtures that move."""

from __future__ import annotations

import asyncio
import base64
import math
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from picktree.authoring.editor import NotEditable, Source, changes, replace_value, scalar
from picktree.files import PicktreeError
from picktree.files.yaml import read_document
from picktree.world import COLOURS, Pose
from picktree.world.scene import SceneDescription, load_scene, scene_loading

from .answers import PageText
from .calls import JsonValue, call
from .slice import Slice, Studio
from .worker import Worker

if TYPE_CHECKING:
    from picktree.logs import triangle_meshes

_GREY = (0.6, 0.6, 0.6)


def spawned(name: str, beside: Path, seed: int, text: str | None) -> dict[str, Any]:
    """Return the bodies of a scene at the start of a run with this seed, before items settle.

    `beside`: folder of the mission; `text`: the scene file's text where it is not saved.
    """
    # The server names these functions, but only its worker loads what they need.
    from picktree.logs import triangle_meshes
    from picktree.simulation import displace_fixtures, spawn_items

    scene = _scene(name, beside, text)
    bodies: list[dict[str, Any]] = []
    for fixture in displace_fixtures(scene, seed).fixtures:
        mesh = triangle_meshes.part_mesh(fixture.shape, fixture.holes)
        bodies.append(_body(str(fixture.id), "fixture", mesh, fixture.pose, fixture.colour))
    for each in scene.bins:
        parts = [
            triangle_meshes.shape_mesh(box).placed(each.pose.inverse() @ pose) for box, pose in each.parts()
        ]
        bodies += [_body(str(each.id), "bin", part, each.pose, each.colour) for part in parts]
    for item in spawn_items(scene, seed):
        bodies.append(
            _body(str(item.id), "item", triangle_meshes.shape_mesh(item.entry.shape), item.pose, item.colour)
        )
    file = Path(scene.source)
    return {
        "name": scene.name,
        "file": "" if file.parent == scene_loading.SHIPPED else str(file),
        "bodies": bodies,
        "cameras": [
            {"name": camera.name, "fov": camera.fov, "size": list(camera.size), **_pose(camera.pose)}
            for camera in scene.cameras
            if camera.on == "world"
        ],
        "views": [camera.name for camera in scene.cameras],
    }


def robot(name: str, beside: Path, text: str | None) -> dict[str, Any]:
    """Return the collision geometry of the scene's robot at `home`."""
    scene = _scene(name, beside, text)
    return _robot(scene.robot, str(Path(scene.source).parent))


@lru_cache(maxsize=2)
def _robot(name: str, beside: str) -> dict[str, Any]:
    from picktree.analysis.render import home_mesh
    from picktree.world.robot_model import load_robot

    return {"robot": name, **_mesh(home_mesh(load_robot(name, Path(beside))))}


def camera_view(name: str, beside: Path, seed: int, camera: str, text: str | None) -> dict[str, Any]:
    """Return a camera's images at the start of a run with this seed in physics, as data URLs."""
    import cv2
    import numpy as np

    from picktree.session import CellSession

    if text is not None:
        raise PicktreeError("the scene is not saved: the camera shows only a saved scene")
    scene = _scene(name, beside, None)
    with CellSession(scene.source, backend="physics", seed=seed) as cell:
        image = cell.capture(camera)
    depth = image.depth
    seen = depth[depth > 0]
    near, far = (float(seen.min()), float(seen.max())) if seen.size else (0.0, 1.0)
    grey = np.where(depth > 0, 255 - 215 * (depth - near) / max(far - near, 1e-6), 0).astype(np.uint8)
    pictures = {"colour": cv2.cvtColor(image.colour, cv2.COLOR_RGB2BGR), "depth": grey}
    values: dict[str, Any] = {"near": near, "far": far}
    for kind, pixels in pictures.items():
        written, data = cv2.imencode(".png", pixels)
        if not written:
            raise PicktreeError("the picture cannot be encoded")
        values[kind] = f"data:image/png;base64,{base64.b64encode(data.tobytes()).decode()}"
    return values


def _scene(name: str, beside: Path, text: str | None) -> SceneDescription:
    if text is None:
        return load_scene(name, beside)
    return scene_loading.check_scene(read_document(beside / name, "scene", text)).required()


def _body(name: str, kind: str, mesh: triangle_meshes.Mesh, pose: Pose, colour: str) -> dict[str, Any]:
    paint = list(COLOURS.get(colour, _GREY))
    return {"name": name, "kind": kind, "colour": paint, **_pose(pose), **_mesh(mesh)}


def _pose(pose: Pose) -> dict[str, Any]:
    return {"position": list(map(float, pose.position)), "quaternion": list(map(float, pose.orientation))}


def _mesh(mesh: triangle_meshes.Mesh) -> dict[str, Any]:
    return {
        "vertices": [round(float(value), 5) for value in mesh.vertices.ravel()],
        "faces": [int(value) for value in mesh.faces.ravel()],
    }


class SceneSlice(Slice):
    """Calls on scenes. They compute in a process of their own."""

    def __init__(self, studio: Studio) -> None:
        self._workspace = studio.workspace
        self._worker = Worker()

    async def close(self) -> None:
        await self._worker.close()

    @call("scene.show")
    async def show(self, mission: str, scene: str, seed: int, text: str | None = None) -> JsonValue:
        """Return the bodies of a scene at the start of a run with a seed; `text`: the unsaved scene file."""
        beside = self._beside(mission, scene)
        found = await self._worker.run(spawned, scene, beside, seed, text)
        return {**found, "file": "" if scene in scene_loading.scene_names() else self._below(beside / scene)}

    @call("scene.robot")
    async def robot(self, mission: str, scene: str, text: str | None = None) -> JsonValue:
        """Return the scene's robot at `home` as a mesh."""
        return await self._worker.run(robot, scene, self._beside(mission, scene), text)

    @call("scene.camera")
    async def camera(
        self, mission: str, scene: str, seed: int, camera: str, text: str | None = None
    ) -> JsonValue:
        """Return a camera's images at the start of a run with a seed in physics, as data URLs."""
        beside = self._beside(mission, scene)
        return await self._worker.run(camera_view, scene, beside, seed, camera, text)

    @call("scene.move")
    async def move(self, text: str, fixture: str, x: float, y: float) -> JsonValue:
        """Return the replacements of a scene's text that move a fixture or bin to x, y (m, world)."""
        if not (math.isfinite(x) and math.isfinite(y)):
            raise PicktreeError("a place is two numbers in metres")
        return await asyncio.to_thread(_moved, text, fixture, x, y)

    def _beside(self, mission: str, scene: str) -> Path:
        folder = self._workspace.resolve(mission).parent
        if scene not in scene_loading.scene_names():
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
    entry = fixtures.child(fixture) if fixtures is not None else None
    at = entry.child("at") if entry is not None else None
    if at is None or at.kind != "list" or len(at.items) < 2:
        raise NotEditable(
            f"the file has no place 'at: [x, y, z]' for {fixture!r}: change the place in its base file"
        )
    new = text
    for index, value in ((1, y), (0, x)):
        new = replace_value(new, ("fixtures", fixture, "at", index), scalar(f"{round(value, 4):g}"))
    return {"changes": PageText(text).changes(changes(text, new)), "text": new}
