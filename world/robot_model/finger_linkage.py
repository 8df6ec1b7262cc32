"""Finger kinematics of grippers with two sliders or with a linkage, computed from links and pads."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from picktree.world import Array, Box, Pose, corners

from .description import Follower, GripperDescription, Linkage
from .urdf_parser import UrdfTree


class SliderPair:
    """Fingers on two sliders, each of which covers half of the opening. Widths in m, joints in the gripper's
    order."""

    def __init__(self, gripper: GripperDescription) -> None:
        self._tip = gripper.tip

    def positions(self, width: float) -> tuple[float, ...]:
        """Return the positions of all joints at that opening."""
        return (width / 2, width / 2)

    def width(self, positions: Sequence[float]) -> float:
        """Return the opening that the driven joints measure, m."""
        return sum(positions)

    def rate(self, positions: Sequence[float], velocities: Sequence[float]) -> float:
        """Return the rate of the opening, m/s; positive while it grows."""
        return sum(velocities)

    def force(self, positions: Sequence[float], efforts: Sequence[float]) -> float:
        """Return the force with which each finger presses, N, from the efforts of the driven joints."""
        return sum(map(abs, efforts)) / 2

    def reach(self, width: float) -> float:
        """Return the reach of the tips beyond the TCP at that opening, m."""
        return self._tip


class LinkageFingers:
    """Fingers that one hinge moves; the other joints follow it. The tables are those of `Linkage`."""

    def __init__(self, linkage: Linkage) -> None:
        self._linkage = linkage
        self._widths, self._angles, self._tips = linkage.widths, linkage.angles, linkage.tips
        self._ratios = (1.0, *(f.multiplier for f in linkage.followers))
        rising = linkage.angles[-1] > linkage.angles[0]
        self._rising = linkage.angles if rising else linkage.angles[::-1]
        self._by_angle = linkage.widths if rising else linkage.widths[::-1]

    def angle(self, width: float) -> float:
        """Return the angle of the driven joint at that opening, rad."""
        return _between(self._widths, self._angles, width)

    def positions(self, width: float) -> tuple[float, ...]:
        angle = self.angle(width)
        return (angle, *(f.multiplier * angle + f.offset for f in self._linkage.followers))

    def width(self, positions: Sequence[float]) -> float:
        return _between(self._rising, self._by_angle, positions[0])

    def opening_per_rad(self, angle: float) -> float:
        """Return the derivative of the opening by the driven joint's angle, m/rad; negative where it
        closes."""
        step = abs(self._rising[-1] - self._rising[0]) / 64
        low, high = max(angle - step, self._rising[0]), min(angle + step, self._rising[-1])
        if low >= high:
            low, high = (
                (self._rising[0], self._rising[0] + step)
                if angle <= self._rising[0]
                else (self._rising[-1] - step, self._rising[-1])
            )
        return (self.width((high,)) - self.width((low,))) / (high - low)

    def rate(self, positions: Sequence[float], velocities: Sequence[float]) -> float:
        return self.opening_per_rad(positions[0]) * velocities[0]

    def force(self, positions: Sequence[float], efforts: Sequence[float]) -> float:
        # Virtual work: both fingers press while the opening changes, and all joints turn with the drive.
        torque = sum(by * effort for by, effort in zip(self._ratios, efforts, strict=True))
        return abs(torque / self.opening_per_rad(positions[0]))

    def reach(self, width: float) -> float:
        return _between(self._widths, self._tips, width)


def fingers_of(gripper: GripperDescription) -> SliderPair | LinkageFingers:
    """Return the finger kinematics of that gripper."""
    return SliderPair(gripper) if gripper.linkage is None else LinkageFingers(gripper.linkage)


def _between(rising: Sequence[float], values: Sequence[float], at: float) -> float:
    """Interpolate linearly; beyond the ends, return the value there."""
    if at <= rising[0]:
        return values[0]
    if at >= rising[-1]:
        return values[-1]
    k = bisect_right(rising, at)
    share = (at - rising[k - 1]) / (rising[k] - rising[k - 1])
    return values[k - 1] + share * (values[k] - values[k - 1])


SAMPLE_COUNT = 129
"""Number of angles of the driven joint for which the opening is computed; between them it is interpolated."""


class UnfitLinkage(ValueError):
    """Joints that do not open and close a gripper; the text is one sentence."""


@dataclass(frozen=True, slots=True)
class LinkageParts:
    """Joints, links and pads from which the opening is computed."""

    drive: str
    followers: tuple[Follower, ...]
    opened: float
    closed: float
    links: tuple[str, str]
    """Finger links; the first is on the TCP's +y side."""
    pads: tuple[tuple[Box, Pose], tuple[Box, Pose]]
    bodies: tuple[tuple[Box, Pose], ...]
    """Rest of the fingers, of the first and the second in turn; a tip that tapers reaches beyond its pad."""
    tcp_link: str
    tcp_in_link: Pose


