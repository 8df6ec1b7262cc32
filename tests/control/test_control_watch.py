"""What else the safety monitor watches: sensors, ticks, torques and load; and for whom a stop is let off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.robot.control import Payload, SafetyMonitor
from picktree.robot.control.external_torque import EffortCheck
from picktree.robot.control.joint_controllers import TrajectoryController
from picktree.robot.control.safety_monitor import payload_limit
from picktree.simulation import FaultInjector, parse_faults
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Array, Failure, JointState, Journal, JournalEvent, SensorStamps, Wrench
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.scene import SafetyLimits

from .control_cell import HOME, MODEL, TICK, Backend, Cell, swing

PERIOD = 1 / 240
CALM = (0.0, 0.0, 0.0)
ASIDE = HOME + 0.3
STILL = np.zeros(7)


def monitor(**limits: float) -> SafetyMonitor:
    return SafetyMonitor(MODEL, replace(SafetyLimits(), **limits), Journal())


def said(watch: SafetyMonitor) -> str:
    assert watch.stopped is not None
    return f"{watch.stopped.cause}: {watch.stopped.message}"


def stamps(now: float, **old: float) -> SensorStamps:
    return replace(SensorStamps(now, now, now), **old)


@pytest.mark.parametrize(
    ("sensor", "longest", "words"),
    [
        ("joints", 0.05, "the encoders of the joints have given no new reading since 2.00 s"),
        ("gripper", 0.5, "the gripper has given no new reading since 2.00 s"),
        ("wrench", 0.1, "the wrist sensor has given no new reading since 2.00 s"),
    ],
)
def test_a_silent_sensor_stops_after_its_own_time(sensor: str, longest: float, words: str) -> None:
    watch = monitor()
    assert not watch.check_sensors(1.999 + longest, stamps(9.0, **{sensor: 2.0}))
    assert watch.check_sensors(2.001 + longest, stamps(9.0, **{sensor: 2.0}))
    assert said(watch) == f"safety.stale_sensor: {words}"
    assert watch.stopped is not None
    assert watch.stopped.evidence == {"sensor": sensor, "since": 2.0, "longest": longest}


def test_a_wrist_that_repeats_itself_although_it_is_noisy_is_dead() -> None:
    watch = monitor()
    assert not watch.check_sensors(5.0, stamps(5.0), repeats_since=4.95)
    assert watch.check_sensors(5.0, stamps(5.0), repeats_since=4.5)
    assert said(watch) == (
        "safety.stale_sensor: the wrist sensor has repeated itself bit by bit since 4.50 s"
    )


def test_silent_encoders_cannot_be_acknowledged_and_say_nothing_of_where_the_arm_is() -> None:
    watch = monitor()
    watch.age_of_joints(lambda: 0.04)
    far = JointState(HOME + 0.2, STILL, STILL)
    assert not watch.check(far, HOME, CALM, PERIOD)  # what they say is old: no control.tracking
    watch.check_sensors(2.1, stamps(2.1, joints=2.0))
    assert not watch.acknowledge("retreat")
    assert watch.stopped is not None
    watch.check_sensors(2.2, stamps(2.2))
    assert watch.acknowledge("retreat")
    assert watch.stopped is None


def test_a_silent_wrist_lets_only_the_retreat_move_and_only_slowly() -> None:
    watch = monitor()

    def silent(now: float) -> bool:
        return watch.check_sensors(now, stamps(now, wrench=1.0))

    assert silent(2.0)
    assert watch.acknowledge("Main/SafeRetreat")
    watch.moves("Main/SafeRetreat")
    assert not silent(3.0) and watch.stopped is None and watch.blind
    fast = JointState(HOME, 0.7 * MODEL.velocity_limit, STILL)
    assert not watch.check(JointState(HOME, 0.5 * MODEL.velocity_limit, STILL), None, CALM, PERIOD)
    assert watch.check(fast, None, CALM, PERIOD)
    assert watch.stopped is not None and watch.stopped.cause.name == "safety.speed_limit"
    watch.acknowledge("Main/SafeRetreat")
    watch.moves("Main/Grasp")
    assert said(watch) == "safety.stale_sensor: the wrist sensor has given no new reading since 1.00 s"
    watch.check_sensors(4.0, stamps(4.0))
    watch.check(JointState(HOME, STILL, STILL), None, CALM, PERIOD)
    watch.acknowledge("Main/SafeRetreat")
    watch.moves("Main/Grasp")
    assert watch.stopped is None and not watch.blind
    assert not watch.check(fast, None, CALM, PERIOD)


def test_a_joint_may_be_overloaded_for_a_moment_only() -> None:
    watch = monitor()
    heavy = JointState(HOME, STILL, np.array([0.0, 86.0, 0, 0, 0, 0, 0]))
    tripped = [watch.check(heavy, HOME, CALM, PERIOD) for _ in range(118)]
    assert not any(tripped)
    assert not watch.check(JointState(HOME, STILL, STILL), HOME, CALM, PERIOD)
    tripped = [watch.check(heavy, HOME, CALM, PERIOD) for _ in range(124)]
    assert tripped.count(True) == 1
    assert said(watch) == (
        "safety.torque_limit: panda_joint2 has exerted 86.0 Nm for 0.5 s, of 87 Nm that it bears"
    )


def test_effort_that_nothing_explains_stops_when_it_lasts() -> None:
    watch = monitor()
    left = np.array([0.0, 0.0, 0.0, -30.0, 0.0, 0.0, 0.0])
    stopped = [watch.check_efforts(watch.explained(left, 0.05)) for _ in range(6)]
    assert stopped == [False, True, False, False, False, False]
    assert watch.stopped is not None
    assert watch.stopped.evidence["joint"] == "panda_joint4"
    assert said(watch).endswith(
        "that neither its motion nor what the wrist feels explains, more than 13.0 Nm"
    )


def test_what_the_hand_may_carry_is_what_the_rated_payload_leaves_or_the_scene_less() -> None:
    left = 3.0 - MODEL.hand_mass
    assert payload_limit(MODEL, SafetyLimits()) == pytest.approx(left)
    assert payload_limit(MODEL, SafetyLimits(payload=0.5)) == 0.5
    assert payload_limit(RobotModel(replace(load_robot("panda"), payload=None)), SafetyLimits()) == float(
        "inf"
    )
    assert [load_robot(name).payload for name in ("panda", "iiwa", "xarm6")] == [3.0, 14.0, 5.0]
    watch = monitor(payload=0.5)
    assert not watch.check_load(0.59)
    assert watch.check_load(0.8)
    assert said(watch) == "safety.payload: the hand carries 0.80 kg, more than the 0.50 kg that it may"
    watch.acknowledge("retreat")
    watch.moves("retreat")
    assert not watch.check_load(0.85)
    assert watch.check_load(0.95)  # it grows
    watch.acknowledge("retreat")
    watch.check_load(0.0)
    watch.moves("other")
    assert watch.stopped is None


def efforts(q: Array, push: Array, load: float = 0.0) -> tuple[JointState, Wrench]:
    """What joints and wrist say at rest when `push` (3,) acts on the hand at the sensor, and a load hangs."""
    force = push - np.array([0.0, 0.0, 9.81 * load])
    jacobian = _at_flange(q)
    lever = MODEL.flange(q).rotation() @ np.array(MODEL.hand_com)
    weight = np.array([0.0, 0.0, -9.81 * MODEL.hand_mass])
    wrench = np.concatenate([weight + force, np.cross(lever, weight)])
    held = MODEL.gravity(q) - jacobian[:3].T @ force
    fx, fy, fz, tx, ty, tz = wrench.tolist()
    return JointState(q, STILL, held), Wrench((fx, fy, fz), (tx, ty, tz))


def _at_flange(q: Array) -> Array:
    """(6, n) by finite differences of the flange's position; the turning part is not needed."""
    rows = np.zeros((6, 7))
    for k in range(7):
        step = np.zeros(7)
        step[k] = 1e-6
        ahead, behind = MODEL.flange(q + step).position, MODEL.flange(q - step).position
        rows[:3, k] = np.subtract(ahead, behind) / 2e-6
    return rows


