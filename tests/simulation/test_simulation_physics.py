"""The physical backend: determinism, rest, gripping, weighing, torque control."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.simulation import SpawnedItem
from picktree.simulation.physics import Client, ItemShapes, PhysicsHardware, add_item, pb
from picktree.world import Box, GripperCommand, ObjectId, Pose
from picktree.world.robot_model import RobotModel
from picktree.world.scene import CatalogueEntry, SceneDescription, SensorNoise, Spawn

from ..other_process import OtherProcess
from .simulated_cell import CATALOGUE, cell, panda

SILENT = SensorNoise(encoder=0.0, width=0.0, force=0.0, torque=0.0, force_bias=0.0, torque_bias=0.0)
HOME = np.array(panda().named["home"])
STILL = np.zeros(7)


def digest(hardware: PhysicsHardware, steps: int) -> str:
    """Of everything that sensors and truth say at the end of some steps of a moving arm."""
    chain = hashlib.sha256()
    for k in range(steps):
        hardware.arm.follow(HOME + 0.2 * np.sin(k / 60) * np.ones(7), 0.2 * np.cos(k / 60) * 4 * np.ones(7))
        hardware.step()
        chain.update(hardware.arm.read().position.tobytes())
        chain.update(repr(hardware.wrench.read()).encode())
    chain.update(repr([(b.pose, b.velocity) for b in hardware.truth()]).encode())
    image = hardware.cameras["overhead"].capture()
    chain.update(image.depth.tobytes() + image.colour.tobytes())
    return chain.hexdigest()


def held_block(mass: float, friction: float) -> SceneDescription:
    """One block in the middle of the table, no noise."""
    block = CatalogueEntry("block", "box", Box((0.04, 0.04, 0.04)), mass, friction)
    spawn = Spawn({"block": 1}, ("red",), ((0.5, 0.0), (0.5, 0.0)))
    return cell(catalogue=(block,), spawn=(spawn,), noise=SILENT)


def lifted(hardware: PhysicsHardware, force: float) -> float:
    """Grip the block with `force` a finger and raise the hand by 10 cm; the block's height then, m."""
    model = RobotModel(hardware.robot)
    block = hardware.truth()[0].pose
    yaw = np.arctan2(block.rotation()[1, 0], block.rotation()[0, 0])
    low = down_at(model, block.position, yaw)
    high = down_at(model, (block.position[0], block.position[1], block.position[2] + 0.1), yaw)
    go(hardware, high, 1.0)
    go(hardware, low, 0.5)
    hardware.gripper.command(GripperCommand(0.0, force))
    go(hardware, low, 0.5)
    go(hardware, high, 1.0)
    return hardware.truth()[0].pose.position[2]


def down_at(model: RobotModel, position: tuple[float, float, float], yaw: float) -> np.ndarray:
    """Joints (7,) with the tool at `position` pointing down, turned by `yaw`. Newton's method."""
    q = HOME.copy()
    wanted = np.diag((1.0, -1.0, -1.0))
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    wanted = turn @ wanted
    for _ in range(100):
        tcp = model.tcp(q)
        off = wanted @ tcp.rotation().T
        spin = 0.5 * np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]])
        error = np.concatenate([np.array(position) - tcp.position, spin])
        step = np.linalg.pinv(model.jacobian(q)) @ error
        q = q + step * min(1.0, 0.3 / max(1e-9, np.abs(step).max()))
    assert np.abs(error).max() < 1e-6
    return q


def go(hardware: PhysicsHardware, target: np.ndarray, duration: float) -> None:
    """A smooth joint motion to `target` (7,)."""
    start = hardware.arm.read().position
    for k in range(1, round(duration * 240) + 1):
        s = k / (duration * 240)
        blend, rate = s * s * (3 - 2 * s), 6 * s * (1 - s) / duration
        hardware.arm.follow(start + blend * (target - start), rate * (target - start))
        hardware.step()


@cache
def digest_alone() -> str:
    """Of a cell that has the process for itself."""
    return digest(PhysicsHardware(cell(), panda(), 5), 60)


def test_two_instances_of_one_process_do_not_disturb_each_other():
    one, other = PhysicsHardware(cell(), panda(), 5), PhysicsHardware(cell(), panda(), 6)
    for _ in range(10):
        other.step()
    assert digest(one, 60) == digest_alone()
    assert digest(other, 60) != digest_alone()


def test_another_process_with_another_hash_seed_gives_the_same_bits(elsewhere: OtherProcess):
    assert elsewhere.call(digest_alone) == digest_alone()