def solve_linkage(skeleton: UrdfTree, parts: LinkageParts) -> Linkage:
    """Compute opening of the pads and reach of the fingers over the angle of the driven joint.

    The opening is the distance between the inner faces of the two pads along the TCP's y axis. Raises
    UnfitLinkage when it does not grow all the way from closed to opened.
    """
    knuckles = _knuckle(skeleton, parts, 0), _knuckle(skeleton, parts, 1)
    angles = np.linspace(parts.closed, parts.opened, SAMPLE_COUNT).tolist()
    widths: list[float] = []
    tips: list[float] = []
    for angle in angles:
        (near, *one), (far, *other) = (_finger_in_tcp(skeleton, parts, n, angle) for n in range(2))
        widths.append(float(near[:, 1].min() - far[:, 1].max()))
        tips.append(max(float(box[:, 2].max()) for box in (near, far, *one, *other)))
    if any(b <= a for a, b in pairwise(widths)):
        raise UnfitLinkage(
            f"the pads do not open all the way as {parts.drive!r} turns from {parts.closed:g} rad (closed) "
            f"to {parts.opened:g} rad (opened): {widths[0] * 1000:.1f} mm, halfway "
            f"{widths[SAMPLE_COUNT // 2] * 1000:.1f} mm, at the end {widths[-1] * 1000:.1f} mm apart"
        )
    if widths[-1] <= 0.0:
        raise UnfitLinkage("the pads overlap even when the gripper is opened")
    if widths[0] < 0.0:
        angles, widths, tips = _from_touching(angles, widths, tips)
    return Linkage(parts.drive, parts.followers, knuckles, tuple(angles), tuple(widths), tuple(tips))


def _knuckle(skeleton: UrdfTree, parts: LinkageParts, n: int) -> str:
    moved = {parts.drive, *(follower.joint for follower in parts.followers)}
    for name in skeleton.joints_to(parts.links[n]):
        if name in moved:
            return name
    raise UnfitLinkage(f"neither {parts.drive!r} nor a follower moves the finger {parts.links[n]!r}")


def _from_touching(
    angles: list[float], widths: list[float], tips: list[float]
) -> tuple[list[float], list[float], list[float]]:
    """Cut the tables off at the angle at which the pads touch."""
    first = next(k for k, width in enumerate(widths) if width >= 0.0)
    if widths[first] == 0.0:
        return angles[first:], widths[first:], tips[first:]
    share = -widths[first - 1] / (widths[first] - widths[first - 1])

    def touching(values: Sequence[float]) -> float:
        return values[first - 1] + share * (values[first] - values[first - 1])

    return (
        [touching(angles), *angles[first:]],
        [0.0, *widths[first:]],
        [touching(tips), *tips[first:]],
    )


def _finger_in_tcp(skeleton: UrdfTree, parts: LinkageParts, n: int, angle: float) -> list[Array]:
    """Return the corners (8, 3) of a finger's boxes in the TCP frame, m; those of its pad come first."""
    positions = {parts.drive: angle}
    positions |= {f.joint: f.multiplier * angle + f.offset for f in parts.followers}
    tcp = skeleton.pose(parts.tcp_link, positions) @ parts.tcp_in_link
    finger = tcp.inverse() @ skeleton.pose(parts.links[n], positions)
    return [(finger @ pose).apply(corners(box)) for box, pose in (parts.pads[n], *parts.bodies[n::2])]
