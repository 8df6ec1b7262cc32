"""Obstacles from one made-up picture to the next: which cells hang together, which name they keep."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from picktree.robot.perception.obstacle_volumes import (
    cell_indices,
    cell_keys,
    cells_of,
    in_picture,
    merge_cells,
    supposed_cells_of,
    update_volumes,
)
from picktree.robot.perception.view import PerceivedView, UnexplainedPatch
from picktree.world import Array, BeliefObject, Box, ObjectId, PlanningScene, Pose

from . import perception_pictures
from .synthetic_view import HEIGHT, HIGH, WIDE, patch_of, raised, synthetic_view

OUT = 300
"""First cell along x of what the picture does not show: nothing is learnt of it."""


def row(*xs: int, y: int = 0, layers: int = 1) -> Array:
    """Cells (n, 3) at these places along x."""
    return np.array([(x, y, z) for x in xs for z in range(layers)])


def run(start: int, count: int, y: int = 0, layers: int = 1) -> Array:
    return row(*range(start, start + count), y=y, layers=layers)


def obstacle(cells: Array, name: str = "obstacle_1", supposed: Array | None = None) -> BeliefObject:
    """By cells (n, 3)."""
    further = None if supposed is None else cell_keys(supposed)
    return perception_pictures.obstacle(cell_keys(cells), name, supposed=further)


def scene_with(*obstacles: BeliefObject) -> PlanningScene:
    scene = PlanningScene((), ())
    for each in obstacles:
        scene.put(each, "test")
    for _ in obstacles:
        scene.new_id("obstacle")
    scene.take_changes()
    return scene


def clear(*cells: Array, rest: float = 0.1) -> PerceivedView:
    """A view in which rays pass these cells near the table, and `rest` is as far as all others go, m."""
    reach = np.full((HIGH, WIDE), rest)
    for x, y, z in np.concatenate(cells) if cells else ():
        depth = 1.0 - 0.02 * (z + 0.5)
        u, v = round(30 + (x + 0.5) / depth), round(20 - (y + 0.5) / depth)
        reach[v - 1 : v + 2, u - 1 : u + 2] = 2.0
    return synthetic_view(HEIGHT, reach=reach)


def look(
    scene: PlanningScene,
    view: PerceivedView | None = None,
    patches: tuple[UnexplainedPatch, ...] = (),
    items: tuple[BeliefObject, ...] = (),
    now: float = 2.0,
) -> list[str]:
    """The changes, as `id: reason`."""
    update_volumes(
        scene, view or synthetic_view(HEIGHT, reach=np.full((HIGH, WIDE), 0.1)), patches, items, now
    )
    return [
        f"{(change.after or change.before).id}: {change.reason}"  # type: ignore[union-attr]  # pyright: ignore[reportOptionalMemberAccess]
        for change in scene.take_changes()
    ]


def taken(scene: PlanningScene) -> dict[str, int]:
    """How many cells each takes up."""
    return {str(o.id): len(cells_of(o)) for o in scene.objects if o.role == "obstacle"}


@pytest.mark.parametrize(
    ("count", "gone", "reasons"), [(5, ["obstacle_1"], ["its place was seen without it"]), (6, [], [])]
)
def test_fewer_than_six_cells_are_noise(count: int, gone: list[str], reasons: list[str]) -> None:
    scene = scene_with(obstacle(run(OUT, count)))
    assert update_volumes(scene, synthetic_view(), (), (), 2.0) == gone
    assert [change.reason for change in scene.take_changes()] == reasons
    assert taken(scene) == ({} if gone else {"obstacle_1": 6})


def test_without_anything_unknown_nothing_is_done() -> None:
    assert look(scene_with()) == []
    held = obstacle(run(OUT, 3))
    scene = scene_with(held)
    scene.attach("obstacle_1", Pose())
    scene.take_changes()
    assert look(scene) == []  # what is held is not looked for
    assert scene.held is not None


@pytest.mark.parametrize("axis", [0, 1])
def test_what_is_two_cells_apart_hangs_together(axis: int) -> None:
    torn = ["obstacle_1: rays pass through parts of it", "obstacle_2: depth that nothing explains"]
    for gap, changes, parts in ((2, [], {"obstacle_1": 13}), (3, torn, {"obstacle_1": 7, "obstacle_2": 6})):
        cells = np.concatenate([run(OUT, 7), run(OUT + 7 + gap, 6)])
        scene = scene_with(obstacle(cells[:, [1, 0, 2]] if axis else cells))
        assert look(scene) == changes
        assert taken(scene) == parts


def test_what_is_askew_hangs_together_as_well() -> None:
    cells = np.concatenate([run(OUT, 3), run(OUT + 5, 3, y=3)])
    scene = scene_with(obstacle(cells))
    assert look(scene) == []
    scene = scene_with(obstacle(np.concatenate([cells, run(OUT + 12, 3, y=4), run(OUT + 17, 3, y=7)])))
    look(scene)
    assert taken(scene) == {"obstacle_1": 6, "obstacle_2": 6}


def test_of_parts_as_large_as_each_other_the_first_along_x_keeps_the_name() -> None:
    """And along y: by the first cell of each, not by the second."""
    wide, close = row(*range(OUT, OUT + 18, 3)), run(OUT, 6, y=10)
    scene = scene_with(obstacle(np.concatenate([wide, close])))
    look(scene)
    assert np.array_equal(cells_of(scene.get("obstacle_1")), cell_keys(wide))


def test_several_that_are_seen_again_keep_their_names() -> None:
    parts = [run(OUT, 8), run(OUT + 20, 7), run(OUT + 40, 9), run(OUT + 60, 6)]
    scene = scene_with(*(obstacle(cells, f"obstacle_{n}") for n, cells in enumerate(parts, 1)))
    assert look(scene) == []
    assert list(taken(scene).values()) == [8, 7, 9, 6]


def test_above_each_other_cells_hang_together_whatever_is_between() -> None:
    scene = scene_with(obstacle(np.array([(OUT + k, 0, z) for k in range(3) for z in (0, 9)])))
    assert look(scene) == []


@pytest.mark.parametrize(("left", "right"), [(6, 9), (9, 6), (7, 7)])
def test_the_greater_part_keeps_the_name_and_the_colour(left: int, right: int) -> None:
    scene = scene_with(obstacle(np.concatenate([run(OUT, left), run(OUT + left + 4, right)])))
    look(scene, now=3.0)
    assert taken(scene) == {"obstacle_1": max(left, right), "obstacle_2": min(left, right)}
    one, other = scene.get("obstacle_1"), scene.get("obstacle_2")
    assert (one.colour, other.colour) == ("red", "grey")
    assert (one.last_seen, other.last_seen) == (1.0, 3.0)  # the picture did not show it; the other is new
    first = one if left >= right else other
    assert first.pose.position[0] == pytest.approx(0.01 * (OUT + left / 2))
    assert (other.sigma_position, other.sigma_angle, other.confidence) == (0.005, 0.1, 0.5)


def test_two_that_have_grown_together_have_the_name_of_the_one_that_is_more_of_it() -> None:
    for few, many in (("obstacle_1", "obstacle_2"), ("obstacle_2", "obstacle_1")):
        scene = scene_with(
            *sorted((obstacle(run(OUT, 6), few), obstacle(run(OUT + 7, 9), many)), key=lambda o: o.id)
        )
        assert look(scene)[-1] == f"{few}: its place was seen without it"
        assert taken(scene) == {many: 15}


def test_each_part_takes_the_name_of_what_it_shares_most_with() -> None:
    """Two that overlap and are torn: of the first most is on the right, the second is there as a whole."""
    first = np.concatenate([run(OUT, 8), run(OUT + 12, 9)])
    second = run(OUT + 12, 10, y=1)
    scene = scene_with(obstacle(first), obstacle(second, "obstacle_2"))
    look(scene)
    assert taken(scene) == {"obstacle_2": 19, "obstacle_1": 8}


def test_one_cell_that_is_shared_gives_the_name() -> None:
    """A long one is gone but for its end, where another part begins: there it is found again."""
    long = run(0, 20)
    scene = scene_with(obstacle(long))
    pixels = [(20 + dv, 52 + du) for dv in range(-1, 2) for du in range(7)]
    reach = np.full((HIGH, WIDE), 2.0)
    reach[:, 51:] = 0.1
    depth = raised(0.01, (slice(19, 22), slice(52, 59)))
    look(scene, synthetic_view(depth, reach=reach), (patch_of(*pixels),))
    assert [str(o.id) for o in scene.objects] == ["obstacle_1"]
    assert len(np.setdiff1d(cell_keys(long), cells_of(scene.get("obstacle_1")))) > 10


def patch_at(x: float, y: float = 0.0, colour: str = "grey") -> tuple[Array, UnexplainedPatch]:
    """A depth picture with a patch 3 cm by 3 cm about (x, y), 3 cm above the table."""
    u, v = round(30 + 100 * x / 0.97), round(20 - 100 * y / 0.97)
    pixels = [(v + dv, u + du) for dv in (-1, 0, 1) for du in (-1, 0, 1)]
    return raised(0.03, (slice(v - 1, v + 2), slice(u - 1, u + 2))), patch_of(*pixels, colour=colour)


def block(wide: float, x: float, y: float) -> BeliefObject:
    """An item that is 10 cm long and stands there."""
    shape, pose = Box((wide, 0.1, 0.04)), Pose((x, y, 0.01))
    return BeliefObject("block", "box", shape, "red", pose, 0.001, 0.01, 1.0, 0.0, id=ObjectId("block"))


def alone(depth: Array) -> PerceivedView:
    """A view of that picture, in which all but what stands out is seen to be free."""
    return synthetic_view(depth, reach=np.where(depth < HEIGHT, 0.1, 2.0))


@cache
def aside() -> tuple[PerceivedView, UnexplainedPatch, Array]:
    """A view with a patch 10 cm aside, and the cells that it takes up."""
    depth, patch = patch_at(0.1)
    scene = scene_with()
    look(scene, alone(depth), (patch,))
    cells = cell_indices(cells_of(scene.objects[0]))
    assert np.ptp(cells[:, 0]) == 4
    return alone(depth), patch, cells


def beside(cells: Array, by: int, sign: int = 1) -> Array:
    """Two columns of cells like the first or last one of those, and so many before or after it."""
    edge = cells[cells[:, 0] == (cells[:, 0].min() if sign > 0 else cells[:, 0].max())]
    return np.concatenate([edge - (sign * k, 0, 0) for k in (by, by + 1)])


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("by", "name"), [(2, "obstacle_1"), (3, "obstacle_2")])
def test_what_went_a_little_aside_is_the_same_and_what_is_far_off_another(
    by: int, name: str, sign: int
) -> None:
    """Five centimetres from middle to middle, here 4.5 and 5.5; it shares no cell with what it was."""
    view, patch, cells = aside()
    scene = scene_with(obstacle(beside(cells, by, sign)))
    look(scene, view, (patch,))
    assert list(taken(scene)) == [name]
    assert np.isin(cell_keys(cells), cells_of(scene.get(name))).all()


def test_of_two_that_went_the_nearer_one_is_the_same() -> None:
    view, patch, cells = aside()
    for near, far in (("obstacle_1", "obstacle_2"), ("obstacle_2", "obstacle_1")):
        both = (obstacle(beside(cells, 1), near), obstacle(beside(cells, 2, -1), far))
        scene = scene_with(*sorted(both, key=lambda o: o.id))
        look(scene, view, (patch,))
        assert list(taken(scene)) == [near]


def test_of_two_that_are_near_what_went_only_one_is_the_same() -> None:
    def speck(u: int) -> tuple[Array, UnexplainedPatch, Array]:
        depth, patch, scene = raised(0.03, (slice(20, 21), slice(u, u + 1))), patch_of((20, u)), scene_with()
        look(scene, alone(depth), (patch,))
        return depth, patch, cell_indices(cells_of(scene.objects[0]))

    depth, left, cells = speck(35)
    last = int(cells[:, 0].max())
    other, right, _ = next(found for u in range(36, 55) if (found := speck(u))[2][:, 0].min() == last + 4)
    former = np.array([(x, y, z) for x in range(last + 1, last + 4) for y in (-1, 0) for z in (0, 1)])
    scene = scene_with(obstacle(former))
    look(scene, alone(np.minimum(depth, other)), (left, right))
    assert sorted(taken(scene)) == ["obstacle_1", "obstacle_2"]


def test_a_new_one_has_the_colour_of_its_largest_patch_and_the_time_of_the_look() -> None:
    depth, large = patch_at(0.1, colour="blue")
    small = patch_of((20, 42), colour="green")
    depth[20, 42] = 0.97
    for patches in ((large, small), (small, large)):
        scene = scene_with()
        assert look(scene, alone(depth), patches, now=5.0) == ["obstacle_1: depth that nothing explains"]
        (new,) = scene.objects
        assert (new.colour, new.last_seen, new.kind, new.form) == ("blue", 5.0, "unknown", "unknown")
        assert (new.sigma_position, new.sigma_angle, new.confidence) == (0.005, 0.1, 0.5)
        assert look(scene, alone(depth), patches, now=6.0) == ["obstacle_1: seen again"]
        assert scene.objects[0].last_seen == 6.0
        # Its place is hidden: it stays, and was not seen.
        assert look(scene, now=7.0) == []
        assert scene.objects[0].last_seen == 6.0


def test_each_of_two_has_the_colour_of_its_own_patch() -> None:
    (left, blue), (right, green) = patch_at(-0.15, colour="blue"), patch_at(0.15, colour="green")
    scene = scene_with()
    look(scene, alone(np.minimum(left, right)), (blue, green))
    assert {o.pose.position[0] > 0: o.colour for o in scene.objects} == {False: "blue", True: "green"}


def test_where_rays_pass_it_is_cleared_and_its_edge_next_to_what_stays_is_not() -> None:
    cells = run(0, 20, layers=1)
    scene = scene_with(obstacle(cells))
    assert look(scene, clear(run(8, 12)), now=4.0) == ["obstacle_1: rays pass through parts of it"]
    after = cells_of(scene.get("obstacle_1"))
    known = scene.get("obstacle_1")
    assert (known.colour, known.last_seen) == ("red", 1.0)
    passed = 8 - 1  # the pixels about the first one clear the cell before it as well
    assert passed <= len(after) <= 9
    assert np.array_equal(after, cell_keys(run(0, len(after))))
    # What is next to what stays has come and gone with the noise.
    assert look(scene, clear(run(len(after) - 1, 1))) == []


def test_what_is_supposed_goes_with_what_was_seen_beside_it() -> None:
    """The supposed cells are beyond the picture's edge, where no ray passes them."""
    seen, supposed = run(8, 20), run(28, 8)
    scene = scene_with(obstacle(seen, supposed=supposed))
    assert look(scene) == []
    assert look(scene, clear(seen[:8])) == ["obstacle_1: rays pass through parts of it"]
    known = scene.get("obstacle_1")
    assert np.isin(cell_keys(seen[10:]), cells_of(known)).all()
    assert np.array_equal(supposed_cells_of(known), cell_keys(supposed))
    assert look(scene, clear(seen)) == ["obstacle_1: its place was seen without it"]


