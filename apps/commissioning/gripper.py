"""Gripper measurement on a URDF's meshes: motion of the fingers, closing direction, pads, opening, TCP and
collision boxes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from picktree.world import Array, Box, Pose, Vector3
from picktree.world.robot_model import MOVING, GripperSettings, LinkageFile, urdf_parser

from .joints import HandGroup
from .link_geometry import LinkGeometry, UnsuitableUrdf, finger_box, hand_boxes, inner_box

MAX_SLIDE = 1.0
"""Greatest range of a sliding finger, m; a greater one is probably in millimetres."""
MIN_PARALLEL_COSINE = np.cos(np.radians(2.0))
"""Least cosine between the axes of two hinges that count as parallel."""
MIN_SNAP_COSINE = np.cos(np.radians(8.0))
"""Least cosine to an axis of the hand's frame from which a direction is set to that axis."""
MIN_OUT_SNAP_COSINE = np.cos(np.radians(20.0))
"""Least such cosine for the direction out of the hand, which is uncertain for a one-sided palm."""
MIN_ROLL_COSINE = np.cos(np.radians(45.0))
"""Least cosine between the direction out of a one-sided hand and the arm's last axis from which the direction
is set to that axis."""
MAX_ACROSS_COSINE = np.sin(np.radians(8.0))
"""Greatest cosine between the hinges of fingers and the closing direction that count as square."""


