"""Where items stand at the start: from scene and seed alone, apart, on the table."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.files import PicktreeError
from picktree.simulation import distance, footprint, spawn_items
from picktree.simulation.spawn import TUMBLE_HEIGHT
from picktree.world import Box, Cylinder, Pose, bottom
from picktree.world.scene import Spawn

from .simulated_cell import cell


def test_the_same_seed_gives_the_same_items_and_another_seed_others():
    assert spawn_items(cell(), 3) == spawn_items(cell(), 3)
    assert spawn_items(cell(), 3) != spawn_items(cell(), 4)


@pytest.mark.parametrize("seed", range(2))
def test_items_stand_on_the_table_inside_the_area_and_keep_the_gap(seed: int):
    items = spawn_items(cell(), seed)
    assert [i.id for i in items] == [f"item_{k:02d}" for k in range(10)]
    for item in items:
        x, y, _ = item.pose.position
        assert 0.35 <= x <= 0.65 and -0.25 <= y <= 0.25
        assert bottom(item.entry.shape, item.pose) == pytest.approx(0.0, abs=1e-9)
    outlines = [footprint(i.entry.shape, i.pose.orientation).at(i.pose.position) for i in items]
    assert min(distance(a, b) for a, b in itertools.combinations(outlines, 2)) >= 0.025


def test_the_share_of_lying_cylinders_is_met_on_average():
    lying = [
        abs(item.pose.rotation()[2, 2]) < 0.5
        for seed in range(40)
        for item in spawn_items(cell(), seed)
        if item.entry.form == "cylinder"
    ]
    assert len(lying) == 120
    assert 0.3 < sum(lying) / len(lying) < 0.5


def test_colours_are_given_out_in_turn():
    colours = [item.colour for item in spawn_items(cell(), 1)]
    assert sorted(colours) == ["blue"] * 5 + ["red"] * 5


def test_a_crowded_area_is_filled_by_pushing_apart():
    spawn = Spawn({"block": 18}, ("red",), ((0.36, -0.16), (0.64, 0.16)), gap=0.012)
    items = spawn_items(cell(spawn=(spawn,)), 0)
    outlines = [footprint(i.entry.shape, i.pose.orientation).at(i.pose.position) for i in items]
    assert min(distance(a, b) for a, b in itertools.combinations(outlines, 2)) >= 0.012


def test_an_area_that_is_too_small_is_refused_with_a_sentence():
    spawn = Spawn({"block": 18}, ("red",), ((0.4, -0.05), (0.5, 0.05)))
    with pytest.raises(PicktreeError) as error:
        spawn_items(cell(spawn=(spawn,)), 0)
    assert str(error.value) == (
        "cell: spawn[0]: the area of 0.10 × 0.10 m is too small for 18 items with a gap of 25 mm; "
        "make it larger, or ask for fewer items or a smaller gap"
    )


def test_an_area_beside_the_table_is_refused():
    spawn = Spawn({"block": 1}, ("red",), ((2.0, 0.0), (2.0, 0.0)))
    with pytest.raises(PicktreeError, match=r"spawn\[0\]: no fixture is below \(2\.000, 0\.000\)"):
        spawn_items(cell(spawn=(spawn,)), 0)


def test_tumbled_items_hang_above_the_table():
    spawn = Spawn({"block": 4}, ("red",), ((0.35, -0.25), (0.65, 0.25)), tumbled=True)
    for item in spawn_items(cell(spawn=(spawn,)), 0):
        assert item.dropped
        assert bottom(item.entry.shape, item.pose) == pytest.approx(TUMBLE_HEIGHT)


def test_no_item_is_spawned_in_a_bin():
    spawn = Spawn({"block": 3}, ("red",), ((0.2, 0.4), (0.5, 0.7)), gap=0.01)
    for seed in range(5):
        for item in spawn_items(cell(spawn=(spawn,)), seed):
            x, y, _ = item.pose.position
            assert abs(x - 0.35) > 0.125 or abs(y - 0.55) > 0.1


@given(st.floats(0.05, 0.5), st.floats(0, 3.2), st.floats(0, 3.2))
def test_the_distance_of_two_boxes_is_at_most_that_of_their_centres_and_symmetric(
    apart: float, yaw: float, other: float
):
    a = footprint(Box((0.04, 0.02, 0.01)), Pose.from_rpy((0, 0, 0), (0, 0, yaw)).orientation)
    b = footprint(Cylinder(0.02, 0.08), Pose.from_rpy((0, 0, 0), (1.5708, 0, other)).orientation)
    gap = distance(a.at((0, 0)), b.at((apart, 0)))
    assert gap == pytest.approx(distance(b.at((apart, 0)), a.at((0, 0))), abs=1e-12)
    assert gap >= apart - a.reach - b.reach - 1e-9
    assert gap <= apart - 0.01 - 0.02 + 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_items_that_stand_side_by_side_touch_and_do_not_overlap(seed: int):
    counts = {"block": 3, "can": 2, "plate": 1}
    spawn = Spawn(counts, ("red",), ((0.38, -0.17), (0.64, 0.17)), touching=True)
    items = spawn_items(cell(spawn=(spawn,)), seed)
    assert spawn_items(cell(spawn=(spawn,)), seed) == items
    outlines = [footprint(i.entry.shape, i.pose.orientation).at(i.pose.position) for i in items]
    for one in outlines:
        near = min(distance(one, other) for other in outlines if other is not one)
        assert 0.0 < near < 1.1e-4
    for item in items:
        assert bottom(item.entry.shape, item.pose) == pytest.approx(0.0, abs=1e-9)


def test_an_area_that_is_too_small_for_items_side_by_side():
    spawn = Spawn({"block": 9}, ("red",), ((0.40, 0.0), (0.46, 0.06)), touching=True)
    with pytest.raises(PicktreeError, match="too small for 9 items"):
        spawn_items(cell(spawn=(spawn,)), 0)
