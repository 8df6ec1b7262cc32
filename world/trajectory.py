"""A timed joint trajectory, the value that planning hands to control."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .values import Array


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Samples of a joint motion on an even or uneven time grid, starting and ending at rest.

    times (m,) s, ascending from 0; position, velocity, acceleration (m, n) in rad, rad/s, rad/s².
    """

    times: Array
    position: Array
    velocity: Array
    acceleration: Array

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.times[-1])

    @property
    def start(self) -> Array:
        return self.position[0]

    @property
    def end(self) -> Array:
        return self.position[-1]

    def sample(self, time: float) -> tuple[Array, Array]:
        """Position and velocity (n,), (n,) at `time`, clipped; cubic Hermite between samples."""
        t = min(max(time, 0.0), self.duration)
        k = min(int(np.searchsorted(self.times, t, side="right")) - 1, len(self.times) - 2)
        if k < 0:
            return self.position[0].copy(), self.velocity[0].copy()
        h = float(self.times[k + 1] - self.times[k])
        s = (t - float(self.times[k])) / h
        p0, p1 = self.position[k], self.position[k + 1]
        m0, m1 = self.velocity[k] * h, self.velocity[k + 1] * h
        position = (
            (2 * s**3 - 3 * s**2 + 1) * p0
            + (s**3 - 2 * s**2 + s) * m0
            + (3 * s**2 - 2 * s**3) * p1
            + (s**3 - s**2) * m1
        )
        velocity = (
            (6 * s**2 - 6 * s) * p0
            + (3 * s**2 - 4 * s + 1) * m0
            + (6 * s - 6 * s**2) * p1
            + (3 * s**2 - 2 * s) * m1
        ) / h
        return position, velocity
