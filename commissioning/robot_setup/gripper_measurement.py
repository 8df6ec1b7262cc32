"""A gripper, measured: which way it closes, where its pads are, how far it opens, how much room it takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull

from ...robots.urdf_tree import MOVING, UrdfTree
from ...world.shapes import Box
from ...world.values import Array, Pose, Vector3
from .joint_groups import HandGroup
from .link_points import LinkGeometry
from .urdf_source import UnsuitableUrdf

STEPS = 9
"""Openings at which the fingers are looked at."""
FACING = np.cos(np.radians(20.0))
"""How squarely a face looks at the other finger to belong to the pad."""
FLAT = 0.5e-3
"""From the middle of what counts as one level face to its highest and lowest corner, m."""
ENOUGH = 0.15
"""Share of all that faces the other finger, from which on a level of it is the pad."""
FROM_TIP = 0.010
"""Of the TCP from the finger tips where they reach furthest, at most, m."""
BEHIND = 0.006
"""Of the TCP behind the tips where they reach least, m."""
THICKEST, THINNEST = 0.020, 0.004
"""Of the box that stands for a pad, behind its face, m."""
SLABS = 3
"""Boxes along the hand, which mostly tapers."""
NARROWEST = 0.010
"""Opening from which on it is a gripper, m."""
STRONGEST, FASTEST = 60.0, 0.15
"""Grip force, N, and speed of a finger, m/s, beyond which the URDF's numbers are not believed."""
SNAP = np.cos(np.radians(8.0))
"""Directions nearer than that to an axis of the hand's frame are that axis."""


@dataclass(frozen=True, slots=True)
class MeasuredGripper:
    """All that a robot file says of a gripper; boxes with their poses, in the frames that the file wants."""

    sliders: tuple[str, str] | None
    """Two sliders whose positions add up to the opening; None: a linkage."""
    drive: str
    opened: float
    closed: float
    followers: Mapping[str, float]
    offsets: Mapping[str, float]
    links: tuple[str, str]
    tcp_in_palm: Pose
    tcp_comment: str
    tip: float
    palm: float
    max_width: float
    max_force: float
    force_comment: str
    speed: float
    pads: tuple[tuple[Box, Pose], tuple[Box, Pose]]
    hand: tuple[tuple[Box, Pose], ...]
    finger: tuple[Box, Pose]


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """The level face of a finger: its corners in the TCP's axes and where it is."""

    y: float
    low: Array
    high: Array


