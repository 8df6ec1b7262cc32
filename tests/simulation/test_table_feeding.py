"""Loads that are set down on the table: when they come, where there is room, and that nobody is hurt."""

from __future__ import annotations

import math
from collections import Counter

import pytest

from picktree.files import PicktreeError
from picktree.simulation import Backend, spawn_items
from picktree.simulation.physics import PhysicsHardware
from picktree.world import FeedSignals
from picktree.world.scene import AtIntervals, AtTimes

from .feed_cell import BELOW, build, fed, load, moved, places, told, turn_to, wait

BACKENDS = pytest.mark.parametrize("backend", ["physics", "kinematic"])


@BACKENDS
def test_a_load_comes_when_the_robot_is_ready(backend: Backend) -> None:
    hardware = build(backend, fed(total=6))
    wait(hardware, 1.0)
    assert hardware.feed.read() == FeedSignals(exhausted=False)
    hardware.feed.ready()
    assert hardware.feed.read().busy
    wait(hardware, 1.5)
    assert hardware.feed.read() == FeedSignals(exhausted=False, deliveries=1)
    assert [str(b.id) for b in hardware.truth()] == ["item_00", "item_01", "item_02"]
    assert told(hardware) == ["3 items are set down"]
    assert told(hardware) == []
    wait(hardware, 1.0)
    assert len(hardware.truth()) == 3


@BACKENDS
def test_a_delivery_counts_when_it_has_come_to_rest(backend: Backend) -> None:
    hardware = build(backend, fed())
    hardware.feed.ready()
    while not hardware.truth():
        hardware.step()
    assert (hardware.feed.read().deliveries, hardware.feed.read().busy) == (0, True)
    hardware.feed.ready()  # of what is being set down
    while hardware.feed.read().busy:
        hardware.step()
    assert all(math.hypot(*body.velocity) < 1e-3 for body in hardware.truth())
    wait(hardware, 1.0)
    assert (hardware.feed.read().deliveries, len(hardware.truth())) == (1, 3)


def test_the_feed_is_exhausted_when_all_have_come() -> None:
    hardware = build("kinematic", fed(total=5))
    for deliveries, items in ((1, 3), (2, 5), (2, 5)):
        hardware.feed.ready()
        wait(hardware, 0.5)
        assert (hardware.feed.read().deliveries, len(hardware.truth())) == (deliveries, items)
    assert hardware.feed.read() == FeedSignals(exhausted=True, deliveries=2)


def test_loads_come_in_a_rhythm() -> None:
    hardware = build("kinematic", fed(AtIntervals(2.0), of=load(("ball", 1))))
    hardware.feed.ready()  # nobody waits for that
    counts: list[int] = []
    for _ in range(7):
        counts.append(len(hardware.truth()))
        wait(hardware, 1.0)
    assert counts == [0, 0, 1, 1, 2, 2, 3]
    assert not hardware.feed.read().busy


def test_loads_come_at_their_times_and_no_more() -> None:
    hardware = build("kinematic", fed(AtTimes((0.5, 2.5)), of=load(("ball", 1))))
    counts: list[int] = []
    for _ in range(5):
        wait(hardware, 1.0)
        counts.append(len(hardware.truth()))
    assert counts == [1, 1, 2, 2, 2]
    assert hardware.feed.read() == FeedSignals(exhausted=True, deliveries=2)


@BACKENDS
def test_nothing_is_set_down_below_the_arm(backend: Backend) -> None:
    hardware = build(backend, fed(of=load(area=BELOW)))
    hardware.feed.ready()
    wait(hardware, 1.0)
    assert hardware.feed.read() == FeedSignals(exhausted=False, busy=True, obstructed=True)
    assert hardware.truth() == ()
    turn_to(hardware, "observe")
    wait(hardware, 1.0)
    assert hardware.feed.read() == FeedSignals(exhausted=False, deliveries=1)
    assert len(hardware.truth()) == 3


def test_a_schedule_waits_for_the_arm_and_loses_no_load() -> None:
    hardware = build("kinematic", fed(AtTimes((0.5, 1.0)), of=load(("ball", 1), area=BELOW)))
    wait(hardware, 3.0)
    assert hardware.feed.read().obstructed
    turn_to(hardware, "observe")
    wait(hardware, 0.5)
    assert (hardware.feed.read().deliveries, len(hardware.truth())) == (2, 2)


NARROW = load(("block", 2), area=((0.4, 0.28), (0.4, 0.395)))


