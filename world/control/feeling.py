"""What a compliant tool feels: the wrist's readings beyond those of before, carried to the TCP."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..robot.model import RobotModel
from ..values import Array
from .wrist import GRAVITY, Wrist

AVERAGED = 1 / 60
"""Time over which readings count together, s."""


class Feeling:
    """External wrench relative to `zero` (6,), which the wrist has felt without a contact (world axes, about
    the sensor), from the arm's configuration q (n,) on. The tool may turn by a few degrees: the weight of
    the hand and the bias of the sensor count as they were."""

    def __init__(self, wrist: Wrist, model: RobotModel, q: Array, zero: Array, period: float) -> None:
        self._wrist = wrist
        tcp = model.tcp(q)
        self._sensor_in_tool: Array = tcp.rotation().T @ (
            np.array(model.flange(q).position) - np.array(tcp.position)
        )
        weight = np.array([0.0, 0.0, model.hand_mass * GRAVITY])
        lever = model.flange(q).rotation() @ np.array(model.hand_com)
        bias = np.concatenate(
            [tcp.rotation() @ np.array(part) for part in (wrist.bias.force, wrist.bias.torque)]
        )
        self._zero: Array = zero + bias - np.concatenate([weight, np.cross(lever, weight)])
        self._recent: deque[Array] = deque(maxlen=max(1, round(AVERAGED / period)))

    def read(self, rotation: Array) -> tuple[Array, Array]:
        """Take this period's reading, the tool being turned by (3, 3): force (3,) N and torque (3,) Nm about
        the TCP, means of the last."""
        reading = self._wrist.latest
        self._recent.append(np.array((*reading.force, *reading.torque)) - self._zero)
        mean = np.mean(self._recent, axis=0)
        force = mean[:3]
        return force, mean[3:] + np.cross(rotation @ self._sensor_in_tool, force)
