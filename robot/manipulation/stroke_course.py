"""Compliant motion of one stroke: up to the object, along with it, and off it again, with contact sensing."""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import numpy as np

from ...world.planar_geometry import PlanarPose
from ...world.values import Array
from ..control.compliant_motion import CartesianStiffness, CompliantMotion, ContactState
from .push_arcs import ArcPath

Phase: TypeAlias = Literal["pushing", "settling", "leaving", "left"]

PUSH_ACCELERATION = 0.4
"""Acceleration of the tool along its path, m/s². Friction decelerates an object far more, so that it stays at
the tool."""
CONTACT_BEGIN_FORCE, CONTACT_END_FORCE = 0.12, 0.04
"""Forces on the tool above which a contact begins, and below which it ends, N. 60 g on a table give 0.3 N;
the sensor's noise over `PUSH_FORCE_TIME_CONSTANT` is 0.03 N."""
PUSH_FORCE_TIME_CONSTANT = 0.08
"""Time constant of the force's mean, s."""
MAX_LOST_TRAVEL = 0.008
"""Travel without contact after which the contact is lost, m."""
MAX_SLOW_LENGTH, SLOW_PUSH_SPEED = 0.010, 0.025
"""Length below which a path is slow, m, and its speed, m/s: sensing needs time."""
ROLLING_DECELERATION = 0.1
"""Deceleration before the end for an object that rolls, m/s²."""
ANCHOR_CORRECTION_RATE = 5.0
"""Rate at which the anchor corrects the spring's deflection, 1/s."""
MAX_ANCHOR_LEAD = 0.006
"""Greatest lead of the anchor, m."""
MAX_ARRIVAL_ERROR = 1.0e-4
"""Error of the tool at which it has arrived, m; `MAX_SETTLING_TIME` is the longest wait for that, s."""
MAX_SETTLING_TIME = 0.6
BACK_OFF_TRAVEL = 0.006
"""Distance of the final motion back from the object, m."""


VERTICAL_DRAG_STIFFNESS = 300.0
DRAG_STIFFNESS = CartesianStiffness(linear=(1500.0, 1500.0, VERTICAL_DRAG_STIFFNESS), angular=60.0)
"""Stiffness of a tool that drags things, and its vertical part, N/m."""
SINK_SPEED, MAX_SINK, SINK_FORCE = 0.03, 0.025, 2.0
"""Speed, m/s, and distance, m, of the descent onto things, and the force on the tool that ends it, N."""