def test_tumbled_items_fall_and_come_to_rest_before_time_zero():
    spawn = Spawn({"block": 3, "can": 2}, ("red",), ((0.35, -0.25), (0.65, 0.25)), tumbled=True)
    for body in PhysicsHardware(cell(spawn=(spawn,)), panda(), 1).truth():
        assert body.pose.position[2] < 0.06
        assert np.linalg.norm(body.velocity) < 0.01


def test_the_arm_follows_a_motion_to_a_tenth_of_a_milliradian():
    hardware = PhysicsHardware(cell(spawn=(), noise=SILENT), panda(), 0)
    worst = 0.0
    for k in range(1, 481):
        time = k / 240
        wanted = HOME + 0.25 * (1 - np.cos(np.pi * time)) * np.array([1, -1, 1, 1, 1, 1, 1])
        rate = 0.25 * np.pi * np.sin(np.pi * time) * np.array([1, -1, 1, 1, 1, 1, 1])
        hardware.arm.follow(wanted, rate)
        hardware.step()
        worst = max(worst, float(np.abs(hardware.arm.read().position - wanted).max()))
    assert worst < 2e-4


def test_the_wrist_carries_the_weight_of_the_hand():
    hardware = PhysicsHardware(cell(spawn=(), noise=SILENT), panda(), 0)
    tilted = HOME + np.array([0.3, 0.2, 0.0, 0.0, 0.0, 0.6, 0.0])
    go(hardware, tilted, 1.0)
    go(hardware, tilted, 0.5)
    model = RobotModel(hardware.robot)
    weight = model.hand_mass * 9.81
    reading = hardware.wrench.read()
    assert reading.force == pytest.approx((0.0, 0.0, -weight), abs=0.02)
    lever = model.flange(hardware.arm.read().position).rotation() @ np.array(model.hand_com)
    assert reading.torque == pytest.approx(np.cross(lever, (0.0, 0.0, -weight)), abs=0.005)


def test_a_load_adds_its_weight_and_a_table_that_pushes_up_takes_from_it():
    hardware = PhysicsHardware(held_block(0.2, 0.6), panda(), 0)
    empty = hardware.wrench.read().force[2]
    assert lifted(hardware, 30.0) > 0.1
    go(hardware, hardware.arm.read().position, 0.5)
    assert hardware.wrench.read().force[2] - empty == pytest.approx(-0.2 * 9.81, abs=0.05)
    model = RobotModel(hardware.robot)
    x, y, _ = hardware.true_tcp().position
    into = down_at(model, (x, y, 0.02 - 0.0003), 0.0)
    go(hardware, into, 1.0)
    assert hardware.wrench.read().force[2] - empty > 1.0


@pytest.mark.parametrize(
    ("mass", "friction", "force", "holds"),
    [(0.1, 0.6, 30.0, True), (1.0, 0.2, 30.0, True), (1.0, 0.12, 30.0, False)],
)
def test_friction_holds_as_coulomb_says(mass: float, friction: float, force: float, holds: bool):
    assert (2 * friction * force > mass * 9.81) is holds
    hardware = PhysicsHardware(held_block(mass, friction), panda(), 0)
    assert (lifted(hardware, force) > 0.1) is holds


@pytest.mark.parametrize("force", [10.0, 30.0])
def test_each_pad_presses_as_it_was_told(force: float):
    hardware = PhysicsHardware(held_block(0.1, 0.6), panda(), 0)
    lifted(hardware, force)
    pads = {"panda_leftfinger": 0.0, "panda_rightfinger": 0.0}
    for contact in hardware.true_contacts():
        for name in (contact.one, contact.other):
            if name in pads:
                pads[name] += contact.force
                assert contact.distance > -0.002
    assert all(pressing == pytest.approx(force, rel=0.1) for pressing in pads.values())
    grip = hardware.gripper.read()
    assert grip.width == pytest.approx(0.04, abs=0.002)
    assert grip.force == pytest.approx(force, rel=0.05)


def test_an_arm_whose_gravity_is_compensated_stays_and_goes_back_to_the_servo_without_a_jump():
    hardware = PhysicsHardware(cell(spawn=(), noise=SILENT), panda(), 0)
    model = RobotModel(hardware.robot)
    for _ in range(480):
        hardware.arm.apply_torque(model.gravity(hardware.arm.read().position))
        hardware.step()
    floating = hardware.arm.read()
    assert np.abs(floating.position - HOME).max() < 0.005
    hardware.arm.follow(floating.position, STILL)
    hardware.step()
    assert np.abs(hardware.arm.read().position - floating.position).max() < 1e-4


def test_without_torque_the_arm_falls():
    hardware = PhysicsHardware(cell(spawn=(), noise=SILENT), panda(), 0)
    hardware.arm.apply_torque(STILL)
    for _ in range(60):
        hardware.step()
    assert np.abs(hardware.arm.read().position - HOME).max() > 0.05


