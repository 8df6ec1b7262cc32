"""Where space is taken up and where rays pass, on pictures made of numbers: each limit from both sides."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from picktree.robot.perception import segmentation
from picktree.robot.perception.obstacle_volumes import (
    bounding_box_of,
    cell_centres,
    cell_indices,
    cell_keys,
    occupied_cells,
    retained_cells,
    surface_of,
    unexplained_patches,
)
from picktree.robot.perception.segmentation import Pixels, SegmentationInput
from picktree.robot.perception.view import PerceivedView
from picktree.world import Array

from .synthetic_view import HEIGHT, HIGH, SIGHT, WIDE, patch_of, raised, synthetic_view

Where = tuple[slice, slice]
SQUARE: Where = (slice(10, 18), slice(30, 38))
Heap = Callable[[Array], NDArray[np.bool_]]


def nothing() -> NDArray[np.bool_]:
    return np.zeros((HIGH, WIDE), dtype=np.bool_)


def marked(*where: Where) -> NDArray[np.bool_]:
    mask = nothing()
    for each in where:
        mask[each] = True
    return mask


def picture(
    depth: Array,
    *,
    label: NDArray[np.bool_] | None = None,
    blocked: NDArray[np.bool_] | None = None,
    owner: NDArray[np.bool_] | None = None,
) -> SegmentationInput:
    colour = nothing() if label is None else label
    owned = nothing() if owner is None else owner
    return SegmentationInput(
        SIGHT, depth, HEIGHT - depth, colour.astype(np.uint8), nothing() if blocked is None else blocked,
        owned.astype(np.int32), [],
    )  # fmt: skip


def found(
    seen: SegmentationInput,
    *,
    backdrop: float | Array = HEIGHT,
    robot: NDArray[np.bool_] | None = None,
    in_heap: Heap = lambda points: np.zeros(len(points), dtype=np.bool_),
) -> list[NDArray[np.bool_]]:
    """A mask for each patch."""
    behind = np.broadcast_to(np.asarray(backdrop, np.float64), (HIGH, WIDE))
    masks: list[NDArray[np.bool_]] = []
    for rows, columns in unexplained_patches(seen, behind, nothing() if robot is None else robot, in_heap):
        masks.append(nothing())
        masks[-1][rows, columns] = True
    return masks


def same(masks: list[NDArray[np.bool_]], *wanted: NDArray[np.bool_]) -> bool:
    return len(masks) == len(wanted) and all(np.array_equal(a, b) for a, b in zip(masks, wanted, strict=True))


def test_grey_depth_that_stands_out_by_a_centimetre_is_something() -> None:
    assert found(picture(raised(0.0119, SQUARE))) == []
    assert same(found(picture(raised(0.0121, SQUARE))), marked(SQUARE))
    assert found(picture(raised(-0.05, SQUARE))) == []


@pytest.mark.parametrize(
    "where",
    [
        (slice(0, 8), slice(0, 8)),
        (slice(HIGH - 8, HIGH), slice(WIDE - 8, WIDE)),
        (slice(0, 8), slice(WIDE - 8, WIDE)),
    ],
)
def test_at_the_edges_of_the_picture_as_well(where: Where) -> None:
    assert same(found(picture(raised(0.1, where))), marked(where))


def test_what_is_coloured_blocked_or_not_measured_is_nothing_unknown() -> None:
    half: Where = (slice(10, 18), slice(34, 38))
    depth, other = raised(0.1, SQUARE), marked((slice(10, 18), slice(30, 34)))
    unmeasured = np.where(marked(half), 0.0, depth)
    for seen, backdrop in (
        (picture(depth, label=marked(half)), HEIGHT),
        (picture(depth, blocked=marked(half)), HEIGHT),
        (picture(unmeasured), HEIGHT),
        (picture(depth), np.where(marked(half), np.inf, HEIGHT)),
    ):
        assert same(found(seen, backdrop=backdrop), other)


def test_fewer_than_twenty_pixels_that_hang_together_are_noise() -> None:
    twenty: Where = (slice(10, 14), slice(30, 35))
    fewer: Where = (slice(20, 23), slice(30, 36))
    assert same(found(picture(raised(0.1, twenty))), marked(twenty))
    assert found(picture(raised(0.1, fewer))) == []
    assert same(found(picture(raised(0.1, twenty, fewer))), marked(twenty))


def test_what_lies_in_a_heap_is_none() -> None:
    """Points of the world are judged: those of the pixels, at their depth."""
    asked: list[Array] = []

    def left(points: Array) -> NDArray[np.bool_]:
        asked.append(points)
        return points[:, 0] < 0.0355

    masks = found(picture(raised(0.1, SQUARE)), in_heap=left)
    assert same(masks, marked((slice(10, 18), slice(34, 38))))
    rows, columns = np.nonzero(marked(SQUARE))
    x, y = 0.9 * 0.01 * (columns - 30), 0.9 * 0.01 * (20 - rows)
    np.testing.assert_allclose(asked[0], np.stack([x, y, np.full(64, 0.1)], axis=1), atol=1e-9)


def test_two_pixels_beside_an_item_are_its_edge() -> None:
    for item, left in (
        ((slice(8, 20), slice(26, 28)), SQUARE),  # its edge reaches to column 29
        ((slice(8, 20), slice(28, 29)), (slice(10, 18), slice(31, 38))),
        ((slice(7, 8), slice(28, 40)), SQUARE),
        ((slice(8, 9), slice(28, 40)), (slice(11, 18), slice(30, 38))),
    ):
        assert same(found(picture(raised(0.1, SQUARE), owner=marked(item))), marked(left))


def test_beside_the_robot_it_must_be_large() -> None:
    small: Where = (slice(10, 17), slice(30, 38))
    sixty: Where = (slice(10, 16), slice(30, 40))
    for where, off, there in ((small, 1, False), (small, 2, True), (sixty, 1, True)):
        top, left = where[0].start - off, where[1].start - off
        above, beside = (slice(top - 3, top + 1), slice(25, 45)), (slice(5, 25), slice(left - 3, left + 1))
        for robot in (above, beside):
            seen = found(picture(raised(0.1, where)), robot=marked(robot))
            assert same(seen, *([marked(where)] if there else [])), (off, robot)


def test_a_pixel_needs_three_neighbours_of_its_depth() -> None:
    for by, kept in ((0.019, True), (0.021, False)):
        for sign in (1.0, -1.0):
            depth = raised(0.1, SQUARE)
            depth[14, 34] += sign * by
            alone = marked(SQUARE)
            alone[14, 34] = kept
            assert same(found(picture(depth)), alone)
    wide: Where = (slice(10, 19), slice(30, 39))
    depth = raised(0.1, wide)
    depth[10:19, 34] -= 0.05  # each has two
    halves = marked((slice(10, 19), slice(30, 34))), marked((slice(10, 19), slice(35, 39)))
    assert same(found(picture(depth)), *halves)
    depth = raised(0.1, wide)
    depth[14, 30:39] -= 0.05
    halves = marked((slice(10, 14), slice(30, 39))), marked((slice(15, 19), slice(30, 39)))
    assert same(found(picture(depth)), *halves)
    # What is no more than the table around is no neighbour.
    depth = raised(0.1, SQUARE)
    depth[10, 30] = HEIGHT - 0.015
    without = marked(SQUARE)
    without[10, 30] = False
    assert same(found(picture(depth)), without)


def test_what_is_two_pixels_wide_is_noise() -> None:
    assert found(picture(raised(0.1, (slice(10, 12), slice(10, 40))))) == []
    assert found(picture(raised(0.1, (slice(5, 35), slice(10, 12))))) == []


def pixels(*where: Where) -> tuple[Pixels, Pixels]:
    rows, columns = np.nonzero(marked(*where))
    return rows, columns


@pytest.mark.parametrize(("high", "wide"), [(10, 4), (4, 10)])
def test_the_box_about_a_patch_stands_on_its_support(high: int, wide: int) -> None:
    where: Where = (slice(8, 8 + high), slice(35, 35 + wide))
    patch = bounding_box_of(picture(raised(0.1, where)), *pixels(where), support=0.02)
    assert patch is not None
    # A pixel is 9 mm wide there.
    assert patch.pose.position == pytest.approx(
        (0.009 * (35 + (wide - 1) / 2 - 30), 0.009 * (20 - 8 - (high - 1) / 2), 0.06), abs=1e-6
    )
    assert patch.shape.size[2] == pytest.approx(0.08)
    corners = patch.pose.apply(
        np.array([[x, y, 0.0] for x in (-1, 1) for y in (-1, 1)]) * patch.shape.size / 2
    )
    assert np.ptp(corners[:, 0]) == pytest.approx(0.009 * wide, abs=1e-6)
    assert np.ptp(corners[:, 1]) == pytest.approx(0.009 * high, abs=1e-6)
    assert (patch.colour, len(patch.rows), len(patch.columns)) == ("grey", 40, 40)


def test_a_slanting_patch_has_a_slanting_box() -> None:
    steps = np.arange(15)
    rows, columns = np.concatenate([5 + steps, 5 + steps]), np.concatenate([20 + steps, 21 + steps])
    depth = np.full((HIGH, WIDE), HEIGHT)
    depth[rows, columns] = 0.9
    patch = bounding_box_of(picture(depth), rows, columns, support=0.0)
    assert patch is not None
    assert max(patch.shape.size[:2]) == pytest.approx(0.009 * (14.5 * math.sqrt(2) + 1.0), rel=0.02)
    assert min(patch.shape.size[:2]) == pytest.approx(0.009 * (0.5 * math.sqrt(2) + 1.0), rel=0.02)
    long = int(np.argmax(patch.shape.size[:2]))
    x, y = patch.pose.rotation()[:2, long]
    assert x * y < -0.45  # to the right and towards the observer


def test_what_is_as_flat_as_its_support_has_no_box() -> None:
    for above, there in ((0.0039, False), (0.0041, True)):
        box = bounding_box_of(picture(raised(0.05, SQUARE)), *pixels(SQUARE), support=0.05 - above)
        assert (box is not None) is there


def test_the_top_is_what_a_twentieth_of_the_pixels_reach() -> None:
    where: Where = (slice(10, 20), slice(30, 40))
    for count, top in ((5, 0.1025), (6, 0.15)):
        depth = raised(0.1, where)
        depth[10, 30 : 30 + count] = HEIGHT - 0.15
        box = bounding_box_of(picture(depth), *pixels(where), support=0.0)
        assert box is not None
        assert box.shape.size[2] == pytest.approx(top)


def test_pixels_without_a_depth_say_nothing_of_the_box() -> None:
    where: Where = (slice(10, 11), slice(30, 40))
    for known, there in ((3, False), (4, True)):
        depth = raised(0.1, where)
        depth[10, 30 + known : 40] = 0.0
        box = bounding_box_of(picture(depth), *pixels(where), support=0.0)
        assert (box is not None) is there
        if box is not None:
            assert box.columns.tolist() == [30, 31, 32, 33]
            assert box.rows.tolist() == [10] * 4
            assert max(box.shape.size[:2]) == pytest.approx(0.036)


def test_the_box_has_the_colour_of_most_of_its_pixels() -> None:
    for red, colour in ((31, "grey"), (33, "red")):
        seen = picture(raised(0.1, SQUARE))
        rows, columns = pixels(SQUARE)
        seen.label[rows[:red], columns[:red]] = segmentation.label_of("red")
        box = bounding_box_of(seen, rows, columns, support=0.0)
        assert box is not None and box.colour == colour


def cells_at(*points: tuple[float, float, float]) -> Array:
    return cell_keys(np.floor(np.array(points) / (0.01, 0.01, 0.02)).astype(np.int64))


def test_a_pixel_shows_what_lies_within_one_pixel_of_it() -> None:
    view, step = synthetic_view(raised(0.11, (slice(12, 13), slice(45, 46)))), 0.89 * 0.01
    around = ((0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
    expected = cells_at(*((step * (15 + du), step * (8 + dv), 0.11) for du, dv in around))
    assert len(expected) == 5
    assert np.array_equal(surface_of(view, patch_of((12, 45))), expected)


def test_a_spike_of_less_than_two_centimetres_is_noise() -> None:
    """Also at a corner of the patch."""
    where: Where = (slice(10, 17), slice(30, 37))
    patch = patch_of(*zip(*pixels(where), strict=True))
    for at, by, layers in (
        ((13, 33), 0.0195, [5]),
        ((13, 33), -0.0195, [5]),
        ((13, 33), 0.0205, [5, 6]),
        ((13, 33), -0.0205, [4, 5]),
        *((corner, 0.015, [5]) for corner in ((10, 30), (10, 36), (16, 30), (16, 36))),
    ):
        depth = raised(0.11, where)
        depth[at] -= by
        cells = surface_of(synthetic_view(depth), patch)
        assert np.unique(cell_indices(cells)[:, 2]).tolist() == layers, (at, by)


def test_at_its_borders_a_patch_is_not_smoothed_with_the_emptiness_around() -> None:
    stairs = [(10 + k, 30 + k) for k in range(6)]
    depth = np.full((HIGH, WIDE), HEIGHT)
    for row, column in stairs:
        depth[row, column] = 0.89
    whole = surface_of(synthetic_view(depth), patch_of(*stairs))
    alone = [surface_of(synthetic_view(depth), patch_of(pixel)) for pixel in stairs]
    assert np.array_equal(whole, np.unique(np.concatenate(alone)))


@pytest.mark.parametrize(("support", "lowest"), [(0.0, 0), (0.019, 0), (0.02, 1), (0.05, 2), (0.109, 5)])
@pytest.mark.parametrize("pixel", [(12, 45), (28, 13)])
def test_it_stands_on_what_is_below(pixel: tuple[int, int], support: float, lowest: int) -> None:
    v, u = pixel
    view = synthetic_view(
        raised(0.11, (slice(v, v + 1), slice(u, u + 1))),
        reach=np.full((HIGH, WIDE), 0.5),
        supports=lambda points: np.full(len(points), support),
    )
    cells = cell_indices(occupied_cells(view, [patch_of(pixel)]))
    top = cell_indices(surface_of(view, patch_of(pixel)))
    columns = {(x, y) for x, y, _ in top.tolist()}
    assert set(map(tuple, cells.tolist())) == {(x, y, z) for x, y in columns for z in range(lowest, 6)}


def test_what_is_not_above_its_support_takes_nothing_up() -> None:
    pixel = (12, 45)
    view = synthetic_view(
        raised(0.11, (slice(12, 13), slice(45, 46))),
        reach=np.full((HIGH, WIDE), 0.5),
        supports=lambda points: np.where(points[:, 0] < 0.14, 0.12, 0.0),
    )
    cells = cell_indices(occupied_cells(view, [patch_of(pixel)]))
    assert cells[:, 0].min() == 14  # of the five points those two are above theirs
    assert len(cells) == 12
    assert len(occupied_cells(view, [])) == 0


def test_a_column_reaches_from_its_highest_point_to_its_lowest_support() -> None:
    """Two pixels of a patch in the same column of cells, at different heights and over different supports."""
    depth = np.full((HIGH, WIDE), HEIGHT)
    depth[12, 45], depth[12, 46] = 0.89, 0.80
    view = synthetic_view(
        depth,
        reach=np.full((HIGH, WIDE), 0.5),
        supports=lambda points: np.where(points[:, 2] > 0.15, 0.07, 0.03),
    )
    cells = cell_indices(occupied_cells(view, [patch_of((12, 45), (12, 46))]))
    low, high = (cell_indices(surface_of(view, patch_of((12, u)))) for u in (45, 46))
    spans: dict[tuple[int, int], tuple[int, int]] = {}
    for points, bottom in ((low, 1), (high, 3)):
        for x, y, z in points.tolist():
            least, most = spans.get((x, y), (bottom, z))
            spans[x, y] = (min(least, bottom), max(most, z))
    expected = {(x, y, z) for (x, y), (least, most) in spans.items() for z in range(least, most + 1)}
    assert set(map(tuple, cells.tolist())) == expected


CELL = cell_keys(np.array([[8, 5, 2]]))
"""Its middle is at (0.085, 0.055, 0.05), seen at pixel (39, 14)."""
ROW, COLUMN, DEPTH = 14, 39, 0.95
MARGIN = 2.5 * 0.002 * (DEPTH / 0.7) ** 2
HALF = math.sqrt(0.01**2 + 0.01**2 + 0.02**2) / 2


def kept(view: PerceivedView, cells: Array = CELL) -> bool:
    return len(retained_cells(view, cells)) == 1


def test_a_ray_that_goes_on_behind_a_cell_clears_it() -> None:
    for beyond, stays in ((-0.1, True), (0.97 * MARGIN, True), (1.03 * MARGIN, False), (0.1, False)):
        assert kept(synthetic_view(reach=np.full((HIGH, WIDE), DEPTH + beyond))) is stays
    assert len(retained_cells(synthetic_view(), CELL[:0])) == 0


def test_where_no_depth_is_known_nothing_passes() -> None:
    depth = np.full((HIGH, WIDE), HEIGHT)
    depth[ROW - 1 : ROW + 2, COLUMN - 1 : COLUMN + 2] = 0.0
    assert kept(synthetic_view(depth, reach=np.full((HIGH, WIDE), np.inf)))
    depth[ROW + 1, COLUMN - 1] = HEIGHT
    assert not kept(synthetic_view(depth, reach=np.full((HIGH, WIDE), np.inf)))


def test_what_is_at_the_camera_or_behind_it_stays() -> None:
    reach = synthetic_view(reach=np.full((HIGH, WIDE), 2.0))
    for z, clears in ((0.93, True), (0.97, False), (1.05, False)):
        assert kept(reach, cell_keys(np.array([[0, 0, round(z / 0.02 - 0.5)]]))) is not clears


def hanging(reach: Array, depth: Array | float = HEIGHT) -> set[int]:
    """Layers that a patch at pixel (14, 39), 11 cm above the table, takes up at the cell of its middle."""
    view = synthetic_view(depth, reach=reach)
    view.depth[ROW, COLUMN] = 0.89
    cells = cell_indices(occupied_cells(view, [patch_of((ROW, COLUMN))])).tolist()
    return {z for x, y, z in cells if (x, y) == (8, 5)}


def test_below_what_hangs_there_is_room_where_all_rays_of_a_cell_go_on() -> None:
    """A ray must go on half a cell's diagonal behind its middle, and what the noise may be."""
    for layer in range(6):
        depth = 1.0 - 0.02 * (layer + 0.5)
        needed = depth + HALF + 2.5 * 0.002 * (depth / 0.7) ** 2
        for beyond, stays in ((-0.0003, True), (0.0003, False)):
            assert (layer in hanging(np.full((HIGH, WIDE), needed + beyond))) is stays


