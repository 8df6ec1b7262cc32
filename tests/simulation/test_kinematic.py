"""The backend without physics: exact motion, objects that follow the fingers, ideal sensors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.simulation.checkpoints import KinematicState
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import GripperCommand, Pose

from ..control.control_cell import DOWN, ROBOT, Cell, reach, swing
from .simulated_cell import cell as sorting_cell


def above(cell: Cell, pose: Pose, height: float) -> None:
    """The open hand over an upright block, fingers along one of its sides, TCP at `height`."""
    yaw = 2 * math.atan2(pose.orientation[2], pose.orientation[3])
    x, y, _ = pose.position
    tcp = Pose((x, y, height), DOWN) @ Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, -yaw % (math.pi / 2)))
    start = cell.loop.held_position
    cell.run(cell.move.along(swing(start, reach(tcp, start))))


def pick(cell: Cell, index: int = 0) -> None:
    pose = cell.hardware.truth()[index].pose
    above(cell, pose, 0.15)
    above(cell, pose, 0.02)
    assert cell.run(cell.grip.close(30.0)) == pytest.approx(0.04, abs=1e-5)
    cell.run(cell.move.guarded((0.0, 0.0, 1.0), 0.13, force=20.0, speed=0.2))


def test_an_object_between_the_fingers_follows_them_and_drops() -> None:
    cell = Cell(items=2)
    pick(cell)
    one, other = cell.hardware.truth()
    assert one.pose.position[2] == pytest.approx(0.15, abs=1e-3)
    assert other.pose.position[2] == pytest.approx(0.02, abs=1e-9)
    cell.go(0.35, 0.55, 0.2)
    held, _ = cell.hardware.truth()
    assert math.dist(held.pose.position, (0.35, 0.55, 0.2)) < 1e-3
    cell.run(cell.grip.open())
    dropped, _ = cell.hardware.truth()
    assert dropped.pose.position[2] == pytest.approx(0.005 + 0.02, abs=2e-4)


def test_an_object_set_down_on_another_stays_there_until_that_is_taken() -> None:
    cell = Cell(items=2)
    pick(cell, 0)
    below = cell.hardware.truth()[1].pose
    above(cell, below, 0.2)
    result = cell.run(cell.move.guarded((0.0, 0.0, -1.0), 0.2, force=4.0, speed=0.05))
    assert result.contact
    cell.run(cell.grip.open())
    assert cell.hardware.truth()[0].pose.position[2] == pytest.approx(0.06, abs=2e-4)
    cell.run(cell.move.guarded((0.0, 0.0, 1.0), 0.1, force=20.0, speed=0.2))
    cell.hardware.remove("item_01")
    assert cell.hardware.truth()[0].pose.position[2] == pytest.approx(0.02, abs=2e-4)


def test_closing_on_nothing() -> None:
    cell = Cell()
    assert cell.run(cell.grip.close(30.0)) == pytest.approx(0.0, abs=1e-9)
    assert cell.run(cell.grip.move(0.05, 30.0)) == pytest.approx(0.05, abs=1e-9)


def test_the_load_is_felt_when_it_leaves_the_table_only() -> None:
    cell = Cell(items=1)
    pose = cell.hardware.truth()[0].pose
    above(cell, pose, 0.02)
    cell.run(cell.loop.settle())
    cell.loop.tare()
    cell.run(cell.grip.close(30.0))
    cell.run(cell.loop.settle())
    assert abs(cell.loop.load()) < 1e-3
    cell.run(cell.move.guarded((0.0, 0.0, 1.0), 0.05, force=20.0, speed=0.1))
    cell.run(cell.loop.settle())
    assert cell.loop.load() == pytest.approx(0.1 * 9.81, abs=1e-6)


@pytest.mark.parametrize("turn", [0.0, 0.66])
def test_fingers_too_weak_to_carry_what_they_close_on_press_nevertheless(turn: float) -> None:
    """Held at an angle, the item's width is rounded differently from period to period."""
    cell = Cell(items=1)
    pose = cell.hardware.truth()[0].pose @ Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, turn))
    above(cell, pose.shifted((0.002, 0.0, 0.0)), 0.02)
    cell.run(cell.grip.close(0.3))
    for _ in range(24):
        cell.hardware.step()
        assert cell.grip.state.force == 0.3


