"""External wrench on the hand: the wrist reading without the tool's weight, the sensor's bias and the
payload.

The bias is estimated when the arm rests; the joints' efforts are a second witness of it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np

from picktree.world import GRAVITY, Array, Clock, JointState, Pose, Vector3, Wrench, WrenchSensor, event_types
from picktree.world.robot_model import RobotModel

from .contact_detection import ForceSample
from .external_torque import EffortCheck
from .payload_estimate import Payload
from .safety_monitor import SafetyMonitor

READING_BUFFER_TIME = 0.21
"""Time over which readings are kept, s."""
DEFAULT_READING_INTERVAL = 1 / 240
"""Default time between two readings, s."""
MAX_BIAS = 12.0
"""Greatest bias of the sensor, N. A larger force at rest in free space acts on the hand."""
MAX_BIAS_STEP = 3.0
"""Greatest change of a learnt bias, N. Sensors drift, they do not jump."""
MAX_QUIET_DEVIATION = 0.6
"""Standard deviation of the force up to which a bias can be learnt, N."""
MAX_SENSOR_NOISE = 1.0
"""Greatest noise that a sensor may have, N."""
NOISE_MARGIN = 1.9
"""Ratio of a deviation to the noise up to which nothing vibrates: some 20 readings estimate both."""
BIAS_DRIFT = 0.015
"""Expected drift of the bias, N after one second; it grows with the root of the time."""


class WristWrench:
    """Readings of the wrist sensor in world axes, about the sensor's origin.

    `force` is the latest external force (contact and load) for controllers and monitor, without tare. Means
    over a time relative to the tare measure a load; `contact` leaves out the known payload.

    The tool's weight follows from the robot file, in any orientation. The sensor's bias turns with the hand.
    Only `zero` learns it, and its caller guarantees an empty, free hand. The loop calls it when the arm first
    rests in a run. That also shows whether the sensor is noisy: a noisy one never repeats a reading.

    A learnt bias is a Kalman estimate (1960) under slow drift. So a reading while the arm still vibrates
    corrects it little.
    """

    def __init__(self, sensor: WrenchSensor, model: RobotModel, clock: Clock) -> None:
        self._sensor = sensor
        self._model = model
        self._clock = clock
        self._weight = model.hand_mass * GRAVITY
        self._readings: deque[tuple[float, Wrench]] = deque()
        self._tare = np.zeros(6)
        self._bias: Array | None = None
        self._bias_variance = 0.0
        """Variance of each axis of the learnt bias's force, N²."""
        self._bias_time = 0.0
        """Time at which the bias was learnt, s."""
        self._bias_in_world: Vector3 = (0.0, 0.0, 0.0)
        self._sensor_in_tool = _sensor_in_tool(model)
        self._hand_com = np.array(model.hand_com)
        self._changed = -1.0
        self.least_noise = MAX_SENSOR_NOISE
        """Least noise of the force at rest so far, N."""
        self.noisy = False
        """Whether all readings differed from each other at the last `zero`."""
        self.payload: Payload | None = None
        """Known payload of the hand, see `carry`. None: the hand is empty."""
        self.force: Vector3 = (0.0, 0.0, 0.0)
        """Latest external force, contact and load, world axes, N."""

    @property
    def latest(self) -> Wrench:
        """Last reading of the sensor, including the weight of the hand and the bias."""
        return self._readings[-1][1] if self._readings else Wrench()

    def unbiased(self, turn: Array) -> Wrench:
        """Return the last reading without the bias, including the hand's weight; `turn` (3, 3): TCP in the
        world."""
        reading = self.latest
        if self._bias is None:
            return reading
        by = np.concatenate([turn @ self._bias[:3], turn @ self._bias[3:]])
        return _wrench(np.array((*reading.force, *reading.torque)) - by)

    @property
    def bias(self) -> Wrench:
        """Learnt bias of the sensor in TCP axes, N and Nm."""
        return Wrench() if self._bias is None else _wrench(self._bias)

    @property
    def zeroed(self) -> bool:
        """Whether a bias has been learnt."""
        return self._bias is not None

    def sample(self) -> None:
        """Read the sensor for this control period."""
        reading, now = self._sensor.read(), self._clock.now
        readings = self._readings
        if not readings or reading.force != readings[-1][1].force:
            self._changed = now
        readings.append((now, reading))
        while now - readings[0][0] > READING_BUFFER_TIME:
            readings.popleft()
        self.force = self._external(reading)

    def turned(self, tool: Pose) -> None:
        """Turn the bias with the tool, which is now at `tool`."""
        if self._bias is not None:
            x, y, z = tool.rotation().dot(self._bias[:3]).tolist()
            self._bias_in_world = (x, y, z)

    def since(self, time: float) -> tuple[ForceSample, ...]:
        """Return the kept external forces after `time` s, oldest first, N in the world."""
        return tuple(ForceSample(at, self._external(w)) for at, w in self._readings if at > time + 1e-9)

    def over(self, window: float, q: Array) -> Array:
        """Return the mean external wrench (6,) over the last `window` s with the arm at q (n,), without
        tare."""
        recent = self._last(window)
        if not recent:
            return np.zeros(6)
        mean = np.add.reduce(np.array([w.force + w.torque for w in recent])) / len(recent)
        across, along, _ = self._model.flange(q).rotation().dot(self._hand_com).tolist()
        mean[2] += self._weight
        mean[3] += along * self._weight
        mean[4] -= across * self._weight
        if self._bias is not None:
            turn = self._model.tcp(q).rotation()
            mean[:3] -= turn.dot(self._bias[:3])
            mean[3:] -= turn.dot(self._bias[3:])
        return mean

    def tare(self, window: float, q: Array) -> None:
        """Take the mean reading over the last `window` s as zero for `external` and `load`."""
        self._tare = self.over(window, q)

    def untare(self) -> None:
        """Take the reading of an empty, free hand as zero, by the learnt bias."""
        self._tare = np.zeros(6)

    def external(self, window: float, q: Array) -> Wrench:
        """Return the mean external wrench relative to the tare."""
        return _wrench(self.over(window, q) - self._tare)

    def contact(self, window: float, q: Array) -> Wrench:
        """Return the mean wrench of contacts at the hand or its load, at rest: without tool, bias, payload
        and tare."""
        return _wrench(self.over(window, q) - self.carried(self._model.tcp(q).rotation()))

    def load(self, window: float) -> float:
        """Return the weight on the hand since the tare, N, mean over the last `window` s."""
        recent = self._last(window)
        if not recent:
            return 0.0
        mean = sum(w.force[2] for w in recent) / len(recent)
        return float(self._tare[2]) - mean - self._weight + self._bias_in_world[2]

    def unrest(self, window: float) -> float:
        """Return the standard deviation of the force over the last `window` s, N, of the worst axis."""
        recent = self._last(window)
        if len(recent) < 2:
            return 0.0
        return float(np.array([w.force for w in recent]).std(axis=0).max())

    def noise(self, window: float) -> float:
        """Return the standard deviation of the sensor's noise over the last `window` s, N, of the worst axis.

        Successive readings differ by the noise; a vibration of the arm hardly changes between them.
        """
        forces = np.array([w.force for w in self._last(window)])
        if len(forces) < 3:
            return 0.0
        return float(np.sqrt(np.square(np.diff(forces, axis=0)).mean(axis=0) / 2.0).max())

    def vibrates(self, window: float, limit: float) -> bool:
        """Return whether the force deviated by more than `limit` N over the last `window` s, and by more than
        the sensor's noise at rest explains."""
        unrest = self.unrest(window)
        return unrest > limit and unrest > NOISE_MARGIN * self.least_noise

    @property
    def repeats_since(self) -> float | None:
        """Time since which a noisy sensor repeats its reading exactly, s. None: the sensor is not noisy."""
        return self._changed if self.noisy else None

    def zero(self, window: float, q: Array, real: Callable[[Array], bool] | None = None) -> bool:
        """Learn the sensor's bias from the last `window` s at rest, with a hand free of contact; see `carry`
        for its payload.

        False: nothing is learnt, because the reading is no bias. It is too large, too different from the
        known one, or not at rest. So a contact is never taken for a bias entirely.

        `real` receives a reading that is too large or too different: a wrench (6,), world axes about the
        sensor. It returns whether that wrench acts on the hand. If not, the bias has jumped, and is learnt.
        With a payload only a jump is learnt: the payload's weight is not known precisely enough.
        """
        recent = self._last(window)
        self.noisy = len(recent) > 2 and len({w.force for w in recent}) == len(recent)
        if len(recent) > 2:
            self.least_noise = min(self.least_noise, self.noise(window))
        known = np.zeros(6) if self._bias is None else self._bias
        tool = self._model.tcp(q)
        turn = tool.rotation()
        felt = self.over(window, q) - self.carried(turn)
        step = np.concatenate([turn.T @ felt[:3], turn.T @ felt[3:]])
        bias = known + step
        sudden = self._bias is not None and float(np.linalg.norm(step[:3])) > MAX_BIAS_STEP
        if self.vibrates(window, MAX_QUIET_DEVIATION):
            return False
        odd = sudden or float(np.linalg.norm(bias[:3])) > MAX_BIAS
        if (odd and (real is None or real(felt))) or (self.payload is not None and not sudden):
            return False
        gain = 1.0 if odd or self._bias is None else self._bias_gain(step[:3], window)
        self._bias_variance, self._bias_time = gain * self._zero_variance(window), self._clock.now
        self._bias = known + gain * step
        self.turned(tool)
        if not odd:
            # The tare contains the drift, too: removing it from both keeps the zero.
            self._tare = self._tare - gain * felt
        self.force = self._external(self.latest)
        return True

    def _bias_gain(self, step: Array, window: float) -> float:
        """Return the share of `step` (3,), N, by which a reading corrects the known bias, 0 … 1.

        A step that drift and readings do not explain shows that the bias drifts faster.
        """
        drifted = self._bias_variance + BIAS_DRIFT**2 * max(self._clock.now - self._bias_time, 0.0)
        read = self._zero_variance(window)
        drifted = max(drifted, float(step @ step) / 3.0 - read)
        return drifted / (drifted + read) if read > 0.0 else 1.0

    def _zero_variance(self, window: float) -> float:
        """Return the variance of the mean force over the last `window` s at rest, N², of the worst axis.

        Differences between successive readings show the sensor's noise, which averages out. The rest of the
        variance is a slower vibration of the arm, which does not.
        """
        forces = np.array([w.force for w in self._last(window)])
        if len(forces) < 2:
            return 0.0
        noise = np.square(np.diff(forces, axis=0)).mean(axis=0) / 2.0
        vibration = np.maximum(forces.var(axis=0) - noise, 0.0)
        return float((noise / len(forces) + vibration).max())

    def carry(self, payload: Payload | None) -> None:
        """Set the payload of the hand; None: it is empty. A payload is no contact."""
        self.payload = payload

    def state(self) -> tuple[tuple[Wrench, ...], tuple[float, ...]]:
        """Return readings and tare for a checkpoint."""
        return tuple(reading for _, reading in self._readings), tuple(self._tare.tolist())

    @property
    def learnt(self) -> tuple[float, ...]:
        """Learnt bias (6,), its variance, N², and its time, s, for a checkpoint; empty: none."""
        if self._bias is None:
            return ()
        return (*self._bias.tolist(), self._bias_variance, self._bias_time)

    @property
    def stamps(self) -> tuple[float, ...]:
        """Times of the kept readings, s."""
        return tuple(at for at, _ in self._readings)

    def restore(
        self,
        readings: Iterable[Wrench],
        tare: Iterable[float],
        stamps: Sequence[float] = (),
        bias: Sequence[float] = (),
        tool: Pose | None = None,
    ) -> None:
        """Restore the values of `state`, `stamps` and `learnt`; `tool`: present TCP pose in the world."""
        readings = tuple(readings)
        now = self._clock.now
        if len(stamps) != len(readings):
            stamps = [now - (len(readings) - 1 - k) * DEFAULT_READING_INTERVAL for k in range(len(readings))]
        self._readings = deque(zip(stamps, readings, strict=True))
        self._tare = np.array(list(tare))
        self._bias = np.array(bias[:6]) if len(bias) >= 6 else None
        self._bias_variance, self._bias_time = bias[6:8] if len(bias) == 8 else (0.0, now)
        self._bias_in_world = (0.0, 0.0, 0.0)
        self.payload = None
        if tool is not None:
            self.turned(tool)
        if self._readings:
            self.force = self._external(self.latest)
        self._changed = max((at for at, _ in self._readings), default=-1.0)

    def _external(self, reading: Wrench) -> Vector3:
        """Return the external force of a reading of this period, N, world axes."""
        x, y, z = reading.force
        bx, by, bz = self._bias_in_world
        return (x - bx, y - by, z + self._weight - bz)

    def carried(self, turn: Array) -> Array:
        """Return the wrench (6,) of the known payload at rest; `turn` (3, 3): TCP in the world."""
        return np.zeros(6) if self.payload is None else self.payload.wrench(turn, self._sensor_in_tool)

    def _last(self, window: float) -> list[Wrench]:
        """Return the readings of the last `window` s."""
        if not self._readings:
            return []
        begin = self._readings[-1][0] - window + 1e-4
        recent: list[Wrench] = []
        for at, reading in reversed(self._readings):
            if at <= begin:
                break
            recent.append(reading)
        recent.reverse()
        return recent