class PushMotion(CompliantMotion):
    """Motion of the TCP whose carrier (see `PushSide`) follows `way`, beginning `gap` m before its start.

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
        through: bool = False,
    ) -> None:
        """`tool`: TCP in the carrier. `hand_mass`: mass whose inertia the wrist measures, kg. `rolls`: see
        `PushSide`. `through`: the stroke goes on without contact, through a heap."""
        super().__init__()
        self._path, self._tool, self._gap = way, tool, gap
        if rolls or way.length < MAX_SLOW_LENGTH:
            speed = min(speed, SLOW_PUSH_SPEED)
        self._rolls, self._braking = rolls, ROLLING_DECELERATION if rolls else PUSH_ACCELERATION
        self._speed, self._most, self._through = speed, speed, through
        self._force, self._mass = force, hand_mass
        self._way, self._rate = -gap, 0.0
        self._pushed = 0.0
        self._without = 0.0
        self._since = 0.0
        self._back = 0.0
        self._offset = np.zeros(2)
        self.phase: Phase = "pushing"
        self.touched_at: float | None = None
        """Travel of the carrier at the first contact, m; negative: earlier than expected. None: no
        contact."""
        self.blocked = False
        self.lost = False
        self.in_contact = False
        """Whether the contact lasted to the end."""
        self.reached = -gap
        """Travel of the carrier, m."""
        self.carrier: PlanarPose = way.at(-gap)
        """Carrier by the encoders at the end of the push."""

    def start(self, position: Array, rotation: Array) -> None:
        super().start(position, rotation)
        begin = self._path.at(self._way)
        self._yaw = begin.yaw
        tcp = begin @ self._tool
        self._offset: Array = position[:2] - (tcp.x, tcp.y)

    @property
    def longest(self) -> float:
        """Duration of the push at the slowest speed, s."""
        return (self._gap + self._path.length) / min(self._speed, SLOW_PUSH_SPEED)

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
        change = PUSH_ACCELERATION * period
        self._rate = min(max(wanted, before - 2 * change), before + change)
        self._way = min(self._way + self._rate * period, self._path.length)
        self.reached = self._way
        self._feel(felt, (self._rate - before) / period, period)
        done = left <= self._rate * period + 1e-6
        if self.blocked or self.lost or done:
            self._rate = 0.0
            self.in_contact = (
                self.touched_at is not None and self._pushed > CONTACT_END_FORCE and not self.lost
            )
            self.phase, self._since = "settling", felt.elapsed
        self._anchor(felt, period, (self._rate - before) / period)

    def _feel(self, felt: ContactState, acceleration: float, period: float) -> None:
        """Update the force against the push, without the inertia of the hand, and the contact flags."""
        x, y = self._path.at(self._way).direction
        against = -float(felt.force[0] * x + felt.force[1] * y) - self._mass * acceleration
        self._pushed += (against - self._pushed) * min(1.0, period / PUSH_FORCE_TIME_CONSTANT)
        if self._pushed > CONTACT_BEGIN_FORCE and self.touched_at is None:
            self.touched_at = self._way
        self._without = 0.0 if self._pushed > CONTACT_END_FORCE else self._without + self._rate * period
        without = self.touched_at is not None and self._without > MAX_LOST_TRAVEL
        self.lost = without and not (self._rolls or self._through)
        self.blocked = against > self._force

    def _settle(self, felt: ContactState, period: float) -> None:
        """Stand where the path ends, or where something stopped the push, before leaving."""
        if self.blocked:
            # A body that resists is not pressed any longer.
            self._offset = felt.position[:2] - self._planned()[:2]
        off = self._anchor(felt, period, 0.0)
        waited = felt.elapsed - self._since
        if (
            (off < MAX_ARRIVAL_ERROR and waited > 0.1)
            or waited > MAX_SETTLING_TIME
            or self.blocked
            or self.lost
        ):
            self.carrier = self._carrier_at(felt)
            self.phase = "leaving"

    def _leave(self, period: float) -> None:
        """Move straight back, off the object."""
        step = min(self._speed, 0.05) * period
        self._back += step
        x, y = self._path.at(self._way).direction
        self.position = self.position - np.array([x, y, 0.0]) * step
        self.velocity = np.array([-x, -y, 0.0]) * (step / period)
        self.acceleration = self.spin = np.zeros(3)
        if self._back >= BACK_OFF_TRAVEL:
            self.velocity = np.zeros(3)
            self.phase = "left"
            self.finished = True

    def _planned(self) -> Array:
        tcp = self._path.at(self._way) @ self._tool
        return np.array([tcp.x, tcp.y, self.origin[2]])

    def _anchor(self, felt: ContactState, period: float, acceleration: float) -> float:
        """Set the anchor of the spring, and return the error of the tool, m."""
        carrier = self._path.at(self._way)
        planned = self._planned()
        error = planned[:2] - felt.position[:2]
        if not self.blocked:
            offset = self._offset + error * (ANCHOR_CORRECTION_RATE * period)
            self._offset = offset * min(1.0, MAX_ANCHOR_LEAD / max(1e-9, float(np.hypot(*offset))))
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
        """Return the carrier for the tool's pose by the encoders."""
        turned = felt.rotation @ self.turn.T
        yaw = self._yaw + math.atan2(float(turned[1, 0]), float(turned[0, 0]))
        tcp = PlanarPose(float(felt.position[0]), float(felt.position[1]), yaw)
        return tcp @ self._tool.inverse()


class DragMotion(PushMotion):
    """Stroke that begins above things: the tool sinks onto them, presses with `press` N, and drags them.

    With `DRAG_STIFFNESS` the force decreases when the tool slips off an edge. It ends above them.
    """

    def __init__(self, way: ArcPath, speed: float, force: float, press: float, hand_mass: float) -> None:
        super().__init__(way, PlanarPose(0.0, 0.0), 0.0, speed, force, hand_mass, through=True)
        self._press, self._sinking = press, True

    @property
    def longest(self) -> float:
        return super().longest + MAX_SINK / SINK_SPEED

    def step(self, felt: ContactState) -> None:
        if not self._sinking:
            super().step(felt)
            return
        sunk = min(SINK_SPEED * felt.elapsed, MAX_SINK)
        self.position = self.origin - (0.0, 0.0, sunk)
        self.velocity = np.array([0.0, 0.0, -SINK_SPEED])
        if felt.force[2] > SINK_FORCE:
            low = felt.position[2] - self._press / VERTICAL_DRAG_STIFFNESS
            self.origin, self._sinking = np.array([*self.origin[:2], low]), False
        elif sunk >= MAX_SINK:
            self.origin, self._sinking = self.position.copy(), False

    def _leave(self, period: float) -> None:
        """Move straight up, off the things."""
        self._back += SINK_SPEED * period
        self.position = self.position + np.array([0.0, 0.0, SINK_SPEED * period])
        self.velocity = np.array([0.0, 0.0, SINK_SPEED])
        self.acceleration = self.spin = np.zeros(3)
        if self._back >= MAX_SINK:
            self.velocity = np.zeros(3)
            self.phase = "left"
            self.finished = True