def test_load_and_contact_at_the_hand_are_explained_and_a_push_at_the_arm_is_not() -> None:
    judge = EffortCheck(MODEL)
    for push, load in (([0.0, 0.0, 0.0], 0.0), ([5.0, -20.0, 12.0], 0.0), ([0.0, 0.0, 0.0], 2.5)):
        state, wrench = efforts(ASIDE, np.array(push), load)
        assert np.abs(judge.unexplained(state, STILL, wrench)).max() < 1e-4
    pushed = JointState(state.position, STILL, state.effort + np.array([0, 20.0, 0, 0, 0, 0, 0]))
    assert judge.unexplained(pushed, STILL, wrench) == pytest.approx([0, 20, 0, 0, 0, 0, 0], abs=1e-4)


def test_in_motion_it_is_newton_and_euler_that_explain() -> None:
    judge, rng = EffortCheck(MODEL), np.random.default_rng(5)
    v, a = rng.normal(size=7), rng.normal(size=7)
    light = Wrench()  # the wrist feels nothing: no hand
    bare = judge.unexplained(JointState(ASIDE, v, STILL), a, light)
    slower = judge.unexplained(JointState(ASIDE, 0.0 * v, STILL), 0.0 * a, light)
    assert np.abs(bare - slower).max() > 1.0
    again = judge.unexplained(JointState(ASIDE, v, -bare), a, light)
    assert np.abs(again).max() < 1e-9