class GripperMeter:
    """Measures one hand. All raises are Unsuitable."""

    def __init__(
        self,
        source: str,
        skeleton: UrdfTree,
        solids: Mapping[str, LinkGeometry],
        hand: HandGroup,
        behind: tuple[str, ...],
    ) -> None:
        """`behind`: the links of the hand that are fixed to its palm."""
        self._source, self._skeleton, self._solids, self._hand = source, skeleton, solids, hand
        self._behind = behind
        self.drive, self.ratios = self._coupling()
        self.links = self._finger_links()

    def measure(self) -> MeasuredGripper:
        lower, upper = self._range()
        first, last = self._gap_at(lower), self._gap_at(upper)
        opened, closed = (upper, lower) if last > first else (lower, upper)
        axes = self._axes(opened)
        near, far = self._levels(closed, axes)
        if near.y - far.y < -0.5 * abs(self._levels(opened, axes)[0].y):
            closed = self._touching(opened, closed, axes)
        positions = np.linspace(closed, opened, STEPS).tolist()
        widths = [max(near.y - far.y, 0.0) for near, far in (self._levels(p, axes) for p in positions)]
        if widths[-1] - widths[0] < NARROWEST:
            self._refuse(
                f"fingers that open {1000 * (widths[-1] - widths[0]):.1f} mm while {self.drive!r} moves",
                f"two fingers that open {1000 * NARROWEST:.0f} mm at least",
            )
        tips = [max(float(self._finger(n, p, axes)[:, 2].max()) for n in range(2)) for p in positions]
        near, far = self._levels(opened, axes)
        tcp, comment = self._tcp(axes, max(tips), max(tips) - min(tips), near, far)
        shift = np.array(tcp.position) @ axes
        return self._described(axes, tcp, comment, shift, positions, widths, tips)

    # ---- what moves how

    def _coupling(self) -> tuple[str, dict[str, tuple[float, float]]]:
        """The joint that drives, and for every other one by how much and from where it follows."""
        joints = self._skeleton.joints
        drive = self._hand.drives[0]
        ratios = {drive: (1.0, 0.0)}
        for name in self._hand.followers:
            mimic = joints[name].mimic
            if mimic is not None and mimic.joint in ratios:
                by, offset = ratios[mimic.joint]
                ratios[name] = (mimic.multiplier * by, mimic.multiplier * offset + mimic.offset)
        for name in self._hand.drives[1:]:
            # Two joints that nobody couples: they are moved alike, each over the whole of its range.
            low, high = self._limits(drive)
            own_low, own_high = self._limits(name)
            if abs(own_high) + abs(own_low) == 0.0 or high == low:
                continue
            straight = abs(own_low - low) + abs(own_high - high) <= abs(own_low + high) + abs(own_high + low)
            by = 1.0 if straight else -1.0
            ratios[name] = (by, 0.0)
        return drive, ratios

    def _limits(self, name: str) -> tuple[float, float]:
        joint = self._skeleton.joints[name]
        if not joint.limited or joint.lower is None or joint.upper is None or joint.lower >= joint.upper:
            self._refuse(
                f"the finger joint {name!r} without limits",
                "how far it moves",
                '<limit lower="0" upper="0.04" effort="20" velocity="0.2"/> inside of that <joint>',
            )
        return joint.lower, joint.upper  # pyright: ignore[reportReturnType]

    def _range(self) -> tuple[float, float]:
        """Of the drive, so that no follower leaves its limits by more than a trifle."""
        lower, upper = self._limits(self.drive)
        return lower, upper

    def _positions(self, drive: float) -> dict[str, float]:
        return {name: by * drive + offset for name, (by, offset) in self.ratios.items()}

    def _finger_links(self) -> tuple[str, str]:
        """The two links furthest out that carry geometry: on different branches of the hand."""
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
            self._refuse(
                f"{len(leaves)} finger with geometry on {self._hand.palm!r}", "two fingers that both move"
            )
        start, end = self._limits(self.drive)
        middle = self._positions((start + end) / 2)
        palm = self._skeleton.pose(self._hand.palm, {})

        def out(link: str) -> float:
            pose = palm.inverse() @ self._skeleton.pose(link, middle)
            return float(np.linalg.norm(pose.apply(self._solids[link].points), axis=1).max())

        ranked = sorted(leaves, key=lambda link: (-round(out(link), 4), leaves.index(link)))
        one = ranked[0]
        branch = self._branch(one)
        other = next((link for link in ranked[1:] if self._branch(link) != branch), None)
        if other is None:
            self._refuse("fingers that all hang on one joint", "two fingers that both move")
        assert other is not None
        return (one, other) if leaves.index(one) < leaves.index(other) else (other, one)

    def _fixed_behind(self, link: str) -> tuple[str, ...]:
        return tuple(
            j.parent for j in self._skeleton.joints.values() if j.child == link and j.type not in MOVING
        )

    def _branch(self, link: str) -> str:
        return next(name for name in self._skeleton.joints_to(link) if name in self.ratios)

    # ---- geometry, in the axes of the palm (columns of `axes`: x, y, z of the TCP)

    def _points(self, link: str, drive: float) -> Array:
        palm = self._skeleton.pose(self._hand.palm, {})
        pose = palm.inverse() @ self._skeleton.pose(link, self._positions(drive))
        return pose.apply(self._solids[link].points)

    def _finger(self, n: int, drive: float, axes: Array) -> Array:
        return self._points(self.links[n], drive) @ axes

    def _gap_at(self, drive: float) -> float:
        one, other = (self._points(link, drive) for link in self.links)
        return float(np.linalg.norm(one.mean(axis=0) - other.mean(axis=0)))

    def _axes(self, opened: float) -> Array:
        """(3, 3), columns x, y, z: z out of the hand, y along the closing towards the first finger."""
        one, other = (self._points(link, opened) for link in self.links)
        closing = _snapped(_unit(one.mean(axis=0) - other.mean(axis=0)))
        # The tips are what is furthest from the palm, not the middle of fingers that lean.
        out = (one.mean(axis=0) + other.mean(axis=0)) / 2
        static = [self._solids[link].points for link in self._behind if link in self._solids]
        if static:
            palm = self._skeleton.pose(self._hand.palm, {})
            points = np.concatenate(
                [
                    (palm.inverse() @ self._skeleton.pose(link, {})).apply(self._solids[link].points)
                    for link in self._behind
                    if link in self._solids
                ]
            )
            out = out - points.mean(axis=0)
        out = out - closing * float(out @ closing)
        if float(np.linalg.norm(out)) < 1e-4:
            out = np.array([0.0, 0.0, 1.0]) - closing * float(closing[2])
        out = _snapped(_unit(out))
        out = _unit(out - closing * float(out @ closing))
        return np.column_stack([np.cross(closing, out), closing, out])

    def _levels(self, drive: float, axes: Array) -> tuple[_Level, _Level]:
        """The faces with which the fingers look at each other."""
        return self._level(0, drive, axes, 1.0), self._level(1, drive, axes, -1.0)

    def _level(self, n: int, drive: float, axes: Array, side: float) -> _Level:
        points = self._finger(n, drive, axes)
        triangles = self._solids[self.links[n]].triangles
        corners = points[triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1) / 2
        inner = (-side * normals[:, 1] > 2 * areas * FACING) & (areas > 0)
        # Only the outer half of the finger grips.
        top = float(points[:, 2].max())
        inner &= corners[:, :, 2].mean(axis=1) > top - 0.6 * float(np.ptp(points[:, 2]))
        depth = side * corners[:, :, 1].mean(axis=1)
        if not inner.any():
            y = float((side * points[:, 1]).min())
            near = points[side * points[:, 1] < y + FLAT]
            return _Level(side * y, near.min(axis=0), near.max(axis=0))
        whole = float(areas[inner].sum())
        each = side * corners[:, :, 1]
        levels: set[int] = {round(float(d) / FLAT) for d in depth[inner]}
        for start in (FLAT * level for level in sorted(levels)):
            chosen = inner & (np.abs(each - start) <= FLAT).all(axis=1)
            if float(areas[chosen].sum()) >= ENOUGH * whole:
                face = corners[chosen].reshape(-1, 3)
                return _Level(side * start, face.min(axis=0), face.max(axis=0))
        face = corners[inner].reshape(-1, 3)
        return _Level(side * float((side * face[:, 1]).min()), face.min(axis=0), face.max(axis=0))

    def _touching(self, opened: float, closed: float, axes: Array) -> float:
        """Where the pads meet, between two positions of the drive."""
        for _ in range(40):
            middle = (opened + closed) / 2
            near, far = self._levels(middle, axes)
            if near.y - far.y > 0.0:
                opened = middle
            else:
                closed = middle
        return opened

    def _tcp(
        self, axes: Array, furthest: float, spread: float, near: _Level, far: _Level
    ) -> tuple[Pose, str]:
        """In the palm's frame; a frame of the URDF that lies between the pads is taken as it is."""
        low = (
            max(float(near.low[2]), float(far.low[2]))
            + furthest
            - max(float(near.high[2]), float(far.high[2]))
        )
        # Fingers on knuckles draw their tips in as they open: the TCP stays behind the tips even then.
        back = max(FROM_TIP, spread + BEHIND)
        z = furthest - min(back, max((furthest - low) / 2, 0.002))
        x = (float(near.low[0] + near.high[0]) + float(far.low[0] + far.high[0])) / 4
        y = (near.y + far.y) / 2
        comment = "Between the pads, measured on the meshes"
        palm = self._skeleton.pose(self._hand.palm, {})
        for link in self._skeleton.below(self._hand.palm):
            if link in self._solids or any(n in self.ratios for n in self._skeleton.joints_to(link)):
                continue
            at = np.array((palm.inverse() @ self._skeleton.pose(link, {})).position) @ axes
            if abs(at[0] - x) < 0.005 and abs(at[1] - y) < 0.005 and low <= at[2] <= furthest - 0.002:
                z, comment = float(at[2]), f"Where the URDF has its frame {link!r}, between the pads"
                break
        position = axes @ np.array([x, y, z])
        return Pose.from_rotation(_clean(position), axes), comment

    # ---- putting it down

    def _described(
        self,
        axes: Array,
        tcp: Pose,
        comment: str,
        shift: Array,
        positions: list[float],
        widths: list[float],
        tips: list[float],
    ) -> MeasuredGripper:
        closed, opened = positions[0], positions[-1]
        reach = max(tips) - float(shift[2])
        sliders = self._sliders(closed, opened, widths)
        per_move = abs(widths[-1] - widths[0]) / abs(opened - closed) / 2
        force, told = self._force(per_move)
        joint = self._skeleton.joints[self.drive]
        speed = min((joint.velocity or 0.1) * per_move, FASTEST)
        static = [self._static(link) @ axes - shift for link in self._behind if link in self._solids]
        palm_top = max((float(points[:, 2].max()) for points in static), default=-0.03)
        others = [
            link
            for link in self._skeleton.below(self._hand.palm)
            if link in self._solids and link not in (*self._behind, *self.links)
        ]
        swept = [self._points(link, p) @ axes - shift for link in others for p in positions]
        fingers = [self._finger(0, p, axes) - shift for p in positions]
        return MeasuredGripper(
            sliders=sliders,
            drive=self.drive,
            opened=opened,
            closed=closed,
            followers={n: by for n, (by, _) in self.ratios.items() if n != self.drive},
            offsets={n: offset for n, (_, offset) in self.ratios.items() if offset != 0.0},
            links=self.links,
            tcp_in_palm=tcp,
            tcp_comment=comment,
            tip=max(reach, 0.0),
            palm=max(-palm_top, 0.005),
            max_width=widths[-1],
            max_force=force,
            force_comment=told,
            speed=max(speed, 0.01),
            pads=(self._pad(0, axes, opened, 1.0), self._pad(1, axes, opened, -1.0)),
            hand=_hand_boxes(static, swept, palm_top, widths[-1]),
            finger=_finger_box(fingers, widths),
        )

    def _static(self, link: str) -> Array:
        palm = self._skeleton.pose(self._hand.palm, {})
        return (palm.inverse() @ self._skeleton.pose(link, {})).apply(self._solids[link].points)

    def _sliders(self, closed: float, opened: float, widths: list[float]) -> tuple[str, str] | None:
        """The two joints when the opening is the sum of their positions, which is the simpler form."""
        names = tuple(self.ratios)
        if len(names) != 2 or any(self._skeleton.joints[n].type != "prismatic" for n in names):
            return None
        by, offset = self.ratios[names[1]]
        simple = by == 1.0 and offset == 0.0 and abs(closed) < 1e-6 and opened > 0.0
        fits = abs(widths[-1] - 2 * opened) < 1.5e-3 and widths[0] < 1.5e-3
        if not (simple and fits):
            return None
        return names if self._branch(self.links[0]) == names[0] else (names[1], names[0])

    def _force(self, per_move: float) -> tuple[float, str]:
        effort = self._skeleton.joints[self.drive].effort or 0.0
        if effort <= 0.0:
            return 20.0, "The URDF gives none: a guess"
        force = effort / per_move if per_move > 0 else effort
        if self._skeleton.joints[self.drive].type == "prismatic":
            force = effort
        if force > STRONGEST:
            return STRONGEST, f"The URDF's effort would be {force:.0f} N: not believed, see the data sheet"
        return force, "From the URDF's effort"

    def _pad(self, n: int, axes: Array, opened: float, side: float) -> tuple[Box, Pose]:
        """In the frame of the finger's link, with edges along the axes of the TCP."""
        level = self._level(n, opened, axes, side)
        points = self._finger(n, opened, axes)
        beside = points[
            (points[:, 2] >= level.low[2] - FLAT)
            & (points[:, 0] >= level.low[0] - FLAT)
            & (points[:, 0] <= level.high[0] + FLAT)
        ]
        behind = float((side * beside[:, 1]).max()) - side * level.y if len(beside) else THINNEST
        depth = min(max(behind, THINNEST), THICKEST)
        # Up to the tip: a rounded edge there belongs to what can press.
        top = (
            float(points[:, 2].max())
            if float(points[:, 2].max()) - level.high[2] < 0.003
            else float(level.high[2])
        )
        low, high = level.low, level.high
        size = (max(float(high[0] - low[0]), 0.004), depth, max(top - float(low[2]), 0.004))
        centre = np.array([(low[0] + high[0]) / 2, level.y + side * depth / 2, (low[2] + top) / 2])
        palm = self._skeleton.pose(self._hand.palm, {})
        finger = palm.inverse() @ self._skeleton.pose(self.links[n], self._positions(opened))
        placed = Pose.from_rotation(_clean(axes @ centre), axes)
        return Box(size), finger.inverse() @ placed

    def _refuse(self, found: str, missing: str, helps: str = "") -> None:
        link = self._hand.palm
        helps = helps or f"another gripper: --gripper URDF:LINK --mount {link}"
        raise UnsuitableUrdf(self._source, found, missing, helps)


