"""What `explain` says of things that are left in a tote."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.analysis.explain.body_tracks import BodyTracks
from picktree.analysis.explain.identities import Identities
from picktree.analysis.explain.run_explanation import failures_of, investigation
from picktree.analysis.explain.unsorted_items import Remainder, lying, remains
from picktree.logs import Stamped
from picktree.logs.log_records import BlockRecord, BodyRecord, Scene
from picktree.robot.manipulation.grasps import GraspCandidate
from picktree.session import RunRequest, Session
from picktree.world import Box, ObjectId, Pose
from picktree.world.scene import Bin

from ..recorded_runs import pick_from_a_tote

TOTE = Bin(ObjectId("tote"), (0.3, 0.4, 0.12), 0.004, Pose((0.5, 0.0, 0.0)), is_tote=True)


def body(x: float, y: float, height: float) -> BodyRecord:
    pose = Pose((x, y, TOTE.wall + height / 2))
    return BodyRecord("unknown", "box", Box((0.04, 0.06, height)), "red", pose, id="item_1")


def heap(x: float, y: float, height: float) -> BodyRecord:
    """Heap of one column of 80 × 80 mm up to a height above the floor."""
    block = BlockRecord((0.08, 0.08, height), (x - 0.5, y, 0.0))
    pose = Pose((0.5, 0.0, TOTE.wall + height / 2))
    return BodyRecord(
        "heap", "", Box((0.3, 0.4, height)), "grey", pose, role="heap", id="tote_heap", blocks=(block,)
    )


@pytest.mark.parametrize(
    ("thing", "seen", "state"),
    [
        (body(0.5, 0.0, 0.03), heap(0.5, 0.0, 0.03), "seen and away from the walls"),
        (body(0.5, 0.0, 0.008), heap(0.5, 0.0, 0.008), "flat, 8 mm high"),
        (body(0.5, 0.0, 0.03), heap(0.5, 0.0, 0.06), "hidden below other things"),
        (body(0.5, 0.0, 0.03), heap(0.4, 0.1, 0.06), "seen and away from the walls"),
        (body(0.5, 0.157, 0.03), heap(0.5, 0.157, 0.03), "at a wall, 9 mm from it"),
        (body(0.379, 0.0, 0.03), None, "at a wall, 5 mm from it"),
    ],
)
def test_how_a_thing_lies(thing: BodyRecord, seen: BodyRecord | None, state: str) -> None:
    assert lying(TOTE, seen, thing) == state


def no_grasps(*_: object) -> Iterator[tuple[GraspCandidate, ...]]:
    return iter(())


@pytest.fixture(scope="module")
def vain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """Run in which no grasp is found, though three things lie in the tote."""
    folder = tmp_path_factory.mktemp("vain")
    mission = pick_from_a_tote(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("picktree.robot.manipulation.heap_pick.grasps", no_grasps)
        result = Session(RunRequest(mission, seed=5, out=folder)).run()
    with Run(result.log) as run:
        yield run


def test_what_is_left_in_a_tote_is_one_root_cause(vain: Run) -> None:
    (root,) = vain.explanation.root_causes
    assert (root.cause, root.ended_run) == ("heap.out_of_reach", True)
    assert root.title.startswith("3 things in tote got no grasp: ")
    assert [sum(f"(item_0{k})" in reason for reason in root.reasons) for k in range(3)] == [1, 1, 1]
    assert all("no grasp was found on it" in reason for reason in root.reasons)


MISSION = """\
picktree: 1
kind: mission
name: exchange
scene: scene.yaml
trees:
  Main:
    Sequence:
      - ForceSuccess: {do: {PickAny: {from: tote, out: "{thing}"}}}
      - ExchangeBin: {bin: tote, clearance: 1 s}
"""


def test_an_empty_tote_and_the_arm_over_it_are_causes(tmp_path: Path) -> None:
    scene = "picktree: 1\nkind: scene\nbase: tote\nspawn: []\nexchange: {takes: 2 s}\n"
    (tmp_path / "scene.yaml").write_text(scene)
    (tmp_path / "exchange.yaml").write_text(MISSION)
    result = Session(RunRequest(tmp_path / "exchange.yaml", seed=1, out=tmp_path)).run()
    with Run(result.log) as run:
        under, empty = run.explanation.root_causes
        assert (under.cause, under.ended_run, under.doubtful) == ("bin.under_arm", True, False)
        assert under.reasons[0].endswith(" mm above the rim")
        assert (empty.cause, empty.title, empty.doubtful) == ("heap.empty", "tote was empty", False)


def test_things_that_were_never_lifted_are_told_so(vain: Run) -> None:
    truths = [item.truth for item in vain.explanation.items]
    assert len(truths) == 3 and all(truth.endswith("; never taken out") for truth in truths)


def moved(item: str, path: list[tuple[float, float, float]], attached: int = 0) -> BodyTracks:
    """Tracks of one body, one place a second; the first `attached` are in the hand."""
    first = replace(body(0.5, 0.0, 0.03), id=item)
    bodies = [replace(first, pose=Pose(at), attached=k < attached) for k, at in enumerate(path)]
    return BodyTracks([Stamped(float(k), Scene((one,), ())) for k, one in enumerate(bodies)])


def together(*tracks: BodyTracks) -> BodyTracks:
    """Tracks of several bodies with the same times."""
    bodies = [track.bodies for each in tracks for track in each.tracks.values()]
    return BodyTracks(
        [
            Stamped(t, Scene(row, ()))
            for t, row in zip(tracks[0].times, zip(*bodies, strict=True), strict=True)
        ]
    )


def test_a_thing_is_the_true_item_that_moved_with_the_hand() -> None:
    way = [(0.5, 0.0, 0.05), (0.5, 0.0, 0.25), (0.5, 0.4, 0.25), (0.5, 0.4, 0.05)]
    deep = [(x, y, z - 0.03) for x, y, z in way]
    left = moved("item_1", [(0.5, 0.01, 0.05)] * 4)
    taken = moved("item_2", deep)
    beside = moved("item_3", [(0.5, 0.4, 0.05)] * 4)
    truth = together(left, taken, beside)
    assert Identities(moved("thing_1", way, attached=3), truth).pairs == {"thing_1": "item_2"}
    assert Identities(moved("thing_1", way, attached=3), together(left, beside)).pairs == {}


def test_nothing_remains_in_a_bin_that_is_no_tote(vain: Run) -> None:
    case = investigation(vain, vain.account, failures_of(vain, vain.account), truth=True)
    assert remains(case, "red_bin", vain.end) == []
    assert all(isinstance(one, Remainder) for one in remains(case, "tote", vain.end))


def test_the_tote_is_no_item_that_the_belief_should_know(vain: Run) -> None:
    (failure,) = vain.failures
    assert failure.item == "tote"
    assert not any("is not known" in sentence for sentence in failure.observed)
