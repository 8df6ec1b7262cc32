"""What is packed of belief, truth, blackboard, events and failures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from picktree.analysis import Run
from picktree.analysis.report import Section
from picktree.analysis.report.board_panel import pack_board, sightings, unknown_bodies, yaw_and_tilt
from picktree.analysis.report.body_motion import Frames, SceneMotion, TrueBodySamples, deviations, motion_of
from picktree.analysis.report.report import pack_failures, plain_value, plan_line, report_events
from picktree.logs.log_records import BodyRecord
from picktree.world import BlackboardWrite, Box, Plan, Pose

from ..logs.scripted_log import Seen, begins, record, tree


def data(section: Section) -> Mapping[str, Any]:
    assert isinstance(section.data, Mapping)
    return section.data


def test_writes_to_the_blackboard_keep_their_tick_and_writer(tmp_path: Path) -> None:
    script = {
        0: [begins("Main"), BlackboardWrite("Main/items", ["a", "b"], "Main/Observe")],
        2: [BlackboardWrite("Main/n", 1, "Main")],
    }
    with Run(record(tmp_path / "log.mcap", tree("Main", "Main/Observe"), 4, script)) as run:
        writes = data(pack_board(run))["writes"]
    words = writes["words"]
    assert writes["tick"].tolist() == [0, 2]
    assert [words[k] for k in writes["key"]] == ["Main/items", "Main/n"]
    assert [words[k] for k in writes["value"]] == ['["a","b"]', "1"]
    assert [words[k] for k in writes["node"]] == ["Main/Observe", "Main"]


def test_the_belief_is_told_when_it_changes(tmp_path: Path) -> None:
    seen = [Seen("a", 0.4), Seen("b", 0.5, tick=3)]
    with Run(record(tmp_path / "log.mcap", tree("Main"), 45, {}, seen=seen)) as run:
        told = sightings(run)
        belief = data(pack_board(run))["belief"]
    assert [(one.time, one.id) for one in told] == [(0.0, "a"), (pytest.approx(0.15), "b")]
    assert belief["there"].tolist() == [1, 1]
    assert [belief["words"][k] for k in belief["object"]] == ["a", "b"]
    assert belief["x"].levels.tolist() == [4000, 5000]


def test_what_is_believed_no_more_is_told_too(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        last = {one.id: one for one in sightings(run)}
        gone = [name for name, one in last.items() if one.body is None]
        believed = run.log.belief_at(run.end)
        assert believed is not None
        assert set(last) - set(gone) == {body.id for body in believed.record.bodies}
        assert len(gone) == 1


def test_the_truth_beside_the_belief_says_how_far_off_and_what_was_taken_away(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        motion = motion_of(run)
        assert motion_of(run) is motion
        found = list(deviations(motion))
        taken = next(at for at in run.events if at.record.kind == "fault")
        truth = data(pack_board(run))["truth"]
        tick = run.ticks.number_at(taken.time)
        (gone,) = truth["gone"]
        assert gone["tick"] == tick
        assert gone["object"] in {one.object for one in found}
    near = [one.distance for one in found if one.object]
    assert max(near) < 0.3
    assert sorted(near)[len(near) // 2] < 0.01
    assert {one.object == "" for one in found if one.tick == 0} == {True}
    assert all(math.isnan(one.distance) for one in found if not one.object)
    assert truth["unknown"][0]["tick"] == 0
    assert len(truth["unknown"][0]["bodies"]) == 4
    assert truth["unknown"][1]["bodies"] == []


def test_what_is_taken_away_unseen_is_unknown_no_longer() -> None:
    shape = Box((0.04, 0.04, 0.04))
    stays, taken = (
        BodyRecord("block", "box", shape, "red", Pose(), id=name) for name in ("item_0", "item_1")
    )
    samples = {stays.id: (0, 20, 40), taken.id: (0, 20, 30)}
    truths = [
        TrueBodySamples(body, np.array(samples[body.id]), np.zeros((3, 7))) for body in (stays, taken)
    ]  # fmt: skip
    motion = SceneMotion(Frames({}, 41), [], truths, [None, None])
    told = sorted(deviations(motion), key=lambda one: one.tick)
    assert list(unknown_bodies(told, motion)) == [
        (0, ("red block (item_0)", "red block (item_1)")),
        (30, ("red block (item_0)",)),
    ]


@pytest.mark.parametrize(
    ("orientation", "yaw", "tilt"),
    [
        ((0.0, 0.0, 0.0, 1.0), 0.0, 0.0),
        ((0.0, 0.0, math.sin(0.4), math.cos(0.4)), 0.8, 0.0),
        ((math.sin(0.3), 0.0, 0.0, math.cos(0.3)), 0.0, 0.6),
        ((1.0, 0.0, 0.0, 0.0), 0.0, math.pi),
    ],
)
def test_yaw_and_tilt(orientation: tuple[float, float, float, float], yaw: float, tilt: float) -> None:
    assert yaw_and_tilt(Pose((0.0, 0.0, 0.0), orientation)) == pytest.approx((yaw, tilt), abs=1e-9)


def test_events_put_a_failure_before_what_is_done_about_it(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        found = report_events(run)
    assert [one.time for one in found] == sorted(one.time for one in found)
    kinds = [one.kind for one in found]
    assert {"belief", "failure", "fault", "item_done", "pick", "plan", "recovery"} <= set(kinds)
    assert "image" not in kinds
    recovery = next(one for one in found if one.kind == "recovery")
    at_once = [one.kind for one in found if one.time == recovery.time]
    assert at_once.index("failure") < at_once.index("recovery")
    assert sum(1 for one in found if one.text == recovery.text) == 1


def test_a_plan_is_said_in_one_line() -> None:
    assert plan_line(Plan("to home", "direct", 12, 0.0, "found", "", 1.5)) == (
        "to home: 1.50 s of motion, 12 checks by direct"
    )
    refused = Plan("to a grasp", "", 3, 0.0, "planning.start_in_collision", "the hand touches the bin", 0.0)
    assert plan_line(refused) == (
        "to a grasp: planning.start_in_collision: the hand touches the bin (3 checks)"
    )


def test_failures_are_the_explanation_field_by_field(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        packed = data(pack_failures(run))
        stories = run.explanation.failures
    assert len(stories) > 0
    assert [story["cause"] for story in packed["failures"]] == [story.cause for story in stories]
    first = packed["failures"][0]
    assert first["handled_by"][0]["handler"] == stories[0].handled_by[0].handler
    assert packed["outcome"]["status"] == run.explanation.outcome.status
    assert set(packed["recovery"]) == {"episodes", "planted"}


def test_plain_values_of_any_kind() -> None:
    assert plain_value({"a": (1, None, Path("x"))}) == {"a": [1, None, "x"]}
