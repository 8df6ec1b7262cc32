"""The scorer looks at the truth alone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from picktree.simulation import TrueBody, score
from picktree.world import FormCount, ItemCount, ObjectId, Pose, Vector3
from picktree.world.scene import CatalogueEntry, Delivery

from .simulated_cell import cell

SCENE = cell()


def item(position: Vector3, colour: str = "red", kind: str = "block") -> TrueBody:
    entry: CatalogueEntry = SCENE.entry(kind)
    return TrueBody.of(ObjectId("item_00"), entry, colour, Pose(position))


def taken_away(body: TrueBody, bin_id: str) -> TrueBody:
    return replace(body, present=False, taken_with=ObjectId(bin_id))


@pytest.mark.parametrize(
    ("body", "verdict"),
    [
        (item((0.35, 0.55, 0.025)), "sorted"),
        (item((0.35, 0.55, 0.025), colour="blue"), "misplaced"),
        (item((0.35, -0.55, 0.025), colour="blue"), "sorted"),
        (item((0.5, 0.0, 0.02)), "left"),
        (item((0.35, 0.55, 0.119)), "sorted"),
        (item((0.35, 0.55, 0.121)), "left"),
        (item((0.35, 0.55, 0.025), colour="green"), "misplaced"),
        (item((0.5, 0.0, 0.02), colour="green"), "no destination"),
        (item((0.35, 0.55, -0.7)), "left"),
        (replace(item((0.35, 0.55, 0.025)), present=False), "left"),
        (replace(item((0.5, 0.0, 0.02), colour="green"), present=False), "left"),
        (taken_away(item((0.35, 0.55, 0.025)), "red_bin"), "sorted"),
        (taken_away(item((0.35, 0.55, 0.121)), "red_bin"), "sorted"),
        (taken_away(item((0.35, 0.55, 0.025), colour="blue"), "red_bin"), "misplaced"),
        (taken_away(item((0.35, 0.55, 0.025), colour="green"), "red_bin"), "misplaced"),
    ],
)
def test_an_item_is_judged_by_where_it_rests(body: TrueBody, verdict: str):
    assert [i.verdict for i in score([body], SCENE).items] == [verdict]


@pytest.mark.parametrize(
    ("colour", "verdict"), [("red", "left"), ("green", "no destination"), ("blue", "sorted")]
)
def test_an_item_in_a_tote_is_in_no_bin(colour: str, verdict: str):
    bins = tuple(replace(each, is_tote=each.id == "blue_bin") for each in SCENE.bins)
    body = item((0.35, -0.55, 0.025), colour=colour)
    assert [i.verdict for i in score([body], replace(SCENE, bins=bins)).items] == [verdict]


def test_the_score_counts_in_all_and_by_form():
    bodies = [
        item((0.35, 0.55, 0.025)),
        item((0.35, 0.55, 0.045), kind="can"),
        item((0.35, -0.55, 0.025)),
        item((0.5, 0.0, 0.02), kind="ball"),
    ]
    result = score(bodies, SCENE)
    count = result.count
    assert (count.total, count.sorted, count.misplaced, count.left) == (4, 2, 1, 1)
    assert (count.by_form["box"], count.by_form["sphere"]) == (FormCount(2, 1), FormCount(1, 0))
    assert not result.reached()
    assert result.reached("sorted >= 2 and misplaced <= 1")
    assert score(bodies[:2], SCENE).reached()


def test_what_a_feed_still_owes_is_outstanding():
    delivery = Delivery({"block": 2}, ("red",), ((0.35, -0.25), (0.65, 0.25)))
    scene = cell(deliveries=(replace(delivery, total=3), delivery))
    first, second = (replace(item((0.35, 0.55, 0.025)), brought_by=n) for n in (0, 1))
    spawned = item((0.35, 0.55, 0.025))
    some = score([spawned, first, first, second], scene)
    assert (some.count.total, some.count.sorted, some.outstanding) == (4, 4, 1)
    assert not some.reached() and some.reached("sorted == total and outstanding < 2")
    assert score([spawned, *[first] * 3, second], scene).reached()
    assert not score([item((0.5, 0.0, 0.02)), *[first] * 3], scene).reached()


def test_items_without_a_destination_count_as_none_of_the_others() -> None:
    free, sorted_ = item((0.5, 0.0, 0.02), colour="green"), item((0.35, 0.55, 0.025))
    judged = score([free, sorted_], SCENE)
    assert judged.count == ItemCount(1, 1, 0, 0, {"box": FormCount(1, 1)}, 1)
    assert judged.reached()
    assert not score([free, item((0.5, 0.0, 0.02))], SCENE).reached()
    assert score([item((0.35, 0.55, 0.025), colour="green")], SCENE).count.misplaced == 1
