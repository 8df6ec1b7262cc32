"""What acts on the hand from outside: the wrist's reading without the weight of the tool, the sensor's bias
and what the hand carries."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from ...robots.model import RobotModel
from ...world.protocols import Clock, WrenchSensor
from ...world.values import GRAVITY, Array, Pose, Vector3, Wrench
from .contact_detection import ForceSample
from .payload_estimate import Payload, PayloadEstimator

KEPT = 0.21
"""Time over which readings are kept, s."""
EVERYDAY = 1 / 240
"""From one reading to the next unless it is known otherwise, s."""
LARGEST_BIAS = 12.0
"""Beyond this, at rest and in the open, a force is no bias of the sensor but something that acts on it, N."""
LARGEST_STEP = 3.0
"""By which a bias may differ from the one that was learnt before, N: sensors drift, they do not jump."""
QUIET = 0.6
"""Standard deviation of the force up to which a bias can be learnt, N."""


class WristWrench:
    """Readings of the wrist sensor in the world's axes, about the sensor's origin.

    `force` is the latest external force (contact and load), which controllers and the monitor use; it
    knows no tare. Means over some time relative to the tare are for feeling a load; `contact` leaves out
    what the hand is known to carry.

    The weight of the tool follows from the robot file, in any orientation. The sensor's bias turns with the
    hand; it is learnt by `zero`, and only there: whoever calls it vouches that the hand is empty and free.
    The loop does so when the arm first rests in a run, and then it shows, too, whether the sensor is noisy:
    one that is never says the same twice.
    """

    def __init__(self, sensor: WrenchSensor, model: RobotModel, clock: Clock) -> None:
        self._sensor = sensor
        self._model = model
        self._clock = clock
        self._weight = model.hand_mass * GRAVITY
        self._readings: deque[tuple[float, Wrench]] = deque()
        self._tare = np.zeros(6)
        self._bias: Array | None = None
        self._bias_in_world: Vector3 = (0.0, 0.0, 0.0)
        self._sensor_in_tool = _sensor_in_tool(model)
        self._changed = -1.0
        self.noisy = False
        """Whether no reading was like the one before when it was looked at last, at rest."""
        self.payload: Payload | None = None
        """What the hand is known to carry, see `carry`."""
        self.force: Vector3 = (0.0, 0.0, 0.0)
        """Latest external force, contact and load, world axes, N."""

    @property
    def latest(self) -> Wrench:
        """The sensor's last reading as it is, the weight of the hand and the bias included."""
        return self._readings[-1][1] if self._readings else Wrench()

    def unbiased(self, turn: Array) -> Wrench:
        """The last reading without the bias, the weight of the hand included; `turn` (3, 3) of the TCP in the
        world."""
        reading = self.latest
        if self._bias is None:
            return reading
        by = np.concatenate([turn @ self._bias[:3], turn @ self._bias[3:]])
        return _wrench(np.array((*reading.force, *reading.torque)) - by)

    @property
    def bias(self) -> Wrench:
        """What the sensor is believed to add, in the axes of the TCP frame, N and Nm."""
        if self._bias is None:
            return Wrench()
        fx, fy, fz, tx, ty, tz = (float(c) for c in self._bias)
        return Wrench((fx, fy, fz), (tx, ty, tz))

    @property
    def zeroed(self) -> bool:
        """Whether a bias was ever learnt."""
        return self._bias is not None

    @property
    def sensor_in_tool(self) -> Array:
        """(3,) origin of the sensor in the TCP frame, m (a copy)."""
        return self._sensor_in_tool.copy()

    def sample(self) -> None:
        """Take this control period's reading."""
        reading, now = self._sensor.read(), self._clock.now
        readings = self._readings
        if not readings or reading.force != readings[-1][1].force:
            self._changed = now
        readings.append((now, reading))
        while now - readings[0][0] > KEPT:
            readings.popleft()
        self.force = self._external(reading)

    def turned(self, tool: Pose) -> None:
        """The tool is there now, and the bias has turned with it."""
        if self._bias is not None:
            x, y, z = (tool.rotation() @ self._bias[:3]).tolist()
            self._bias_in_world = (x, y, z)

    def since(self, time: float) -> tuple[ForceSample, ...]:
        """Every reading after `time` s that is kept, oldest first: external force in the world, N."""
        return tuple(ForceSample(at, self._external(w)) for at, w in self._readings if at > time + 1e-9)

    def over(self, window: float, q: Array) -> Array:
        """Mean external wrench (6,) over the last `window` s, the arm being at q; without tare."""
        recent = self._last(window)
        if not recent:
            return np.zeros(6)
        mean = np.array([(*w.force, *w.torque) for w in recent]).mean(axis=0)
        rotation = self._model.flange(q).rotation()
        lever = rotation @ np.array(self._model.hand_com)
        mean[2] += self._weight
        mean[3] += lever[1] * self._weight
        mean[4] -= lever[0] * self._weight
        if self._bias is not None:
            turn = self._model.tcp(q).rotation()
            mean[:3] -= turn @ self._bias[:3]
            mean[3:] -= turn @ self._bias[3:]
        return mean

    def tare(self, window: float, q: Array) -> None:
        """What was felt over the last `window` s counts as nothing, for `external` and `load`."""
        self._tare = self.over(window, q)

    def untare(self) -> None:
        """What an empty hand feels in the open, by the known bias, counts as nothing."""
        self._tare = np.zeros(6)

    def external(self, window: float, q: Array) -> Wrench:
        """Mean external wrench relative to the tare."""
        return _wrench(self.over(window, q) - self._tare)

    def contact(self, window: float, q: Array) -> Wrench:
        """Mean wrench of what touches the hand or what it carries: without tool, bias and payload, at rest.
        The tare has no part in it."""
        return _wrench(self.over(window, q) - self._carried(self._model.tcp(q).rotation()))

    def load(self, window: float) -> float:
        """Weight that hangs on the hand since the tare, N, mean over the last `window` s."""
        recent = self._last(window)
        if not recent:
            return 0.0
        mean = sum(w.force[2] for w in recent) / len(recent)
        return float(self._tare[2]) - mean - self._weight + self._bias_in_world[2]

    def unrest(self, window: float) -> float:
        """Standard deviation of the force over the last `window` s, the worst axis, N."""
        recent = self._last(window)
        if len(recent) < 2:
            return 0.0
        return float(np.array([w.force for w in recent]).std(axis=0).max())

    @property
    def repeats_since(self) -> float | None:
        """From when on the sensor says the same numbers bit by bit, s; None for one that is not noisy."""
        return self._changed if self.noisy else None

    def zero(self, window: float, q: Array, real: Callable[[Array], bool] | None = None) -> bool:
        """Learn the sensor's bias from the last `window` s at rest, with a hand that nothing touches; what it
        carries is what `carry` said.

        False, and nothing is learnt, when what is felt is no bias: too large, too different from the one
        known, or not at rest. So what pushes at the hand is never taken for the sensor's fault altogether.
        `real` is asked about what is too large or too different: whether a wrench (6,), world axes about the
        sensor, really acts on the hand besides. Where it does not, the sensor's bias has jumped, and is
        learnt. With a load nothing but a jump is: what its weight is known to be is not that sure.
        """
        recent = self._last(window)
        self.noisy = len(recent) > 2 and len({w.force for w in recent}) == len(recent)
        known = np.zeros(6) if self._bias is None else self._bias
        tool = self._model.tcp(q)
        turn = tool.rotation()
        felt = self.over(window, q) - self._carried(turn)
        step = np.concatenate([turn.T @ felt[:3], turn.T @ felt[3:]])
        bias = known + step
        sudden = self._bias is not None and float(np.linalg.norm(step[:3])) > LARGEST_STEP
        if self.unrest(window) > QUIET:
            return False
        odd = sudden or float(np.linalg.norm(bias[:3])) > LARGEST_BIAS
        if (odd and (real is None or real(felt))) or (self.payload is not None and not sudden):
            return False
        self._bias = bias
        self.turned(tool)
        if not odd:
            # The drift was in what was tared, too: what counts as nothing stays what it was.
            self._tare = self._tare - felt
        self.force = self._external(self.latest)
        return True

    def carry(self, payload: Payload | None) -> None:
        """The hand carries this from now on, or nothing: it is no contact."""
        self.payload = payload

    def estimate(self) -> PayloadEstimator:
        """An estimate of a payload without readings; `weigh` adds them."""
        return PayloadEstimator(self._sensor_in_tool)

    def weigh(self, estimate: PayloadEstimator, window: float, q: Array) -> None:
        """Add what is felt now, at rest, beyond tool and bias, to an estimate of what the hand carries."""
        estimate.add(self.over(window, q), self._model.tcp(q).rotation())

    def state(self) -> tuple[tuple[Wrench, ...], tuple[float, ...]]:
        """Readings and tare."""
        return tuple(reading for _, reading in self._readings), tuple(self._tare.tolist())

    @property
    def learnt(self) -> tuple[float, ...]:
        """The bias (6,) for a checkpoint; empty when none was learnt."""
        return () if self._bias is None else tuple(self._bias.tolist())

    @property
    def stamps(self) -> tuple[float, ...]:
        """Times of the readings that are kept, s."""
        return tuple(at for at, _ in self._readings)

    def restore(
        self,
        readings: Iterable[Wrench],
        tare: Iterable[float],
        stamps: Sequence[float] = (),
        bias: Sequence[float] = (),
        tool: Pose | None = None,
    ) -> None:
        """As `state`, `stamps` and `learnt` had it; `tool`: where the TCP is now."""
        readings = tuple(readings)
        now = self._clock.now
        if len(stamps) != len(readings):
            stamps = [now - (len(readings) - 1 - k) * EVERYDAY for k in range(len(readings))]
        self._readings = deque(zip(stamps, readings, strict=True))
        self._tare = np.array(list(tare))
        self._bias = np.array(bias) if len(bias) == 6 else None
        self._bias_in_world = (0.0, 0.0, 0.0)
        self.payload = None
        if tool is not None:
            self.turned(tool)
        if self._readings:
            self.force = self._external(self.latest)
        self._changed = max((at for at, _ in self._readings), default=-1.0)

    def _external(self, reading: Wrench) -> Vector3:
        """The force of a reading that was taken just now."""
        x, y, z = reading.force
        bx, by, bz = self._bias_in_world
        return (x - bx, y - by, z + self._weight - bz)

    def _carried(self, turn: Array) -> Array:
        """(6,) what the hand is known to carry does to the wrist at rest."""
        return np.zeros(6) if self.payload is None else self.payload.wrench(turn, self._sensor_in_tool)

    def _last(self, window: float) -> list[Wrench]:
        """Readings of the last `window` s."""
        if not self._readings:
            return []
        begin = self._readings[-1][0] - window + 1e-4
        return [reading for at, reading in self._readings if at > begin]


def _wrench(six: Array) -> Wrench:
    fx, fy, fz, tx, ty, tz = (float(c) for c in six)
    return Wrench((fx, fy, fz), (tx, ty, tz))


def _sensor_in_tool(model: RobotModel) -> Array:
    """Origin of the wrist's sensor in the TCP frame (3,): both are fixed to the hand."""
    q = (model.lower + model.upper) / 2
    return np.array((model.tcp(q).inverse() @ model.flange(q)).position)


AVERAGED = 1 / 60
"""Time over which readings count together, s."""


class TcpWrench:
    """External wrench relative to `zero` (6,), which the wrist has felt without a contact (world axes, about
    the sensor), from the arm's configuration q (n,) on. The sensor's bias turns with the tool; the
    hand's weight counts at the lever that it had, so the tool may turn by a few degrees."""

    def __init__(self, wrist: WristWrench, model: RobotModel, q: Array, zero: Array, period: float) -> None:
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
