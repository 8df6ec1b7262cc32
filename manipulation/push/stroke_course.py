"""The course of one stroke: up to the object, with it along a way, off it again; it feels what it does."""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import numpy as np

from ...control.cartesian.compliant_motion import CompliantMotion, ContactState
from ...world.planar_geometry import PlanarPose
from ...world.values import Array
from .push_arcs import ArcPath

Phase: TypeAlias = Literal["pushing", "settling", "leaving", "left"]

ACCELERATION = 0.4
"""Of the tool along its way, m/s²: far less than what friction takes from an object, so that it stays at the
tool when that brakes."""
TOUCHED, LOST = 0.12, 0.04
"""Force on the tool above which it touches, and below which it touches no more, N: 60 g on a table give 0.3
N, the sensor's noise over `MEMORY` is 0.03 N."""
MEMORY = 0.08
"""Time over which the force is averaged, s."""
LOST_WAY = 0.008
"""Way without a contact after which it counts as lost, m."""
SHORT, SLOW = 0.010, 0.025
"""A way that is shorter than this, m, is gone slowly, m/s, so that there is time to feel."""
GENTLE = 0.1
"""Braking before what rolls, m/s²."""
GAIN = 5.0
"""Rate at which the anchor makes up for what the spring gives way, 1/s."""
MOST = 0.006
"""By which the anchor is ahead at most, m."""
EXACT = 1.0e-4
"""The tool is where it should be, m; it is waited for so long at most, s."""
SETTLING = 0.6
AWAY = 0.006
"""Back from the object at the end, m."""