def test_all_rays_of_the_cell_must_go_on() -> None:
    for dv, du in ((0, 2), (2, 0), (-2, -2), (2, 2), (0, 3), (3, 0), (-3, 0), (0, -3)):
        reach = np.full((HIGH, WIDE), 1.2)
        reach[ROW + dv, COLUMN + du] = 0.5
        assert (2 in hanging(reach)) is (max(abs(dv), abs(du)) <= 2), (dv, du)


def test_where_three_tenths_of_its_depths_are_unknown_nothing_is_said_of_a_cell() -> None:
    for known, stays in ((7, True), (8, False)):
        depth = np.zeros((HIGH, WIDE))
        window = [(ROW + dv, COLUMN + du) for dv in range(-2, 3) for du in range(-2, 3)]
        window.remove((ROW, COLUMN))
        for row, column in window[: known - 1]:
            depth[row, column] = HEIGHT
        assert (2 in hanging(np.full((HIGH, WIDE), 1.2), depth)) is stays  # its own depth is one, too


def test_many_cells_at_once_are_judged_as_each_by_itself() -> None:
    """Against the definition, cell by cell, with cells all over the picture and out of it."""
    rng = np.random.default_rng(4)
    cells = cell_keys(rng.integers((-40, -30, -3), (40, 30, 48), (3000, 3)))
    for low in (0.02, 0.2):
        reach = np.where(rng.random((HIGH, WIDE)) < low, rng.uniform(0.1, 1.0, (HIGH, WIDE)), 1.3)
        reach = reach.astype(np.float32)
        passed = []
        for x, y, z in cell_centres(cells):
            depth = 1.0 - z
            u, v = round(30 + 100 * x / depth), round(20 - 100 * y / depth)
            near = reach[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2].min(initial=9.0)
            seen = 0 <= u < WIDE and 0 <= v < HIGH and depth > 0.05
            passed.append(bool(seen and near > depth + 2.5 * 0.002 * (depth / 0.7) ** 2))
        assert 100 < sum(passed) < len(cells) - 100
        assert np.array_equal(retained_cells(synthetic_view(reach=reach), cells), cells[~np.array(passed)])


def test_close_to_the_camera_a_quarter_of_the_picture_is_enough() -> None:
    """A cell at 7 cm is 36 pixels wide; 15 on each side are looked at."""
    depth = np.full((HIGH, WIDE), HEIGHT)
    depth[20, 30] = 0.065
    for du, stays in ((15, True), (16, False)):
        reach = np.full((HIGH, WIDE), 1.2)
        reach[13, 37 + du] = 0.01  # its middle is seen at (37, 13)
        cells = cell_indices(occupied_cells(synthetic_view(depth, reach=reach), [patch_of((20, 30))]))
        assert ((0, 0, 46) in set(map(tuple, cells.tolist()))) is stays