def test_what_finds_no_room_comes_with_the_next_load() -> None:
    hardware = build("kinematic", fed(of=NARROW, total=4))
    hardware.feed.ready()
    wait(hardware, 0.5)
    first = hardware.truth()
    assert told(hardware) == ["2 items are set down"]
    hardware.remove("item_00")
    hardware.feed.ready()
    wait(hardware, 0.5)
    assert told(hardware) == ["1 item is set down, 1 more found no room"]
    assert not hardware.feed.read().exhausted
    for item in ("item_01", "item_02"):
        hardware.remove(item)
    hardware.feed.ready()
    wait(hardware, 0.5)
    assert told(hardware) == ["1 item is set down"]
    assert hardware.feed.read().exhausted
    assert [b.colour for b in first] == ["red", "blue"] or [b.colour for b in first] == ["blue", "red"]
    assert Counter(b.colour for b in hardware.truth()) == {"red": 2, "blue": 2}


def test_a_full_table_keeps_nobody_busy_and_the_load_comes_when_there_is_room() -> None:
    hardware = build("kinematic", fed(of=NARROW))
    hardware.feed.ready()
    wait(hardware, 0.5)
    hardware.feed.ready()
    wait(hardware, 0.5)
    assert hardware.feed.read() == FeedSignals(exhausted=False, deliveries=1)
    hardware.remove("item_00")
    hardware.remove("item_01")
    wait(hardware, 1.5)
    assert hardware.feed.read() == FeedSignals(exhausted=False, deliveries=2)


def test_what_lies_below_the_table_takes_no_room_on_it() -> None:
    hardware = build("physics", fed(of=NARROW))
    for deliveries in (1, 2):
        hardware.feed.ready()
        wait(hardware, 1.0)
        assert hardware.feed.read().deliveries == deliveries
        here = [name for name, (_, _, z) in places(hardware).items() if z > 0.0]
        moved(hardware, {name: (0.4, 0.3 + 0.07 * n, -0.6) for n, name in enumerate(here)})
    assert len(hardware.truth()) == 4


def test_what_comes_follows_from_scene_and_seed_whatever_the_robot_does() -> None:
    def loads(removed: bool) -> list[Counter[tuple[str, str]]]:
        hardware = build("kinematic", fed(of=load(("block", 1), ("can", 1), ("ball", 1))))
        found: list[Counter[tuple[str, str]]] = []
        known = 0
        for _ in range(2):
            hardware.feed.ready()
            wait(hardware, 0.2)
            found.append(Counter((b.kind, b.colour) for b in hardware.truth()[known:]))
            known = len(hardware.truth())
            if removed:
                hardware.remove(str(hardware.truth()[-1].id))
        return found

    assert loads(removed=True) == loads(removed=False)


def test_items_at_the_beginning_are_what_they_are_without_a_feed() -> None:
    spawn = (load(area=BELOW),)
    scene = fed(spawn=spawn)
    assert spawn_items(scene, 3) == spawn_items(fed(spawn=spawn, of=load(("ball", 5))), 3)
    hardware = build("kinematic", scene)
    hardware.feed.ready()
    wait(hardware, 0.2)
    assert [str(b.id) for b in hardware.truth()] == [f"item_{n:02d}" for n in range(6)]
    assert [b.brought_by for b in hardware.truth()] == [None, None, None, 0, 0, 0]


def test_what_is_set_down_lies_apart_and_sinks_into_nothing() -> None:
    spawn = (load(("block", 3), area=((0.3, 0.25), (0.6, 0.42))),)
    hardware = build(
        "physics", fed(spawn=spawn, of=load(("block", 2), ("can", 2), ("plate", 1), ("ball", 1)))
    )
    assert isinstance(hardware, PhysicsHardware)
    before = places(hardware)
    hardware.feed.ready()
    wait(hardware, 0.2)
    items = {str(body.id) for body in hardware.truth()}
    for _ in range(240):
        hardware.step()
        for contact in hardware.true_contacts():
            assert contact.distance > -1e-3
            assert not {contact.one, contact.other} <= items
    assert hardware.feed.read().deliveries == 1
    after = places(hardware)
    assert all(after[name] == pytest.approx(where, abs=1e-4) for name, where in before.items())
    assert all(after[name][2] > 0.0 for name in items)


def test_an_area_without_any_room_is_refused() -> None:
    with pytest.raises(PicktreeError) as error:
        build("kinematic", fed(of=load(area=((0.33, 0.54), (0.37, 0.56)))))
    assert str(error.value) == (
        "cell: feed[0]: no item fits into the area of 0.04 × 0.02 m beside the bodies there; "
        "make it larger, or put it elsewhere"
    )


@BACKENDS
def test_faults_meet_what_was_brought(backend: Backend) -> None:
    hardware = build(backend, fed())
    hardware.feed.ready()
    wait(hardware, 1.0)
    hardware.change_dynamics("item_01", friction=0.1, mass=0.2)
    hardware.remove("item_00")
    wait(hardware, 0.1)
    assert [b.present for b in hardware.truth()] == [False, True, True]
    with pytest.raises(PicktreeError, match="item 'item_00' was taken away before"):
        hardware.remove("item_00")
    with pytest.raises(PicktreeError, match="there is no item 'item_03'; known: item_00, item_01, item_02"):
        hardware.remove("item_03")
