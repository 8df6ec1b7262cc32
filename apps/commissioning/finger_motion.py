"""Motion of the two fingers of a gripper with its driven joint, and the points of its links."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NoReturn

import numpy as np

from ...world.robot_model.urdf_faults import MOVING
from ...world.robot_model.urdf_tree import UrdfTree
from ...world.values import Array
from .joint_groups import HandGroup
from .link_geometry import LinkGeometry, UnsuitableUrdf

MAX_SLIDE = 1.0
"""Greatest range of a finger that slides, m; more looks like millimetres."""
MIN_PARALLEL_COSINE = np.cos(np.radians(2.0))
"""Least cosine between the axes of two hinges that count as parallel."""
MIN_SNAP_COSINE = np.cos(np.radians(8.0))
"""Least cosine to an axis of the hand's frame from which a direction is set to that axis."""
MIN_OUT_SNAP_COSINE = np.cos(np.radians(20.0))
"""The same for the direction out of the hand, which the middle of a one-sided palm leaves uncertain."""
MIN_ROLL_COSINE = np.cos(np.radians(45.0))
"""Least cosine between the direction out of a one-sided hand and the arm's last axis from which the direction
is set to that axis."""
MAX_ACROSS_COSINE = np.sin(np.radians(8.0))
"""Greatest cosine between the hinges of fingers and the closing direction that count as square."""


