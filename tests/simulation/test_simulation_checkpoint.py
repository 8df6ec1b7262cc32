"""A run that went through a checkpoint and one that was resumed from it are the same, bit for bit."""

from __future__ import annotations

import json

import numpy as np
import pytest

from picktree.files import PicktreeError
from picktree.simulation.checkpoints import Checkpoint
from picktree.simulation.physics import PhysicsHardware
from picktree.world import GripperCommand

from ..other_process import OtherProcess
from .simulated_cell import cell, panda
from .test_simulation_physics import HOME, digest, go


def disturbed() -> PhysicsHardware:
    """A run in which much has happened: motion, images, every fault, something still moving."""
    hardware = PhysicsHardware(cell(), panda(), 4)
    go(hardware, HOME + 0.3, 0.5)
    hardware.gripper.command(GripperCommand(0.03, 12.0))
    hardware.cameras["overhead"].capture()
    hardware.change_dynamics("item_02", friction=0.05, mass=0.5)
    hardware.remove("item_05")
    hardware.bump("item_06", (0.2, 0.1, 0.0), (0.0, 0.0, 3.0))
    go(hardware, HOME, 0.3)
    return hardware


def resumed(saved: str) -> str:
    """Digest of the continuation of a checkpoint in JSON."""
    checkpoint = Checkpoint.from_plain(json.loads(saved))
    return digest(PhysicsHardware.resume(cell(), panda(), 4, checkpoint), 60)


def test_a_resumed_run_continues_bit_for_bit_in_another_process(elsewhere: OtherProcess):
    """A checkpoint changes nothing that can be seen at once, and survives JSON exactly."""
    hardware = disturbed()
    before = (hardware.wrench.read(), hardware.gripper.read(), hardware.clock.now)
    joints, truth = hardware.arm.read(), hardware.truth()
    checkpoint = hardware.checkpoint()
    assert (hardware.wrench.read(), hardware.gripper.read(), hardware.clock.now) == before
    assert np.array_equal(hardware.arm.read().position, joints.position)
    assert np.array_equal(hardware.arm.read().effort, joints.effort)
    for one, other in zip(truth, hardware.truth(), strict=True):
        assert one.pose.position == other.pose.position
        assert one.pose.orientation == pytest.approx(other.pose.orientation, abs=1e-14)
        assert one.velocity == pytest.approx(other.velocity, abs=1e-14)
    saved = json.dumps(checkpoint.to_plain())
    assert Checkpoint.from_plain(json.loads(saved)) == checkpoint
    assert elsewhere.call(resumed, saved) == digest(hardware, 60)


def test_a_run_under_torque_is_resumed_as_well():
    hardware = disturbed()
    for _ in range(5):
        hardware.arm.apply_torque(np.array([0.0, -20.0, 0.0, 15.0, 0.0, 2.0, 0.0]))
        hardware.step()
    saved = hardware.checkpoint()
    assert saved.arm.mode == "torque"
    again = PhysicsHardware.resume(cell(), panda(), 4, saved)
    for _ in range(30):
        hardware.step()
        again.step()
    assert again.arm.read().position.tobytes() == hardware.arm.read().position.tobytes()
    assert again.truth() == hardware.truth()


def test_items_at_rest_stay_at_rest_through_checkpoints():
    hardware = PhysicsHardware(cell(), panda(), 4)
    for _ in range(10):
        for _ in range(60):
            hardware.step()
        hardware.checkpoint()
    for before, after in zip(hardware.initial_truth, hardware.truth(), strict=True):
        assert before.pose.distance(after.pose) < 0.001


def test_faults_survive_a_checkpoint():
    hardware = disturbed()
    again = PhysicsHardware.resume(cell(), panda(), 4, hardware.checkpoint())
    for each in (hardware, again):
        assert [b.present for b in each.truth()] == [k != 5 for k in range(10)]
        each.bump("item_02", (0.5, 0.0, 0.0))
        start = each.truth()[2].pose
        for _ in range(60):
            each.step()
        assert each.truth()[2].pose.distance(start) > 0.06
        assert each.initial_truth == hardware.initial_truth
    with pytest.raises(PicktreeError, match="item 'item_05' was taken away before"):
        again.remove("item_05")


def test_a_checkpoint_of_another_run_is_refused():
    saved = PhysicsHardware(cell(), panda(), 4).checkpoint()
    for scene, seed, words in (
        (cell(), 5, "^the checkpoint is of seed 4, but this run has seed 5$"),
        (cell(spawn=()), 4, "but the scene spawns"),
        (cell(cameras=()), 4, "but the scene has"),
    ):
        with pytest.raises(PicktreeError, match=words):
            PhysicsHardware.resume(scene, panda(), seed, saved)


def test_what_is_no_checkpoint_is_refused():
    with pytest.raises(PicktreeError) as error:
        Checkpoint.from_plain({"seed": "x"})
    assert str(error.value).startswith(
        "not a valid checkpoint of the simulation: seed: Input should be a valid integer"
    )
