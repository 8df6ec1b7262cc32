"""A timed joint trajectory, the value that planning hands to control."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .values import Array


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
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
        """Position and velocity (n,), (n,) at `time`, clipped; between samples see `polynomials`."""
        t = min(max(time, 0.0), self.duration)
        k = min(int(np.searchsorted(self.times, t, side="right")) - 1, len(self.times) - 2)
        if k < 0:
            return self.position[0].copy(), self.velocity[0].copy()
        h = float(self.times[k + 1] - self.times[k])
        p, v, a = self.position, self.velocity, self.acceleration
        c = quintic(p[k], v[k], a[k], p[k + 1], v[k + 1], a[k + 1], h)
        u = t - float(self.times[k])
        position = c[0] + u * (c[1] + u * (c[2] + u * (c[3] + u * (c[4] + u * c[5]))))
        velocity = c[1] + u * (2 * c[2] + u * (3 * c[3] + u * (4 * c[4] + u * 5 * c[5])))
        return position, velocity

    def polynomials(self) -> Array:
        """Return the coefficients (m - 1, 6, n) of the motion between samples, in powers of the time since
        the earlier one. The fifth degree keeps position, velocity and acceleration continuous."""
        p, v, a = self.position, self.velocity, self.acceleration
        if len(p) < 2:
            return np.concatenate([p[:, None], np.zeros((len(p), 5, p.shape[1]))], axis=1)
        h = np.diff(self.times)[:, None]
        return quintic(p[:-1], v[:-1], a[:-1], p[1:], v[1:], a[1:], h).transpose(1, 0, 2)


def quintic(p0: Array, v0: Array, a0: Array, p1: Array, v1: Array, a1: Array, span: Array | float) -> Array:
    """Coefficients (6, …) of the polynomial over [0, span] with these values and two derivatives at its
    ends. Arrays of one shape; `span` a number, or an array that goes with them."""
    h = span
    d = p1 - p0 - v0 * h - 0.5 * a0 * h**2
    e = (v1 - v0 - a0 * h) * h
    f = (a1 - a0) * h**2
    return np.array(
        [
            p0,
            v0,
            0.5 * a0,
            (10 * d - 4 * e + 0.5 * f) / h**3,
            (-15 * d + 7 * e - f) / h**4,
            (6 * d - 3 * e + 0.5 * f) / h**5,
        ]
    )