def _hand_boxes(
    static: list[Array], swept: list[Array], top: float, widest: float
) -> tuple[tuple[Box, Pose], ...]:
    """Boxes around the hand behind its palm, and around what sticks out beside the open fingers."""
    boxes: list[tuple[Box, Pose]] = []
    below = [points[points[:, 2] <= top] for points in swept]
    points = (
        np.concatenate([*static, *(b for b in below if len(b))]) if static or any(map(len, below)) else None
    )
    if points is not None and len(points) >= 4:
        bottom = float(points[:, 2].min())
        edges = _hull_edges(points)
        count = SLABS if top - bottom > 0.03 else 1
        bounds = np.linspace(top, bottom, count + 1)
        for high, low in pairwise(bounds.tolist()):
            inside = _between(edges, low, high)
            if len(inside):
                boxes.append(_box(inside.min(axis=0), inside.max(axis=0), low, high))
    for side in (1.0, -1.0):
        beside = [p[(p[:, 2] > top) & (side * p[:, 1] >= widest / 2)] for p in swept]
        beside = [p for p in beside if len(p)]
        if beside:
            whole = np.concatenate(beside)
            low, high = whole.min(axis=0), whole.max(axis=0)
            boxes.append(_box(low, high, float(low[2]), float(high[2])))
    if not boxes:
        boxes.append((Box((0.04, 0.04, 0.02)), Pose((0.0, 0.0, top - 0.01))))
    return tuple(boxes)