def test_the_joints_believe_a_push_and_not_a_bias() -> None:
    judge = EffortCheck(MODEL)
    push = np.array([4.0, -3.0, 8.0])
    claimed = np.concatenate([push, np.zeros(3)])
    touched, _ = efforts(ASIDE, push)
    free, _ = efforts(ASIDE, np.zeros(3))
    assert judge.believes(touched, claimed, np.zeros(6))
    assert not judge.believes(free, claimed, np.zeros(6))


def test_a_motion_that_nobody_looks_after_is_braked_and_latched() -> None:
    cell = Cell()
    lease = cell.loop.acquire("Main/Lost")
    track = TrajectoryController(swing(HOME, ASIDE, 3.0), MODEL, cell.loop.period)
    lease.run(track)
    for _ in range(10):
        assert lease.valid
        cell.loop.step_tick(TICK)
    assert cell.monitor.stopped is None
    for _ in range(4):
        cell.loop.step_tick(TICK)
    assert cell.monitor.stopped is None
    cell.loop.step_tick(TICK)
    assert said(cell.monitor) == (
        "safety.watchdog: Main/Lost moves the arm (Track), but has not looked after it for 0.25 s"
    )
    cell.rest()
    assert track.braking and 0.7 < track.progress < 1.6
    with pytest.raises(Failure, match=r"^safety.stop: a safety stop is not acknowledged: Main/Lost moves"):
        cell.run(cell.move.along(swing(cell.loop.held_position, HOME)))
    cell.monitor.acknowledge()
    cell.run(cell.move.along(swing(cell.loop.held_position, HOME)))
    assert cell.monitor.stops == 1


class Wrist:
    """The wrist sensor of a cell with noise, which may die, or be off by a force."""

    def __init__(self, cell: Cell) -> None:
        self._read: Callable[[], Wrench] = cell.hardware.wrench.read
        self._rng = np.random.default_rng(2)
        self.off, self.dead = np.zeros(3), False
        self._last = Wrench()

    def read(self) -> Wrench:
        if not self.dead:
            true = self._read()
            x, y, z = (np.array(true.force) + self.off + 0.1 * self._rng.standard_normal(3)).tolist()
            self._last = Wrench((x, y, z), true.torque)
        return self._last


def noisy_cell(backend: Backend = KinematicHardware) -> tuple[Cell, Wrist]:
    cell = Cell(backend=backend)
    wrist = Wrist(cell)
    cell.loop.wrist._sensor = wrist  # pyright: ignore[reportPrivateUsage]
    for _ in range(10):
        cell.loop.step_tick(TICK)
    assert cell.loop.wrist.noisy
    return cell, wrist


