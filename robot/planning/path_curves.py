"""Path curves: joint-space paths as polynomial pieces with continuous first and second derivatives.

Their parameter is about the arc length in rad, so that pieces of different origin fit together. The pieces
are straight segments with rounded corners, splines through the dense waypoints of a Cartesian line, and
blends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from picktree.files import library_parts
from picktree.world import Array, quintic

if TYPE_CHECKING:
    from scipy.linalg.lapack import dgtsv
else:
    dgtsv = library_parts.library_part("scipy.linalg._flapack", "scipy.linalg.lapack.dgtsv")

POLYNOMIAL_DEGREE = 5
SAME_WAYPOINT_DISTANCE = 1e-6
"""Distance below which two waypoints are the same, rad."""
_FACTORS = [
    np.array([float(math.perm(power, order)) for power in range(order, POLYNOMIAL_DEGREE + 1)])
    for order in range(4)
]
"""Factors of the powers in the derivative of each order."""


def polyline_length(points: Array) -> float:
    """Return the length of a polyline (m, n), in the units of its points."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


@dataclass(frozen=True, slots=True, eq=False)
class JointCurve:
    """Piecewise polynomial: breaks (k + 1,) ascending from 0; coefficients (k, 6, n) of the powers of s -
    breaks[i]."""

    breaks: Array
    coefficients: Array

    @property
    def length(self) -> float:
        """Length of the parameter, about rad."""
        return float(self.breaks[-1])

    @property
    def straight(self) -> bool:
        return len(self.coefficients) == 1 and not self.coefficients[0, 2:].any()

    def at(self, s: Array | float, order: int = 0) -> Array:
        """Return the derivative of that order (m, n) at parameters (m,); (n,) for a single one."""
        value = self.derivatives(np.atleast_1d(np.asarray(s, dtype=np.float64)), order, order)[0]
        return value if np.ndim(s) else value[0]

    def derivatives(self, s: Array, last: int, first: int = 0) -> list[Array]:
        """Return the derivatives (m, n) of the orders from `first` to `last` at parameters (m,)."""
        piece = np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(self.breaks) - 2)
        powers = np.vander(s - self.breaks[piece], POLYNOMIAL_DEGREE + 1, increasing=True)
        c = self.coefficients[piece]
        return [
            np.einsum(
                "mp,mpn->mn", powers[:, : POLYNOMIAL_DEGREE + 1 - order] * _FACTORS[order], c[:, order:]
            )
            for order in range(first, last + 1)
        ]

    def piece(self, low: float, high: float) -> JointCurve:
        """Return the part between two parameters, its own parameter from 0."""
        inner = self.breaks[(self.breaks > low + 1e-12) & (self.breaks < high - 1e-12)]
        breaks: Array = np.concatenate([[low], inner, [high]])
        # `low` may be a break but for rounding: the middle of a piece identifies it.
        index = np.searchsorted(self.breaks, (breaks[:-1] + breaks[1:]) / 2, side="right") - 1
        coefficients = self.coefficients[index].copy()
        begin = float(low - self.breaks[index[0]])
        if begin > 0.0:
            coefficients[0] = _shifted(coefficients[0], begin)
        return JointCurve(breaks - low, coefficients)


def concatenate(curves: list[JointCurve]) -> JointCurve:
    """Concatenate curves: each must begin where the one before ends."""
    breaks, begin = [np.zeros(1)], 0.0
    for curve in curves:
        breaks.append(curve.breaks[1:] + begin)
        begin += curve.length
    return JointCurve(np.concatenate(breaks), np.concatenate([curve.coefficients for curve in curves]))