class FingerMotion:
    """Forward kinematics of one hand over the position of its driven joint. Methods raise UnsuitableUrdf when
    the hand has no two such fingers."""

    def __init__(
        self, source: str, skeleton: urdf_parser.UrdfTree, solids: Mapping[str, LinkGeometry], hand: HandGroup
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
            ratios[name] = (1.0 if straight else -1.0, 0.0)
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
                'write <limit lower="0" upper="0.04" effort="20" velocity="0.2"/> inside of that <joint>',
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
        to_palm = len(self._skeleton.joints_to(self._hand.palm))
        moved = [
            link
            for link in self._skeleton.links
            if link in self._solids
            and any(name in self.ratios for name in self._skeleton.joints_to(link)[to_palm:])
        ]
        inner = {joints[name].parent for name in self.ratios}
        inner |= {j.parent for j in joints.values() if j.child in inner and j.type not in MOVING}
        leaves = [link for link in moved if link not in inner] or moved
        if len(leaves) < 2:
            self.refuse(
                f"{len(leaves)} finger with geometry on {self._hand.palm!r}", "two fingers that both move"
            )
        start, end = self.limits(self.drive)
        middle = self.positions((start + end) / 2)

        def out(link: str) -> float:
            points = self.pose(link, middle).apply(self._solids[link].points)
            return float(np.linalg.norm(points, axis=1).max())

        ranked = sorted(leaves, key=lambda link: (-round(out(link), 4), leaves.index(link)))
        one = ranked[0]
        branch = self.branch(one)
        other = next((link for link in ranked[1:] if self.branch(link) != branch), None)
        if other is None:
            self.refuse("fingers that all hang on one joint", "two fingers that both move")
        return (one, other) if leaves.index(one) < leaves.index(other) else (other, one)

    def branch(self, link: str) -> str:
        """Return the first finger joint on the way to a link."""
        return next(name for name in self._skeleton.joints_to(link) if name in self.ratios)

    def pose(self, link: str, positions: Mapping[str, float]) -> Pose:
        """Return a link's pose in the palm's frame."""
        return self._skeleton.pose(self._hand.palm, {}).inverse() @ self._skeleton.pose(link, positions)

    def points(self, link: str, drive: float) -> Array:
        """Return a link's points (n, 3) in the palm's frame, m, with the driven joint at `drive`."""
        return self.pose(link, self.positions(drive)).apply(self._solids[link].points)

    def finger(self, n: int, drive: float, axes: Array) -> Array:
        """Return the points (k, 3) of finger n in `axes` (3, 3), columns in the palm's frame."""
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
        return self.pose(link, {}).apply(self._solids[link].points)

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
        return np.array(self.pose(above[0], {}).position)

    def refuse(self, found: str, missing: str, helps: str = "") -> NoReturn:
        """Raise UnsuitableUrdf; without `helps` it proposes another gripper."""
        link = self._hand.palm
        helps = helps or f"mount another gripper: --gripper URDF:LINK --mount {link}"
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


MEASURED_OPENINGS = 9
"""Number of openings at which the fingers are measured."""
MIN_FACING_COSINE = np.cos(np.radians(20.0))
"""Least cosine between a pad face's normal and the direction to the other finger."""
MAX_LEVEL_DEVIATION = 0.5e-3
"""Greatest distance of a level face's corners from its middle plane, m."""
MIN_PAD_AREA_SHARE = 0.15
"""Least area of the pad's level, as a share of all area that faces the other finger."""
SAME_LEVEL_SHARE = 0.9
"""Share of the largest area of level faces from which others are as good."""
MIN_TCP_TIP_DISTANCE = 0.002
"""Least distance of a frame of the URDF behind the pads' ends where they reach least, m."""
MAX_TCP_TIP_DISTANCE = 0.010
"""Greatest distance of the TCP from the pads' ends where they reach furthest, m."""
TCP_TIP_CLEARANCE = 0.006
"""Distance of the TCP behind the pads' ends where they reach least, m."""
MAX_ROUNDED_TIP = 0.003
"""Greatest length of a tip beyond its level face that still belongs to the pad, m."""
MAX_PAD_THICKNESS, MIN_PAD_THICKNESS = 0.020, 0.004
"""Greatest and least thickness of a pad's box behind its face, m."""
MIN_OPENING = 0.010
"""Least opening of a gripper, m."""
MAX_GRIP_FORCE, MAX_FINGER_SPEED = 60.0, 0.15
"""Greatest plausible grip force, N, and finger speed, m/s; higher values of the URDF are replaced."""
MIN_GRIP_FORCE, DEFAULT_GRIP_FORCE = 2.0, 20.0
"""Least plausible grip force, N, and the one that replaces a lower one."""
KNUCKLE_CLEARANCE = 0.002
"""Least distance between held item and knuckles, m: pads yield, and items tilt."""
FINGER_BODY_SETBACK = 0.003
"""Distance of the rest of a finger behind the face of its pad, m: the pads alone grip what reaches deep."""
MIN_FINGER_BODY_SIZE = 0.004
"""Least size of a part of the rest of a finger, m; less is left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredGripper(GripperSettings):
    """Measured gripper: all that a robot file needs, with boxes and poses in the frames of that file."""

    sliders: tuple[str, str] | None
    """Two sliding joints whose positions add up to the opening; None: a linkage."""
    linkage: LinkageFile
    """Motion of the fingers by one of their joints."""
    links: tuple[str, str]
    tcp_in_palm: Pose
    tcp_comment: str
    min_width: float
    max_width: float
    force_comment: str
    force_guessed: bool
    finger: tuple[Box, Pose]


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """Level face of a finger: its position along the closing axis and its corners, in the TCP's axes."""

    y: float
    low: Array
    high: Array


class GripperMeter:
    """Gripper meter: measures one hand. Raises UnsuitableUrdf when it is no gripper with two fingers."""

    def __init__(
        self,
        source: str,
        skeleton: urdf_parser.UrdfTree,
        solids: Mapping[str, LinkGeometry],
        hand: HandGroup,
        behind: tuple[str, ...],
    ) -> None:
        """`behind`: links of the hand that are fixed to its palm."""
        self._skeleton, self._solids, self._hand = skeleton, solids, hand
        self._behind = behind
        self._motion = FingerMotion(source, skeleton, solids, hand)
        self.drive, self.ratios, self.links = self._motion.drive, self._motion.ratios, self._motion.links

    def measure(self) -> MeasuredGripper:
        """Measure the gripper at several openings between the drive's limits."""
        lower, upper = self._motion.limits(self.drive)
        first, last = self._motion.gap_at(lower), self._motion.gap_at(upper)
        opened, closed = (upper, lower) if last > first else (lower, upper)
        axes = self._motion.axes(opened, self._behind)
        near, far = self._levels(closed, axes)
        if near.y - far.y < -0.5 * abs(self._levels(opened, axes)[0].y):
            closed = self._touching(opened, closed, axes)
        positions = np.linspace(closed, opened, MEASURED_OPENINGS).tolist()
        widths = [max(near.y - far.y, 0.0) for near, far in (self._levels(p, axes) for p in positions)]
        if widths[-1] - widths[0] < MIN_OPENING:
            self._motion.refuse(
                f"fingers that open {1000 * (widths[-1] - widths[0]):.1f} mm while {self.drive!r} moves",
                f"two fingers that open {1000 * MIN_OPENING:.0f} mm at least",
            )
        tips = [max(float(self._motion.finger(n, p, axes)[:, 2].max()) for n in range(2)) for p in positions]
        flat = self._flattest(positions, axes)
        near, far = self._levels(positions[flat], axes)
        ends = [self._top(n, positions[flat], axes, level) for n, level in enumerate((near, far))]
        short = tips[flat] - max(ends)
        pads = [self._pad_corners(n, axes, positions[flat], side) for n, side in enumerate((1.0, -1.0))]
        middle = float(np.mean(pads, axis=(0, 1))[0])
        tcp, comment = self._tcp(axes, middle, max(tips) - short, max(tips) - min(tips), near, far)
        shift = np.array(tcp.position) @ axes
        return self._described(axes, tcp, comment, shift, positions, widths, tips, positions[flat])

    def _flattest(self, positions: list[float], axes: Array) -> int:
        """Return the index of the position with the largest level faces; of equal ones, the most open.

        Fingers on hinges may turn as they close. Pads are what grips: the faces that then look at each other.
        """

        def area(drive: float) -> float:
            sizes = [level.high - level.low for level in self._levels(drive, axes)]
            return min(float(size[0] * size[2]) for size in sizes)

        areas = [area(drive) for drive in positions]
        return max(k for k, each in enumerate(areas) if each >= SAME_LEVEL_SHARE * max(areas))

    def _levels(self, drive: float, axes: Array) -> tuple[_Level, _Level]:
        """Return the two faces with which the fingers face each other."""
        return self._level(0, drive, axes, 1.0), self._level(1, drive, axes, -1.0)

    def _level(self, n: int, drive: float, axes: Array, side: float) -> _Level:
        points = self._motion.finger(n, drive, axes)
        triangles = self._solids[self.links[n]].triangles
        corners = points[triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1) / 2
        inner = (-side * normals[:, 1] > 2 * areas * MIN_FACING_COSINE) & (areas > 0)
        # Only the outer half of the finger grips.
        top = float(points[:, 2].max())
        inner &= corners[:, :, 2].mean(axis=1) > top - 0.6 * float(np.ptp(points[:, 2]))
        depth = side * corners[:, :, 1].mean(axis=1)
        if not inner.any():
            y = float((side * points[:, 1]).min())
            near = points[side * points[:, 1] < y + MAX_LEVEL_DEVIATION]
            return _Level(side * y, near.min(axis=0), near.max(axis=0))
        whole = float(areas[inner].sum())
        each = side * corners[:, :, 1]
        levels: set[int] = {round(float(d) / MAX_LEVEL_DEVIATION) for d in depth[inner]}
        for start in (MAX_LEVEL_DEVIATION * level for level in sorted(levels)):
            chosen = inner & (np.abs(each - start) <= MAX_LEVEL_DEVIATION).all(axis=1)
            if float(areas[chosen].sum()) >= MIN_PAD_AREA_SHARE * whole:
                face = corners[chosen].reshape(-1, 3)
                return _Level(side * start, face.min(axis=0), face.max(axis=0))
        face = corners[inner].reshape(-1, 3)
        return _Level(side * float((side * face[:, 1]).min()), face.min(axis=0), face.max(axis=0))

    def _touching(self, opened: float, closed: float, axes: Array) -> float:
        """Return the position of the drive at which the pads meet, between two positions."""
        for _ in range(40):
            middle = (opened + closed) / 2
            near, far = self._levels(middle, axes)
            if near.y - far.y > 0.0:
                opened = middle
            else:
                closed = middle
        return opened

    def _tcp(
        self, axes: Array, x: float, furthest: float, spread: float, near: _Level, far: _Level
    ) -> tuple[Pose, str]:
        """Return the TCP in the palm's frame, with a comment.

        `x` is the pads' middle, `furthest` their end at the furthest reach, `spread` their retraction, m. A
        frame of the URDF is used when it stays between the pads at each opening: a tool frame at the tips of
        closed fingers on hinges is in front of them once they open.
        """
        low = (
            max(float(near.low[2]), float(far.low[2]))
            + furthest
            - max(float(near.high[2]), float(far.high[2]))
        )
        # Fingers on linkages retract their tips as they open: the TCP stays behind the tips even
        # then.
        back = max(MAX_TCP_TIP_DISTANCE, spread + TCP_TIP_CLEARANCE)
        z = furthest - min(back, max((furthest - low) / 2, 0.002))
        y = (near.y + far.y) / 2
        comment, beyond = "Between the pads, measured on the meshes", ""
        for link in self._skeleton.below(self._hand.palm):
            if link in self._solids or any(n in self.ratios for n in self._skeleton.joints_to(link)):
                continue
            at = np.array(self._motion.pose(link, {}).position) @ axes
            aligned = abs(at[0] - x) < 0.005 and abs(at[1] - y) < 0.005 and link != self._hand.palm
            if aligned and low <= at[2] <= furthest - spread - MIN_TCP_TIP_DISTANCE:
                z, comment = float(at[2]), f"At the URDF's frame {link!r}, which lies between the pads"
                break
            if aligned and low <= at[2] and not beyond:
                beyond = (
                    f"; the URDF's frame {link!r} lies {1000 * (at[2] - z):.0f} mm further out, at the tips"
                )
        else:
            comment += beyond
        position = axes @ np.array([x, y, z])
        return Pose.from_rotation(_clean(position), axes), comment

    def _described(
        self,
        axes: Array,
        tcp: Pose,
        comment: str,
        shift: Array,
        positions: list[float],
        widths: list[float],
        tips: list[float],
        flat: float,
    ) -> MeasuredGripper:
        """Return the gripper; its pads and the rest of its fingers are measured with the drive at `flat`."""
        closed, opened = positions[0], positions[-1]
        reach = max(tips) - float(shift[2])
        sliders = self._sliders(closed, opened, widths)
        per_move = abs(widths[-1] - widths[0]) / abs(opened - closed) / 2
        force, force_comment, guessed = self._force(per_move)
        joint = self._skeleton.joints[self.drive]
        speed = min((joint.velocity or 0.1) * per_move, MAX_FINGER_SPEED)
        static = [self._motion.static(link) @ axes - shift for link in self._behind if link in self._solids]
        palm_top = max((float(points[:, 2].max()) for points in static), default=-0.03)
        pads = (self._pad(0, axes, flat, 1.0), self._pad(1, axes, flat, -1.0))
        others = [
            link
            for link in self._skeleton.below(self._hand.palm)
            if link in self._solids and link not in (*self._behind, *self.links)
        ]
        swept = [self._motion.points(link, p) @ axes - shift for link in others for p in positions]
        inside = [
            self._reach_inside(link, p, axes, shift, (pads[0][0].size[0] / 2, width / 2))
            for link in others
            for p, width in zip(positions, widths, strict=True)
        ]
        fingers = [self._motion.finger(0, p, axes) - shift for p in positions]
        return MeasuredGripper(
            sliders=sliders,
            linkage=LinkageFile(
                drive=self.drive,
                opened=opened,
                closed=closed,
                followers={n: by for n, (by, _) in self.ratios.items() if n != self.drive},
                offsets={n: offset for n, (_, offset) in self.ratios.items() if offset != 0.0},
            ),
            links=self.links,
            tcp_in_palm=tcp,
            tcp_comment=comment,
            tip=max(reach, 0.0),
            palm=max(-max([palm_top, *inside]), 0.005),
            min_width=widths[0],
            max_width=widths[-1],
            max_force=force,
            force_comment=force_comment,
            force_guessed=guessed,
            speed=max(speed, 0.01),
            pads=pads,
            hand=hand_boxes(static, swept, palm_top, widths[-1]),
            finger=finger_box(fingers, widths),
            finger_bodies=self._bodies(axes, flat),
        )

    def _reach_inside(
        self, link: str, drive: float, axes: Array, shift: Array, half: tuple[float, float]
    ) -> float:
        """Return the distance by which a link behind the pads reaches forward (+z of the TCP) between them,
        m.

        -inf: nowhere. `half`: half of the pads' depth and of the opening, m. A held item meets the knuckles
        of a linkage before the palm.
        """
        points = self._solids[link].along_edges(self._motion.points(link, drive) @ axes - shift)
        between = (np.abs(points[:, 0]) < half[0]) & (np.abs(points[:, 1]) < half[1] + KNUCKLE_CLEARANCE)
        return float(points[between, 2].max()) if between.any() else -math.inf

    def _sliders(self, closed: float, opened: float, widths: list[float]) -> tuple[str, str] | None:
        """Return the two sliding joints when the opening is the sum of their positions; else None."""
        names = tuple(self.ratios)
        if len(names) != 2 or any(self._skeleton.joints[n].type != "prismatic" for n in names):
            return None
        by, offset = self.ratios[names[1]]
        simple = by == 1.0 and offset == 0.0 and abs(closed) < 1e-6 and opened > 0.0
        fits = abs(widths[-1] - 2 * opened) < 1.5e-3 and widths[0] < 1.5e-3
        if not (simple and fits):
            return None
        return names if self._motion.branch(self.links[0]) == names[0] else (names[1], names[0])

    def _force(self, per_move: float) -> tuple[float, str, bool]:
        """Return the grip force, N, the origin of the value, and whether it is a guess."""
        effort = self._skeleton.joints[self.drive].effort or 0.0
        force = effort / per_move if per_move > 0 else effort
        if self._skeleton.joints[self.drive].type == "prismatic":
            force = effort
        if force < MIN_GRIP_FORCE:
            comment = f"The URDF's effort means only {force:g} N; this force is a guess: see the data sheet"
            return DEFAULT_GRIP_FORCE, comment, True
        if force > MAX_GRIP_FORCE:
            comment = f"The URDF's effort means {force:.0f} N, which is implausible: see the data sheet"
            return MAX_GRIP_FORCE, comment, True
        return force, "From the URDF's effort", False

    def _pad(self, n: int, axes: Array, drive: float, side: float) -> tuple[Box, Pose]:
        """Return a pad's box in the frame of its finger link, with edges along the axes of the TCP."""
        return self._box(n, axes, drive, *self._pad_corners(n, axes, drive, side))

    def _pad_corners(self, n: int, axes: Array, drive: float, side: float) -> tuple[Array, Array]:
        level = self._level(n, drive, axes, side)
        points = self._motion.finger(n, drive, axes)
        beside = points[
            (points[:, 2] >= level.low[2] - MAX_LEVEL_DEVIATION)
            & (points[:, 0] >= level.low[0] - MAX_LEVEL_DEVIATION)
            & (points[:, 0] <= level.high[0] + MAX_LEVEL_DEVIATION)
        ]
        behind = float((side * beside[:, 1]).max()) - side * level.y if len(beside) else MIN_PAD_THICKNESS
        depth = min(max(behind, MIN_PAD_THICKNESS), MAX_PAD_THICKNESS)
        middle, bottom = float(level.low[0] + level.high[0]) / 2, float(level.low[2])
        half = max(float(level.high[0] - level.low[0]), MIN_FINGER_BODY_SIZE) / 2
        top = max(self._top(n, drive, axes, level), bottom + MIN_FINGER_BODY_SIZE)
        near, far = sorted((level.y, level.y + side * depth))
        low, high = np.array([middle - half, near, bottom]), np.array([middle + half, far, top])
        return inner_box(points, low, high, side, MIN_PAD_THICKNESS)

    def _top(self, n: int, drive: float, axes: Array, level: _Level) -> float:
        """Return the position of the end of a finger's pad along the axis out of the hand, m.

        A pad extends to a tip that is near: a rounded edge there can press, too. It ends before a tip that
        tapers away from the other finger.
        """
        tip, end = float(self._motion.finger(n, drive, axes)[:, 2].max()), float(level.high[2])
        return tip if tip - end < MAX_ROUNDED_TIP else end

    def _bodies(self, axes: Array, drive: float) -> tuple[tuple[Box, Pose], ...]:
        """Return boxes of each finger between pad and palm and beyond the pad, in its link's frame.

        Those of the first and the second finger in turn; none where all is pad.
        """
        found: list[tuple[Box, Pose]] = []
        for part in (self._behind_pad, self._tapered_tip):
            bodies = [part(n, axes, drive, side) for n, side in enumerate((1.0, -1.0))]
            if len(kept := [each for each in bodies if each is not None]) == len(bodies):
                found += kept
        return tuple(found)

    def _behind_pad(self, n: int, axes: Array, drive: float, side: float) -> tuple[Box, Pose] | None:
        """Return the box of a finger between pad and palm; None: no geometry there."""
        level = self._level(n, drive, axes, side)
        points = self._solids[self.links[n]].along_edges(self._motion.finger(n, drive, axes))
        behind = side * points[:, 1] >= side * level.y + FINGER_BODY_SETBACK
        bottom = self._pad_corners(n, axes, drive, side)[0][2]
        return self._body(n, axes, drive, points[behind & (points[:, 2] <= bottom)])

    def _tapered_tip(self, n: int, axes: Array, drive: float, side: float) -> tuple[Box, Pose] | None:
        """Return the box of a tip beyond the pad, which tapers away from the other finger; None: there is
        none.

        Its face is where the tip is half way out.
        """
        level = self._level(n, drive, axes, side)
        points = self._solids[self.links[n]].along_edges(self._motion.finger(n, drive, axes))
        end, tip = self._top(n, drive, axes, level), float(points[:, 2].max())
        if tip - end < MIN_FINGER_BODY_SIZE:
            return None
        half_way_out = points[points[:, 2] >= (end + tip) / 2]
        face = max(float((side * half_way_out[:, 1]).min()), side * level.y)
        beyond = points[(points[:, 2] >= end) & (side * points[:, 1] >= face)]
        return self._body(n, axes, drive, beyond)

    def _body(self, n: int, axes: Array, drive: float, points: Array) -> tuple[Box, Pose] | None:
        """Return the box around points (m, 3) of a finger in its link's frame; None for less than a body."""
        if not len(points) or (np.ptp(points, axis=0) < MIN_FINGER_BODY_SIZE).any():
            return None
        low, high = points.min(axis=0), points.max(axis=0)
        finger = self._motion.finger(n, drive, axes)
        low, high = inner_box(finger, low, high, 1.0 - 2.0 * n, MIN_FINGER_BODY_SIZE)
        return self._box(n, axes, drive, low, high)

    def _box(self, n: int, axes: Array, drive: float, low: Array, high: Array) -> tuple[Box, Pose]:
        """Return the box between two corners (3,) in the TCP's axes, in the frame of a finger link."""
        size: Vector3 = tuple((high - low).tolist())
        finger = self._motion.pose(self.links[n], self._motion.positions(drive))
        centre = Pose.from_rotation(_clean(axes @ ((low + high) / 2)), axes)
        return Box(size), finger.inverse() @ centre


def _clean(position: Array) -> Vector3:
    x, y, z = (0.0 if abs(c) < 1e-4 else float(c) for c in position)
    return (x, y, z)