class PushMotion(CompliantMotion):
    """Carries the TCP so that its carrier (see `Side`) follows `way`, from `gap` m before its start on.

    It ends early when the force against the push exceeds `force` N, or when the contact is lost.
    """

    def __init__(
        self,
        way: ArcPath,
        tool: PlanarPose,
        gap: float,
        speed: float,
        force: float,
        hand_mass: float,
        *,
        rolls: bool = False,
    ) -> None:
        """`tool`: the TCP in the carrier. `hand_mass`: what the wrist feels the tool accelerate, kg.
        `rolls`: see `Side`."""
        super().__init__()
        self._path, self._tool, self._gap = way, tool, gap
        if rolls or way.length < SHORT:
            speed = min(speed, SLOW)
        self._rolls, self._braking = rolls, GENTLE if rolls else ACCELERATION
        self._speed, self._most = speed, speed
        self._force, self._mass = force, hand_mass
        self._way, self._rate = -gap, 0.0
        self._pushed = 0.0
        self._without = 0.0
        self._since = 0.0
        self._back = 0.0
        self._offset = np.zeros(2)
        self.phase: Phase = "pushing"
        self.touched_at: float | None = None
        """Way of the carrier at which the object was felt first, m; negative: before it was expected."""
        self.blocked = False
        self.lost = False
        self.in_contact = False
        """Whether the object was felt to the end."""
        self.reached = -gap
        """Way of the carrier, m."""
        self.carrier: PlanarPose = way.at(-gap)
        """By the encoders, when the push ended."""

    def start(self, position: Array, rotation: Array) -> None:
        super().start(position, rotation)
        begin = self._path.at(self._way)
        self._yaw = begin.yaw
        tcp = begin @ self._tool
        self._offset: Array = position[:2] - (tcp.x, tcp.y)

    @property
    def direction(self) -> Array:
        x, y = self._path.at(self._way).direction
        away = -1.0 if self.phase == "leaving" else 1.0
        return np.array([away * x, away * y, 0.0]) if self.phase in ("pushing", "leaving") else np.zeros(3)

    def limit(self, speed: float) -> None:
        self._most = max(1e-3, min(speed, self._speed))

    def step(self, felt: ContactState) -> None:
        period = felt.period
        if self.phase == "pushing":
            self._push(felt, period)
        elif self.phase == "settling":
            self._settle(felt, period)
        elif self.phase == "leaving":
            self._leave(period)

    def _push(self, felt: ContactState, period: float) -> None:
        before = self._rate
        left = self._path.length - self._way
        wanted = min(self._most, math.sqrt(max(0.0, 2 * self._braking * left)))
        change = ACCELERATION * period
        self._rate = min(max(wanted, before - 2 * change), before + change)
        self._way = min(self._way + self._rate * period, self._path.length)
        self.reached = self._way
        self._feel(felt, (self._rate - before) / period, period)
        done = left <= self._rate * period + 1e-6
        if self.blocked or self.lost or done:
            self._rate = 0.0
            self.in_contact = self.touched_at is not None and self._pushed > LOST and not self.lost
            self.phase, self._since = "settling", felt.elapsed
        self._anchor(felt, period, (self._rate - before) / period)

    def _feel(self, felt: ContactState, acceleration: float, period: float) -> None:
        """What acts against the push; the sensor feels the hand beyond it accelerate, too."""
        x, y = self._path.at(self._way).direction
        against = -float(felt.force[0] * x + felt.force[1] * y) - self._mass * acceleration
        self._pushed += (against - self._pushed) * min(1.0, period / MEMORY)
        if self._pushed > TOUCHED and self.touched_at is None:
            self.touched_at = self._way
        self._without = 0.0 if self._pushed > LOST else self._without + self._rate * period
        self.lost = self.touched_at is not None and self._without > LOST_WAY and not self._rolls
        self.blocked = against > self._force

    def _settle(self, felt: ContactState, period: float) -> None:
        """Stand where the way ends, or where something stopped it, before leaving."""
        if self.blocked:
            # What resists is not pressed against any longer.
            self._offset = felt.position[:2] - self._planned()[:2]
        off = self._anchor(felt, period, 0.0)
        waited = felt.elapsed - self._since
        if (off < EXACT and waited > 0.1) or waited > SETTLING or self.blocked or self.lost:
            self.carrier = self._carrier_at(felt)
            self.phase = "leaving"

    def _leave(self, period: float) -> None:
        """Straight back, off the object."""
        step = min(self._speed, 0.05) * period
        self._back += step
        x, y = self._path.at(self._way).direction
        self.position = self.position - np.array([x, y, 0.0]) * step
        self.velocity = np.array([-x, -y, 0.0]) * (step / period)
        self.acceleration = self.spin = np.zeros(3)
        if self._back >= AWAY:
            self.velocity = np.zeros(3)
            self.phase = "left"
            self.finished = True

    def _planned(self) -> Array:
        tcp = self._path.at(self._way) @ self._tool
        return np.array([tcp.x, tcp.y, self.origin[2]])

    def _anchor(self, felt: ContactState, period: float, acceleration: float) -> float:
        """Where the spring is held; the distance of the tool from where it should be, m."""
        carrier = self._path.at(self._way)
        planned = self._planned()
        error = planned[:2] - felt.position[:2]
        if not self.blocked:
            offset = self._offset + error * (GAIN * period)
            self._offset = offset * min(1.0, MOST / max(1e-9, float(np.hypot(*offset))))
        self.position = planned + np.append(self._offset, 0.0)
        turn = carrier.yaw - self._yaw
        c, s = math.cos(turn), math.sin(turn)
        self.rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ self.turn
        spin = self._rate * self._path.curvature(self._way)
        x, y = carrier.direction
        arm = planned[:2] - (carrier.x, carrier.y)
        self.velocity = np.array([x * self._rate - spin * arm[1], y * self._rate + spin * arm[0], 0.0])
        self.spin = np.array([0.0, 0.0, spin])
        self.acceleration = np.array([x, y, 0.0]) * acceleration
        return float(np.hypot(*error))

    def _carrier_at(self, felt: ContactState) -> PlanarPose:
        """The carrier where the encoders say that the tool is."""
        turned = felt.rotation @ self.turn.T
        yaw = self._yaw + math.atan2(float(turned[1, 0]), float(turned[0, 0]))
        tcp = PlanarPose(float(felt.position[0]), float(felt.position[1]), yaw)
        return tcp @ self._tool.inverse()
