"""What a stop of the safety monitor reports, at which level it stands, and its limits to the last bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from picktree.robot.control import SafetyMonitor
from picktree.robot.control.safety_monitor import payload_limit
from picktree.world import Array, JointState, Journal, SensorStamps
from picktree.world.event_types import WristBiasEvent
from picktree.world.robot_model import RobotModel
from picktree.world.scene import SafetyLimits

from .control_cell import HOME, MODEL, ROBOT
from .test_monitor_limits import (
    CALM,
    PERIOD,
    SLACKS,
    STILL,
    WORKSPACE,
    Violation,
    cause,
    lags,
    monitor,
    one,
    reads,
    retreats,
)


def evidence(watch: SafetyMonitor) -> dict[str, object]:
    assert watch.stopped is not None
    return dict(watch.stopped.evidence)


def message(watch: SafetyMonitor) -> str:
    assert watch.stopped is not None
    return watch.stopped.message


def test_a_monitor_begins_with_nothing_felt() -> None:
    limits = SafetyLimits(60.0, WORKSPACE)
    watch = SafetyMonitor(MODEL, limits, Journal())
    assert (watch.limits, watch.pressed, watch.blind, watch.stops) == (limits, False, False, 0)
    assert watch.stopped is None
    assert watch.state().felt == CALM
    assert (watch.state().overloaded, watch.state().unexplained) == ((0.0,) * 7, (0.0,) * 7)


def test_what_the_control_loop_notes_goes_into_the_journal() -> None:
    journal = Journal()
    watch = SafetyMonitor(MODEL, SafetyLimits(), journal)
    event = WristBiasEvent("it has jumped", force=3.0)
    watch.note(event)
    assert [*journal.take()] == [event]


def test_the_mean_of_the_force_has_its_time_constant_on_each_axis() -> None:
    watch = monitor()
    still = JointState(HOME, STILL, STILL)
    watch.check(still, HOME, (10.0, -20.0, 40.0), 0.0375)
    assert watch.state().felt == pytest.approx((5.0, -10.0, 20.0))
    watch.check(still, HOME, (10.0, -20.0, 40.0), 0.0375)
    assert watch.state().felt == pytest.approx((7.5, -15.0, 30.0))
    watch.check(still, HOME, CALM, 0.0125)
    assert watch.state().felt == pytest.approx((5.625, -11.25, 22.5))


@pytest.mark.parametrize(("violate", "name", "slack", "level"), SLACKS)
def test_a_violation_stands_at_what_is_beyond_its_limit(
    violate: Violation, name: str, slack: float, level: float
) -> None:
    del slack
    watch = monitor()
    violate(watch, level)
    ((key, stands),) = watch.state().levels
    assert key.partition("/")[0] == name
    assert stands == pytest.approx(level, rel=0.02)


def test_numbers_are_told_to_the_third_decimal() -> None:
    watch = monitor()
    watch.check(JointState(HOME, STILL, STILL), HOME, (0.0, 0.0, 987.654321), PERIOD)
    felt = watch.state().felt[2]
    assert evidence(watch) == {"force": [0.0, 0.0, round(felt, 3)], "limit": 60.0}
    assert message(watch) == f"{felt:.0f} N at the wrist, above the limit of 60 N"
    watch = SafetyMonitor(MODEL, SafetyLimits(payload=0.51234567), Journal())
    watch.check_load(0.87654321)
    assert evidence(watch) == {"mass": 0.877, "limit": 0.512}
    assert message(watch) == "the hand carries 0.88 kg, more than the 0.51 kg that it may"
    watch = monitor()
    reads(watch, effort=one(1, -86.123456), seconds=0.6)
    assert evidence(watch) == {"joint": "panda_joint2", "effort": -86.123, "limit": 87.0}
    assert message(watch) == "panda_joint2 has exerted 86.1 Nm for 0.5 s, of 87 Nm that it bears"
    watch = monitor()
    watch.unattended("Main/Lost", "Track", 0.2512345)
    assert evidence(watch)["seconds"] == 0.251
    watch = monitor()
    limit = float(MODEL.torque_limit[4])
    watch.check_efforts(watch.explained(one(4, -0.3123456 * limit), 9.9))
    share = watch.state().unexplained[4]
    assert share == pytest.approx(-0.3123456 * 0.99)
    told = {"joint": "panda_joint5", "unexplained": round(share * limit, 3), "limit": round(0.15 * limit, 3)}
    assert evidence(watch) == told
    assert message(watch) == (
        f"panda_joint5 exerts {-share * limit:.1f} Nm that neither its motion nor what the wrist feels "
        f"explains, more than {0.15 * limit:.1f} Nm"
    )


def test_the_limit_of_unexplained_torque_is_told_exactly() -> None:
    robot = RobotModel(ROBOT)
    robot.torque_limit = np.full(7, 123.4567)
    watch = SafetyMonitor(robot, SafetyLimits(), Journal())
    watch.check_efforts(watch.explained(one(0, 100.0), 9.9))
    assert evidence(watch)["limit"] == 18.519


@pytest.mark.parametrize(
    ("violation", "words"),
    [
        (
            {"position": np.where(np.arange(7) == 3, MODEL.upper[3] + 0.05, HOME)},
            "panda_joint4 at -1.1 deg is 2.9 deg beyond its limit of -4.0 deg",
        ),
        ({"velocity": one(2, -5.0)}, "panda_joint3 moves at -5.00 rad/s"),
        (
            {"commanded": HOME + one(5, 0.125)},
            "panda_joint6 is 0.125 rad from where it was told to be",
        ),
    ],
)
def test_each_limit_of_the_joints_has_its_own_words(violation: dict[str, Array], words: str) -> None:
    watch = monitor()
    reads(watch, **violation)  # type: ignore[arg-type]
    assert message(watch) == words


def test_the_tool_is_told_how_far_outside_of_the_workspace_it_is() -> None:
    watch = monitor()
    watch.check_tool((0.4, 0.63, 0.3))
    assert message(watch) == "the tool is 30 mm outside the workspace: y = 630 mm, at most 600 mm"


def test_at_a_limit_to_the_last_bit_nothing_is_violated() -> None:
    watch = monitor()
    assert not watch.check_tool(WORKSPACE.max)
    assert not watch.check_tool(WORKSPACE.min)
    for now, stamps, repeats in (
        (0.05, SensorStamps(0.0, 0.05, 0.05), None),
        (0.1, SensorStamps(0.1, 0.1, 0.0), None),
        (0.5, SensorStamps(0.5, 0.0, 0.5), None),
        (0.1, SensorStamps(0.1, 0.1, 0.1), 0.0),
    ):
        assert not watch.check_sensors(now, stamps, repeats), stamps
    burdened = SafetyMonitor(MODEL, SafetyLimits(payload=0.5), Journal())
    assert not burdened.check_load(0.5 + 0.1)
    # A joint that is as fast as it may be is not what stops an arm that is off its way.
    reads(watch, velocity=one(2, 1.15 * float(MODEL.velocity_limit[2])), commanded=HOME + 0.2)
    assert cause(watch) == "control.tracking"
    # One whose effort is as great as it may be is not overloaded.
    watch = monitor()
    lags(watch, 0.1)
    reads(watch, effort=one(1, 0.95 * float(MODEL.torque_limit[1])), commanded=HOME + 0.2, seconds=1.0)
    assert watch.state().overloaded == (0.0,) * 7


def test_an_overload_may_last_half_a_second_to_the_last_bit() -> None:
    watch = monitor()
    heavy = JointState(HOME, STILL, one(1, 87.0))
    assert [watch.check(heavy, HOME, CALM, 0.125) for _ in range(5)] == [False] * 4 + [True]


def test_a_reading_of_the_encoders_may_be_one_and_a_half_periods_old() -> None:
    watch = monitor()
    watch.age_of_joints(lambda: 0.75)
    assert watch.check(JointState(HOME, STILL, STILL), HOME + 0.2, CALM, 0.5)


def test_a_wrist_that_gives_no_reading_is_not_said_to_repeat_itself() -> None:
    silent = SensorStamps(joints=5.0, gripper=5.0, wrench=4.5)
    watch = monitor()
    watch.check_sensors(5.0, silent, repeats_since=4.5)
    assert message(watch) == "the wrist sensor has given no new reading since 4.50 s"
    watch = monitor()
    watch.check_sensors(5.0, silent, repeats_since=4.4)
    assert message(watch) == "the wrist sensor has repeated itself bit by bit since 4.40 s"
    assert evidence(watch) == {"sensor": "wrench", "since": 4.4, "longest": 0.1}


def test_a_sensor_that_was_acknowledged_and_spoke_again_stops_anew() -> None:
    for sensor in ("wrench", "gripper"):
        watch = monitor()
        good = SensorStamps(5.0, 5.0, 5.0)
        silent = replace(good, **{sensor: 4.0})
        assert watch.check_sensors(5.0, silent)
        retreats(watch)
        assert not watch.check_sensors(5.0, silent)
        assert watch.blind is (sensor == "wrench")
        assert not watch.check_sensors(5.0, good)
        assert not watch.blind
        assert not watch.state().levels
        assert watch.check_sensors(5.0, silent)


def test_silent_encoders_cannot_be_acknowledged() -> None:
    watch = monitor()
    watch.check_sensors(5.0, SensorStamps(4.0, 5.0, 5.0))
    before = watch.stopped
    assert watch.acknowledge("retreat") is False
    assert watch.stopped is before is not None
    watch.check_sensors(5.2, SensorStamps(5.2, 5.2, 5.2))
    assert watch.acknowledge("retreat") is True
    assert watch.stopped is None


def test_whoever_was_lost_once_may_be_lost_again() -> None:
    watch = monitor()
    watch.unattended("Main/Lost", "Track", 0.25)
    watch.acknowledge("retreat")
    watch.unattended("retreat", "Track", 0.25)
    assert watch.stopped is None  # for as long as before it is let off
    watch.unattended("retreat", "Track", 0.26)
    assert watch.stops == 2
    retreats(watch)
    watch.unattended("retreat", "Track", 0.25)
    assert (watch.stops, cause(watch)) == (3, "safety.watchdog")


def test_efforts_that_are_explained_by_doubting_the_wrist_are_let_off_as_before() -> None:
    """The mean is still too great: what was acknowledged is not over."""
    watch = monitor()
    push = one(3, 0.4 * float(MODEL.torque_limit[3]))
    assert watch.check_efforts(watch.explained(push, 9.9)) is True
    retreats(watch)
    assert watch.check_efforts(True) is False
    assert watch.check_efforts(watch.explained(push, 9.9)) is False
    watch.explained(STILL, 99.0)
    assert watch.check_efforts(True) is False
    assert watch.check_efforts(watch.explained(push, 99.0)) is True


@pytest.mark.parametrize("acknowledged", [False, True])
def test_a_restored_retreat_is_slow_only_where_it_was_acknowledged(acknowledged: bool) -> None:
    """Nobody moves before: a stop that is not acknowledged refuses all motion anyway."""
    watch, twin = monitor(), monitor()
    watch.check_sensors(5.0, SensorStamps(joints=5.0, gripper=5.0, wrench=4.0))
    if acknowledged:
        watch.acknowledge("retreat")
    twin.restore(watch.state())
    for share, fast in ((0.56, False), (0.6, acknowledged), (1.1, acknowledged), (1.2, True)):
        reads(twin, velocity=one(2, share * float(MODEL.velocity_limit[2])))
        assert ("safety.speed_limit" in dict(twin.state().levels)) is fast, share


def test_a_hand_that_weighs_all_that_is_rated_may_carry_nothing() -> None:
    weak = RobotModel(replace(ROBOT, payload=0.9 * MODEL.hand_mass))
    assert payload_limit(weak, SafetyLimits()) == 0.0
    assert payload_limit(weak, SafetyLimits(payload=0.2)) == 0.0
