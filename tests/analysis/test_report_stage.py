"""Motion in a report: poses over ticks, and the truth between the seconds at which it was written."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from picktree.analysis import Run
from picktree.analysis.export import LAYOUT_FILE
from picktree.analysis.render import body_mesh, heap_remark
from picktree.analysis.render.scene_view import TRUTH_LINE, UNSEEN_COLOUR
from picktree.analysis.report import row
from picktree.analysis.report.body_motion import (
    BelievedBody,
    BodyAppearance,
    TrueBodySamples,
    between,
    composed,
    continuous,
    filled,
    inverse,
    match_bodies,
    motion_of,
    spans,
    true_poses,
)
from picktree.analysis.report.packing import Quantised
from picktree.analysis.report.report import style
from picktree.analysis.report.stage_panel import MAX_LINK_FACES, pack_stage, packed_link, search_summary
from picktree.logs.binary_gltf import write_glb
from picktree.logs.log_records import BlockRecord, BodyRecord, LinkMesh, PartRecord
from picktree.logs.triangle_meshes import join_meshes, shape_mesh
from picktree.world import Array, Box, Candidate, Candidates, Pose, Sphere, StageCount

STILL = row(Pose())


def poses(n: int = 40) -> tuple[list[Pose], Array]:
    rng = np.random.default_rng(5)
    found = []
    for _ in range(n):
        q = rng.normal(size=4)
        x, y, z, w = (float(c) for c in q / np.linalg.norm(q))
        a, b, c = (float(v) for v in rng.uniform(-1, 1, 3))
        found.append(Pose((a, b, c), (x, y, z, w)))
    return found, np.array([row(pose) for pose in found])


def assert_same(a: Array, b: Array) -> None:
    """Assert that rows (n, 7) are the same poses: a quaternion and its negative are one rotation."""
    np.testing.assert_allclose(a[:, :3], b[:, :3], atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(a[:, 3:] * b[:, 3:], axis=1)), 1.0, atol=1e-12)


def test_rows_of_poses_compose_as_poses_do() -> None:
    one, a = poses()
    two = list(reversed(one))
    b = a[::-1]
    assert_same(composed(a, b), np.array([row(p @ q) for p, q in zip(one, two, strict=True)]))
    assert_same(inverse(a), np.array([row(p.inverse()) for p in one]))
    assert_same(composed(inverse(a), a), np.tile(np.array(STILL), (len(a), 1)))


def test_between_two_poses_the_shorter_way_is_taken() -> None:
    turned = Pose.from_rpy((1.0, 0.0, 0.0), (0.0, 0.0, 0.4))
    start = np.array([STILL])
    end = np.array([row(turned)]) * np.array([1, 1, 1, -1, -1, -1, -1])
    half = between(start, end, np.array([0.5]))
    assert_same(half, np.array([row(Pose.from_rpy((0.5, 0.0, 0.0), (0.0, 0.0, 0.2)))]))


def test_quaternions_do_not_jump_to_their_negatives() -> None:
    angles = np.linspace(0.0, 4.0 * math.pi, 200)
    rows = np.array([row(Pose.from_rotation((0.0, 0.0, 0.0), _about_z(angle))) for angle in angles])
    assert np.abs(np.diff(rows, axis=0)).max() > 1.0  # w ≥ 0 makes them jump
    smooth = continuous(rows)
    assert np.abs(np.diff(smooth, axis=0)).max() < 0.1
    assert_same(smooth, rows)


def _about_z(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def test_gaps_are_filled_from_before_and_at_the_start_from_behind() -> None:
    gap = [math.nan] * 7
    a, b = list(STILL), [1.0, *STILL[1:]]
    assert filled(np.array([gap, a, gap, gap, b, gap])).tolist() == [a, a, a, a, b, b]
    assert filled(np.array([gap, gap])).tolist() == [a, a]


def test_spans_of_flags() -> None:
    assert spans(np.array([True, True, False, True, False, False, True])) == [(0, 1), (3, 3), (6, 6)]
    assert spans(np.zeros(3, dtype=np.bool_)) == []


def body(name: str, colour: str = "red", kind: str = "block") -> BodyRecord:
    return BodyRecord(kind, "box", Box((0.04, 0.04, 0.04)), colour, Pose(), id=name)


def believed(name: str, xs: Array, held: Array | None = None, colour: str = "red") -> BelievedBody:
    """Return a believed body at (x, 0, 0) for the x of each tick, m."""
    rows = np.tile(np.array(STILL), (len(xs), 1))
    rows[:, 0] = xs
    rows[np.isnan(xs)] = np.nan
    flags = np.zeros(len(xs), dtype=np.bool_) if held is None else held.astype(np.bool_)
    return BelievedBody(name, rows, flags, (BodyAppearance(0, body(name, colour)),))


def sampled(name: str, ticks: list[int], xs: list[float], colour: str = "red") -> TrueBodySamples:
    rows = np.tile(np.array(STILL), (len(ticks), 1))
    rows[:, 0] = xs
    return TrueBodySamples(body(name, colour), np.array(ticks), rows)


def test_true_bodies_are_matched_to_the_nearest_believed_ones_of_their_kind() -> None:
    ones = [
        believed("red_1", np.full(21, 0.50)),
        believed("red_2", np.full(21, 0.30)),
        believed("blue_1", np.full(21, 0.31), colour="blue"),
    ]
    truths = [
        sampled("item_0", [0, 20], [0.301, 0.301]),
        sampled("item_1", [0, 20], [0.305, 0.305], "blue"),
        sampled("item_2", [0, 20], [0.502, 0.502]),
        sampled("item_3", [0, 20], [0.9, 0.9], "green"),
    ]
    assert match_bodies(ones, truths) == [1, 2, 0, None]
    assert match_bodies([], truths) == [None] * 4


def test_what_lies_is_interpolated_from_second_to_second() -> None:
    truth = sampled("item", [0, 20, 40], [0.0, 0.2, 0.2])
    found = true_poses(truth, None, 60)
    np.testing.assert_allclose(found[:21, 0], np.linspace(0.0, 0.2, 21))
    assert np.isnan(found[41:, 0]).all()  # the log does not say


def test_what_is_held_moves_with_the_hand_and_not_straight() -> None:
    arc = np.sin(np.linspace(0.0, math.pi, 21))  # out and back between two samples
    one = believed("red_1", arc, np.ones(21))
    found = true_poses(sampled("item", [0, 20], [0.002, 0.004]), one, 21)
    np.testing.assert_allclose(found[:, 0] - arc, np.linspace(0.002, 0.004, 21), atol=1e-9)


def test_what_is_taken_stays_where_it_was_until_then() -> None:
    held = np.arange(21) >= 12
    hand = np.where(held, 0.5 + 0.01 * (np.arange(21) - 12), 0.5)
    found = true_poses(sampled("item", [0, 20], [0.501, 0.581]), believed("red_1", hand, held), 21)
    np.testing.assert_allclose(found[:12, 0], 0.501)
    np.testing.assert_allclose(found[12:, 0], hand[12:] + 0.001)


def test_what_slips_from_the_hand_goes_from_the_hand_to_where_it_was_found() -> None:
    hand = np.linspace(0.0, 1.0, 21)
    found = true_poses(sampled("item", [0, 20], [0.0, 0.3]), believed("red_1", hand, np.ones(21)), 21)
    assert found[0, 0] == pytest.approx(0.0)
    assert found[-1, 0] == pytest.approx(0.3)
    low, high = np.minimum(hand, 0.3), np.maximum(hand, 0.3)
    assert ((low - 1e-9 <= found[:, 0]) & (found[:, 0] <= high + 1e-9)).all()


def test_links_stand_in_the_page_where_the_log_says(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        data = pack_stage(run).data
        frames = motion_of(run).frames
        assert isinstance(data, dict)
        here = np.tile(np.array(STILL), (frames.ticks, 1))
        for link, packed in zip(data["links"], data["chain"], strict=True):  # type: ignore[arg-type]
            part = [packed[key].levels * packed[key].step for key in ("p", "q")]  # type: ignore[index]
            step = np.hstack(part)
            step[:, 3:] /= np.linalg.norm(step[:, 3:], axis=1, keepdims=True)
            here = composed(here, step)
            known = frames.track(str(link))
            assert np.abs(here[:, :3] - known[:, :3]).max() < 1e-3
            turned = 1.0 - np.abs(np.sum(here[:, 3:] * known[:, 3:], axis=1))
            assert turned.max() < 1e-6  # 0.2 degrees


def test_an_item_that_a_fault_took_away_is_gone_from_that_tick_on(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        taken = next(at for at in run.events if at.record.kind == "fault")
        tick = run.ticks.number_at(taken.time)
        data = pack_stage(run).data
        assert isinstance(data, dict)
        presence = {truth["id"]: truth["present"] for truth in data["truths"]}  # type: ignore
        item = taken.record.data["item"]
        assert presence.pop(item) == [[0, tick]]
        assert set(map(str, presence.values())) == {str([[0, len(run.ticks) - 1]])}


def test_a_bin_has_a_tint_of_the_items_that_alone_belong_into_it(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        data = pack_stage(run).data
    assert isinstance(data, dict)
    strongest = {
        part["id"]: max(range(3), key=lambda k: part["colour"][k])  # type: ignore
        for part in data["fixed"]  # type: ignore[union-attr]
        if str(part["id"]).endswith("_bin")  # type: ignore
    }
    assert strongest == {
        f"{colour}_bin": k
        for k, colour in enumerate(("red", "green", "blue"))
        if f"{colour}_bin" in strongest
    }
    assert len(strongest) >= 2


def test_the_truth_has_one_colour_on_pages_and_in_pictures() -> None:
    picture = "#" + bytes(TRUTH_LINE).hex()
    assert f"--truth:{picture}" in style().replace(" ", "")
    layout = LAYOUT_FILE.read_text(encoding="utf-8")
    assert layout.count(f'"color": "{picture}') == 2


def test_heavy_models_are_thinned_and_foreign_ones_left_out() -> None:
    balls = [shape_mesh(Sphere(0.05)).placed(Pose((0.2 * k, 0.0, 0.0))) for k in range(3)]
    heavy = join_meshes(balls)
    assert len(heavy.faces) > 2 * MAX_LINK_FACES
    packed = packed_link(LinkMesh("link", write_glb(heavy)))
    assert isinstance(packed, dict)
    faces, vertices = packed["faces"], packed["vertices"]
    assert isinstance(faces, np.ndarray) and isinstance(vertices, Quantised)
    assert MAX_LINK_FACES < len(faces) <= 3 * MAX_LINK_FACES
    places = vertices.levels * vertices.step
    away = np.linalg.norm(places - np.round(places / 0.2) * 0.2 * [1, 0, 0], axis=1)
    assert np.abs(away - 0.05).max() < 0.004  # on the balls still
    assert packed_link(LinkMesh("link", b"glTF of others")) is None


def heap(*columns: tuple[float, float], place: str = "tote") -> BodyRecord:
    """Return a heap of columns 20 mm wide above a floor at 4 mm, each with its x and its height, m."""
    tallest = max(height for _, height in columns)
    blocks = tuple(BlockRecord((0.02, 0.02, h), (x, 0.0, (h - tallest) / 2)) for x, h in columns)
    shape, pose = Box((0.2, 0.2, tallest)), Pose((0.0, 0.0, 0.004 + tallest / 2))
    return BodyRecord(
        "heap", "unknown", shape, "grey", pose, role="heap", place=place, id="tote_heap", blocks=blocks
    )


WALL = PartRecord("tote/1", "grey", Box((0.004, 0.2, 0.124)), Pose((0.1, 0.0, 0.062)))


def colours_of(body: BodyRecord) -> list[tuple[float, ...]]:
    """Return the colours of a heap's columns in their order."""
    mesh = body_mesh(body, (WALL,))
    return [tuple(colours[0]) for colours in mesh.colours.reshape(len(body.blocks), -1, 3).tolist()]