def _finger_box(fingers: list[Array], widths: list[float]) -> tuple[Box, Pose]:
    """Around the +y finger at every opening, moved back by half of it."""
    moved = np.concatenate(
        [points - [0.0, width / 2, 0.0] for points, width in zip(fingers, widths, strict=True)]
    )
    low, high = moved.min(axis=0), moved.max(axis=0)
    low[1] = max(low[1], 0.0)
    return _box(low, high, float(low[2]), float(high[2]))


def _box(low: Array, high: Array, bottom: float, top: float) -> tuple[Box, Pose]:
    size = (float(high[0] - low[0]), float(high[1] - low[1]), top - bottom)
    centre = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2, (bottom + top) / 2)
    return Box((max(size[0], 1e-3), max(size[1], 1e-3), max(size[2], 1e-3))), Pose(centre)


def _hull_edges(points: Array) -> Array:
    """(m, 2, 3): the edges of the convex hull."""
    try:
        hull = ConvexHull(points)
    except (RuntimeError, ValueError):
        return np.stack([points, points], axis=1)
    pairs = np.concatenate([hull.simplices[:, [0, 1]], hull.simplices[:, [1, 2]], hull.simplices[:, [2, 0]]])
    return points[pairs]


def _between(edges: Array, low: float, high: float) -> Array:
    """Points (k, 3) of the edges' parts between two heights."""
    found: list[Array] = []
    for z in (low, high):
        a, b = edges[:, 0], edges[:, 1]
        across = (a[:, 2] - z) * (b[:, 2] - z) < 0
        share = (z - a[across, 2]) / (b[across, 2] - a[across, 2])
        found.append(a[across] + share[:, None] * (b[across] - a[across]))
    ends = edges.reshape(-1, 3)
    found.append(ends[(ends[:, 2] >= low - 1e-9) & (ends[:, 2] <= high + 1e-9)])
    return np.concatenate(found)


def _unit(vector: Array) -> Array:
    return vector / max(float(np.linalg.norm(vector)), 1e-12)


def _snapped(direction: Array) -> Array:
    """An axis of the frame, when the direction is nearly that."""
    k = int(np.abs(direction).argmax())
    if abs(float(direction[k])) < SNAP:
        return direction
    axis = np.zeros(3)
    axis[k] = np.sign(direction[k])
    return axis


def _clean(position: Array) -> Vector3:
    x, y, z = (0.0 if abs(c) < 1e-4 else float(c) for c in position)
    return (x, y, z)
