"""The wrist: bias, tare and payload, over times and not numbers of readings; contacts."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from picktree.robot.control import ContactDetector, Payload
from picktree.robot.control.contact_detection import ForceSample
from picktree.robot.control.wrist_wrench import WristWrench
from picktree.world import Array, Wrench
from picktree.world.robot_model import RobotModel, load_robot

MODEL = RobotModel(load_robot("panda"))
HOME = MODEL.named("home")
TILTED = HOME + np.array([0.3, 0.2, 0.1, 0.0, 0.4, 0.6, -1.0])
WEIGHT = MODEL.hand_mass * 9.81
BIAS = np.array([1.2, -0.7, 2.0, 0.05, -0.04, 0.02])
"""In the tool's axes."""


@dataclass
class Sensor:
    """A sensor at rest with the arm at q: hand, a payload, a push in the world, and a bias."""

    q: Array
    bias: Array = field(default_factory=lambda: np.zeros(6))
    payload: Payload | None = None
    push: Array = field(default_factory=lambda: np.zeros(3))
    now: float = 0.0
    period: float = 1 / 240

    def read(self) -> Wrench:
        turn = MODEL.tcp(self.q).rotation()
        lever = MODEL.flange(self.q).rotation() @ np.array(MODEL.hand_com)
        weight = np.array([0.0, 0.0, -WEIGHT])
        felt = np.concatenate([weight + self.push, np.cross(lever, weight)])
        felt += np.concatenate([turn @ self.bias[:3], turn @ self.bias[3:]])
        if self.payload is not None:
            felt += self.payload.wrench(turn, WRIST_IN_TOOL)
        fx, fy, fz, tx, ty, tz = felt.tolist()
        return Wrench((fx, fy, fz), (tx, ty, tz))


WRIST_IN_TOOL = np.array((MODEL.tcp(HOME).inverse() @ MODEL.flange(HOME)).position)


def wrist(sensor: Sensor) -> WristWrench:
    return WristWrench(sensor, MODEL, sensor)


def rest(one: WristWrench, sensor: Sensor, seconds: float = 0.15) -> None:
    """Let time pass with the arm where it is."""
    for _ in range(round(seconds / sensor.period)):
        sensor.now += sensor.period
        one.sample()
    one.turned(MODEL.tcp(sensor.q))


def test_a_bias_that_was_learnt_turns_with_the_hand() -> None:
    sensor = Sensor(HOME, BIAS)
    one = wrist(sensor)
    rest(one, sensor)
    assert one.zero(0.1, HOME)
    assert (*one.bias.force, *one.bias.torque) == pytest.approx(tuple(BIAS), abs=1e-9)
    sensor.q = TILTED
    rest(one, sensor)
    one.turned(MODEL.tcp(TILTED))
    one.sample()
    assert one.force == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert one.over(0.1, TILTED) == pytest.approx(np.zeros(6), abs=1e-9)


@pytest.mark.parametrize("push", [[0.0, 0.0, 16.0], [10.0, -10.0, 0.0]])
def test_what_pushes_hard_is_never_taken_for_a_bias(push: list[float]) -> None:
    sensor = Sensor(HOME, BIAS, push=np.array(push))
    one = wrist(sensor)
    rest(one, sensor)
    assert not one.zero(0.1, HOME)
    assert one.force == pytest.approx(np.array(push) + MODEL.tcp(HOME).rotation() @ BIAS[:3], abs=1e-9)


def test_a_bias_that_is_known_does_not_jump() -> None:
    sensor = Sensor(HOME, BIAS)
    one = wrist(sensor)
    rest(one, sensor)
    one.zero(0.1, HOME)
    sensor.push = np.array([0.0, 0.0, 4.0])
    rest(one, sensor)
    assert not one.zero(0.1, HOME)
    assert one.force[2] == pytest.approx(4.0, abs=1e-9)


def test_a_bias_is_not_learnt_while_the_hand_shakes() -> None:
    sensor = Sensor(HOME)
    one = wrist(sensor)
    for k in range(40):
        sensor.push = np.array([0.0, 2.0 * (-1) ** k, 0.0])
        rest(one, sensor, sensor.period)
    assert not one.zero(0.1, HOME)


def test_a_vibration_corrects_a_known_bias_little_and_a_quiet_rest_much() -> None:
    sensor, rng = Sensor(HOME, BIAS), np.random.default_rng(0)

    def zeroed(amplitude: float) -> float:
        """Let 0.1 s of a slow vibration and of noise pass, learn the bias, and return its error in z, N."""
        for k in range(40):
            slow = amplitude * np.sin(2 * np.pi * k / 40)
            sensor.push = np.array([0.0, 0.0, slow]) + rng.normal(0.0, 0.15, 3)
            rest(one, sensor, sensor.period)
        sensor.push = np.zeros(3)
        assert one.zero(0.1, HOME)
        return abs(one.bias.force[2] - BIAS[2])

    one = wrist(sensor)
    assert zeroed(0.0) < 0.1
    sensor.now += 6.0
    before = one.bias.force[2]
    zeroed(0.5)
    assert abs(one.bias.force[2] - before) < 0.07, "all of the vibration's mean, -0.25 N, became bias"
    errors: list[float] = []
    for _ in range(4):
        sensor.now += 6.0
        errors.append(zeroed(0.0))
    assert errors[-1] < 0.05