def test_a_wrist_that_dies_on_the_way_brakes_the_arm_and_refuses_motions_by_feel() -> None:
    cell, wrist = noisy_cell()
    moving = cell.move.along(swing(HOME, ASIDE, 2.0), node="Main/GoTo")
    cell.ticks(moving, 10)
    wrist.dead = True
    with pytest.raises(Failure, match=r"^safety.stale_sensor: the wrist sensor has repeated itself bit by"):
        cell.run(moving)
    cell.monitor.acknowledge("Main/SafeRetreat")
    cell.run(cell.move.rest())
    with pytest.raises(Failure, match=r"^safety.stale_sensor: a motion by feel is refused: the wrist sensor"):
        cell.run(cell.move.guarded((0, 0, -1), 0.02, force=3.0, speed=0.02, node="Main/SafeRetreat"))
    back = swing(cell.loop.held_position, HOME, 3.0)
    cell.run(cell.move.along(back, node="Main/SafeRetreat"))
    with pytest.raises(Failure, match=r"^safety.stale_sensor: the wrist sensor has repeated itself"):
        cell.run(cell.move.along(swing(cell.loop.held_position, ASIDE, 3.0), node="Main/GoTo"))
    assert np.abs(cell.loop.state.position - HOME).max() < 0.01


def test_a_bias_that_has_jumped_is_learnt_anew_where_no_joint_carries_it() -> None:
    cell, wrist = noisy_cell()
    wrist.off = np.array([0.0, 18.0, -9.0])
    for _ in range(10):
        cell.loop.step_tick(TICK)
    assert cell.loop.wrist.force[1] == pytest.approx(18.0, abs=0.6)
    assert cell.loop.zero()
    assert np.abs(cell.loop.wrist.force).max() < 1.0
    events = [e for e in cell.journal.take() if isinstance(e, JournalEvent) and e.kind == "wrist_bias"]
    assert [e.message[:34] for e in events] == ["the wrist felt 20.1 N that no join"]


def test_what_is_read_without_a_bias_that_was_learnt_anew_is_the_weight_of_the_hand() -> None:
    cell, wrist = noisy_cell()
    wrist.off = np.array([0.0, 18.0, -9.0])
    for _ in range(10):
        cell.loop.step_tick(TICK)
    assert cell.loop.zero()
    read = cell.loop.wrist.unbiased(MODEL.tcp(HOME).rotation())
    assert read.force == pytest.approx((0.0, 0.0, -MODEL.hand_mass * 9.81), abs=1.0)
    assert cell.loop.wrist.latest.force[1] == pytest.approx(18.0, abs=1.0)


def test_a_bias_that_jumps_under_a_load_is_told_from_the_load() -> None:
    cell, wrist = noisy_cell(PhysicsHardware)
    cell.loop.wrist.carry(Payload(0.1, 0.01))
    load = cell.loop.load()
    wrist.off = np.array([0.0, 0.0, -26.0])
    for _ in range(10):
        cell.loop.step_tick(TICK)
    assert cell.loop.monitor.stopped is None
    (event,) = [e for e in cell.journal.take() if isinstance(e, JournalEvent) and e.kind == "wrist_bias"]
    assert "its bias has jumped" in event.message
    assert cell.loop.load() == pytest.approx(load, abs=1.5)


def test_drives_that_stand_still_all_at_once_are_no_contact() -> None:
    cell = Cell(backend=PhysicsHardware)
    for _ in range(10):
        cell.loop.step_tick(TICK)
    entry = "picktree: 1\nkind: faults\nfaults:\n  - {fault: stall, when: {at: 0}, lasts: 2 s}\n"
    assert isinstance(cell.hardware, PhysicsHardware)
    injector = FaultInjector(parse_faults(entry, Path("faults.yaml")), cell.hardware, seed=1)
    moving = cell.move.along(swing(HOME, ASIDE, 1.0), node="Main/GoTo", guard=15.0)
    cell.ticks(moving, 10)
    injector.tick()
    with pytest.raises(Failure, match=r"^control.tracking: "):
        cell.run(moving)