def test_what_a_pixel_takes_up_beyond_the_picture_is_supposed() -> None:
    pixels = [(row, column) for row in range(15, 25) for column in range(WIDE - 5, WIDE)]
    scene = scene_with()
    view = synthetic_view(raised(0.1, (slice(15, 25), slice(WIDE - 5, WIDE))))
    look(scene, view, (patch_of(*pixels),))
    known = scene.get("obstacle_1")
    cells = cells_of(known)
    outside = cells[~in_picture(view, cells)]
    assert len(outside) and np.isin(outside, supposed_cells_of(known)).all()
    nothing = synthetic_view(reach=np.full((HIGH, WIDE), 2.0))
    assert look(scene, nothing) == ["obstacle_1: its place was seen without it"]


def test_what_was_supposed_and_then_is_seen_stays_as_what_was_seen() -> None:
    pixels = [(row, column) for row in range(15, 25) for column in range(20, 40)]
    view = synthetic_view(raised(0.03, (slice(15, 25), slice(20, 40))))
    scene = scene_with()
    look(scene, view, (patch_of(*pixels),))
    whole = cells_of(scene.get("obstacle_1"))
    scene = scene_with(obstacle(cell_indices(whole[:20]), supposed=cell_indices(whole[20:])))
    assert look(scene, view, (patch_of(*pixels),)) == ["obstacle_1: more of it was seen"]
    assert not len(supposed_cells_of(scene.get("obstacle_1")))
    assert look(scene, view, (patch_of(*pixels),)) == []