def test_the_gripper_opens_and_closes_at_its_speed():
    hardware = PhysicsHardware(cell(spawn=(), noise=SILENT), panda(), 0)
    hardware.gripper.command(GripperCommand(0.0, 30.0))
    for _ in range(48):
        hardware.step()
    assert hardware.gripper.read().width == pytest.approx(0.08 - 2 * 0.1 * 0.2, abs=0.005)
    for _ in range(120):
        hardware.step()
    assert hardware.gripper.read().width == pytest.approx(0.0, abs=0.001)


def test_sensor_noise_has_the_deviations_of_the_scene():
    hardware = PhysicsHardware(cell(spawn=()), panda(), 0)
    states: list[np.ndarray] = []
    widths: list[float] = []
    forces: list[tuple[float, float, float]] = []
    for _ in range(2000):
        hardware.step()
        states.append(hardware.arm.read().position)
        widths.append(hardware.gripper.read().width)
        forces.append(hardware.wrench.read().force)
    noise = hardware.scene.noise
    assert np.std(states, axis=0) == pytest.approx(np.full(7, noise.encoder), rel=0.1)
    assert np.std(widths) == pytest.approx(noise.width, rel=0.1)
    assert np.std(forces, axis=0) == pytest.approx(np.full(3, noise.force), rel=0.1)


def test_a_reading_stays_the_same_until_the_next_step():
    hardware = PhysicsHardware(cell(spawn=()), panda(), 0)
    assert np.array_equal(hardware.arm.read().position, hardware.arm.read().position)
    assert hardware.wrench.read() == hardware.wrench.read()
    first = hardware.wrench.read()
    hardware.step()
    assert hardware.wrench.read() != first


def test_commands_that_pybullet_would_swallow_are_refused():
    hardware = PhysicsHardware(cell(spawn=()), panda(), 0)
    bad = HOME.copy()
    bad[2] = np.nan
    with pytest.raises(PicktreeError, match="arm position: not finite"):
        hardware.arm.follow(bad, STILL)
    with pytest.raises(PicktreeError, match=r"arm torque: shape \(3,\), but \(7,\) is needed"):
        hardware.arm.apply_torque(np.zeros(3))
    with pytest.raises(PicktreeError, match=r"gripper: width nan, force 1\.0; both must be finite"):
        hardware.gripper.command(GripperCommand(float("nan"), 1.0))


def test_bodies_that_pybullet_would_swallow_are_refused():
    scene = cell()
    table = replace(scene.fixtures[0], shape=Box((1.2, -1.6, 0.04)))
    with pytest.raises(
        PicktreeError, match=r"table: size \(1\.2, -1\.6, 0\.04\); every size must be positive"
    ):
        PhysicsHardware(cell(fixtures=(table,), spawn=()), panda(), 0)
    tilted = replace(scene.bins[0], pose=replace(scene.bins[0].pose, orientation=(0.0, 0.0, 0.0, 2.0)))
    with pytest.raises(PicktreeError, match="red_bin: orientation"):
        PhysicsHardware(cell(bins=(tilted,), spawn=()), panda(), 0)


def test_a_missing_mesh_is_named():
    robot = panda()
    text = Path(robot.urdf).read_text(encoding="utf-8")
    broken = Path(robot.urdf).parent / "missing.urdf"
    with pytest.raises(PicktreeError, match=r"missing\.urdf"):
        PhysicsHardware(cell(), replace(robot, urdf=str(broken)), 0)
    assert "finger.obj" in text


def test_clients_are_given_back():
    import pybullet as pb

    hardware = PhysicsHardware(cell(spawn=()), panda(), 0)
    client = hardware._client  # pyright: ignore[reportPrivateUsage]
    assert pb.isConnected(client)
    hardware.close()
    assert not pb.isConnected(client)


def test_items_of_one_hull_share_its_shapes_and_none_is_enlarged() -> None:
    known: ItemShapes = {}
    owner = Client()
    item = SpawnedItem(ObjectId("item_00"), CATALOGUE[-1], "red", Pose(), False)
    bodies = [add_item(item, Pose((x, 0.0, 0.0)), owner.id, known) for x in (0.0, 0.2)]
    (nearest, *_) = pb.getClosestPoints(*bodies, 1.0, physicsClientId=owner.id)
    assert len(known) == 1
    assert nearest[8] == pytest.approx(0.2 - 0.04, abs=1e-4)  # pybullet enlarges a hull by 1 mm unless told


def test_the_engine_is_imported_without_a_word():
    program = "import picktree.simulation.physics.backend, picktree.simulation.kinematic.camera"
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert (answer.stdout, answer.stderr) == ("", "")