def test_columns_of_a_heap_have_the_colours_of_their_heights() -> None:
    low, same, high, over = colours_of(heap((-0.05, 0.012), (-0.02, 0.012), (0.02, 0.06), (0.05, 0.132)))
    assert low == same and len({low, high, over, UNSEEN_COLOUR}) == 4
    assert high == colours_of(heap((0.0, 0.06)))[0]  # whatever else is in the tote


def test_columns_that_were_never_seen_are_grey() -> None:
    columns = ((-0.03, 0.06), (0.03, 0.12))
    assert colours_of(heap(*columns))[1] == UNSEEN_COLOUR
    assert heap_remark(heap(*columns), (WALL,)) == "0 … 100 mm; tote_heap: up to 60 mm; grey: never seen"
    assert UNSEEN_COLOUR not in colours_of(heap(*columns, place="table"))
    assert heap_remark(heap((0.0, 0.12), place="table"), (WALL,)) == "0 … 100 mm; tote_heap: up to 120 mm"
    assert heap_remark(body("red_1"), (WALL,)) == ""


def test_columns_end_at_the_inner_sides_of_the_walls() -> None:
    mesh = body_mesh(heap((0.095, 0.06), (-0.12, 0.06)), (WALL,))
    assert np.abs(mesh.vertices[:, 0]).max() == pytest.approx(0.1)
    assert mesh.vertices[:, 0].min() == pytest.approx(0.085)


def candidate(name: str, verdict: str, stage: str = "") -> Candidate:
    return Candidate(name, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 0.0, verdict, stage=stage)


def test_a_search_is_told_with_the_reasons_of_refusal() -> None:
    far, found = "the pre-grasp is out of reach", (StageCount("ranked", 9), StageCount("hand fits", 3))
    refused = (candidate("a", far, "pre-grasp reached"), candidate("b", far, "pre-grasp reached"))
    whole = Candidates("grasp by Pick", "tote_heap", found, (*refused, candidate("c", "accepted")))
    start = "tote_heap: 9 candidates"
    assert search_summary(whole) == f"{start}, 3 checked, 1 taken; refused: 2 {far}"
    vain = Candidates("grasp by Pick", "tote_heap", found, refused)
    assert search_summary(vain) == f"{start}, 2 checked, none taken; refused: 2 {far}"
    twice = (candidate("c", far, "pre-grasp reached"), candidate("c", "accepted"))
    taken = Candidates("grasp by Pick", "tote_heap", found, twice)
    assert search_summary(taken) == f"{start}, 1 checked, 1 taken"