def test_fault_remove_out_of_the_hand() -> None:
    cell = Cell(items=1)
    pick(cell)
    cell.hardware.remove("item_00")
    cell.loop.step_tick(0.05)
    assert not cell.hardware.truth()[0].present
    cell.run(cell.grip.move(0.0, 30.0))
    assert cell.grip.width == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(PicktreeError, match=r"^item 'item_00' was taken away before$"):
        cell.hardware.remove("item_00")
    with pytest.raises(PicktreeError, match=r"^there is no item 'nothing'; known: item_00$"):
        cell.hardware.remove("nothing")


def test_fault_slippery_and_heavy() -> None:
    cell = Cell(items=1)
    pick(cell)
    cell.hardware.change_dynamics("item_00", friction=0.05, mass=0.5)
    cell.loop.step_tick(0.05)
    assert cell.hardware.truth()[0].pose.position[2] == pytest.approx(0.02, abs=2e-4)


def test_fault_bump_slides_along_the_table() -> None:
    cell = Cell(items=1)
    before = cell.hardware.truth()[0].pose
    cell.hardware.bump("item_00", (0.5, 0.0, 0.0))
    after = cell.hardware.truth()[0].pose
    assert after.position[0] - before.position[0] == pytest.approx(0.5**2 / (2 * 0.6 * 9.81))
    assert after.position[2] == pytest.approx(0.02, abs=1e-9)


def test_torque_mode_falls_without_torque_and_stands_with_gravity() -> None:
    hardware = KinematicHardware(sorting_cell(), ROBOT, 1)
    home = hardware.arm.read().position
    for _ in range(48):
        hardware.arm.apply_torque(hardware.model.gravity(hardware.arm.position))
        hardware.step()
    np.testing.assert_allclose(hardware.arm.read().position, home, atol=1e-9)
    hardware.arm.apply_torque(np.zeros(7))
    for _ in range(24):
        hardware.step()
    assert hardware.true_tcp().position[2] < 0.46
    assert np.isfinite(hardware.arm.read().position).all()


def test_checkpoint_resumes_alike() -> None:
    scene, robot, seed = sorting_cell(), ROBOT, 3
    live = KinematicHardware(scene, robot, seed)
    live.gripper.command(GripperCommand(0.03, 20.0))
    for k in range(30):
        live.arm.follow(live.model.named("home") + 0.001 * k, np.zeros(7))
        live.step()
    saved = live.checkpoint()
    again = KinematicState.from_plain(saved.to_plain())
    assert again == saved
    twin = KinematicHardware.resume(scene, robot, seed, again)
    for hardware in (live, twin):
        hardware.remove("item_03")
        hardware.gripper.command(GripperCommand(0.0, 20.0))
        for _ in range(30):
            hardware.step()
    assert twin.checkpoint() == live.checkpoint()
    assert twin.truth() == live.truth()
    with pytest.raises(PicktreeError, match="is of seed"):
        KinematicHardware(scene, robot, seed + 1).restore(saved)
    with pytest.raises(PicktreeError, match=r"^not a valid checkpoint of the kinematic backend: seed: "):
        KinematicState.from_plain({"seed": "x"})


def test_everything_spawned_rests_on_something() -> None:
    for body in KinematicHardware(sorting_cell(), ROBOT, 2).truth():
        assert -1e-9 < body.pose.position[2] < 0.2
        assert body.present


def test_the_camera_sees_colour_and_depth_of_what_is_there() -> None:
    hardware = KinematicHardware(sorting_cell(), ROBOT, 1)
    left = hardware.model.named("observe")
    hardware.arm.follow(left, np.zeros(7))
    hardware.step()
    camera = hardware.cameras["overhead"]
    image = camera.capture()
    again = camera.capture()
    assert np.array_equal(image.depth, again.depth) and np.array_equal(image.colour, again.colour)
    before = image.depth.copy()
    assert image.stamp == hardware.clock.now
    body = hardware.truth()[0]
    point = image.camera_in_world.inverse().apply(np.array(body.pose.position))
    k = image.intrinsics
    u = round(k.cx + k.fx * point[0] / point[2])
    v = round(k.cy + k.fy * point[1] / point[2])
    assert point[2] - 0.05 < image.depth[v, u] < point[2]
    hardware.remove(body.id)
    assert camera.capture().depth[v, u] > before[v, u] + 0.01
