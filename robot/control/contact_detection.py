"""Contact detection: a change of the force against its recent mean, above noise and drift."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from picktree.world import Vector3

DETECTION_WINDOW = 0.017
"""Time over which readings are averaged, s."""


@dataclass(frozen=True, slots=True)
class ForceSample:
    """External force (3,) on the hand at a time: s, world axes, N."""

    at: float
    force: Vector3


@dataclass(frozen=True, slots=True)
class DetectedContact:
    """Contact at the hand."""

    since: float
    """Time of the detection, s."""
    force: Vector3
    """Latest force on the hand beyond the baseline, N, world axes."""

    @property
    def size(self) -> float:
        return math.hypot(*self.force)

    @property
    def direction(self) -> Vector3:
        """Unit vector (3,) of the force on the hand, world axes."""
        x, y, z = self.force
        size = self.size or 1.0
        return (x / size, y / size, z / size)


class ContactDetector:
    """Detector of contacts at the hand from force readings. `contact` is the present one.

    A contact begins when the mean of the last 17 ms differs by more than `threshold` N from the baseline. It
    ends when it differs by less than `release` N: the hysteresis prevents flickering. The baseline is the
    mean over `memory` s that ended `delay` s ago, so that it follows drift and not the contact. During a
    contact it is constant.

    Noise of 0.15 N in each axis at 240 Hz makes the mean differ from the baseline by 0.08 N in each axis. A
    threshold of 1 N is 12 of these.
    """

    def __init__(
        self, threshold: float = 1.0, release: float = 0.5, memory: float = 0.1, delay: float = 0.02
    ) -> None:
        self._threshold = threshold
        self._release = min(release, threshold)
        self._memory = memory
        self._delay = delay
        self._readings: deque[ForceSample] = deque()
        self._baseline: Vector3 | None = None
        self._free = -math.inf
        """End of the last contact, s. Readings before it have no part in the baseline."""
        self.contact: DetectedContact | None = None

    def watch(self, readings: Iterable[ForceSample]) -> DetectedContact | None:
        """Add readings, oldest first, and return the contact after them."""
        for reading in readings:
            self._take(reading)
        return self.contact

    def _take(self, reading: ForceSample) -> None:
        kept = self._readings
        kept.append(reading)
        oldest = reading.at - self._memory - self._delay - DETECTION_WINDOW
        while kept[0].at < oldest - 1e-9:
            kept.popleft()
        lately = [r.force for r in kept if r.at > reading.at - DETECTION_WINDOW + 1e-9]
        if self.contact is None:
            until = reading.at - DETECTION_WINDOW - self._delay
            before = [r.force for r in kept if self._free <= r.at <= until + 1e-9]
            if before:
                self._baseline = _mean(before)
        if self._baseline is None:
            return
        fx, fy, fz = _mean(lately)
        bx, by, bz = self._baseline
        change = (fx - bx, fy - by, fz - bz)
        size = math.hypot(*change)
        if self.contact is not None:
            self.contact = DetectedContact(self.contact.since, change) if size >= self._release else None
            self._free = reading.at
        elif size > self._threshold:
            self.contact = DetectedContact(reading.at, change)


def _mean(forces: list[Vector3]) -> Vector3:
    n = len(forces)
    x, y, z = (sum(axis) / n for axis in zip(*forces, strict=True))
    return (x, y, z)
