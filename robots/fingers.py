"""From the opening of a gripper to its joints and back: two sliders, or a linkage with one motor."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Protocol

from .description import GripperDescription, Linkage


class Fingers(Protocol):
    """How the joints of a gripper open and close it. Widths in m, angles in rad, joints in their order."""

    def positions(self, width: float) -> tuple[float, ...]:
        """Of all joints at that opening."""
        ...

    def width(self, positions: Sequence[float]) -> float:
        """The opening, by what the driven joints measure."""
        ...

    def rate(self, positions: Sequence[float], velocities: Sequence[float]) -> float:
        """How fast the opening grows, m/s."""
        ...

    def force(self, positions: Sequence[float], efforts: Sequence[float]) -> float:
        """With which each finger presses, N, by the efforts of the driven joints."""
        ...

    def reach(self, width: float) -> float:
        """How far the tips reach beyond the TCP at that opening, m."""
        ...


class SliderPair:
    """Two sliders, each of which goes half of the way."""

    def __init__(self, gripper: GripperDescription) -> None:
        self._tip = gripper.tip

    def positions(self, width: float) -> tuple[float, ...]:
        return (width / 2, width / 2)

    def width(self, positions: Sequence[float]) -> float:
        return sum(positions)

    def rate(self, positions: Sequence[float], velocities: Sequence[float]) -> float:
        return sum(velocities)

    def force(self, positions: Sequence[float], efforts: Sequence[float]) -> float:
        return sum(map(abs, efforts)) / 2

    def reach(self, width: float) -> float:
        return self._tip


class LinkedFingers:
    """Fingers that one hinge moves; the others follow it. See `Linkage` for the table that it reads."""

    def __init__(self, linkage: Linkage) -> None:
        self._linkage = linkage
        self._widths, self._angles, self._tips = linkage.widths, linkage.angles, linkage.tips
        self._ratios = (1.0, *(f.multiplier for f in linkage.followers))
        rising = linkage.angles[-1] > linkage.angles[0]
        self._rising = linkage.angles if rising else linkage.angles[::-1]
        self._by_angle = linkage.widths if rising else linkage.widths[::-1]

    def angle(self, width: float) -> float:
        """Of the driven joint."""
        return _between(self._widths, self._angles, width)

    def positions(self, width: float) -> tuple[float, ...]:
        angle = self.angle(width)
        return (angle, *(f.multiplier * angle + f.offset for f in self._linkage.followers))

    def width(self, positions: Sequence[float]) -> float:
        return _between(self._rising, self._by_angle, positions[0])

    def opening_per_rad(self, angle: float) -> float:
        """How much the opening grows with the driven joint, m/rad; negative where it closes."""
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


def fingers_of(gripper: GripperDescription) -> Fingers:
    """How that gripper opens and closes."""
    return SliderPair(gripper) if gripper.linkage is None else LinkedFingers(gripper.linkage)


def _between(rising: Sequence[float], values: Sequence[float], at: float) -> float:
    """Linear interpolation; beyond the ends, the values there."""
    if at <= rising[0]:
        return values[0]
    if at >= rising[-1]:
        return values[-1]
    k = bisect_right(rising, at)
    share = (at - rising[k - 1]) / (rising[k] - rising[k - 1])
    return values[k - 1] + share * (values[k] - values[k - 1])
