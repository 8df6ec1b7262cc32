"""Runs with a feed go on from a checkpoint as if nothing had been: bit for bit, in either backend."""

from __future__ import annotations

import json

import pytest

from picktree.files import PicktreeError
from picktree.simulation import Backend
from picktree.simulation.checkpoints import Checkpoint, KinematicState
from picktree.simulation.physics import PhysicsHardware
from picktree.world import ObjectId

from ..other_process import OtherProcess
from .feed_cell import Hardware, build, digest, fed, load, moved, resumed, wait
from .simulated_cell import cell, panda

BACKENDS = pytest.mark.parametrize("backend", ["physics", "kinematic"])
RED = ObjectId("red_bin")


def eventful(backend: Backend) -> Hardware:
    """Items have come, left with a bin and been changed; more are just being set down, and the bin is being
    exchanged once more."""
    spawn = (load(("block", 3), area=((0.3, -0.2), (0.6, -0.1))),)
    hardware = build(backend, fed(total=7, spawn=spawn))
    hardware.feed.ready()
    wait(hardware, 0.8)
    # Of the first kind one that was there and one that was brought.
    moved(hardware, {"item_00": (0.3, 0.52, 0.04), "item_03": (0.38, 0.58, 0.06)})
    hardware.change_dynamics("item_00", friction=0.2)
    hardware.change_dynamics("item_04", friction=0.2, mass=0.3)
    hardware.remove("item_02")
    hardware.feed.exchange(RED)
    wait(hardware, 2.1)
    hardware.feed.ready()
    hardware.feed.exchange(RED)
    wait(hardware, 0.125)
    hardware.take_events()
    return hardware


@BACKENDS
def test_a_run_with_a_feed_is_resumed_bit_for_bit(backend: Backend) -> None:
    hardware = eventful(backend)
    assert [b.present for b in hardware.truth()] == [False, True, False, False, True, True, True, True, True]
    assert [b.taken_with for b in hardware.truth()][:4] == [RED, None, None, RED]
    assert hardware.feed.read().busy
    again = resumed(hardware)
    assert again.truth() == hardware.truth()
    assert again.feed.read() == hardware.feed.read()
    for each in (hardware, again):
        each.feed.ready()
    assert digest(again, 3.0) == digest(hardware, 3.0)
    assert again.feed.read().exchanges == {RED: 2}
    for each in (hardware, again):
        each.feed.ready()
    assert digest(again, 1.0) == digest(hardware, 1.0)
    assert again.feed.read().exhausted
    assert len(again.truth()) == 10


def digest_resumed(backend: Backend) -> str:
    return digest(resumed(eventful(backend)), 2.0)


@BACKENDS
def test_another_process_has_the_same_digest(backend: Backend, elsewhere: OtherProcess) -> None:
    there = elsewhere.call(digest_resumed, backend)
    hardware = eventful(backend)
    hardware.checkpoint()
    assert there == digest(hardware, 2.0)


@BACKENDS
def test_a_checkpoint_survives_json_exactly(backend: Backend) -> None:
    saved = eventful(backend).checkpoint()
    assert type(saved).from_plain(json.loads(json.dumps(saved.to_plain()))) == saved


def test_checkpoints_of_older_logs_are_taken_up() -> None:
    scene = cell()
    for hardware, kind in (
        (build("physics", scene), Checkpoint),
        (build("kinematic", scene), KinematicState),
    ):
        saved = hardware.checkpoint()
        plain = saved.to_plain()
        del plain["inventory"], plain["feeder"], plain["belts"]
        assert kind.from_plain(plain) == saved


def test_a_checkpoint_of_another_feed_is_refused() -> None:
    saved = eventful("physics").checkpoint()
    assert isinstance(saved, Checkpoint)
    spawn = (load(("block", 3), area=((0.3, -0.2), (0.6, -0.1))),)
    scene = fed(spawn=spawn)
    with pytest.raises(PicktreeError) as error:
        PhysicsHardware.resume(cell(spawn=spawn, deliveries=scene.deliveries * 2), panda(), 4, saved)
    assert str(error.value) == (
        "the checkpoint's feed has 1 with an area among its entries, but the scene's has 2"
    )