def _wrench(six: Array) -> Wrench:
    fx, fy, fz, tx, ty, tz = six.tolist()
    return Wrench((fx, fy, fz), (tx, ty, tz))


def _sensor_in_tool(model: RobotModel) -> Array:
    """Return the origin (3,) of the wrist sensor in the TCP frame, m: both are fixed to the hand."""
    q = (model.lower + model.upper) / 2
    return np.array((model.tcp(q).inverse() @ model.flange(q)).position)


TCP_WRENCH_WINDOW = 1 / 60
"""Time over which readings are averaged, s."""


class TcpWrench:
    """External wrench relative to `zero` (6,), the wrist wrench without contact at q (n,).

    `zero` is in world axes about the sensor. The sensor's bias turns with the tool; the hand's weight keeps
    its initial lever, so the tool may turn by a few degrees.
    """

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
        self._recent: deque[list[float]] = deque(maxlen=max(1, round(TCP_WRENCH_WINDOW / period)))

    def read(self, rotation: Array) -> tuple[Array, Array]:
        """Read this period's wrench: mean force (3,) N and torque (3,) Nm about the TCP, world axes.

        `rotation` (3, 3): tool in the world. Plain numbers: numpy would take ten times as long for so few.
        """
        reading, recent = self._wrist.latest, self._recent
        bias = [*(rotation @ self._bias[0]).tolist(), *(rotation @ self._bias[1]).tolist()]
        felt = zip((*reading.force, *reading.torque), self._zero, bias, strict=True)
        recent.append([a - b - c for a, b, c in felt])
        count = len(recent)
        fx, fy, fz, tx, ty, tz = (sum(column) / count for column in zip(*recent, strict=True))
        x, y, z = (rotation @ self._sensor_in_tool).tolist()
        turning = (tx + y * fz - z * fy, ty + z * fx - x * fz, tz + x * fy - y * fx)
        return np.array((fx, fy, fz)), np.array(turning)


