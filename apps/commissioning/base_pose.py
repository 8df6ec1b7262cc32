"""Base of an arm: the nearest one from which the tool reaches items and bins of a sorting scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from picktree.robot.manipulation import release_poses
from picktree.robot.planning import InverseKinematics
from picktree.world import Array, Pose, Vector3
from picktree.world.robot_model import RobotModel, urdf_parser
from picktree.world.scene import SceneDescription, load_scene

from .link_geometry import LinkGeometry

SCENE = "sort_small"
"""Scene whose items and bins the arm is to reach, and in whose workspace its poses are."""
HEIGHTS_OVER_TABLE, HEIGHT_OVER_BIN = (0.02, 0.12), 0.10
"""Heights of the tool over the table at an item and before it, and over the rim at the release, m."""
YAWS = (0.0, np.pi / 4, np.pi / 2, 3 * np.pi / 4)
"""Directions of the fingers that are tried, rad."""
STEPS_ALONG = tuple((0.05 * np.arange(-6, 7)).round(2).tolist())
"""Positions of the base that are tried along the table, m."""
STEPS_UP = (0.0, 0.1, 0.2, 0.3)
"""Heights of the base that are tried, m: those of a pedestal."""
RISE_COST = 2.0
"""Cost of a pedestal, in distances along the table."""
CLEARANCE = 0.02
"""Least distance of the foot from items and bins, m."""


@dataclass(frozen=True, slots=True)
class TargetPlace:
    """Place where the tool has to point down: name, and position (3,) of the tool in the world, m."""

    name: str
    position: Array


@dataclass(frozen=True, slots=True)
class BaseProposal:
    """Proposed base, its distance from the given one, m, and the name of each place it does not reach."""

    at: Vector3
    moved: Vector3
    missed: tuple[str, ...]
    count: int
    """Number of all places."""

    @property
    def sentence(self) -> str:
        """Sentence on the places that the tool reaches from there."""
        reached = f"{self.count - len(self.missed)} of {self.count} places of items and bins in {SCENE}"
        reached = reached if self.missed else f"items and bins of {SCENE}"
        return f"from there the tool, pointing down, reaches {reached}"


@cache
def scene() -> SceneDescription:
    return load_scene(SCENE)


@cache
def places() -> tuple[TargetPlace, ...]:
    """Return the places that the tool has to reach in the scene: over the items' area and over each bin."""
    found: list[TargetPlace] = []
    # What is missed most often comes first: it ends the search at a base early.
    for bin_ in scene().bins:
        over = bin_.pose.apply(np.array([0.0, 0.0, bin_.size[2] + HEIGHT_OVER_BIN]))
        inwards = -np.sign(over * (1.0, 1.0, 0.0)) * (
            *(np.array(bin_.size[:2]) / release_poses.CELLS_PER_SIDE),
            0.0,
        )
        found += [TargetPlace(str(bin_.id), place) for place in (over, over + inwards)]
    for spawn in scene().spawn:
        (left, front), (right, back) = spawn.rectangle
        for at in product(np.linspace(left, right, 3), np.linspace(front, back, 3), HEIGHTS_OVER_TABLE):
            found.append(TargetPlace("items", np.array(at)))
    return tuple(found)


def propose_base(
    model: RobotModel, tree: urdf_parser.UrdfTree, solids: Mapping[str, LinkGeometry]
) -> BaseProposal | None:
    """Propose the nearest base from which most places of the scene are reached.

    None: no other base reaches more of them than the model's.
    """
    reached = _Reach(model)
    foot = _foot(model, tree, solids)
    best, least = None, reached.missed((0.0, 0.0, 0.0), len(places()))
    moves = [(x, 0.0, z) for x in STEPS_ALONG for z in STEPS_UP if x or z]
    for moved in sorted(moves, key=lambda move: (abs(move[0]) + RISE_COST * move[2], move)):
        if not least:
            break
        if not _stands_free(foot + np.array(moved[:2])):
            continue
        missed = reached.missed(moved, len(least))
        if len(missed) < len(least):
            best, least = moved, missed
    if best is None:
        return None
    x, y, z = (round(a + b, 4) for a, b in zip(model.description.base_in_world.position, best, strict=True))
    return BaseProposal((x, y, z), best, tuple(least), len(places()))


class _Reach:
    """Places of the scene that the tool reaches, pointing down."""

    def __init__(self, model: RobotModel) -> None:
        self._ik, self._generator = InverseKinematics(model), np.random.default_rng(0)
        self._home = model.named("home")

    def missed(self, moved: Vector3, most: int) -> list[str]:
        """Return the names of places out of reach from a displaced base; it stops at `most` of them."""
        found: list[str] = []
        for place in places():
            x, y, z = (place.position - np.array(moved)).tolist()
            poses = (Pose.from_rpy((x, y, z), (np.pi, 0.0, yaw)) for yaw in YAWS)
            if not any(self._ik.solutions(pose, self._generator, self._home, 1) for pose in poses):
                found.append(place.name)
            if len(found) >= most:
                break
        return found


def _foot(model: RobotModel, tree: urdf_parser.UrdfTree, solids: Mapping[str, LinkGeometry]) -> Array:
    """Return points (n, 2) of the links on the table, seen from above, m in the world."""
    first = tree.joints[model.description.joints[0]]
    standing = tree.joints_to(first.parent)
    links = {first.child, first.parent, *(tree.joints[name].parent for name in standing)}
    poses = model.link_poses(model.named("home"), 0.0)
    points = [poses[link].apply(solids[link].points)[:, :2] for link in links if link in solids]
    return np.concatenate(points) if points else np.zeros((1, 2))


def _stands_free(foot: Array) -> bool:
    """Whether the foot's outline keeps away from items and bins."""
    low, high = foot.min(axis=0), foot.max(axis=0)
    taken = [(np.array(spawn.rectangle[0]), np.array(spawn.rectangle[1])) for spawn in scene().spawn]
    for bin_ in scene().bins:
        half, at = np.array(bin_.size[:2]) / 2, np.array(bin_.pose.position[:2])
        taken.append((at - half, at + half))
    return not any((low < b + CLEARANCE).all() and (high > a - CLEARANCE).all() for a, b in taken)
