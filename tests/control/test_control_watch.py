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
from picktree.world import Array, Failure, JointState, Journal, SensorStamps, Wrench
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.scene import SafetyLimits

from .control_cell import HOME, MODEL, TICK, Backend, Cell, swing
from .scripted_cell import ASIDE, STILL, flange_jacobian


def said(watch: SafetyMonitor) -> str:
    assert watch.stopped is not None
    return f"{watch.stopped.cause}: {watch.stopped.message}"


@pytest.mark.parametrize(
    ("sensor", "longest", "words"),
    [
        ("joints", 0.05, "the encoders of the joints have given no new reading since 2.00 s"),
        ("gripper", 0.5, "the gripper has given no new reading since 2.00 s"),
        ("wrench", 0.1, "the wrist sensor has given no new reading since 2.00 s"),
    ],
)
def test_a_silent_sensor_stops_after_its_own_time(sensor: str, longest: float, words: str) -> None:
    watch = SafetyMonitor(MODEL, SafetyLimits(), Journal())
    stamps = replace(SensorStamps(9.0, 9.0, 9.0), **{sensor: 2.0})
    assert not watch.check_sensors(1.999 + longest, stamps)
    assert watch.check_sensors(2.001 + longest, stamps)
    assert said(watch) == f"safety.stale_sensor: {words}"
    assert watch.stopped is not None
    assert watch.stopped.evidence == {"sensor": sensor, "since": 2.0, "longest": longest}


def test_what_the_hand_may_carry_is_what_the_rated_payload_leaves_or_the_scene_less() -> None:
    unrated = RobotModel(replace(load_robot("panda"), payload=None))
    assert payload_limit(MODEL, SafetyLimits()) == pytest.approx(3.0 - MODEL.hand_mass)
    assert payload_limit(MODEL, SafetyLimits(payload=0.5)) == 0.5
    assert payload_limit(unrated, SafetyLimits()) == float("inf")
    assert [load_robot(name).payload for name in ("panda", "iiwa", "xarm6")] == [3.0, 14.0, 5.0]


def efforts(q: Array, push: Array, load: float = 0.0) -> tuple[JointState, Wrench]:
    """What joints and wrist say at rest when `push` (3,) acts on the hand at the sensor, and a load hangs."""
    force = push - np.array([0.0, 0.0, 9.81 * load])
    lever = MODEL.flange(q).rotation() @ np.array(MODEL.hand_com)
    weight = np.array([0.0, 0.0, -9.81 * MODEL.hand_mass])
    wrench = np.concatenate([weight + force, np.cross(lever, weight)])
    held = MODEL.gravity(q) - flange_jacobian(q)[:3].T @ force
    fx, fy, fz, tx, ty, tz = wrench.tolist()
    return JointState(q, STILL, held), Wrench((fx, fy, fz), (tx, ty, tz))


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


def test_a_motion_that_nobody_looks_after_is_braked_and_latched() -> None:
    cell = Cell()
    lease = cell.loop.acquire("Main/Lost")
    track = TrajectoryController(swing(HOME, ASIDE, 3.0), MODEL, cell.loop.period)
    lease.run(track)
    for _ in range(10):
        assert lease.valid
        tick(cell, 1)
    tick(cell, 4)
    assert cell.monitor.stopped is None
    tick(cell, 1)
    assert said(cell.monitor) == (
        "safety.watchdog: Main/Lost moves the arm (Track), but has not looked after it for 0.25 s"
    )
    assert cell.monitor.stopped is not None
    assert cell.monitor.stopped.evidence["seconds"] == 0.25
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
    tick(cell)
    assert cell.loop.wrist.noisy
    return cell, wrist


def tick(cell: Cell, count: int = 10) -> None:
    for _ in range(count):
        cell.loop.step_tick(TICK)


def told_of_bias(cell: Cell) -> list[str]:
    return [entry.message for entry in cell.events() if entry.kind == "wrist_bias"]


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
    """What is read without it is the weight of the hand."""
    cell, wrist = noisy_cell()
    wrist.off = np.array([0.0, 18.0, -9.0])
    tick(cell)
    assert cell.loop.wrist.force[1] == pytest.approx(18.0, abs=0.6)
    assert cell.loop.zero()
    assert np.abs(cell.loop.wrist.force).max() < 1.0
    (message,) = told_of_bias(cell)
    assert message.startswith("the wrist felt 20.1 N that no join")
    read = cell.loop.wrist.unbiased(MODEL.tcp(HOME).rotation())
    assert read.force == pytest.approx((0.0, 0.0, -MODEL.hand_mass * 9.81), abs=1.0)
    assert cell.loop.wrist.latest.force[1] == pytest.approx(18.0, abs=1.0)


def test_a_bias_that_jumps_under_a_load_is_told_from_the_load() -> None:
    cell, wrist = noisy_cell(PhysicsHardware)
    cell.loop.wrist.carry(Payload(0.1, 0.01))
    load = cell.loop.load()
    wrist.off = np.array([0.0, 0.0, -26.0])
    tick(cell)
    assert cell.loop.monitor.stopped is None
    (message,) = told_of_bias(cell)
    assert "its bias has jumped" in message
    assert cell.loop.load() == pytest.approx(load, abs=1.5)


def test_drives_that_stand_still_all_at_once_are_no_contact() -> None:
    cell = Cell(backend=PhysicsHardware)
    tick(cell)
    entry = "picktree: 1\nkind: faults\nfaults:\n  - {fault: stall, when: {at: 0}, lasts: 2 s}\n"
    assert isinstance(cell.hardware, PhysicsHardware)
    injector = FaultInjector(parse_faults(entry, Path("faults.yaml")), cell.hardware, seed=1)
    moving = cell.move.along(swing(HOME, ASIDE, 1.0), node="Main/GoTo", guard=15.0)
    cell.ticks(moving, 10)
    injector.tick()
    with pytest.raises(Failure, match=r"^control.tracking: "):
        cell.run(moving)
