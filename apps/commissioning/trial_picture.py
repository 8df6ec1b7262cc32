"""Picture of a plan: the arm at start and goal, and the tool's path; for a failure, the bodies in
collision."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...analysis.render.captions import Caption, CaptionFailure, write
from ...analysis.render.rasterizer import Picture
from ...analysis.render.scene_view import SceneContent, SceneRenderer
from ...analysis.render.viewpoint import PictureView
from ...files.atomic_write import whole
from ...logs.binary_gltf import link_meshes, read_glb, write_glb
from ...logs.recording.images import require_picture_name, write_picture
from ...logs.recording.journal_records import belief_record
from ...logs.schema.records import BodyRecord, LinkMesh, PartRecord, Scene
from ...robot.planning.requests import MotionPlan
from ...robot.world import World
from ...world.causes import Failure
from ...world.shapes import Sphere
from ...world.values import Array, Pose

START_COLOUR = (0.80, 0.86, 0.93)
"""Colour of the arm at the start."""
HAND_COLOUR = (0.90, 0.91, 0.84)
"""Colour of the hand between start and goal."""
COLLISION_COLOUR = (0.85, 0.15, 0.12)
"""Colour of a link in collision."""
COPY_SCALE = (0.99, 0.99, 0.99)
INTERMEDIATE_HANDS = 3
"""Number of hands that are drawn between start and goal."""


def draw(
    world: World,
    start: Array,
    outcome: MotionPlan | Failure | None,
    asked: str,
    output: Path,
    view: PictureView,
    size: tuple[int, int],
) -> None:
    """Write the picture. Raises PicktreeError when it cannot be written."""
    require_picture_name(output)
    picture = plan_picture(world, start, outcome, asked, view, size)
    with whole([output], output) as (beside,):
        output.parent.mkdir(parents=True, exist_ok=True)
        write_picture(str(beside), picture)


def plan_picture(
    world: World,
    start: Array,
    outcome: MotionPlan | Failure | None,
    asked: str,
    view: PictureView,
    size: tuple[int, int],
    width: float | None = None,
    time: float = 0.0,
) -> Picture:
    """Return the picture as RGB (h, w, 3).

    `start` is the configuration (n,), rad, `width` the opening of the fingers, m; None: fully open. Without
    an outcome the arm stands at the start. `time` is shown, s.
    """
    meshes = link_meshes(world.robot.description.urdf)
    width = world.robot.description.gripper.max_width if width is None else width
    robots = _Robots(meshes)
    path: tuple[tuple[float, float, float], ...] = ()
    marked: tuple[BodyRecord, ...] = ()
    point: tuple[BodyRecord, ...] = ()
    caption = Caption(time, asked)
    if isinstance(outcome, MotionPlan):
        q = outcome.trajectory.position
        robots.add("", world.robot.link_poses(q[-1], width))
        robots.add("start", _undrawn(world.robot.link_poses(q[0], width), robots.poses), START_COLOUR)
        for k in np.linspace(0, len(q) - 1, INTERMEDIATE_HANDS + 2).astype(int)[1:-1]:
            hand = _hand(world, world.robot.link_poses(q[k], width))
            robots.add(f"way {k}", hand, HAND_COLOUR)
        path = tuple(world.robot.tcp(one).position for one in q[:: max(1, len(q) // 60)])
        caption = Caption(outcome.trajectory.duration, asked, f"by {outcome.planner}")
    elif isinstance(outcome, Failure):
        at, names = _failure_configuration(outcome, start), _named_bodies(outcome)
        robots.add("", world.robot.link_poses(at, width), alarm=names)
        if not np.array_equal(at, start):
            robots.add("start", _undrawn(world.robot.link_poses(start, width), robots.poses), START_COLOUR)
        marked = tuple(_marked(world, names))
        point = _point(outcome)
        caption = replace(caption, trouble=CaptionFailure(outcome.cause.name, outcome.message))
    else:
        robots.add("", world.robot.link_poses(start, width))
    bodies = tuple(belief_record(o) for o in world.scene.objects)
    scene = Scene((*bodies, *point), tuple(_fixed(world)))
    shown = SceneContent(robots.poses, scene, Scene(marked, ()), path)
    picture = SceneRenderer(tuple(robots.meshes), view, size, {}).single(shown)
    write(picture, caption)
    return picture


class _Robots:
    """Drawn copies of the robot in several configurations and colours."""

    def __init__(self, meshes: tuple[LinkMesh, ...]) -> None:
        self._own = {mesh.link: mesh for mesh in meshes}
        self.meshes: list[LinkMesh] = []
        self.poses: dict[str, Pose] = {}

    def add(
        self,
        name: str,
        links: dict[str, Pose],
        colour: tuple[float, float, float] | None = None,
        alarm: frozenset[str] = frozenset(),
    ) -> None:
        """Add a copy of the robot in its own colours or another; links in `alarm` are red."""
        for link, pose in links.items():
            mesh = self._own.get(link)
            if mesh is None:
                continue
            painted = COLLISION_COLOUR if link in alarm else colour
            glb = mesh.glb
            if painted is not None:
                other = read_glb(glb).coloured(painted)
                # Slightly smaller, so that surfaces that coincide do not flicker through each
                # other.
                glb = write_glb(other if colour is None else other.placed(Pose(), COPY_SCALE))
            self.meshes.append(LinkMesh(f"{name}/{link}", glb))
            self.poses[f"{name}/{link}"] = pose


def _hand(world: World, links: dict[str, Pose]) -> dict[str, Pose]:
    """Return the links of hand and fingers."""
    gripper = world.robot.description.gripper
    wanted = {world.robot.description.tcp_link, *gripper.fingers}
    return {link: pose for link, pose in links.items() if link in wanted}


def _failure_configuration(failure: Failure, start: Array) -> Array:
    """Return the configuration of a failure; the start when it has none."""
    told = failure.evidence.get("configuration")
    if isinstance(told, list) and len(told) == len(start):
        return np.array([float(x) for x in told])
    return start


def _point(failure: Failure) -> tuple[BodyRecord, ...]:
    """Return a red ball at the failure's point: the goal's, or where a line stopped."""
    for key in ("point", "first", "at"):
        told = failure.evidence.get(key)
        if isinstance(told, list) and len(told) == 3:
            x, y, z = (float(c) for c in told)
            return (BodyRecord("point", "point", "sphere", "red", Sphere(0.012), Pose((x, y, z))),)
    return ()


def _undrawn(links: dict[str, Pose], drawn: dict[str, Pose]) -> dict[str, Pose]:
    """Return the links that are not drawn at the same pose already."""
    return {link: pose for link, pose in links.items() if drawn.get(f"/{link}") != pose}


def _named_bodies(failure: Failure) -> frozenset[str]:
    """Return the names of all bodies in contact or in the way."""
    names: set[str] = set()
    for key in ("pairs", "in_the_way", "enclosed_by"):
        told = failure.evidence.get(key)
        for line in told if isinstance(told, list) else ():
            names.update(str(line).split())
    return frozenset(names)


def _marked(world: World, names: frozenset[str]) -> Iterable[BodyRecord]:
    """Return the named bodies of the scene, to be outlined."""
    for o in world.scene.objects:
        if o.id in names:
            yield belief_record(o)
    for part in _fixed(world):
        if part.id.split("/")[0] in names:
            yield BodyRecord(part.id, "fixture", "box", "red", part.shape, part.pose)


def _fixed(world: World) -> Iterable[PartRecord]:
    for f in world.scene.fixtures.values():
        yield PartRecord(f.id, f.colour, f.shape, f.pose, f.holes)
    for b in world.scene.bins.values():
        for k, (box, pose) in enumerate(b.parts()):
            yield PartRecord(f"{b.id}/{k}", b.colour, box, pose)
