"""The second, independent judge of whole trajectories: python-fcl on geometry that it builds itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from ..robot.model import RobotModel
from ..robot.urdf import LinkMesh, LinkShape, link_geometry
from ..scene.planning_scene import PlanningScene
from ..trajectory import Trajectory
from ..values import Array, Pose
from .bodies import loose_bodies, still_bodies
from .fcl_shapes import Placed, Solid, bounds_apart, gap, hull, place, solid
from .margins import Margins, Part
from .requests import Contact
from .way import SLACK, ZONE

STEP = 0.005
"""Greatest way of any link's origin or of the TCP between two configurations that are judged, m."""
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
    """A body at one moment, robot's or scene's."""

    name: str
    part: Part
    placed: Placed


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
        # What the hand holds cannot reach the link that carries the hand.
        self._held_against = [
            k
            for k, limb in enumerate(self._limbs)
            if limb.part not in gripper and limb.link not in _carriers(model)
        ]

    def judge(self, trajectory: Trajectory, scene: PlanningScene, width: float) -> tuple[Contact, ...]:
        """Every pair that penetrates on the way, at its deepest. Empty: the trajectory is free.

        Pairs that the scene allows to touch, and what a held object may sink into a board, do not count;
        nor does what touches already at the start, near the start, unless it gets deeper.
        """
        around = [
            _Thing(b.name, Part.SUPPORT if b.support else Part.OBSTACLE, place(solid(b.shape), b.pose))
            for b in (*still_bodies(scene), *loose_bodies(scene.objects))
        ]
        held = scene.held
        held_solid = None if held is None else solid(held.shape)
        worst: dict[tuple[str, str], Contact] = {}
        at_start: dict[tuple[str, str], float] = {}
        for k, q in enumerate(self._moments(trajectory, width)):
            tcp = self._model.tcp(q)
            poses = self._model.link_poses(q, width)
            limbs = [
                _Thing(m.link, m.part, place(m.solid, poses[m.link] @ m.pose_in_link)) for m in self._limbs
            ]
            pairs = [(limbs[i], limbs[j]) for i, j in self._self_pairs]
            hand = limbs
            if held is not None and held_solid is not None and held.object_in_tcp is not None:
                thing = _Thing(held.id, Part.HELD, place(held_solid, tcp @ held.object_in_tcp))
                pairs += [(limbs[i], thing) for i in self._held_against]
                hand = [*limbs, thing]
            pairs += [(a, b) for a in hand if a.part is not Part.BASE for b in around]
            near_start = float(np.abs(q - trajectory.start).max()) <= ZONE
            for a, b in pairs:
                if bounds_apart(a.placed, b.placed, 0.0) or self._allowed(scene, a, b):
                    continue
                between = gap(a.placed, b.placed)
                least = min(0.0, self._margins.between(a.part, b.part))
                key = (a.name, b.name)
                if k == 0 and between.distance < least:
                    at_start[key] = min(between.distance, at_start.get(key, 0.0))
                if near_start and key in at_start:
                    least = min(least, at_start[key] - SLACK)
                if between.distance < min(least - TOLERANCE, worst[key].distance if key in worst else 0.0):
                    worst[key] = Contact(a.name, b.name, between.distance, between.point_b)
        return tuple(sorted(worst.values(), key=lambda contact: contact.distance))

    def _allowed(self, scene: PlanningScene, a: _Thing, b: _Thing) -> bool:
        if b.part not in (Part.SUPPORT, Part.OBSTACLE):
            return False
        side = "arm" if a.part is Part.ARM else "gripper"
        return scene.allowed(side, b.name) or scene.allowed(a.name, b.name)

    def _moments(self, trajectory: Trajectory, width: float) -> list[Array]:
        """Configurations (n,) along the trajectory, between which no link moves further than STEP."""
        kept: list[Array] = []
        last: Array | None = None
        for q in trajectory.position:
            poses = self._model.link_poses(q, width)
            points = np.array([self._model.tcp(q).position, *(p.position for p in poses.values())])
            way = np.inf if last is None else float(np.linalg.norm(points - last, axis=1).max())
            if way > STEP and kept and last is not None:
                # The samples may be further apart than STEP themselves.
                extra = int(np.ceil(way / STEP))
                before = kept[-1]
                kept += [before + (q - before) * (k / extra) for k in range(1, extra)]
            if way > STEP:
                kept.append(q)
                last = points
        kept.append(trajectory.end)
        return kept


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