WRIST_WINDOW = 0.1
"""Time over which the wrist is read for a tare or a load, s."""


class BiasEstimator:
    """Estimator of the wrist sensor's bias at rest."""

    def __init__(self, model: RobotModel, monitor: SafetyMonitor, wrist: WristWrench) -> None:
        self._model = model
        self._monitor = monitor
        self._wrist = wrist
        self.efforts = EffortCheck(model)
        self.doubtful = False
        """Whether the joints' efforts contradict the wrist sensor."""

    def come_to_rest(self, state: JointState) -> None:
        """Learn the bias when the arm has just come to rest, if the bias is missing or in doubt."""
        if not self._wrist.zeroed:
            # A run begins with an empty hand in free space.
            self._wrist.zero(WRIST_WINDOW, state.position)
        elif self._monitor.pressed or self.doubtful:
            self.doubtful = not self.learn(state)

    def learn(self, state: JointState) -> bool:
        """Learn the bias as `WristWrench.zero`.

        A wrench that the joints do not carry is bias, however large.
        """
        before = self._wrist.force
        was_zeroed = self._wrist.zeroed
        learnt = self._wrist.zero(WRIST_WINDOW, state.position, partial(self._is_carried_by_joints, state))
        by = math.dist(before, self._wrist.force)
        if learnt and was_zeroed and by > MAX_BIAS_STEP:
            self._monitor.forget_efforts()
            words = (
                f"the wrist felt {by:.1f} N that no joint carries: its bias has jumped, and is learnt anew"
            )
            self._monitor.note(event_types.WristBiasEvent(words, force=by))
        return learnt

    def zero_empty(self, state: JointState, *, rested: bool) -> bool:
        """Learn the bias of the empty hand, and tare. False: the reading cannot be a bias, and the known one
        stays."""
        self._wrist.carry(None)
        learnt = rested and self.learn(state)
        if self._wrist.zeroed:
            self._wrist.untare()
        else:
            self._wrist.tare(WRIST_WINDOW, state.position)
        return learnt

    def known_load(self, state: JointState) -> Array:
        """Return the wrench (6,) of the known payload on the wrist at rest, world axes."""
        return self._wrist.carried(self._model.tcp(state.position).rotation())

    def _is_carried_by_joints(self, state: JointState, claimed: Array) -> bool:
        """Return whether the joints, at rest, carry the wrench (6,) that the wrist reads beyond the
        payload."""
        return self.efforts.believes(state, claimed, self.known_load(state))
