"""Ways in the plane that a pushed object can follow: arcs, each beginning in the direction of the last."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...world.planar_geometry import Planar, wrapped

STRAIGHT = 1e-6
"""Curvature below which an arc is a line, 1/m."""


@dataclass(frozen=True, slots=True)
class Arcs:
    """From `start` on along its x axis: lengths, m, and curvatures, 1/m, positive to the left."""

    start: Planar
    pieces: tuple[tuple[float, float], ...]

    @property
    def length(self) -> float:
        return sum(length for length, _ in self.pieces)

    @property
    def sharpest(self) -> float:
        """Greatest curvature either way, 1/m."""
        return max((abs(curvature) for length, curvature in self.pieces if length > 1e-6), default=0.0)

    @property
    def turning(self) -> float:
        """All turns added up, rad."""
        return sum(abs(length * curvature) for length, curvature in self.pieces)

    def at(self, way: float) -> Planar:
        """The frame after `way` m, its x axis along the way; before the start and after the end it goes
        straight on."""
        frame = self.start
        if way <= 0.0:
            return frame @ Planar(way, 0.0)
        for length, curvature in self.pieces:
            frame = frame @ _along(min(way, length), curvature)
            way -= length
            if way <= 0.0:
                return frame
        return frame @ Planar(way, 0.0)

    def curvature(self, way: float) -> float:
        """1/m, to the left positive."""
        if way < 0.0:
            return 0.0
        for length, curvature in self.pieces:
            if way < length:
                return curvature
            way -= length
        return 0.0


def _along(way: float, curvature: float) -> Planar:
    if abs(curvature) < STRAIGHT:
        return Planar(way, 0.0, 0.0)
    turn = way * curvature
    return Planar(math.sin(turn) / curvature, (1.0 - math.cos(turn)) / curvature, turn)


def straight(start: Planar, length: float) -> Arcs:
    return Arcs(start, ((length, 0.0),))


def arc_to(start: Planar, x: float, y: float) -> Arcs | None:
    """The one arc that ends in a point; None when that lies abreast or behind."""
    there = start.inverse() @ Planar(x, y)
    off = math.hypot(there.x, there.y)
    if there.x <= 0.0 or off < 1e-9:
        return None
    curvature = 2.0 * there.y / off**2
    if abs(curvature) < STRAIGHT:
        return straight(start, off)
    return Arcs(start, ((2.0 * math.atan2(there.y, there.x) / curvature, curvature),))


def biarc(start: Planar, end: Planar) -> Arcs | None:
    """Two arcs that lead to `end` in its direction, with equal chords of their control polygon (Bolton,
    "Biarc curves", Computer-Aided Design 7, 1975); None when the way would begin or end backwards."""
    goal = start.inverse() @ Planar(end.x, end.y, end.yaw)
    v = np.array([goal.x, goal.y])
    t1, t2 = np.array([1.0, 0.0]), np.array([math.cos(goal.yaw), math.sin(goal.yaw)])
    both = float(v @ (t1 + t2))
    denominator = 2.0 * (1.0 - float(t1 @ t2))
    square = float(v @ v)
    if square < 1e-12 or both <= 0.0:
        return None
    if denominator < 1e-12:
        d = square / (2.0 * both)
    else:
        d = (-both + math.sqrt(both**2 + denominator * square)) / denominator
    if d <= 0.0:
        return None
    joint = (v + d * (t1 - t2)) / 2.0
    first = arc_to(start, *(start @ Planar(float(joint[0]), float(joint[1]))).apply(np.zeros((1, 2)))[0])
    if first is None:
        return None
    second = arc_to(first.at(first.length), end.x, end.y)
    if second is None:
        return None
    whole = Arcs(start, (*first.pieces, *second.pieces))
    return whole if abs(wrapped(whole.at(whole.length).yaw - end.yaw)) < 1e-6 else None


def cut(way: Arcs, length: float) -> Arcs:
    """The first `length` m of a way."""
    left, pieces = length, list[tuple[float, float]]()
    for piece, curvature in way.pieces:
        if left <= 0.0:
            break
        pieces.append((min(piece, left), curvature))
        left -= piece
    return Arcs(way.start, tuple(pieces))