@pytest.mark.parametrize(("wide", "columns"), [(0.043, 4), (0.045, 6)])
def test_an_item_that_is_recognised_has_its_own_cells_and_those_within_3_mm(
    wide: float, columns: int
) -> None:
    """The middles of the columns are 5, 15, 25, … mm from the item's. One is next to what stays of it."""
    scene = scene_with(obstacle(np.array([(OUT + x, y, 0) for x in range(-10, 10) for y in range(6)])))
    look(scene, items=(block(wide, 0.01 * OUT, 0.03),))
    assert sum(taken(scene).values()) == (20 - columns + 1) * 6


@pytest.mark.parametrize(
    ("share", "reason"),
    [
        (0.3, "rays pass through parts of it"),
        (0.4, "rays pass through parts of it"),
        (0.5, "its place was seen without it"),
    ],
)
def test_what_was_an_item_for_two_fifths_is_gone(share: float, reason: str) -> None:
    scene = scene_with(obstacle(np.array([(OUT + x, y, 0) for x in range(20) for y in range(4)])))
    wide = 20 * 0.01 * share - 0.01  # it reaches a cell's width beyond its faces
    assert look(scene, items=(block(wide, 0.01 * OUT + wide / 2, 0.02),)) == [f"obstacle_1: {reason}"]
    assert (taken(scene) != {}) is (share < 0.5)


