"""Mechanisms behind single causes, each in a made-up investigation or a short run."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from picktree.analysis import Run
from picktree.analysis.explain.case import Investigation
from picktree.analysis.explain.device_causes import fingers_stuck, joint_saturated
from picktree.analysis.explain.explanation import ItemVerdict, between
from picktree.analysis.explain.held_items import held_periods
from picktree.analysis.explain.item_causes import ItemDisplacement, moved_by_arm
from picktree.analysis.explain.obstruction_causes import explain_hidden
from picktree.analysis.explain.run_endings import explain_missed_goal
from picktree.analysis.explain.run_explanation import failures_of, investigation
from picktree.logs.series import ControlSeries, GripperSeries, JointSeries
from picktree.world import Box, Pose

from .test_explain_roots import BLOCK, run

if TYPE_CHECKING:
    from picktree.analysis.explain import ExplainedOutcome

TIMES = np.asarray(0.05 * np.arange(40), np.float64)


def case(**known: object) -> Investigation:
    return cast("Investigation", SimpleNamespace(**known))


@pytest.mark.parametrize(
    ("start", "end", "words"),
    [(4.0, 4.0, "at 4.00 s"), (4.0, 4.02, "at 4.00 s"), (4.0, 4.2, "between 4.0 and 4.2 s")],
)
def test_a_period_of_no_length_is_a_time(start: float, end: float, words: str) -> None:
    assert between(start, end) == words


@pytest.mark.parametrize(("pressed", "stuck"), [(0.0, True), (20.0, False)])
def test_fingers_that_stand_open_though_told_to_close_are_stuck(pressed: float, stuck: bool) -> None:
    """Those that press on something as wide as they open hold it."""
    closing = [SimpleNamespace(name="close", start=0.5, end=1.5)]
    gripper = GripperSeries(TIMES, np.full(40, 0.08), np.full(40, pressed))
    steps = {"close": closing, "release": []}
    found = list(fingers_stuck(case(gripper=gripper, steps=steps.__getitem__)))
    assert [each.cause for each in found] == ["gripper.jammed"] * stuck
    if stuck:
        assert found[0].title.startswith("the fingers are stuck at 80 mm")


def test_a_joint_that_keeps_its_torque_while_the_arm_is_compliant_is_weak() -> None:
    effort = np.stack(
        [np.sin(TIMES), np.where((TIMES > 0.6) & (TIMES < 1.4), 2.5, 4.0 * np.cos(TIMES))], axis=1
    )
    joints = JointSeries(("a", "b"), TIMES, 0 * effort, 0 * effort, effort)
    controls = ControlSeries(
        TIMES, ("CartesianImpedance",) * 40, np.full((40, 2), np.nan), np.full((40, 2), np.nan)
    )
    info = SimpleNamespace(backend="physics")
    log = SimpleNamespace(controls=controls, joints=joints, joint_names=(("a", "b"), ()), info=info)
    (found,) = joint_saturated(case(run=log))
    assert (found.cause, found.about) == ("joint.weak", "b")
    assert found.spans[0] == (pytest.approx(0.7, abs=0.06), pytest.approx(1.35, abs=0.06))


def test_an_item_that_went_with_the_hand_was_carried_off_by_it() -> None:
    def pose(time: float) -> tuple[float, float, float]:
        return (0.4 + 0.2 * time, 0.0, 0.02)

    def body(time: float) -> SimpleNamespace:
        return SimpleNamespace(pose=Pose(pose(time)), form="box")

    track = SimpleNamespace(before=body, after=body, first=body(0.0), bodies=[body(0.0), body(1.0)])
    wrench = SimpleNamespace(times=TIMES, forces=np.zeros((40, 3)))
    found = case(
        world=SimpleNamespace(is_true=True),
        bodies=SimpleNamespace(tracks={"item_00": track}),
        hand=pose,
        run=SimpleNamespace(wrenches=wrench),
    )
    carried, evidence = moved_by_arm(found, "item_00", ItemDisplacement(0.0, 1.0, 0.2))
    assert carried
    assert evidence.startswith("the hand went with it")


@pytest.mark.parametrize(("x", "hidden"), [(0.0, True), (0.3, False)])
def test_an_unknown_body_between_camera_and_item_hides_it(x: float, hidden: bool) -> None:
    camera = SimpleNamespace(name="overhead", on="world", pose=Pose((0.5, 0.0, 1.5)))
    crate = SimpleNamespace(shape=Box((0.1, 0.1, 0.02)), pose=Pose((0.5 + x, 0.0, 0.4)))
    found = explain_hidden(
        case(scene=SimpleNamespace(cameras=[camera]), obstacles_at=lambda _: [("lid", crate)]),
        "red_ball_1",
        cast("Any", SimpleNamespace(pose=Pose((0.5, 0.0, 0.02)))),
        3.0,
    )
    assert (found is not None) is hidden
    if found is not None:
        assert (found.cause, found.about) == ("scene.unknown_obstacle", "lid")


def test_a_missed_goal_counts_the_items_that_are_in_place() -> None:
    verdicts = {"a": ItemVerdict("red_bin", "red_bin", "sorted"), "b": ItemVerdict("red_bin", "", "left")}
    scene = SimpleNamespace(goal="sorted >= 2")
    belief = SimpleNamespace(tracks={"a": SimpleNamespace(first=SimpleNamespace(role="item"))})
    log = SimpleNamespace(attachments=())
    asked = case(verdicts=verdicts, scene=scene, belief=belief, run=SimpleNamespace(log=log))
    ended = cast("ExplainedOutcome", SimpleNamespace(status="incomplete", end=9.0))
    found = explain_missed_goal(asked, ended)
    assert found is not None
    assert found.title == "1 of 2 items are in place, and the goal is missed: `sorted >= 2` does not hold"


def test_an_item_between_the_fingers_of_a_linkage_stays_in_the_hand(tmp_path: Path) -> None:
    """The frames of a Robotiq's fingers turn while they close: the hand is its TCP."""
    with Run(run(tmp_path, items=BLOCK, scene="robot: ur10e\n")) as log:
        account = log.account
        found = investigation(log, account, failures_of(log, account), truth=True)
        (period,) = held_periods(found)
        during = (found.gripper.times > period.start) & (found.gripper.times < period.end - 0.3)
        assert period.left is None
        assert float(np.median(found.gripper.widths[during])) == pytest.approx(0.04, abs=0.003)
        blind = investigation(log, account, failures_of(log, account), truth=False)
        assert [each.left for each in held_periods(blind)] == [None]