class FingerMotion:
    """Forward kinematics of one hand over the position of its driven joint. Methods raise UnsuitableUrdf when
    the hand has no two such fingers."""

    def __init__(
        self, source: str, skeleton: UrdfTree, solids: Mapping[str, LinkGeometry], hand: HandGroup
    ) -> None:
        self._source, self._skeleton, self._solids, self._hand = source, skeleton, solids, hand
        self.drive, self.ratios = self._coupling()
        self.links = self._finger_links()

    def _coupling(self) -> tuple[str, dict[str, tuple[float, float]]]:
        """Return the driven joint, and factor and offset with which every other joint follows it."""
        drive = self._hand.drives[0]
        ratios = {drive: (1.0, 0.0)}
        waiting = [*self._hand.followers]
        while waiting:
            # A follower may stand in the file before the one that it follows.
            late = [name for name in waiting if not self._follow(ratios, name)]
            if len(late) == len(waiting):
                break
            waiting = late
        for name in self._hand.drives[1:]:
            # Two joints without a coupling are moved alike, each over the whole of its range.
            low, high = self.limits(drive)
            own_low, own_high = self.limits(name)
            if abs(own_high) + abs(own_low) == 0.0 or high == low:
                continue
            straight = abs(own_low - low) + abs(own_high - high) <= abs(own_low + high) + abs(own_high + low)
            by = 1.0 if straight else -1.0
            ratios[name] = (by, 0.0)
        return drive, ratios

    def _follow(self, ratios: dict[str, tuple[float, float]], name: str) -> bool:
        """Enter a follower's factor and offset. Return whether the joint that it follows is known."""
        mimic = self._skeleton.joints[name].mimic
        if mimic is None or mimic.joint not in ratios:
            return False
        by, offset = ratios[mimic.joint]
        ratios[name] = (mimic.multiplier * by, mimic.multiplier * offset + mimic.offset)
        return True

    def limits(self, name: str) -> tuple[float, float]:
        """Return a joint's limits, rad or m. Raises UnsuitableUrdf when it has none."""
        joint = self._skeleton.joints[name]
        if not joint.limited or joint.lower is None or joint.upper is None or joint.lower >= joint.upper:
            self.refuse(
                f"the finger joint {name!r} without limits",
                "how far it moves",
                '<limit lower="0" upper="0.04" effort="20" velocity="0.2"/> inside of that <joint>',
            )
        if joint.type == "prismatic" and joint.upper - joint.lower > MAX_SLIDE:
            self.refuse(
                f"the finger joint {name!r} that slides from {joint.lower:g} to {joint.upper:g} m",
                "limits of a finger, in metres: are these millimetres?",
                f'<limit lower="{joint.lower / 1000:g}" upper="{joint.upper / 1000:g}" …/> in that <joint>',
            )
        return joint.lower, joint.upper

    def positions(self, drive: float) -> dict[str, float]:
        """Return the positions of all finger joints with the driven joint at `drive`, rad or m."""
        return {name: by * drive + offset for name, (by, offset) in self.ratios.items()}

    def _finger_links(self) -> tuple[str, str]:
        """Return the two links furthest out that have geometry, on different branches of the hand."""
        joints = self._skeleton.joints
        moved = [
            link
            for link in self._skeleton.links
            if link in self._solids
            and any(
                name in self.ratios
                for name in self._skeleton.joints_to(link)[len(self._skeleton.joints_to(self._hand.palm)) :]
            )
        ]
        inner = {joints[name].parent for name in self.ratios}
        leaves = [
            link for link in moved if not any(link in (p, *self._fixed_behind(p)) for p in inner)
        ] or moved
        if len(leaves) < 2:
            self.refuse(
                f"{len(leaves)} finger with geometry on {self._hand.palm!r}", "two fingers that both move"
            )
        start, end = self.limits(self.drive)
        middle = self.positions((start + end) / 2)
        palm = self._skeleton.pose(self._hand.palm, {})

        def out(link: str) -> float:
            pose = palm.inverse() @ self._skeleton.pose(link, middle)
            return float(np.linalg.norm(pose.apply(self._solids[link].points), axis=1).max())

        ranked = sorted(leaves, key=lambda link: (-round(out(link), 4), leaves.index(link)))
        one = ranked[0]
        branch = self.branch(one)
        other = next((link for link in ranked[1:] if self.branch(link) != branch), None)
        if other is None:
            self.refuse("fingers that all hang on one joint", "two fingers that both move")
        return (one, other) if leaves.index(one) < leaves.index(other) else (other, one)

    def _fixed_behind(self, link: str) -> tuple[str, ...]:
        return tuple(
            j.parent for j in self._skeleton.joints.values() if j.child == link and j.type not in MOVING
        )

    def branch(self, link: str) -> str:
        """Return the first finger joint on the way to a link."""
        return next(name for name in self._skeleton.joints_to(link) if name in self.ratios)

    def points(self, link: str, drive: float) -> Array:
        """Return a link's points (n, 3) in the palm's frame, m, with the driven joint at `drive`."""
        palm = self._skeleton.pose(self._hand.palm, {})
        pose = palm.inverse() @ self._skeleton.pose(link, self.positions(drive))
        return pose.apply(self._solids[link].points)

    def finger(self, n: int, drive: float, axes: Array) -> Array:
        """Return the points (k, 3) of finger n in `axes` (3, 3), directions in the palm's frame by
        columns."""
        return self.points(self.links[n], drive) @ axes

    def gap_at(self, drive: float) -> float:
        """Return the distance between the two fingers' mean points, m."""
        one, other = (self.points(link, drive) for link in self.links)
        return float(np.linalg.norm(one.mean(axis=0) - other.mean(axis=0)))

    def hinge(self) -> Array | None:
        """Return the direction (3,) of all hinges that move the fingers, in the palm's frame.

        None when a finger only slides, or when the hinges are not parallel.
        """
        palm = self._skeleton.pose(self._hand.palm, {}).rotation()
        found: list[Array] = []
        for link in self.links:
            names = [name for name in self._skeleton.joints_to(link) if name in self.ratios]
            joints = [self._skeleton.joints[name] for name in names]
            axes = [
                palm.T @ self._skeleton.pose(joint.child, {}).rotation() @ np.array(joint.axis)
                for joint in joints
                if joint.type != "prismatic"
            ]
            if not axes:
                return None
            found += [axis / float(np.linalg.norm(axis)) for axis in axes]
        parallel = all(abs(float(axis @ found[0])) > MIN_PARALLEL_COSINE for axis in found)
        return found[0] if parallel else None

    def axes(self, opened: float, behind: tuple[str, ...]) -> Array:
        """Return axes (3, 3) with columns x, y, z: z out of the hand, y along the closing towards the first
        finger.

        `behind`: links of the hand that are fixed to its palm.
        """
        one, other = (self.points(link, opened) for link in self.links)
        closing = _snapped(_unit(one.mean(axis=0) - other.mean(axis=0)))
        # The tips are furthest from the palm, which the middle of leaning fingers is not.
        out = (one.mean(axis=0) + other.mean(axis=0)) / 2
        out = out - self.back(behind)
        out = out - closing * float(out @ closing)
        # Hinged fingers move across their hinges, however one-sided the palm is.
        hinge = self.hinge()
        if hinge is not None and abs(float(hinge @ closing)) < MAX_ACROSS_COSINE:
            across = _unit(hinge - closing * float(hinge @ closing))
            out = out - across * float(out @ across)
        if float(np.linalg.norm(out)) < 1e-4:
            out = np.array([0.0, 0.0, 1.0]) - closing * float(closing[2])
        out = _snapped(_unit(out), MIN_OUT_SNAP_COSINE)
        roll = self._roll_axis()
        if roll is not None and float(np.abs(out).max()) < 1.0:
            along = float(out @ roll)
            if abs(along) > MIN_ROLL_COSINE and abs(float(roll @ closing)) < MAX_ACROSS_COSINE:
                out = _snapped(np.sign(along) * roll)
        out = _unit(out - closing * float(out @ closing))
        return np.column_stack([np.cross(closing, out), closing, out])

    def _roll_axis(self) -> Array | None:
        """Return the direction (3,) of the arm's last axis in the palm's frame; None: it slides."""
        palm = self._skeleton.pose(self._hand.palm, {}).rotation()
        for name in reversed(self._skeleton.joints_to(self._hand.palm)):
            joint = self._skeleton.joints[name]
            if joint.type in MOVING:
                turns = joint.type != "prismatic"
                axis = palm.T @ self._skeleton.pose(joint.child, {}).rotation() @ np.array(joint.axis)
                return _unit(axis) if turns else None
        return None

    def static(self, link: str) -> Array:
        """Return a static link's points (n, 3) in the palm's frame, m."""
        palm = self._skeleton.pose(self._hand.palm, {})
        return (palm.inverse() @ self._skeleton.pose(link, {})).apply(self._solids[link].points)

    def back(self, behind: tuple[str, ...]) -> Array:
        """Return a point (3,) behind the fingers in the palm's frame, m.

        It is the middle of the links `behind` them, else of the links that carry the palm, else the last
        joint of the arm.
        """
        known, joints = self._solids, self._skeleton.joints
        above: list[str] = []
        for name in reversed(self._skeleton.joints_to(self._hand.palm)):
            above.append(joints[name].parent)
            if joints[name].type in MOVING:
                above.insert(0, joints[name].child)
                break
        for links in (behind, above[:-1]):
            if points := [self.static(link) for link in links if link in known]:
                return np.concatenate(points).mean(axis=0)
        if not above:
            return np.zeros(3)
        palm = self._skeleton.pose(self._hand.palm, {})
        return np.array((palm.inverse() @ self._skeleton.pose(above[0], {})).position)

    def refuse(self, found: str, missing: str, helps: str = "") -> NoReturn:
        """Raise UnsuitableUrdf; without `helps` it proposes another gripper."""
        link = self._hand.palm
        helps = helps or f"another gripper: --gripper URDF:LINK --mount {link}"
        raise UnsuitableUrdf(self._source, found, missing, helps)


def _unit(vector: Array) -> Array:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)


def _snapped(direction: Array, least: float = MIN_SNAP_COSINE) -> Array:
    """Return the nearest axis of the frame when the direction is close to it, else the direction."""
    k = int(np.abs(direction).argmax())
    if abs(float(direction[k])) < least:
        return direction
    axis = np.zeros(3)
    axis[k] = np.sign(direction[k])
    return axis