def rounded_polyline(points: Array, radius: float) -> JointCurve:
    """Round the corners of a polyline (m, n), m > 1, no two in a row the same.

    Each arc begins and ends at most `radius` rad from its corner; two arcs share a segment. On an arc the
    direction turns as 3x² - 2x³, so the curvature is 0 at both ends, and the arc stays within the triangle.
    """
    along = np.diff(points, axis=0)
    lengths: Array = np.linalg.norm(along, axis=1)
    units: Array = along / lengths[:, None]
    cuts = np.zeros(len(points))
    cuts[1:-1] = np.minimum(radius, 0.5 * np.minimum(lengths[:-1], lengths[1:]))
    spans: list[float] = []
    coefficients: list[Array] = []
    for k in range(len(along)):
        straight = float(lengths[k] - cuts[k] - cuts[k + 1])
        if straight > 1e-9:
            spans.append(straight)
            coefficients.append(_line(points[k] + units[k] * cuts[k], units[k]))
        if cuts[k + 1] > 0.0:
            spans.append(2.0 * float(cuts[k + 1]))
            coefficients.append(_arc(points[k + 1], units[k], units[k + 1], float(cuts[k + 1])))
    return JointCurve(np.concatenate([[0.0], np.cumsum(spans)]), np.array(coefficients))


def tridiagonal_solution(lower: Array, diagonal: Array, upper: Array, right: Array) -> Array:
    """Solve the system (n, n) with these three diagonals, (n - 1,), (n,), (n - 1,), for right sides (n, k).

    The matrix must not be singular; it is a spline's, whose diagonal dominates.
    """
    if len(diagonal) == 1:
        return right / diagonal[0]
    return dgtsv(lower, diagonal, upper, right)[3]


def spline_through(points: Array) -> JointCurve:
    """Return the natural cubic spline through points (m, n), m > 2, no two in a row the same."""
    along = np.diff(points, axis=0)
    h: Array = np.linalg.norm(along, axis=1)[:, None]
    slopes = along / h
    # Second derivatives: 0 at both ends, and such that the first ones agree between.
    diagonal, beside = 2.0 * (h[:-1, 0] + h[1:, 0]), h[1:-1, 0]
    bend = np.zeros_like(points)
    bend[1:-1] = tridiagonal_solution(beside, diagonal, beside, 6.0 * np.diff(slopes, axis=0))
    coefficients = np.zeros((len(h), POLYNOMIAL_DEGREE + 1, points.shape[1]))
    coefficients[:, 0] = points[:-1]
    coefficients[:, 1] = slopes - h * (2.0 * bend[:-1] + bend[1:]) / 6.0
    coefficients[:, 2] = bend[:-1] / 2.0
    coefficients[:, 3] = np.diff(bend, axis=0) / (6.0 * h)
    return JointCurve(np.concatenate([[0.0], np.cumsum(h)]), coefficients)


def blend_curves(before: JointCurve, after: JointCurve, radius: float) -> JointCurve:
    """Blend two curves, from `radius` before the end of one to `radius` after the beginning of the other.

    The blend is the polynomial of the fifth degree that agrees with both in its first and second derivatives.
    """
    span = 2.0 * radius
    a, b = before.length - radius, radius
    p0, v0, w0 = (value[0] for value in before.derivatives(np.array([a]), 2))
    p1, v1, w1 = (value[0] for value in after.derivatives(np.array([b]), 2))
    return JointCurve(np.array([0.0, span]), quintic(p0, v0, w0, p1, v1, w1, span)[None])


def distinct(path: Array) -> Array:
    """Remove repeated points (m, n); begin and end stay exactly the same."""
    kept = [path[0]]
    for point in path[1:]:
        if float(np.abs(point - kept[-1]).max()) > SAME_WAYPOINT_DISTANCE:
            kept.append(point)
    if len(kept) > 1:
        kept[-1] = path[-1]
    return np.array(kept)


def _line(start: Array, unit: Array) -> Array:
    coefficients = np.zeros((POLYNOMIAL_DEGREE + 1, len(start)))
    coefficients[0], coefficients[1] = start, unit
    return coefficients


def _arc(corner: Array, before: Array, after: Array, cut: float) -> Array:
    # The direction is before + (after - before) (3x² - 2x³) with x = u / (2 cut).
    coefficients = _line(corner - before * cut, before)
    turn, span = after - before, 2.0 * cut
    coefficients[3] = turn / span**2
    coefficients[4] = -turn / (2.0 * span**3)
    return coefficients


def _shifted(coefficients: Array, by: float) -> Array:
    """Return the polynomial in u - by instead of u (Taylor)."""
    shifted = coefficients.copy()
    for low in range(POLYNOMIAL_DEGREE):
        for k in range(POLYNOMIAL_DEGREE - 1, low - 1, -1):
            shifted[k] += by * shifted[k + 1]
    return shifted
