"""The safety monitor's limits, each from both sides: what trips, what stays tolerated, what is over."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from picktree.robot.control import SafetyMonitor
from picktree.robot.control.safety_monitor import Latch
from picktree.world import Array, Bounds, JointState, Journal, JournalEvent, SensorStamps, Vector3, safety
from picktree.world.scene import SafetyLimits

from .control_cell import HOME, MODEL

PERIOD = 1 / 240
CALM: Vector3 = (0.0, 0.0, 0.0)
STILL = np.zeros(7)
WORKSPACE = Bounds((0.1, -0.5, 0.0), (0.8, 0.6, 1.0))


def monitor() -> SafetyMonitor:
    return SafetyMonitor(MODEL, SafetyLimits(60.0, WORKSPACE), Journal())


def cause(watch: SafetyMonitor) -> str:
    return "" if watch.stopped is None else watch.stopped.cause.name


def retreats(watch: SafetyMonitor) -> None:
    """A retreat acknowledges what stands, and moves."""
    assert watch.acknowledge("retreat")
    watch.moves("retreat")


def one(joint: int, value: float) -> Array:
    return value * np.eye(7)[joint]


def reads(
    watch: SafetyMonitor,
    *,
    position: Array = HOME,
    velocity: Array = STILL,
    effort: Array = STILL,
    commanded: Array | None = None,
    force: Vector3 = CALM,
    seconds: float = PERIOD,
) -> bool:
    """Whether that reading trips the monitor while it lasts."""
    tripped = [
        watch.check(JointState(position, velocity, effort), commanded, force, PERIOD)
        for _ in range(round(seconds / PERIOD))
    ]
    return any(tripped)


def at_limit(joint: int, beyond: float, upper: bool) -> Array:
    q = HOME.copy()
    q[joint] = MODEL.upper[joint] + beyond if upper else MODEL.lower[joint] - beyond
    return q


@pytest.mark.parametrize("upper", [True, False])
@pytest.mark.parametrize("joint", [0, 3, 6])
def test_a_joint_may_be_a_hundredth_beyond_its_limit(joint: int, upper: bool) -> None:
    for beyond, stops in ((0.009, ""), (0.011, "safety.joint_limit")):
        watch = monitor()
        reads(watch, position=at_limit(joint, beyond, upper))
        assert cause(watch) == stops


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_joint_may_be_a_little_faster_than_its_limit(sign: float) -> None:
    for share, stops in ((1.14, ""), (1.16, "safety.speed_limit")):
        watch = monitor()
        reads(watch, velocity=one(2, sign * share * MODEL.velocity_limit[2]))
        assert cause(watch) == stops


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_joint_may_lag_a_little(sign: float) -> None:
    for off, stops in ((0.049, ""), (0.051, "control.tracking")):
        watch = monitor()
        reads(watch, commanded=HOME + one(4, sign * off))
        assert cause(watch) == stops
    watch = monitor()
    reads(watch, position=HOME + one(4, 1.0), commanded=None)  # under torques nothing is commanded
    assert cause(watch) == ""


def test_the_evidence_says_which_joint_and_how() -> None:
    watch = monitor()
    reads(watch, velocity=one(2, 5.0))
    assert watch.stopped is not None
    assert watch.stopped.evidence == {"joint": "panda_joint3", "position": float(HOME[2]), "speed": 5.0}


def test_a_force_may_last_up_to_the_limit() -> None:
    for force, stops in (
        ((0.0, 0.0, 59.9), ""),
        ((0.0, 0.0, -60.1), "safety.force_limit"),
        ((34.0, -34.0, 34.0), ""),
        ((35.0, 35.0, -35.0), "safety.force_limit"),
    ):
        watch = monitor()
        reads(watch, force=force, seconds=1.0)
        assert cause(watch) == stops, force
        assert watch.pressed is bool(stops)
        reads(watch, seconds=1.0)
        assert not watch.pressed


def test_the_force_is_told_as_it_is_felt() -> None:
    watch = monitor()
    reads(watch, force=(0.0, 80.0, 0.0), seconds=0.5)
    assert watch.stopped is not None
    (x, y, z) = watch.stopped.evidence["force"]  # type: ignore[misc]
    assert (x, z) == (0.0, 0.0)
    assert 60.0 < y < 62.5  # type: ignore[operator]
    assert watch.stopped.evidence["limit"] == 60.0


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_tool_stays_in_the_workspace_on_every_side(axis: int) -> None:
    for edge, out in ((WORKSPACE.min[axis], -1.0), (WORKSPACE.max[axis], 1.0)):
        for off, stops in ((-0.001, ""), (0.001, "safety.workspace")):
            at = [0.4, 0.0, 0.5]
            at[axis] = edge + out * off
            watch = monitor()
            assert watch.check_tool((at[0], at[1], at[2])) is bool(stops)
            assert cause(watch) == stops
    assert watch.stopped is not None
    assert watch.stopped.evidence == {"position": at, "axis": "xyz"[axis], "by": 0.001}


@pytest.mark.parametrize(("share", "trips"), [(0.94, False), (0.96, True)])
def test_an_overload_counts_from_near_the_limit_on(share: float, trips: bool) -> None:
    for sign in (1.0, -1.0):
        watch = monitor()
        effort = one(1, sign * share * MODEL.torque_limit[1])
        assert not reads(watch, effort=effort, seconds=0.495)
        assert reads(watch, effort=effort, seconds=0.02) is trips


def test_a_pause_ends_an_overload_and_each_joint_has_its_own() -> None:
    watch = monitor()
    full = [one(n, MODEL.torque_limit[n]) for n in range(3)]
    for joint in (0, 1, 2, 0):
        assert not reads(watch, effort=full[joint], seconds=0.4)
    assert reads(watch, effort=full[0], seconds=0.2)
    assert watch.stopped is not None
    limit = float(MODEL.torque_limit[0])
    assert watch.stopped.evidence == {"joint": "panda_joint1", "effort": limit, "limit": limit}


Violation = Callable[[SafetyMonitor, float], object]


def pressed(watch: SafetyMonitor, by: float) -> object:
    return reads(watch, force=(0.0, 0.0, 60.0 + by), seconds=2.0)


def outside(watch: SafetyMonitor, by: float) -> object:
    return watch.check_tool((0.8 + by, 0.0, 0.5))


def beyond(watch: SafetyMonitor, by: float) -> object:
    return reads(watch, position=at_limit(2, 0.01 + by, True))


def hurries(watch: SafetyMonitor, by: float) -> object:
    return reads(watch, velocity=one(2, 1.15 * MODEL.velocity_limit[2] + by))


def lags(watch: SafetyMonitor, by: float) -> object:
    return reads(watch, commanded=HOME + one(4, 0.05 + by))


def strains(watch: SafetyMonitor, by: float) -> object:
    """`by`: share of the limit."""
    return reads(watch, effort=one(1, (0.95 + by) * MODEL.torque_limit[1]), seconds=0.6)


def unexplained(watch: SafetyMonitor, by: float) -> object:
    left = one(3, -(0.15 + by) * MODEL.torque_limit[3])
    return [watch.check_efforts(watch.explained(left, 0.05)) for _ in range(60)]


def carries(watch: SafetyMonitor, by: float) -> object:
    return watch.check_load(watch.most_load + 0.1 + by)


def falls_silent(watch: SafetyMonitor, by: float) -> object:
    return watch.check_sensors(2.0, SensorStamps(2.0, 2.0, 1.0))


SLACKS = [
    (pressed, "safety.force_limit", 5.0, 20.0),
    (outside, "safety.workspace", 0.005, 0.05),
    (beyond, "safety.joint_limit", 0.01, 0.1),
    (hurries, "safety.speed_limit", 0.01, 0.1),
    (lags, "control.tracking", 0.01, 0.1),
    (strains, "safety.torque_limit", 0.1, 0.3),
    (unexplained, "safety.torque_limit", 0.1, 0.3),
    (carries, "safety.payload", 0.1, 0.5),
]


@pytest.mark.parametrize(("violate", "name", "slack", "level"), SLACKS)
def test_what_was_acknowledged_may_grow_by_its_slack(
    violate: Violation, name: str, slack: float, level: float
) -> None:
    for grown, stops in ((0.95, ""), (1.05, name)):
        watch = monitor()
        violate(watch, level)
        assert cause(watch) == name
        retreats(watch)
        violate(watch, level)
        assert cause(watch) == ""
        violate(watch, level + grown * slack)
        assert cause(watch) == stops
        assert watch.stops == (2 if stops else 1)


@pytest.mark.parametrize(("violate", "name", "slack", "level"), SLACKS)
def test_what_was_acknowledged_is_measured_by_its_least(
    violate: Violation, name: str, slack: float, level: float
) -> None:
    """What has shrunk must not grow back to what it was."""
    watch = monitor()
    violate(watch, level)
    retreats(watch)
    violate(watch, level / 20)
    assert cause(watch) == ""
    violate(watch, level / 20 + 1.05 * slack)
    assert cause(watch) == name


@pytest.mark.parametrize(
    ("violate", "name", "slack", "level"), [s for s in SLACKS if s[0] not in (unexplained, carries)]
)
def test_what_was_acknowledged_is_over_once_it_is_undercut(
    violate: Violation, name: str, slack: float, level: float
) -> None:
    """A hair within it is not over yet: it may flicker on the way out."""
    for within, stops in ((0.95, ""), (1.05, name)):
        watch = monitor()
        violate(watch, level)
        retreats(watch)
        violate(watch, -within * slack)
        assert cause(watch) == ""
        violate(watch, 0.5 * slack)
        assert cause(watch) == stops


@pytest.mark.parametrize("violate", [unexplained, carries])
def test_what_has_no_slack_is_over_at_once(violate: Violation) -> None:
    watch = monitor()
    violate(watch, 0.3)
    retreats(watch)
    violate(watch, -0.02)
    assert cause(watch) == ""
    violate(watch, 0.02)
    assert cause(watch) != ""


def test_for_another_what_stands_stops_at_once_and_what_is_over_does_not() -> None:
    watch = monitor()
    outside(watch, 0.05)
    watch.acknowledge("retreat")
    watch.moves("Main/Grasp")
    assert cause(watch) == "safety.workspace"
    assert watch.stops == 2
    watch.acknowledge("retreat")
    outside(watch, -0.05)
    watch.moves("Main/Grasp")
    assert cause(watch) == ""


def test_a_mean_of_what_is_not_explained_rises_with_its_time_constant() -> None:
    """After 0.1 s half of it counts, and what stands for an instant only does not."""
    limit = MODEL.torque_limit
    for share, explained in ((0.29, True), (0.31, False)):
        watch = monitor()
        assert watch.explained(one(2, share * limit[2]), 0.1) is explained
    watch = monitor()
    # In all of them together more, in none of them enough.
    assert watch.explained(0.29 * limit, 0.1)
    assert not watch.explained(0.29 * limit, 0.1)
    watch.forget_efforts()
    assert watch.explained(0.29 * limit, 0.1)
    assert not watch.check_efforts(True)


def test_a_tenth_of_a_kilogram_more_than_allowed_is_no_burden() -> None:
    watch = monitor()
    for more, too_much in ((0.099, False), (0.101, True)):
        assert watch.overburdened(watch.most_load + more) is too_much
        assert watch.check_load(watch.most_load + more) is too_much
    assert watch.stopped is not None
    assert watch.stopped.evidence == {
        "mass": round(watch.most_load + 0.101, 3),
        "limit": round(watch.most_load, 3),
    }


def test_the_wrist_may_repeat_itself_for_a_tenth_of_a_second() -> None:
    for since, dead in ((4.901, False), (4.899, True)):
        assert monitor().check_sensors(5.0, SensorStamps(5.0, 5.0, 5.0), repeats_since=since) is dead


def test_after_a_silence_of_the_wrist_the_full_speed_is_allowed_again() -> None:
    fast = one(2, 0.6 * MODEL.velocity_limit[2])
    watch, twin = monitor(), monitor()
    falls_silent(watch, 0.0)
    watch.acknowledge("retreat")
    assert watch.blind
    twin.restore(watch.state())
    for blind in (watch, twin):
        blind.moves("retreat")
        blind.check_sensors(2.0, SensorStamps(2.0, 2.0, 1.0))  # it still is
        assert not reads(blind, velocity=one(2, 0.57 * MODEL.velocity_limit[2]))
        assert reads(blind, velocity=fast)
        blind.acknowledge("retreat")
        blind.check_sensors(2.1, SensorStamps(2.1, 2.1, 2.1))
        assert not blind.blind
        assert not reads(blind, velocity=fast)
    for stops, speaks in ((outside, False), (falls_silent, True)):
        other = monitor()
        stops(other, 0.1)
        retreats(other)
        if speaks:
            other.check_sensors(2.1, SensorStamps(2.1, 2.1, 2.1))
        assert not reads(other, velocity=fast), "nothing but a silent wrist makes a retreat slow"


def test_without_a_sign_of_life_whoever_moves_the_arm_is_named() -> None:
    watch = monitor()
    watch.unattended("", "Track", 0.25)
    assert watch.stopped is not None
    assert watch.stopped.message == ("somebody moves the arm (Track), but has not looked after it for 0.25 s")
    assert watch.stopped.evidence == {"owner": "", "controller": "Track", "seconds": 0.25}
    watch.acknowledge("retreat")
    watch.moves("Main/Grasp")  # who begins anew has given a sign
    assert cause(watch) == ""


def test_encoders_of_before_say_nothing_of_the_joints() -> None:
    for age, stops in ((1.4 * PERIOD, "control.tracking"), (1.6 * PERIOD, "")):
        watch = monitor()
        watch.age_of_joints(lambda age=age: age)
        reads(watch, commanded=HOME + 0.2)
        assert cause(watch) == stops


def test_all_of_it_is_saved_and_restored() -> None:
    watch = monitor()
    reads(watch, force=(0.0, 0.0, 75.0), seconds=0.3)
    reads(watch, effort=one(1, MODEL.torque_limit[1]), seconds=0.4)
    watch.explained(one(3, 20.0), 0.1)
    twin = monitor()
    twin.restore(watch.state())
    assert twin.state() == watch.state()
    assert (twin.stops, twin.stopped, twin.pressed) == (1, watch.stopped, watch.pressed)
    for each in (watch, twin):
        each.acknowledge("retreat")
    assert twin.state() == watch.state()
    for each in (watch, twin):
        assert reads(each, effort=one(1, MODEL.torque_limit[1]), seconds=0.2)
    old = replace(watch.state(), overloaded=(), unexplained=())
    twin.restore(old)
    assert twin.state().overloaded == twin.state().unexplained == (0.0,) * 7
    pressed(watch, 20.0)
    twin.restore(watch.state())
    assert twin.pressed
    twin.restore(monitor().state())
    assert (twin.state(), twin.pressed) == (monitor().state(), False)


def test_the_first_violation_is_latched_and_told_once() -> None:
    journal = Journal()
    latch = Latch(journal)
    for level in (1.0, 2.0):
        latch.violated("a", safety.WORKSPACE, level, 0.1, f"a by {level}", at=[1.0, 2.0], by="x")
    latch.violated("b", safety.FORCE_LIMIT, 1.0, 0.1, "b")
    assert latch.stopped is not None
    assert (latch.stopped.message, latch.stops) == ("a by 1.0", 1)
    assert (latch.take_fresh(), latch.take_fresh()) == (True, False)
    assert [(e.kind, e.message, e.data) for e in journal.take() if isinstance(e, JournalEvent)] == [
        ("safety_stop", "a by 1.0", {"cause": "safety.workspace", "at": [1.0, 2.0], "by": "x"})
    ]
    assert latch.busy and latch.is_violated("a") and latch.is_violated("b") and not latch.tolerates("a")
    latch.acknowledge("retreat")
    assert latch.tolerates("a") and latch.tolerates("b") and latch.stopped is None
    latch.within("b", 1.0, 0.1)
    assert not latch.is_violated("b") and not latch.tolerates("b")
    latch.moves("other")
    assert latch.stopped.message == "a by 2.0"
    assert not latch.tolerates("a")
    assert latch.stops == 2


def test_what_was_acknowledged_when_nothing_was_latched_is_not_tolerated() -> None:
    latch = Latch(Journal())
    latch.acknowledge("retreat")
    assert not latch.busy
    latch.violated("a", safety.WORKSPACE, 1.0, 0.1, "a")
    assert latch.stopped is not None


def test_a_level_that_is_exactly_at_the_slack_is_tolerated() -> None:
    latch = Latch(Journal())
    latch.violated("a", safety.WORKSPACE, 1.0, 0.5, "a")
    latch.acknowledge("retreat")
    latch.violated("a", safety.WORKSPACE, 1.5, 0.5, "a")
    assert latch.stopped is None
    latch.violated("a", safety.WORKSPACE, math.nextafter(1.5, 2.0), 0.5, "a")
    assert latch.stopped is not None
