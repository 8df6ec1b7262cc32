"""What acts on the hand from outside: the wrist's reading without the weight of the tool."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np

from ..protocols import WrenchSensor
from ..robot.model import RobotModel
from ..values import Array, Vector3, Wrench

GRAVITY = 9.81
KEPT = 48
"""Readings that are kept."""


class Wrist:
    """Readings of the wrist sensor in the world's axes, about the sensor's origin.

    `force` is the latest external force (contact and load), which controllers and the monitor use; it
    knows no tare. Means over many readings relative to the tare are for feeling a load.
    """

    def __init__(self, sensor: WrenchSensor, model: RobotModel) -> None:
        self._sensor = sensor
        self._model = model
        self._weight = model.hand_mass * GRAVITY
        self._readings: deque[Wrench] = deque(maxlen=KEPT)
        self._tare = np.zeros(6)
        self.force: Vector3 = (0.0, 0.0, 0.0)

    def sample(self) -> None:
        """Take this control period's reading."""
        reading = self._sensor.read()
        self._readings.append(reading)
        x, y, z = reading.force
        self.force = (x, y, z + self._weight)

    def mean(self, samples: int, q: Array) -> Array:
        """External wrench (6,) over the last readings, the arm being at q; without tare."""
        recent = list(self._readings)[-samples:]
        if not recent:
            return np.zeros(6)
        mean = np.array([(*w.force, *w.torque) for w in recent]).mean(axis=0)
        lever = self._model.flange(q).rotation() @ np.array(self._model.hand_com)
        mean[2] += self._weight
        mean[3] += lever[1] * self._weight
        mean[4] -= lever[0] * self._weight
        return mean

    def tare(self, samples: int, q: Array) -> None:
        self._tare = self.mean(samples, q)

    def external(self, samples: int, q: Array) -> Wrench:
        """Mean external wrench relative to the tare."""
        fx, fy, fz, tx, ty, tz = (float(c) for c in self.mean(samples, q) - self._tare)
        return Wrench((fx, fy, fz), (tx, ty, tz))

    def load(self, samples: int) -> float:
        """Weight that hangs on the hand since the tare, N."""
        recent = list(self._readings)[-samples:]
        if not recent:
            return 0.0
        mean = sum(w.force[2] for w in recent) / len(recent)
        return float(self._tare[2]) - mean - self._weight

    def unrest(self, samples: int) -> float:
        """Standard deviation of the force over the last readings, the worst axis, N."""
        recent = list(self._readings)[-samples:]
        if len(recent) < 2:
            return 0.0
        return float(np.array([w.force for w in recent]).std(axis=0).max())

    def state(self) -> tuple[tuple[Wrench, ...], tuple[float, ...]]:
        return tuple(self._readings), tuple(self._tare.tolist())

    def restore(self, readings: Iterable[Wrench], tare: Iterable[float]) -> None:
        self._readings = deque(readings, maxlen=KEPT)
        self._tare = np.array(list(tare))
        if self._readings:
            x, y, z = self._readings[-1].force
            self.force = (x, y, z + self._weight)