def test_a_little_more_at_the_surface_is_noise_and_much_more_is_growth() -> None:
    patch = patch_of(*((v, u) for v in range(10, 30) for u in range(10, 40)))
    depth = raised(0.03, (slice(10, 30), slice(10, 40)))
    view = synthetic_view(depth, reach=np.full((HIGH, WIDE), 0.1))
    scene = scene_with()
    look(scene, view, (patch,))
    whole = cells_of(scene.objects[0])
    full = len(whole)
    xs = np.unique(whole >> 40)
    scene = scene_with(obstacle(cell_indices(whole[(whole >> 40) < xs[-1]])))
    assert look(scene, view, (patch,)) == ["obstacle_1: more of it was seen"]
    assert taken(scene) == {"obstacle_1": full}
    # Up to three in a hundred of them here and there are noise.
    mixed = np.random.default_rng(1).permutation(full)
    few = int(0.03 * full)
    for missing, reason in ((1, "seen again"), (few, "seen again"), (few + 1, "more of it was seen")):
        scene = scene_with(obstacle(cell_indices(whole[np.sort(mixed[missing:])])))
        assert look(scene, view, (patch,)) == [f"obstacle_1: {reason}"], missing


@pytest.mark.parametrize(("count", "said"), [(5, []), (6, ["obstacle_1: rays pass through parts of it"])])
def test_a_few_cells_that_are_gone_are_noise_and_more_in_one_place_are_a_part(
    count: int, said: list[str]
) -> None:
    body = np.concatenate([run(0, 30, y=y) for y in range(15)])
    beside = run(0, count, y=-4)
    scene = scene_with(obstacle(np.concatenate([body, beside])))
    assert look(scene, clear(beside)) == said
    assert taken(scene) == {"obstacle_1": len(body) + (0 if said else count)}


