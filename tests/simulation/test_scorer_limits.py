"""The judge's limits, each from both sides: what lies in a bin, and what is in a hole."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from picktree.simulation import HoledFixtures, HoleSeating, score
from picktree.world import Box, Pose, Shape, Sphere, Vector3, bottom

from .test_scorer_holes import BOARD, peg
from .test_scorer_holes import SCENE as PEGS
from .test_simulation_scorer import SCENE, item

IN_THE_BIN = (0.35, 0.55, 0.025)


@pytest.mark.parametrize(
    ("velocity", "spin", "verdict"),
    [
        ((0.0, 0.0, 0.019), (0.0, 0.0, 0.0), "sorted"),
        ((0.0, 0.0, 0.021), (0.0, 0.0, 0.0), "left"),
        ((0.015, 0.0, -0.015), (0.0, 0.0, 0.0), "left"),
        ((0.0, 0.0, 0.0), (0.0, -0.99, 0.0), "sorted"),
        ((0.0, 0.0, 0.0), (0.0, -1.01, 0.0), "left"),
        ((0.0, 0.0, 0.0), (0.8, 0.0, 0.8), "left"),
    ],
)
def test_what_moves_lies_nowhere(velocity: Vector3, spin: Vector3, verdict: str) -> None:
    body = replace(item(IN_THE_BIN), velocity=velocity, spin=spin)
    assert score([body], SCENE).items[0].verdict == verdict


@pytest.mark.parametrize(
    ("away", "within"),
    [
        ((0.119, 0.0, 0.025), True),
        ((0.121, 0.0, 0.025), False),
        ((-0.119, 0.0, 0.025), True),
        ((-0.121, 0.0, 0.025), False),
        ((0.0, 0.094, 0.025), True),
        ((0.0, 0.096, 0.025), False),
        ((0.0, -0.094, 0.025), True),
        ((0.0, -0.096, 0.025), False),
        ((0.0, 0.0, 0.001), True),
        ((0.0, 0.0, -0.001), False),
    ],
)
def test_in_a_bin_is_within_its_walls_and_above_its_bottom(away: Vector3, within: bool) -> None:
    """A bin of 25 cm by 20 cm outside, with walls of 5 mm, its middle at (0.35, 0.55)."""
    x, y, z = away
    verdict = score([item((0.35 + x, 0.55 + y, z))], SCENE).items[0]
    assert (verdict.bin, verdict.verdict) == (("red_bin", "sorted") if within else (None, "left"))


def test_what_was_crushed_is_misplaced_wherever_it_lies() -> None:
    for at in (IN_THE_BIN, (0.5, 0.0, 0.02)):
        fine, crushed = item(at), replace(item(at), crushed=31.25)
        before, (judged,) = score([fine], SCENE).items[0], score([crushed], SCENE).items
        assert (judged.verdict, judged.reason) == (
            "misplaced",
            "it was crushed: a finger pressed with 31.2 N",
        )
        assert (judged.bin, judged.destination) == (before.bin, "red_bin")
        assert before.reason == ""


@pytest.mark.parametrize(
    ("how", "verdict"),
    [
        # Of 30 mm, 24 are deep enough.
        ({"up": 0.0059}, "sorted"),
        ({"up": 0.0061}, "left"),
        ({"deep": 0.14e-3}, "sorted"),
        ({"deep": 0.16e-3}, "misplaced"),
        ({"up": 0.001, "lean": math.radians(4.9)}, "sorted"),
        ({"up": 0.001, "lean": math.radians(5.1)}, "left"),
        # The circle's radius is 21 mm.
        ({"off": 0.0209}, "sorted"),
        ({"off": 0.0211}, "left"),
    ],
)
def test_in_a_hole_is_deep_upright_over_it_and_in_no_wall(how: dict[str, float], verdict: str) -> None:
    body = peg("dowel_30", "round_42", **{"up": 0.0, **how})
    assert score([body], PEGS).items[0].verdict == verdict


def seat_at(
    shape: Shape, x: float, y: float, lowest: float, hole: str = "", lean: float = 0.0
) -> HoleSeating | None:
    """An item at (x, y) of a hole, or of the board, with its lowest point so far above the board's top."""
    middle = next((h.pose.position for h in BOARD.holes if h.id == f"board/{hole}"), (0.0, 0.0, 0.0))
    assert isinstance(BOARD.shape, Box)
    z = BOARD.shape.size[2] / 2 + lowest - bottom(shape, Pose.from_rpy((0.0, 0.0, 0.0), (lean, 0.0, 0.0)))
    item_in_board = Pose.from_rpy((middle[0] + x, middle[1] + y, z), (lean, 0.0, 0.0))
    return HoledFixtures([BOARD]).seat(shape, BOARD.pose @ item_in_board)


