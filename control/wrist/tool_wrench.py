"""What a compliant tool feels: the wrist's readings beyond those of before, carried to the TCP."""

from __future__ import annotations

from collections import deque

import numpy as np

from ...robots.model import RobotModel
from ...world.values import GRAVITY, Array
from .wrist_wrench import Wrist

AVERAGED = 1 / 60
"""Time over which readings count together, s."""


class Feeling:
    """External wrench relative to `zero` (6,), which the wrist has felt without a contact (world axes, about
    the sensor), from the arm's configuration q (n,) on. The sensor's bias turns with the tool; the
    hand's weight counts at the lever that it had, so the tool may turn by a few degrees."""

    def __init__(self, wrist: Wrist, model: RobotModel, q: Array, zero: Array, period: float) -> None:
        self._wrist = wrist
        tcp = model.tcp(q)
        self._sensor_in_tool: Array = tcp.rotation().T @ (
            np.array(model.flange(q).position) - np.array(tcp.position)
        )
        weight = np.array([0.0, 0.0, model.hand_mass * GRAVITY])
        lever = model.flange(q).rotation() @ np.array(model.hand_com)
        self._zero: list[float] = (zero - np.concatenate([weight, np.cross(lever, weight)])).tolist()
        self._bias: tuple[Array, Array] = (np.array(wrist.bias.force), np.array(wrist.bias.torque))
        self._recent: deque[list[float]] = deque(maxlen=max(1, round(AVERAGED / period)))

    def read(self, rotation: Array) -> tuple[Array, Array]:
        """Take this period's reading, the tool being turned by (3, 3): force (3,) N and torque (3,) Nm about
        the TCP, means of the last. Plain numbers: numpy would take ten times as long for so few."""
        reading, recent = self._wrist.latest, self._recent
        bias = [*(rotation @ self._bias[0]).tolist(), *(rotation @ self._bias[1]).tolist()]
        felt = zip((*reading.force, *reading.torque), self._zero, bias, strict=True)
        recent.append([a - b - c for a, b, c in felt])
        count = len(recent)
        fx, fy, fz, tx, ty, tz = (sum(column) / count for column in zip(*recent, strict=True))
        x, y, z = (rotation @ self._sensor_in_tool).tolist()
        turning = (tx + y * fz - z * fy, ty + z * fx - x * fz, tz + x * fy - y * fx)
        return np.array((fx, fy, fz)), np.array(turning)