def spans_of(cells: Array) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    spans = merge_cells(cell_keys(cells))
    return sorted((tuple(low.tolist()), tuple(high.tolist())) for low, high in spans)


def test_a_block_of_cells_is_one_box() -> None:
    block = np.array([(x, y, z) for x in range(3, 7) for y in range(-2, 3) for z in range(4, 6)])
    assert spans_of(block) == [((3, -2, 4), (7, 3, 6))]


def test_boxes_grow_in_the_better_order_and_may_overlap() -> None:
    # A cross of two bars: each box goes through the middle.
    cross = np.unique(np.concatenate([run(-3, 7), run(-3, 7)[:, [1, 0, 2]]]), axis=0)
    assert spans_of(cross) == [((-3, 0, 0), (4, 1, 1)), ((0, -3, 0), (1, 4, 1))]
    # A step: the larger of two boxes is taken first, along x here and along y there.
    wide = np.concatenate([run(0, 6), run(0, 2, y=1)])
    assert spans_of(wide) == [((0, 0, 0), (2, 2, 1)), ((0, 0, 0), (6, 1, 1))]
    assert spans_of(wide[:, [1, 0, 2]]) == [((0, 0, 0), (1, 6, 1)), ((0, 0, 0), (2, 2, 1))]
    # A block with a wall beside it: up, along x and then along y, or the other way round.
    block = [(x, y, z) for x in range(4) for y in range(2) for z in range(4)]
    wall = [(0, y, z) for y in range(4) for z in range(4)]
    both = np.unique(np.array(block + wall), axis=0)
    assert spans_of(both) == [((0, 0, 0), (1, 4, 4)), ((0, 0, 0), (4, 2, 4))]
    assert spans_of(both[:, [1, 0, 2]]) == [((0, 0, 0), (2, 4, 4)), ((0, 0, 0), (4, 1, 4))]
    # It goes up first: a tower on a plate.
    tower = np.concatenate([run(0, 3), np.array([(0, 0, z) for z in range(1, 5)])])
    assert spans_of(tower) == [((0, 0, 0), (1, 1, 5)), ((0, 0, 0), (3, 1, 1))]


def test_boxes_contain_nothing_else_however_many_they_are() -> None:
    stairs = np.array([(2 * k, 2 * k, 0) for k in range(30)])
    assert spans_of(stairs) == [((x, y, z), (x + 1, y + 1, z + 1)) for x, y, z in stairs.tolist()]
