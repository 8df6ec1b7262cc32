"""The second, independent judge of whole trajectories: python-fcl on geometry that it builds itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from ..robot.model import RobotModel
from ..robot.urdf import LinkMesh, LinkShape, link_geometry
from ..scene.planning_scene import PlanningScene
from ..trajectory import Trajectory
from ..values import Array, Pose
from .bodies import loose_bodies, still_bodies
from .fcl_shapes import Placed, Solid, gap, hull, place, solid
from .margins import Margins, Part
from .requests import Contact
from .way import SLACK, ZONE

STEP = 0.005
"""Greatest way of the TCP between two configurations that are judged, m."""
TURN = 0.03
"""Greatest way in joint space between them, rad: the elbow may move while the TCP does not."""
TOLERANCE = 0.0001
"""Penetration that is put down to rounding, m."""


@dataclass(frozen=True, slots=True)
class _Limb:
    link: str
    solid: Solid
    pose_in_link: Pose
    part: Part


@dataclass(frozen=True, slots=True)
class _Thing:
    """A body of the robot or of the scene, wherever it is."""

    name: str
    part: Part


class Judge:
    """Judges trajectories of one robot; the hulls of its links are made once."""

    def __init__(self, model: RobotModel) -> None:
        self._model = model
        self._margins = Margins()
        beyond = _links_beyond(model)
        fingers = model.description.gripper.fingers
        fixed = model.link_poses(model.lower, 0.0), model.link_poses(model.upper, 0.08)
        self._limbs: list[_Limb] = []
        for element in link_geometry(model.description.urdf, "collision"):
            link = element.link
            if link in fingers:
                part = Part.FINGER
            elif link in beyond:
                part = Part.HAND
            else:
                part = Part.BASE if fixed[0][link] == fixed[1][link] else Part.ARM
            self._limbs.append(_Limb(link, _solid_of(element), element.pose_in_link, part))
        disabled = {frozenset(pair) for pair in model.description.disabled_pairs}
        gripper = (Part.HAND, Part.FINGER)
        self._self_pairs = [
            (i, j)
            for i, a in enumerate(self._limbs)
            for j, b in enumerate(self._limbs[i + 1 :], i + 1)
            if a.link != b.link
            and frozenset((a.link, b.link)) not in disabled
            and not (a.part in gripper and b.part in gripper)
        ]
        # What the hand holds cannot reach the links that carry the hand.
        carriers = _carriers(model)
        self._held_against = [
            k for k, limb in enumerate(self._limbs) if limb.part not in gripper and limb.link not in carriers
        ]

    def judge(
        self, trajectory: Trajectory, scene: PlanningScene, width: float, *, excuse_start: bool = True
    ) -> tuple[Contact, ...]:
        """Every pair that penetrates on the way, at its deepest. Empty: the trajectory is free.

        Pairs that the scene allows to touch, and what a held object may sink into a board, do not count;
        with `excuse_start` nor does what touches already at the start, near it, unless it gets deeper.
        """
        bodies = (*still_bodies(scene), *loose_bodies(scene.objects))
        around = [place(solid(b.shape), b.pose) for b in bodies]
        held = scene.held
        held_solid = None if held is None else solid(held.shape)
        things = [_Thing(limb.link, limb.part) for limb in self._limbs]
        if held is not None:
            things.append(_Thing(held.id, Part.HELD))
        robots = len(things)
        things += [_Thing(b.name, Part.SUPPORT if b.support else Part.OBSTACLE) for b in bodies]
        meets = self._meets(scene, things, robots)
        worst: dict[tuple[str, str], Contact] = {}
        at_start: dict[tuple[str, str], float] = {}
        for moment, q in enumerate(self._moments(trajectory)):
            poses = self._model.link_poses(q, width)
            placed = [place(m.solid, poses[m.link] @ m.pose_in_link) for m in self._limbs]
            if held is not None and held_solid is not None and held.object_in_tcp is not None:
                placed.append(place(held_solid, self._model.tcp(q) @ held.object_in_tcp))
            placed += around
            near_start = float(np.abs(q - trajectory.start).max()) <= ZONE
            for i, j in _overlapping(placed, robots, meets):
                a, b = things[i], things[j]
                between = gap(placed[i], placed[j])
                least = min(0.0, self._margins.between(a.part, b.part))
                key = (a.name, b.name)
                if excuse_start and moment == 0 and between.distance < least:
                    at_start[key] = min(between.distance, at_start.get(key, 0.0))
                if near_start and key in at_start:
                    least = min(least, at_start[key] - SLACK)
                if between.distance < min(least - TOLERANCE, worst[key].distance if key in worst else 0.0):
                    worst[key] = Contact(a.name, b.name, between.distance, between.point_b)
        return tuple(sorted(worst.values(), key=lambda contact: contact.distance))

    def _meets(self, scene: PlanningScene, things: list[_Thing], robots: int) -> NDArray[np.bool_]:
        """(robots, all): the pairs that may not touch."""
        meets = np.zeros((robots, len(things)), dtype=np.bool_)
        for i, j in self._self_pairs:
            meets[i, j] = True
        if robots > len(self._limbs):
            meets[self._held_against, robots - 1] = True
        for i, a in enumerate(things[:robots]):
            side = "arm" if a.part is Part.ARM else "gripper"
            for j, b in enumerate(things[robots:], robots):
                touching = scene.allowed(side, b.name) or scene.allowed(a.name, b.name)
                meets[i, j] = a.part is not Part.BASE and not touching
        return meets

    def _moments(self, trajectory: Trajectory) -> list[Array]:
        """Configurations (n,) along the trajectory, at most STEP of the TCP and TURN of the joints apart."""
        kept = [trajectory.start]
        last = np.array(self._model.tcp(trajectory.start).position)
        for index, q in enumerate(trajectory.position[1:], 1):
            point = np.array(self._model.tcp(q).position)
            ways = float(np.linalg.norm(point - last)) / STEP, float(np.linalg.norm(q - kept[-1])) / TURN
            count = int(np.ceil(max(ways)))
            if max(ways) > 0.9 or index == len(trajectory.position) - 1:
                # Two samples may be further apart than that themselves.
                before = kept[-1]
                kept += [before + (q - before) * (k / count) for k in range(1, count)] + [q]
                last = point
        return kept


def _overlapping(placed: list[Placed], robots: int, meets: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Pairs (of the robot, of anything) whose bounding boxes overlap."""
    low = np.array([p.low for p in placed])
    high = np.array([p.high for p in placed])
    apart = (low[:robots, None] > high[None]).any(axis=2) | (low[None] > high[:robots, None]).any(axis=2)
    return [(int(i), int(j)) for i, j in np.argwhere(meets & ~apart)]


def judge(
    trajectory: Trajectory, scene: PlanningScene, model: RobotModel, width: float
) -> tuple[Contact, ...]:
    """One trajectory judged; see `Judge.judge`."""
    return Judge(model).judge(trajectory, scene, width)


def _solid_of(element: LinkMesh | LinkShape) -> Solid:
    if isinstance(element, LinkShape):
        return solid(element.shape)
    mesh: trimesh.Trimesh = trimesh.load_mesh(element.path)  # pyright: ignore[reportUnknownMemberType]
    return hull(np.array(mesh.vertices, dtype=np.float64) * np.array(element.scale))


def _links_beyond(model: RobotModel) -> set[str]:
    """Links that hang on the flange joint."""
    frames = model.full.frames
    beyond = {model.full.getFrameId(model.description.flange_joint)}
    for index, frame in enumerate(frames):
        if frame.parentFrame in beyond and index > 0:
            beyond.add(index)
    return {frames[index].name for index in beyond}


def _carriers(model: RobotModel) -> set[str]:
    """Links that do not move against the hand."""
    flange = model.full.frames[model.full.getFrameId(model.description.flange_joint)]
    return {frame.name for frame in model.full.frames if frame.parentJoint == flange.parentJoint}
