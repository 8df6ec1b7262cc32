"""Totes that come back full when they are exchanged: what comes, what leaves, and checkpoints meanwhile."""

from __future__ import annotations

from dataclasses import replace

import pytest

from picktree.files import PicktreeError
from picktree.simulation import TrueBody, score
from picktree.simulation.physics import PhysicsHardware
from picktree.simulation.scorer import is_inside
from picktree.world import FeedSignals, ObjectId
from picktree.world.scene import SceneDescription, load_scene
from picktree.world.scene.description import Exchange

from .feed_cell import build, digest, resumed, told, turn_to, wait

TOTE = ObjectId("tote")


def totes(load: int = 3, total: int = 5) -> SceneDescription:
    """Two things in the first tote, and loads of three; tags, so that they are remembered, too."""
    scene = load_scene("totes")
    (spawn,), (delivery,) = scene.spawn, scene.deliveries
    assert scene.assortment is not None
    return replace(
        scene,
        spawn=(replace(spawn, counts={"assortment": 2}),),
        deliveries=(replace(delivery, counts={"assortment": load}, total=total),),
        exchange=Exchange(1.0),
        assortment=replace(scene.assortment, tags=(1, 2, 3), tag_size=0.01),
    )


def cell(scene: SceneDescription) -> PhysicsHardware:
    hardware = build("physics", scene)
    assert isinstance(hardware, PhysicsHardware)
    turn_to(hardware, "rest", 1.0)
    return hardware


def lie_in_tote(hardware: PhysicsHardware) -> list[TrueBody]:
    (tote,) = (each for each in hardware.scene.bins if each.id == TOTE)
    return [body for body in hardware.truth() if is_inside(tote, body)]


def test_a_tote_comes_back_full_until_all_has_come() -> None:
    hardware = cell(totes())
    assert len(lie_in_tote(hardware)) == 2
    hardware.feed.exchange(TOTE)
    wait(hardware, 1.2)
    assert [body.taken_with for body in hardware.truth()] == [TOTE] * 2 + [None] * 3
    assert hardware.feed.read() == FeedSignals(False, True, False, 0, {TOTE: 0}), "its items still move"
    wait(hardware, 5.0)
    assert hardware.feed.read() == FeedSignals(False, False, False, 1, {TOTE: 1})
    assert len(lie_in_tote(hardware)) == 3
    hardware.feed.exchange(TOTE)
    wait(hardware, 6.2)
    assert hardware.feed.read().exhausted, "the last load is what is missing of the total"
    assert len(lie_in_tote(hardware)) == 2
    hardware.feed.exchange(TOTE)
    wait(hardware, 1.2)
    assert hardware.feed.read().exchanges == {TOTE: 3}
    assert lie_in_tote(hardware) == []
    assert told(hardware) == [
        "tote comes with 3 items",
        "tote comes with 2 items",
        "tote is exchanged for a full one, with 2 items in it",
        "tote is exchanged for a full one, with 3 items in it",
        "tote is exchanged for an empty one, with 2 items in it",
    ]
    found = score(hardware.truth(), hardware.scene)
    assert (found.count.total, found.count.left, found.outstanding) == (7, 7, 0), (
        "what leaves with a tote is left"
    )


def test_what_comes_follows_from_scene_and_seed() -> None:
    ones: list[list[tuple[str, object, int | None]]] = []
    for seed in (4, 4, 5):
        hardware = build("physics", totes(), seed)
        turn_to(hardware, "rest", 1.0)
        hardware.feed.exchange(TOTE)
        wait(hardware, 1.2)
        ones.append([(body.colour, body.shape, body.tag) for body in hardware.truth()[2:]])
    assert ones[0] == ones[1] != ones[2]


@pytest.mark.parametrize("after", [1.3, 7.5], ids=["while_it_settles", "after_two"])
def test_a_run_is_resumed_bit_for_bit(after: float) -> None:
    hardware = cell(totes())
    hardware.feed.exchange(TOTE)
    if after > 6.0:
        wait(hardware, 6.2)
        hardware.feed.exchange(TOTE)
        after -= 6.2
    wait(hardware, after)
    hardware.take_events()
    left = [body for body in hardware.truth() if body.taken_with]
    again = resumed(hardware)
    assert [body for body in again.truth() if body.taken_with] == left
    assert again.truth() == hardware.truth()
    assert again.feed.read() == hardware.feed.read()
    assert digest(again, 2.0) == digest(hardware, 2.0)


def test_a_checkpoint_of_another_feed_is_refused() -> None:
    scene = totes()
    saved = cell(scene).checkpoint()
    with pytest.raises(PicktreeError) as error:
        cell(replace(scene, deliveries=())).restore(saved)
    assert str(error.value) == (
        "the checkpoint's feed has 1 with a tote among its entries, but the scene's has 0"
    )
