"""Items come on a belt: it runs when the robot is ready, and stops when its light barrier sees another."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from picktree.simulation import TrueBody
from picktree.simulation.checkpoints import Checkpoint, KinematicState
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware
from picktree.world.robot_model import RobotModel
from picktree.world.scene import Delivery, SceneDescription

from ..other_process import OtherProcess
from .belt_cell import AT, BELT, KINDS, TOP, Hardware, belt_of, belt_scene
from .simulated_cell import panda

BACKENDS = (PhysicsHardware, KinematicHardware)
EYE, LENGTH = 0.1, 1.0


def scene(
    total: int | None = None, spacing: float = 0.2, speed: float = 0.1, **counts: int
) -> SceneDescription:
    """A belt of 1 m on which blocks come, or what `counts` says."""
    counts = counts or {"block": 1}
    area = ((0.45, -LENGTH / 2), (0.65, LENGTH / 2))
    delivery = Delivery(counts, ("red", "green"), area, lying=0.5, total=total, belt=BELT, spacing=spacing)
    return replace(belt_scene(eye=EYE, length=LENGTH, speed=speed), catalogue=KINDS, deliveries=(delivery,))


def there(hardware: Hardware) -> list[TrueBody]:
    """What lies on the belt, in the order in which it came."""
    return [body for body in hardware.truth() if body.pose.position[2] > 0.0]


def serve(hardware: Hardware) -> None:
    """Say that the robot is ready, and wait for what comes."""
    hardware.feed.ready()
    until_idle(hardware)


def until_idle(hardware: Hardware) -> None:
    for _ in range(60 * 240):
        hardware.step()
        if not hardware.feed.read().busy:
            return
    raise AssertionError("the belt runs for a minute")


def over(hardware: Hardware, *, belt: bool) -> None:
    """Bring the arm over the belt, or home."""
    model = RobotModel(panda())
    q = model.named("home").copy()
    if belt:
        q[1], q[3] = 0.4, -1.6
    hardware.arm.follow(q, np.zeros(model.n))
    for _ in range(240):
        hardware.step()


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_belt_runs_for_the_robot_until_another_item_comes(backend: type[Hardware]) -> None:
    hardware = backend(scene(), panda(), 1)
    for _ in range(120):
        hardware.step()
    assert there(hardware) == []
    assert not hardware.feed.read().busy
    serve(hardware)
    signals = hardware.feed.read()
    assert (signals.deliveries, signals.busy, signals.exhausted) == (1, False, False)
    first, *others = there(hardware)
    # Its front is behind the barrier by what it takes to stop.
    assert first.pose.position[1] == pytest.approx(EYE + 0.02 - 0.024, abs=0.012)
    assert len(others) in (2, 3, 4)
    assert all(body.pose.position[2] == pytest.approx(TOP + 0.02, abs=1e-3) for body in others)
    assert all(body.brought_by == 0 for body in others)
    still = belt_of(hardware).travelled
    for _ in range(120):
        hardware.step()
    assert belt_of(hardware).travelled == still


def test_what_was_left_in_the_barrier_rides_on_until_another_item_comes() -> None:
    hardware = KinematicHardware(scene(), panda(), 1)
    serve(hardware)
    left, second, *_ = there(hardware)
    assert belt_of(hardware).interrupted()
    serve(hardware)
    assert hardware.feed.read().deliveries == 2
    now = {body.id: body.pose.position[1] for body in there(hardware)}
    assert now[second.id] == pytest.approx(EYE, abs=0.016)
    assert now[left.id] - now[second.id] == pytest.approx(
        left.pose.position[1] - second.pose.position[1], abs=1e-3
    )


def test_what_is_never_taken_falls_off_and_the_feed_ends() -> None:
    hardware = KinematicHardware(scene(total=4), panda(), 2)
    stops = 0
    while not hardware.feed.read().exhausted:
        serve(hardware)
        stops += 1
    assert stops == hardware.feed.read().deliveries == 4
    assert len(hardware.truth()) == 4
    assert len(there(hardware)) in (2, 3)
    assert max(body.pose.position[1] for body in there(hardware)[-1:]) == pytest.approx(EYE, abs=0.03)
    serve(hardware)
    assert hardware.feed.read().deliveries == 4


def test_the_last_item_comes_to_the_barrier_though_others_were_taken() -> None:
    hardware = KinematicHardware(scene(total=2), panda(), 2)
    serve(hardware)
    for body in there(hardware):
        hardware.remove(body.id)
    serve(hardware)
    assert hardware.feed.read().exhausted
    assert hardware.feed.read().deliveries == 2


def test_spacing_and_place_are_drawn_and_the_mixture_keeps_its_shares() -> None:
    hardware = KinematicHardware(scene(total=12, spacing=0.16, speed=0.15, block=2, can=1), panda(), 3)
    belt, ways = belt_of(hardware), list[float]()
    while not hardware.feed.read().exhausted:
        hardware.feed.ready()
        for _ in range(4):
            hardware.step()
        if len(hardware.truth()) > len(ways):
            ways.append(belt.travelled)
    items = hardware.truth()
    for half in (items[:6], items[6:]):
        assert Counter(body.kind for body in half) == {"block": 4, "can": 2}
        assert Counter(body.colour for body in half) == {"red": 3, "green": 3}
    assert [b.kind for b in items[:6]] != [b.kind for b in items[6:]]
    spacings = np.diff(ways)
    assert 0.117 <= spacings.min() < 0.15
    assert 0.17 < spacings.max() <= 0.2 + 0.15 * 0.05
    aside = [abs(body.pose.position[0] - AT[0]) for body in items]
    assert 0.01 < max(aside) < 0.1 - 0.0435


@pytest.mark.parametrize("backend", BACKENDS)
def test_no_belt_runs_below_the_arm(backend: type[Hardware]) -> None:
    hardware = backend(scene(), panda(), 1)
    over(hardware, belt=True)
    hardware.feed.ready()
    for _ in range(240):
        hardware.step()
    signals = hardware.feed.read()
    assert (signals.busy, signals.obstructed) == (True, True)
    assert belt_of(hardware).travelled == 0.0
    over(hardware, belt=False)
    assert belt_of(hardware).moving
    over(hardware, belt=True)
    assert not belt_of(hardware).moving
    stopped = belt_of(hardware).travelled
    assert hardware.feed.read().obstructed
    over(hardware, belt=False)
    assert belt_of(hardware).travelled > stopped
    assert not hardware.feed.read().obstructed
    until_idle(hardware)
    assert hardware.feed.read().deliveries == 1


def test_the_journal_hears_of_runs_and_stops_but_not_of_places() -> None:
    hardware = KinematicHardware(scene(), panda(), 1)
    serve(hardware)
    runs, stops = hardware.take_events()
    assert (runs.kind, runs.message) == ("belt_runs", "belt runs")
    assert runs.data == {"feed": 0, "belt": "belt", "number": 1}
    assert (stops.kind, stops.message) == ("belt_stops", "belt stops")
    assert stops.data == {"feed": 0, "belt": "belt", "number": 1, "items": len(there(hardware))}


def told(hardware: Hardware) -> str:
    """A digest of what happens until the belt has stopped."""
    found = hashlib.sha256()
    hardware.feed.ready()
    while hardware.feed.read().busy:
        for _ in range(12):
            hardware.step()
        found.update(f"{hardware.truth()} {hardware.feed.read()} {belt_of(hardware).state}".encode())
    return found.hexdigest()


def told_from(saved: str, backend: type[Hardware]) -> str:
    """A digest of what happens from a checkpoint in JSON."""
    plain, of = json.loads(saved), (scene(block=1, can=1), panda(), 5)
    if backend is PhysicsHardware:
        return told(PhysicsHardware.resume(*of, Checkpoint.from_plain(plain)))
    return told(KinematicHardware.resume(*of, KinematicState.from_plain(plain)))


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_checkpoint_while_items_come_goes_on_the_same_elsewhere(
    backend: type[Hardware], elsewhere: OtherProcess
) -> None:
    hardware = backend(scene(block=1, can=1), panda(), 5)
    hardware.feed.ready()
    for _ in range(3 * 240):
        hardware.step()
    assert belt_of(hardware).moving
    saved = json.dumps(hardware.checkpoint().to_plain())
    assert elsewhere.call(told_from, saved, backend) == told(hardware)
