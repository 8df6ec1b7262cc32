"""Devices of the simulation fail when a fault says so, work again when it is over, and go on so in a resumed
run."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from picktree.simulation import Backend, FaultInjector, build_hardware, parse_faults
from picktree.simulation.checkpoints import KinematicState
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware
from picktree.world import GripperCommand, NoImage, Pose, RgbdImage

from .simulated_cell import cell, panda

BOTH = pytest.mark.parametrize("backend", ["kinematic", "physics"])
Cell = tuple[KinematicHardware | PhysicsHardware, FaultInjector]


def failing(backend: Backend, *entries: str) -> Cell:
    """A cell in which this goes wrong."""
    hardware = build_hardware(backend, cell(), panda(), 1)
    assert isinstance(hardware, KinematicHardware | PhysicsHardware)
    return hardware, FaultInjector(faults(entries), hardware, seed=1)


def faults(entries: Iterable[str]):
    text = "picktree: 1\nkind: faults\nfaults:\n" + "".join(f"  - {{{entry}}}\n" for entry in entries)
    return parse_faults(text, Path("faults.yaml"))


def told(running: Cell, ticks: int = 1) -> list[str]:
    """What the record says in so many ticks."""
    hardware, injector = running
    said: list[str] = []
    for _ in range(ticks):
        for _ in range(12):
            hardware.step()
        said += [happened.message for happened in injector.tick()]
    return said


def seen(running: Cell) -> RgbdImage:
    return running[0].cameras["overhead"].capture()


@BOTH
def test_a_wrist_sensor_is_off_and_falls_silent(backend: Backend) -> None:
    running = failing(
        backend,
        "fault: wrench_bias, when: {at: 50 ms}, force: [0, 0, 8 N], lasts: 100 ms",
        "fault: wrench_dead, when: {at: 200 ms}, lasts: 100 ms",
    )
    hardware = running[0]
    before = hardware.wrench.read().force[2]
    assert told(running) == ["the wrist sensor is off by 8 N, for 0.1 s"]
    assert hardware.wrench.read().force[2] - before == pytest.approx(-8.0, abs=1.0)  # it looks down
    assert told(running, 2) == ["the wrist sensor is right again"]
    assert hardware.wrench.read().force[2] == pytest.approx(before, abs=1.0)
    assert told(running) == ["the wrist sensor falls silent, for 0.1 s"]
    last, stamp = hardware.wrench.read(), hardware.stamps
    assert told(running) == []
    assert hardware.wrench.read() == last
    assert (hardware.stamps.wrench, hardware.stamps.joints) == (stamp.wrench, pytest.approx(0.25))
    assert told(running) == ["the wrist sensor speaks again"]
    assert hardware.stamps.wrench == hardware.stamps.joints


@BOTH
def test_fingers_jam_and_lose_force(backend: Backend) -> None:
    running = failing(
        backend,
        "fault: gripper_jam, when: {at: 200 ms}, lasts: 500 ms",
        "fault: gripper_weak, when: {at: 700 ms}, share: 10 %",
    )
    gripper = running[0].gripper
    gripper.command(GripperCommand(0.0, 40.0))
    assert told(running, 4) == ["the fingers jam 40 mm open, for 0.5 s"]
    gripper.command(GripperCommand(0.08, 40.0))
    assert told(running, 9) == []
    assert gripper.read().width == pytest.approx(0.04, abs=0.0015)
    assert told(running) == ["the fingers move again", "the gripper has 10% of its force"]
    assert told(running, 8) == []
    assert gripper.read().width == pytest.approx(0.08, abs=0.001)


@BOTH
def test_a_weak_joint_sags_and_comes_back(backend: Backend) -> None:
    running = failing(
        backend, "fault: joint_weak, when: {at: 50 ms}, joint: panda_joint4, share: 10 %, lasts: 400 ms"
    )
    arm = running[0].arm
    home = arm.read().position
    arm.follow(home, np.zeros(7))
    assert told(running, 8) == ["panda_joint4 has 10% of its torque, for 0.4 s"]
    sagged = arm.read().position - home
    assert np.argmax(np.abs(sagged)) == 3
    assert sagged[3] < -0.1
    assert abs(arm.read().effort[3]) == pytest.approx(8.7, abs=0.5)
    assert told(running, 20) == ["panda_joint4 has all its torque again"]
    assert abs(arm.read().position[3] - home[3]) < 5e-3


@BOTH
def test_stalled_drives_stand_where_they_are(backend: Backend) -> None:
    running = failing(backend, "fault: stall, when: {at: 100 ms}, lasts: 200 ms")
    hardware = running[0]
    home, rate = hardware.arm.read().position, np.array([0.5, *[0.0] * 6])
    for n in range(1, 48):
        hardware.arm.follow(home + rate * n / 240, rate)
        hardware.step()
        if n % 12 == 0:
            running[1].tick()
    assert hardware.arm.read().position[0] - home[0] == pytest.approx(0.05, abs=2e-3)
    assert told(running, 3)[-1:] == ["the arm's drives take commands again"]
    for _ in range(60):
        hardware.arm.follow(home, np.zeros(7))
        hardware.step()
    assert np.abs(hardware.arm.read().position - home).max() < 2e-3


@BOTH
def test_images_do_not_come(backend: Backend) -> None:
    running = failing(backend, "fault: camera_drop, when: {at: 50 ms}, camera: overhead, images: 2")
    assert told(running) == ["no image comes from overhead, 2 images long"]
    for _ in range(2):
        with pytest.raises(NoImage, match="overhead gave no image"):
            seen(running)
    assert seen(running).stamp == pytest.approx(0.05)
    assert told(running) == ["images come from overhead again"]


@BOTH
def test_a_camera_is_knocked_noisy_and_mistaken(backend: Backend) -> None:
    running = failing(
        backend,
        "fault: camera_shift, when: {at: 50 ms}, shift: [30 mm, 0, 0], lasts: 50 ms",
        "fault: camera_noise, when: {at: 100 ms}, factor: 30, lasts: 50 ms",
        "fault: camera_mislabel, when: {at: 150 ms}, colour: red, shown_as: green, lasts: 50 ms",
    )
    usual = seen(running)
    assert told(running) == ["every camera is knocked by 30 mm, for 0.05 s"]
    knocked = seen(running)
    assert knocked.camera_in_world == usual.camera_in_world
    way = 0.03 / 0.7 * usual.intrinsics.fx
    assert column(knocked) - column(usual) == pytest.approx(-way, abs=0.2 * way)
    assert told(running) == [
        "every camera is back in its place",
        "every camera is 30 times as noisy, for 0.05 s",
    ]
    assert spread(seen(running)) > 5.0 * spread(usual)
    assert "every camera shows red as green, for 0.05 s" in told(running)
    mistaken = seen(running)
    assert (reds(usual).sum() > 100, reds(mistaken).sum()) == (True, 0)
    assert told(running) == ["every camera shows red as it is again"]
    assert column(seen(running)) == pytest.approx(column(usual), abs=0.5)


def reds(image: RgbdImage):
    red, green, blue = (image.colour[:, :, k].astype(int) for k in range(3))
    return (red > 90) & (green < red // 2) & (blue < red // 2)


def column(image: RgbdImage) -> float:
    """Where red things are in the picture on average, pixels."""
    return float(np.nonzero(reds(image))[1].mean())


def spread(image: RgbdImage) -> float:
    """Typical change of the depth from one pixel to the next, m."""
    return float(np.median(np.abs(np.diff(image.depth, axis=1)))) + 1e-4


LASTING = (
    "fault: gripper_jam, when: {at: 50 ms}, lasts: 400 ms",
    "fault: wrench_dead, when: {at: 50 ms}, lasts: 300 ms",
    "fault: joint_weak, when: {at: 50 ms}, joint: panda_joint4, share: 15 %, lasts: 300 ms",
    "fault: camera_drop, when: {at: 50 ms}, images: 3",
    "fault: larger, when: {at: 50 ms}, target: {index: 0}, factor: 1.2",
    "fault: appear, when: {at: 50 ms}, kind: can, colour: red, place: [0.5, 0.33]",
)


@BOTH
def test_a_resumed_run_goes_on_with_what_was_wrong(backend: Backend) -> None:
    hardware, injector = running = failing(backend, *LASTING)
    home = hardware.arm.read().position
    hardware.arm.follow(home, np.zeros(7))
    assert len(told(running, 3)) == 6
    with pytest.raises(NoImage):
        seen(running)
    saved, states = hardware.checkpoint(), injector.state()
    again = build_hardware(backend, cell(), panda(), 1, saved.to_plain())
    assert isinstance(again, KinematicHardware | PhysicsHardware)
    resumed = FaultInjector(faults(LASTING), again, seed=1)
    resumed.restore(states)
    assert again.truth() == hardware.truth()
    for _ in range(2):
        for one in (running, (again, resumed)):
            with pytest.raises(NoImage):
                seen(one)
    for _ in range(8):
        for one in (hardware, again):
            one.arm.follow(home, np.zeros(7))
            one.gripper.command(GripperCommand(0.0, 40.0))
        assert told((again, resumed)) == told(running)
        assert again.wrench.read() == hardware.wrench.read()
    assert again.checkpoint() == hardware.checkpoint()
    assert resumed.state() == injector.state()
    assert len(hardware.truth()) == len(cell_items()) + 1


def cell_items():
    return KinematicHardware(cell(), panda(), 1).truth()


def test_what_slips_has_its_own_friction_again_after_a_resumed_run_as_well() -> None:
    hardware = KinematicHardware(cell(), panda(), 1)
    hardware.lubricate("item_00", 0.0)
    saved = hardware.checkpoint()
    assert isinstance(saved, KinematicState)
    assert hardware.bodies[hardware.truth()[0].id].friction == 0.0
    again = KinematicHardware.resume(cell(), panda(), 1, saved)
    assert again.bodies[again.truth()[0].id].friction == 0.6
    again.lubricate("item_00", 0.0, again=True)
    assert again.checkpoint() == saved
    again.lubricate("item_00", None)
    assert again.bodies[again.truth()[0].id].friction == 0.6


def test_fingers_that_open_all_the_way_let_go_of_what_is_as_wide_as_that() -> None:
    hardware = KinematicHardware(cell(), panda(), 1)
    item, gripper = hardware.truth()[0].id, hardware.gripper
    gripper.gripped = gripper.width = 0.0798
    gripper.item_in_tcp = Pose()
    hardware.bodies.take(item, hardware.true_tcp())
    gripper.command(GripperCommand(0.0, 40.0))
    hardware.step()
    assert hardware.in_hand() == item
    gripper.command(GripperCommand(0.08, 20.0))
    hardware.step()
    assert hardware.in_hand() is None
