"""The scorer on items in holes: deep enough, upright, in no wall, at rest, in a hole of their form."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from picktree.simulation import HoledFixtures, TrueBody, score
from picktree.world import ObjectId, Pose
from picktree.world.scene import load_scene

SCENE = load_scene("pegs")
BOARD = SCENE.fixture("board")


def peg(kind: str, hole: str, up: float, off: float = 0.0, lean: float = 0.0, deep: float = 0.0) -> TrueBody:
    """A peg whose lower end, if it stood straight, would be `up` above the hole's bottom."""
    entry = SCENE.entry(kind)
    mouth = BOARD.pose @ next(h for h in BOARD.holes if h.id == f"board/{hole}").pose
    half = 0.0325 if kind.startswith(("dowel", "post")) else 0.03
    pose = mouth @ Pose.from_rpy((off, 0.0, up - 0.03 + half), (lean, 0.0, 0.0))
    body = TrueBody.of(ObjectId("item_00"), entry, "red", pose)
    seat = HoledFixtures([BOARD]).seat(entry.shape, pose)
    return replace(body, seat=None if seat is None else replace(seat, penetration=deep))


@pytest.mark.parametrize(
    ("body", "verdict", "within", "reason"),
    [
        (peg("dowel_30", "round_31", 0.0), "sorted", "board/round_31", ""),
        (peg("dowel_30", "round_42", 0.0), "sorted", "board/round_42", ""),
        (peg("dowel_30", "round_31", 0.005), "sorted", "board/round_31", ""),
        (
            peg("dowel_30", "round_31", 0.007), "left", None,
            "it is 23.0 mm deep in board/round_31, which is 30.0 mm deep",
        ),
        (
            peg("dowel_30", "round_42", 0.001, lean=math.radians(6)), "left", None,
            "it leans by 6.0 deg in board/round_42",
        ),
        (
            peg("dowel_30", "round_31", 0.0, deep=0.4e-3), "misplaced", None,
            "it is 0.40 mm deep in a wall of board/round_31",
        ),
        (peg("post_30", "round_42", 0.0), "left", None, "board/round_42 is no hole for it"),
        (peg("dowel_30", "round_31", 0.02, off=0.03), "left", None, "it is 30.0 mm beside board/round_31"),
        (
            replace(peg("dowel_30", "round_31", 0.0), velocity=(0.0, 0.0, -0.1)), "left", None,
            "it still moves in board/round_31",
        ),
        (peg("dowel_30", "round_31", 0.03), "left", None, ""),
    ],
)  # fmt: skip
def test_what_counts_as_in_a_hole(body: TrueBody, verdict: str, within: str | None, reason: str) -> None:
    (item,) = score([body], SCENE).items
    assert (item.verdict, item.bin, item.reason) == (verdict, within, reason)
    assert item.seat == body.seat


def test_one_hole_may_be_the_destination() -> None:
    rule = replace(SCENE.destinations[0], to=ObjectId("board/round_42"))
    scene = replace(SCENE, destinations=(rule,))
    right, wrong = peg("dowel_40", "round_42", 0.0), peg("dowel_30", "round_31", 0.0)
    assert [item.verdict for item in score([right, wrong], scene).items] == ["sorted", "misplaced"]
    assert score([wrong], scene).items[0].reason == "it belongs into board/round_42"


def test_what_belongs_nowhere_may_lie_about_but_not_fill_a_hole() -> None:
    scene = replace(SCENE, destinations=())
    inside, beside = peg("dowel_30", "round_31", 0.0), peg("dowel_30", "round_31", 0.02)
    assert [item.verdict for item in score([inside, beside], scene).items] == ["misplaced", "no destination"]