@pytest.mark.parametrize(("off", "over"), [(0.0204, True), (0.0206, False)])
def test_over_a_square_hole_is_within_both_of_its_sides(off: float, over: bool) -> None:
    for x, y in ((off, 0.0), (-off, 0.0), (0.0, off), (0.0, -off)):
        seat = seat_at(PEGS.entry("post_40").shape, x, y, -0.01, "square_41")
        assert seat is not None
        assert (seat.hole, seat.over, seat.fits) == ("board/square_41", over, True)
        assert seat.off == pytest.approx(off)
    # Its corner is over it, though farther from the middle.
    seat = seat_at(PEGS.entry("post_40").shape, 0.02, 0.02, -0.01, "square_41")
    assert seat is not None and seat.over
    seat = seat_at(PEGS.entry("dowel_40").shape, 0.02, 0.02, -0.01, "round_42")
    assert seat is not None and not seat.over


def test_a_seat_measures_depth_and_lean_at_the_nearest_hole() -> None:
    seat = seat_at(PEGS.entry("dowel_30").shape, 0.003, -0.004, -0.012, "round_31", lean=0.1)
    assert seat is not None
    assert (seat.hole, seat.over, seat.fits) == ("board/round_31", True, True)
    assert (seat.depth, seat.bottom, seat.off) == pytest.approx((0.012, 0.03, 0.005))
    assert seat.tilt == pytest.approx(0.1)
    # Head first it stands, too; a ball has no head.
    seat = seat_at(PEGS.entry("dowel_30").shape, 0.0, 0.0, -0.012, "round_31", lean=math.pi)
    assert seat is not None and seat.tilt == pytest.approx(0.0, abs=1e-6)
    seat = seat_at(Sphere(0.015), 0.0, 0.0, -0.012, "round_31", lean=1.0)
    assert seat is not None and (seat.tilt, seat.fits) == (0.0, True)


def test_a_seat_is_over_the_board_and_below_its_top() -> None:
    assert isinstance(BOARD.shape, Box)
    x, y, z = BOARD.shape.size
    ball = Sphere(0.01)
    for lowest, there in (
        (-0.0009, False), (-0.0011, True), (-z - 0.0009, True), (-z - 0.0011, False)
    ):  # fmt: skip
        assert (seat_at(ball, 0.0, 0.0, lowest) is not None) is there, lowest
    for off, there in ((-0.001, True), (0.001, False)):
        for dx, dy in ((x / 2 + off, 0.0), (-x / 2 - off, 0.0), (0.0, y / 2 + off), (0.0, -y / 2 - off)):
            assert (seat_at(ball, dx, dy, -0.01) is not None) is there, (dx, dy)
    assert not HoledFixtures(SCENE.fixtures)
    assert HoledFixtures(PEGS.fixtures)
    assert HoledFixtures(SCENE.fixtures).seat(ball, Pose((0.5, 0.0, -0.01))) is None


def test_how_deep_it_is_and_should_be_is_told_to_a_tenth_of_a_millimetre() -> None:
    body = peg("dowel_30", "round_42", 0.0)
    assert body.seat is not None
    for depth, bottom_, words in ((0.04744, 0.06044, "47.4 mm"), (0.04746, 0.06046, "47.5 mm")):
        shallow = replace(body, seat=replace(body.seat, depth=depth, bottom=bottom_))
        (judged,) = score([shallow], PEGS).items
        assert judged.reason == (
            f"it is {words} deep in board/round_42, which is {'60.4' if depth < 0.04745 else '60.5'} mm deep"
        )