def test_a_bias_that_drifts_fast_is_followed() -> None:
    sensor, rng = Sensor(HOME, BIAS), np.random.default_rng(0)
    one = wrist(sensor)
    for k in range(20):
        sensor.now += 6.0
        sensor.bias = BIAS + np.array([0.0, 0.0, 0.3 * k, 0.0, 0.0, 0.0])
        for _ in range(40):
            sensor.push = rng.normal(0.0, 0.15, 3)
            rest(one, sensor, sensor.period)
        assert one.zero(0.1, HOME)
        assert one.bias.force[2] == pytest.approx(sensor.bias[2], abs=0.15)


def test_a_restored_wrist_learns_as_the_saved_one_would() -> None:
    sensor, rng = Sensor(HOME, BIAS), np.random.default_rng(0)
    one, other = wrist(sensor), wrist(sensor)

    def rested(*wrists: WristWrench) -> None:
        for _ in range(40):
            sensor.push = rng.normal(0.0, 0.15, 3)
            sensor.now += sensor.period
            for each in wrists:
                each.sample()
                each.turned(MODEL.tcp(HOME))

    rested(one)
    assert one.zero(0.1, HOME)
    readings, tare = one.state()
    other.restore(readings, tare, one.stamps, one.learnt, MODEL.tcp(HOME))
    assert other.learnt == one.learnt
    sensor.now += 6.0
    rested(one, other)
    assert one.zero(0.1, HOME) and other.zero(0.1, HOME)
    assert other.learnt == one.learnt


def test_a_window_is_a_time_whatever_the_rate() -> None:
    """0.05 s at 5 N and 0.05 s at 1 N before them, at 1000 Hz and then at 240 Hz."""
    sensor = Sensor(HOME, period=1 / 1000)
    one = wrist(sensor)
    sensor.push = np.array([0.0, 0.0, -1.0])
    rest(one, sensor, 0.05)
    sensor.push, sensor.period = np.array([0.0, 0.0, -5.0]), 1 / 240
    rest(one, sensor, 0.05)
    assert one.load(0.05) == pytest.approx(5.0)
    assert one.load(0.2) == pytest.approx((50 * 1.0 + 12 * 5.0) / 62)


def test_what_the_hand_carries_is_no_contact_in_any_orientation() -> None:
    carried = Payload(0.5, 0.005, (0.01, -0.02, 0.03))
    sensor = Sensor(HOME, payload=carried)
    one = wrist(sensor)
    one.carry(carried)
    for q in (HOME, TILTED):
        sensor.q = q
        rest(one, sensor, 0.3)
        contact = one.contact(0.1, q)
        assert (*contact.force, *contact.torque) == pytest.approx((0.0,) * 6, abs=1e-9)
    sensor.push = np.array([0.0, 3.0, 0.0])
    rest(one, sensor, 0.3)
    assert one.contact(0.1, TILTED).force == pytest.approx((0.0, 3.0, 0.0), abs=1e-9)


def test_a_payload_reads_as_grams() -> None:
    assert str(Payload(0.8, 0.005)) == "800 ± 5 g"


def noisy(seconds: float, force: Array, seed: int, begin: float = 0.0) -> list[ForceSample]:
    rng = np.random.default_rng(seed)
    count = round(seconds * 240)
    values = force + rng.standard_normal((count, 3)) * 0.15
    return [ForceSample(begin + k / 240, (x, y, z)) for k, (x, y, z) in enumerate(values.tolist())]


def test_noise_and_drift_alone_are_no_contact() -> None:
    """Six seconds at 0.15 N, drifting by 0.3 N: no alarm. A threshold of 0.2 N would be too low."""
    ramp = [
        ForceSample(r.at, (r.force[0] + 0.05 * r.at, r.force[1], r.force[2]))
        for r in noisy(6.0, np.zeros(3), 1)
    ]
    detector, eager = ContactDetector(), ContactDetector(0.2, 0.1)
    alarms = eagerly = 0
    for reading in ramp:
        alarms += detector.watch([reading]) is not None
        eagerly += eager.watch([reading]) is not None
    assert alarms == 0
    assert eagerly > 0


def test_a_contact_says_when_where_and_how_hard_and_ends() -> None:
    detector = ContactDetector()
    assert detector.watch(noisy(1.0, np.zeros(3), 2)) is None
    contact = detector.watch(noisy(0.5, np.array([0.0, -4.0, 0.0]), 3, begin=1.0))
    assert contact is not None
    assert 1.0 <= contact.since < 1.02
    assert contact.size == pytest.approx(4.0, abs=0.4)
    assert contact.direction == pytest.approx((0.0, -1.0, 0.0), abs=0.1)
    assert detector.watch(noisy(0.2, np.zeros(3), 4, begin=1.5)) is None


def test_between_release_and_threshold_it_stays_as_it_was() -> None:
    detector = ContactDetector(threshold=2.0, release=1.0)
    quiet = [ForceSample(k / 240, (0.0, 0.0, 0.0)) for k in range(100)]
    assert detector.watch(quiet) is None
    between = [ForceSample(1 + k / 240, (1.5, 0.0, 0.0)) for k in range(20)]
    assert ContactDetector(2.0, 1.0).watch([*quiet, *between]) is None
    touched = [ForceSample(1 + k / 240, (3.0, 0.0, 0.0)) for k in range(10)]
    after = [ForceSample(1.1 + k / 240, (1.5, 0.0, 0.0)) for k in range(20)]
    assert detector.watch([*touched, *after]) is not None
