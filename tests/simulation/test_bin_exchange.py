"""Bins that are exchanged: when, what goes with them, and what stays known of it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import pytest

from picktree.files import PicktreeError
from picktree.simulation import Backend, TrueBody, score
from picktree.simulation.checkpoints import Checkpoint, KinematicState
from picktree.simulation.fault_entries import FaultTarget
from picktree.simulation.fault_injector import choose_target
from picktree.simulation.feeder import goes_with
from picktree.simulation.physics import PhysicsHardware, pb
from picktree.world import ObjectId, Pose, Vector3
from picktree.world.scene.description import Exchange

from .feed_cell import Hardware, build, fed, load, moved, told, turn_to, wait
from .simulated_cell import cell

BACKENDS = pytest.mark.parametrize("backend", ["physics", "kinematic"])
RED, BLUE = ObjectId("red_bin"), ObjectId("blue_bin")
IN_RED: tuple[Vector3, ...] = ((0.3, 0.52, 0.04), (0.38, 0.58, 0.04))


def filled(backend: Backend, seed: int = 4) -> Hardware:
    """Two of three spawned items in the red bin, the third beside it."""
    spawn = (load(("block", 3), area=((0.3, -0.2), (0.6, -0.1))),)
    hardware = build(backend, fed(spawn=spawn, of=load(("ball", 1))), seed)
    moved(hardware, {"item_00": IN_RED[0], "item_01": IN_RED[1], "item_02": (0.35, 0.4, 0.02)})
    return hardware


def verdicts(bodies: Iterable[TrueBody]) -> dict[str, tuple[str | None, str]]:
    return {str(i.id): (i.bin, i.verdict) for i in score(bodies, cell()).items}


@BACKENDS
def test_what_lies_in_the_bin_goes_with_it_and_stays_judged(backend: Backend) -> None:
    hardware = filled(backend)
    hardware.feed.exchange(RED)
    assert hardware.feed.read().busy
    wait(hardware, 1.9)
    before = hardware.truth()
    judged = verdicts(before)
    assert sorted(bin_id or "" for bin_id, _ in judged.values()) == ["", "red_bin", "red_bin"]
    assert hardware.feed.read().exchanges == {}
    wait(hardware, 0.2)
    after = hardware.truth()
    assert [b.taken_with for b in after] == [RED, RED, None]
    assert [b.present for b in after] == [False, False, True]
    assert [b.pose for b in hardware.recent_truth()[:2]] == [b.pose for b in before[:2]]
    assert verdicts(after) == judged
    assert hardware.feed.read().exchanges == {RED: 1}
    assert not hardware.feed.read().busy
    assert told(hardware) == ["red_bin is exchanged for an empty one, with 2 items in it"]
    wait(hardware, 0.5)
    assert hardware.truth()[2].pose.position == pytest.approx((0.35, 0.4, 0.02), abs=1e-3)


@BACKENDS
def test_numbers_are_never_given_twice(backend: Backend) -> None:
    hardware = filled(backend)
    hardware.feed.exchange(RED)
    wait(hardware, 2.1)
    hardware.feed.ready()
    wait(hardware, 0.2)
    assert [str(b.id) for b in hardware.truth()] == [f"item_{n:02d}" for n in range(4)]
    with pytest.raises(PicktreeError, match="item 'item_00' was taken away before"):
        hardware.remove("item_00")


def test_a_bin_asked_for_twice_is_exchanged_once_and_bins_one_after_the_other() -> None:
    hardware = filled("kinematic")
    for bin_id in (RED, RED, BLUE):
        hardware.feed.exchange(bin_id)
    wait(hardware, 3.0)
    hardware.feed.exchange(BLUE)
    assert hardware.feed.read().exchanges == {RED: 1}
    wait(hardware, 3.0)
    assert hardware.feed.read().exchanges == {RED: 1, BLUE: 1}
    assert told(hardware)[1] == "blue_bin is exchanged for an empty one, with 0 items in it"


@BACKENDS
def test_nobody_reaches_below_the_arm(backend: Backend) -> None:
    scene = fed(exchange=Exchange(0.5))
    bins = (replace(scene.bins[0], pose=Pose((0.0, 0.5, 0.0))), scene.bins[1])
    hardware = build(backend, replace(scene, bins=bins))
    turn_to(hardware, "observe")
    hardware.feed.exchange(RED)
    wait(hardware, 1.0)
    assert (hardware.feed.read().obstructed, hardware.feed.read().exchanges) == (True, {})
    turn_to(hardware, "home")
    wait(hardware, 1.0)
    assert (hardware.feed.read().obstructed, hardware.feed.read().exchanges) == (False, {RED: 1})


def test_without_anybody_to_exchange_it_a_bin_stays() -> None:
    hardware = build("kinematic", fed(exchange=None))
    hardware.feed.exchange(RED)
    wait(hardware, 1.0)
    assert (hardware.feed.read().busy, hardware.feed.read().exchanges) == (False, {})


def test_there_must_be_such_a_bin() -> None:
    hardware = build("kinematic", fed())
    with pytest.raises(PicktreeError) as error:
        hardware.feed.exchange(ObjectId("green_bin"))
    assert str(error.value) == "there is no bin 'green_bin'; known: red_bin, blue_bin"


@pytest.mark.parametrize(
    ("position", "goes"),
    [
        ((0.35, 0.55, 0.025), True),  # on the bottom
        ((0.35, 0.55, 0.2), True),  # on a heap, over the rim
        ((0.474, 0.55, 0.11), True),  # across a wall, more inside than out
        ((0.476, 0.55, 0.11), False),  # more out than inside
        ((0.5, 0.55, 0.02), False),  # beside it
        ((0.35, 0.55, -0.7), False),  # on the floor
    ],
)
def test_what_goes_with_a_bin(position: Vector3, goes: bool) -> None:
    scene = cell()
    body = TrueBody.of(ObjectId("item_00"), scene.entry("block"), "red", Pose(position))
    assert goes_with(scene.bins[0], body) is goes
    turned = Pose.from_rpy((0.35, 0.55, 0.0), (0.0, 0.0, 1.0))
    around = turned @ Pose((0.35, 0.55, 0.0)).inverse() @ body.pose
    assert goes_with(replace(scene.bins[0], pose=turned), replace(body, pose=around)) is goes


def bodies_in(hardware: PhysicsHardware) -> int:
    client = hardware._client  # pyright: ignore[reportPrivateUsage] # the engine's own count
    return pb.getNumBodies(client)


def test_the_engine_keeps_nothing_of_what_left_and_a_checkpoint_a_line() -> None:
    hardware = build("physics", fed(of=load(("block", 2)), exchange=Exchange(0.05)))
    assert isinstance(hardware, PhysicsHardware)
    empty, sizes = bodies_in(hardware), list[int]()
    for _ in range(4):
        hardware.feed.ready()
        wait(hardware, 0.7)
        assert bodies_in(hardware) == empty + 2
        here = [str(b.id) for b in hardware.truth() if b.present]
        moved(hardware, dict(zip(here, IN_RED, strict=True)))
        hardware.feed.exchange(RED)
        wait(hardware, 0.2)
        assert bodies_in(hardware) == empty
        sizes.append(len(json.dumps(hardware.checkpoint().to_plain())))
    assert len(hardware.truth()) == 8
    grown = [later - earlier for earlier, later in pairwise(sizes)]
    assert max(grown) < 2 * 320


@BACKENDS
def test_a_target_s_index_is_the_item_s_number_after_others_have_left(backend: Backend) -> None:
    hardware = filled(backend)
    hardware.feed.exchange(RED)
    wait(hardware, 2.1)
    assert hardware.item_count == 3
    chosen = [choose_target(hardware, FaultTarget(index=n), "", lambda _: None) for n in range(3)]
    assert [body and body.id for body in chosen] == [None, None, "item_02"]


@BACKENDS
def test_items_of_older_checkpoints_have_left_one_by_one(backend: Backend) -> None:
    hardware = filled(backend)
    hardware.feed.exchange(RED)
    wait(hardware, 2.1)
    older = hardware.checkpoint().to_plain()
    kinds = older["inventory"].pop("kinds")
    older["inventory"]["departed"] = [
        {"id": f"item_{number:02d}", "pose": {"position": [0.3, 0.5, 0.0]}, **kinds[index]}
        for number, index in older["inventory"]["departed"]
    ]
    again = build(backend, hardware.scene)
    again.restore((Checkpoint if backend == "physics" else KinematicState).from_plain(older))  # type: ignore[arg-type]
    assert again.truth() == hardware.truth()


def test_items_that_left_are_kept_by_number_and_kind() -> None:
    hardware = filled("kinematic")
    hardware.feed.exchange(RED)
    wait(hardware, 2.1)
    kept = hardware.snapshot().to_plain()["inventory"]
    assert [number for number, _ in kept["departed"]] == [0, 1]
    assert {kind["taken_with"] for kind in kept["kinds"]} == {RED}
    assert len(json.dumps(kept["departed"])) < 20
