"""Mechanisms behind single causes, each in a made-up investigation or a short run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from picktree.analysis import Run
from picktree.analysis.explain.body_tracks import BodyTracks
from picktree.analysis.explain.case import Investigation
from picktree.analysis.explain.device_causes import fingers_stuck, joint_saturated, wrist_biased
from picktree.analysis.explain.explanation import FailureStory, ItemVerdict, RejectedCandidate
from picktree.analysis.explain.held_items import HeldPeriod, held_periods
from picktree.analysis.explain.identities import Identities
from picktree.analysis.explain.item_causes import ItemDisplacement, explain_wrong_place, moved_by_arm
from picktree.analysis.explain.obstruction_causes import explain_hidden, explain_unreachable_bin
from picktree.analysis.explain.run_endings import explain_missed_goal, explain_nothing_seen
from picktree.analysis.explain.run_explanation import failures_of, investigation
from picktree.analysis.explain.seen_world import SeenWorld
from picktree.analysis.explain.wording import between
from picktree.logs import Stamped
from picktree.logs.log_records import BodyRecord, Scene
from picktree.logs.series import ControlSeries, GripperSeries, JointSeries
from picktree.world import Box, ObjectId, Pose
from picktree.world.scene import Bin

from .test_explain_roots import BLOCK, run

if TYPE_CHECKING:
    from picktree.analysis.explain import ExplainedOutcome

TIMES = np.asarray(0.05 * np.arange(40), np.float64)


def case(**known: object) -> Investigation:
    return cast("Investigation", SimpleNamespace(**known))


def always(value: object) -> Callable[..., object]:
    return lambda *_, **__: value


def failed(cause: str, item: str, time: float = 3.0) -> FailureStory:
    return FailureStory(
        number=0, time=time, tick=0, visit=0, node="Main/Grasp", id="Grasp", item=item, attempt=1,
        cause=cause, sentence="", remedy="", step="", message="", evidence={}, chain=(), handled_by=(),
        fate="open", fate_by="", fate_at=None, because_of=None, choices=(), observed=(),
    )  # fmt: skip


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
        case(fixed_cameras=[camera], obstacles_at=always([("lid", crate)])),
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


BIN = Bin(ObjectId("red_bin"), (0.2, 0.2, 0.1), 0.005, Pose((0.5, 0.4, 0.0)))


@pytest.mark.parametrize(
    ("stage", "by", "cause", "words"),
    [
        ("place reached", "", "bin.out_of_reach", "the arm does not reach over red_bin"),
        ("place reached", "red_bin", "bin.out_of_reach", "over red_bin the arm would be in red_bin"),
        ("place reached", "shelf", "scene.blocked", "shelf is in the way over red_bin"),
        ("room at the place", "red_bin", "bin.hemmed_in", "red_ball_1 cannot be let go over red_bin"),
    ],
)
def test_a_refused_place_is_told_by_the_robots_own_reason(
    stage: str, by: str, cause: str, words: str
) -> None:
    far = SimpleNamespace(shape=Box((0.1, 0.1, 0.1)), pose=Pose((-1.0, 0.0, 0.0)))
    asked = case(
        last_believed=always("it"),
        destination=always("red_bin"),
        bins={"red_bin": BIN},
        fixtures={"shelf": far},
        belief=SimpleNamespace(tracks={}, at=always(None)),
        believed_at=always([]),
        obstacles_at=always([]),
    )
    failure = failed("grasp.no_candidate", "red_ball_1")
    found = explain_unreachable_bin(asked, failure, [RejectedCandidate("yaw 0", "no", 24, stage, by)], 24)
    assert found is not None
    assert found.cause == cause
    assert found.title.startswith(words)


def test_an_item_that_moved_before_the_fingers_closed_explains_its_failed_insertion() -> None:
    """In the hand it is then beside its believed place, and the robot cannot know."""

    def key(x: float, **more: Any) -> BodyRecord:
        shape, at = Box((0.05, 0.02, 0.06)), Pose((x, 0.2, 0.03))
        return BodyRecord("key", "box", shape, "red", at, id=ObjectId("key_1"), **more)

    def tracks(*samples: tuple[float, BodyRecord]) -> BodyTracks:
        return BodyTracks([Stamped(time, Scene((body,), ())) for time, body in samples])

    truth = tracks(*((0.1 * n, key(0.4 if n < 8 else 0.37)) for n in range(200)))
    belief = tracks(*((0.1 * n, key(0.4, attached=n > 14)) for n in range(200)))
    asked = case(
        pairs={"key_1": "key_1"},
        believed={"key_1": ("key_1",)},
        once=always((HeldPeriod("key_1", "key_1", 1.5, 19.9, None),)),
        world=SimpleNamespace(is_true=False),
        gone=always(None),
        belief=belief,
        bodies=truth,
        sampled=0.1,
        changes=always(()),
        hand=always(None),
        truly="",
        bin_at=always(""),
        entry_of=always(None),
        devices=(),
    )
    found = explain_wrong_place(asked, failed("insert.not_found", "key_1", time=12.0))
    assert found is not None
    assert (found.cause, found.about) == ("item.moved", "key_1")
    assert found.time == pytest.approx(0.7, abs=0.11)


@pytest.mark.parametrize(("colour", "cause"), [("green", "item.larger"), ("grey", "scene.unknown_obstacle")])
def test_a_body_that_looks_like_an_item_is_one_of_another_size(colour: str, cause: str) -> None:
    body = SimpleNamespace(shape=Box((0.07, 0.08, 0.12)), colour=colour, role="obstacle", id="obstacle_1")
    entries = [SimpleNamespace(kind="can", shape=Box((0.05, 0.05, 0.08))),
               SimpleNamespace(kind="brick", shape=Box((0.03, 0.08, 0.02)))]  # fmt: skip
    seen = SimpleNamespace(first=body, id="obstacle_1", times=[0.1])
    found = explain_nothing_seen(
        case(
            scene=SimpleNamespace(catalogue=entries),
            belief=SimpleNamespace(tracks={"obstacle_1": seen}),
            events=always(["a look"]),
            once=always(()),
            obstacles=SimpleNamespace(tracks={"obstacle_1": seen}),
        )
    )
    assert found is not None
    assert found.cause == cause
    if colour == "green":
        assert found.title == "obstacle_1 looks like a green can, 1.5 times as large as in the catalogue"


def test_without_truth_an_item_has_its_first_name() -> None:
    """No look has to show a thing that was lifted out of a heap before it is known by its name."""
    nothing = BodyTracks([])
    assert Identities(nothing, nothing, {"thing_1": "thing_1"}).pairs == {"thing_1": "thing_1"}


@pytest.mark.parametrize("held", [False, True])
def test_a_force_on_what_is_held_is_no_bias_of_the_wrist(held: bool) -> None:
    """What is held may be held fast. An empty hand at rest touches nothing."""
    pulled = np.where(TIMES > 1.1, 15.0, 0.0)
    forces = np.stack([0 * TIMES, 0 * TIMES, pulled], axis=1)
    still = np.zeros((40, 1))
    track = SimpleNamespace(times=TIMES, bodies=[SimpleNamespace(attached=held)] * 40)
    hand = GripperSeries(TIMES, np.full(40, 0.04), np.full(40, 20.0 * held))
    log = SimpleNamespace(
        wrenches=SimpleNamespace(times=TIMES, forces=forces),
        joints=JointSeries(("a",), TIMES, still, still, still),
        info=SimpleNamespace(backend="kinematic"),
        controls=SimpleNamespace(errors=np.zeros((0, 1))),
    )
    asked = case(
        run=log,
        gripper=hand,
        belief=SimpleNamespace(tracks={"red_ball_1": track}),
        family=SimpleNamespace(visits=()),
        failures=(),
        events=always([]),
        hand=always((0.4, 0.0, 0.3)),
    )
    assert [found.cause for found in wrist_biased(asked)] == ([] if held else ["wrist.biased"])


@pytest.mark.parametrize(("x", "name"), [(0.4, "red_block_1"), (0.5, "blue_block_1")])
def test_without_truth_an_item_that_changes_its_colour_where_it_lies_is_the_same(x: float, name: str) -> None:
    def scene(time: float, at: float, colour: str) -> Stamped[Scene]:
        body = BodyRecord("block", "box", Box((0.04, 0.04, 0.04)), colour, Pose((at, 0.2, 0.02)),
                          id=ObjectId(f"{colour}_block_1"), last_seen=time)  # fmt: skip
        return Stamped(time, Scene((body,), ()))

    looks = [scene(0.1, 0.4, "red"), scene(5.0, x, "blue"), scene(6.0, x, "blue")]
    asked = case(
        belief=BodyTracks(looks),
        events=always([]),
        failures=(),
        run=SimpleNamespace(log=SimpleNamespace(beliefs=always(looks))),
    )
    assert SeenWorld(asked).names["blue_block_1"] == name
