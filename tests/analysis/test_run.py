from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from picktree.analysis import Run
from picktree.files import PicktreeError
from picktree.session import RunRequest, Session

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def sorted_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run without physics that sorts a small table."""
    out = tmp_path_factory.mktemp("runs")
    request = RunRequest(
        mission=EXAMPLES / "sort_by_colour.yaml", scene="sort_small", backend="kinematic", out=out
    )
    return Session(request).run().folder


def test_a_run_says_what_its_result_was(sorted_run: Path) -> None:
    with Run(sorted_run) as run:
        assert run.result is not None
        assert run.result.to_json_text() == (sorted_run / "result.json").read_text()
        assert run.recovered == ""
        assert run.info.seed == 0


def test_ticks_are_had_by_number_and_by_time(sorted_run: Path) -> None:
    with Run(sorted_run) as run:
        assert len(run.ticks) == len(run.ticks.times) > 100
        assert [tick.number for tick in run.ticks] == list(range(len(run.ticks)))
        assert run.ticks[7].time == run.ticks.times[7] == pytest.approx(0.35)
        assert run.ticks[-1].record.root_status == "SUCCESS"
        assert run.ticks.number_at(0.39) == 7
        assert run.ticks.number_at(-1) == 0
        assert run.ticks.number_at(1e6) == len(run.ticks) - 1
        assert [tick.number for tick in run.ticks[2:5]] == [2, 3, 4]


def test_visits_tell_which_node_did_what_for_which_item(sorted_run: Path) -> None:
    with Run(sorted_run) as run:
        grasps = [visit for visit in run.visits if visit.id == "Grasp"]
        assert run.result is not None
        assert len(grasps) >= run.result.picks.held
        assert {visit.item for visit in grasps} == {pick.object for pick in run.picks}
        for visit in grasps:
            assert visit.inputs["object"] == visit.item
            assert visit.outcome == "SUCCESS"
            assert visit.parent is not None
            around = run.visits[visit.parent]
            assert around.first <= visit.first and visit.last <= around.last
            assert around.item == visit.item  # a node without a subject is about the element of the loop
        assert run.visits[0].parent is None
        assert run.visits[0].outcome == "SUCCESS"
        assert len({visit.key for visit in run.visits}) == len(run.visits)


def test_a_moment_has_belief_and_blackboard(sorted_run: Path) -> None:
    with Run(sorted_run) as run:
        before, after = run.at(0.0), run.at(run.end)
        assert before.blackboard == {"Main/rounds": 4}  # the mission's parameter
        assert any(key.endswith("items") for key in after.blackboard)
        assert after.belief is not None and after.truth is not None
        assert len(after.belief.bodies) == len(after.truth.bodies)


def test_series_have_a_row_for_each_tick(sorted_run: Path) -> None:
    with Run(sorted_run) as run:
        assert run.joints.positions.shape == (len(run.ticks), len(run.joints.names))
        assert np.array_equal(run.joints.times, run.ticks.times)
        assert run.wrenches.forces.shape == (len(run.ticks), 3)


def test_a_log_without_a_result_has_none(sample: ModuleType, log_path: Path) -> None:
    with Run(log_path) as run:
        assert run.result is None
        assert [tick.time for tick in run.ticks[:2]] == [0.0, 0.05]


def test_no_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PicktreeError) as refused:
        Run(tmp_path / "nothing.mcap")
    assert str(refused.value) == f"{tmp_path}/nothing.mcap: there is no such log"


def test_ticks_in_a_row_are_read_in_one_go(sorted_run: Path) -> None:
    with Run(sorted_run) as run:
        assert run.ticks[20:30:3] == tuple(run.ticks[number] for number in (20, 23, 26, 29))
        assert run.ticks[3:0:-1] == tuple(run.ticks[number] for number in (3, 2, 1))
        assert run.ticks[5:5] == ()


def test_images_are_had_by_number_and_by_time(sorted_run: Path) -> None:
    with Run(sorted_run) as run:
        assert run.images.cameras == ("overhead", "overhead")
        shot = run.images[0]
        assert shot.time == run.images.times[0]
        assert shot.record.camera == "overhead"
        assert shot.record.colour.shape == (*shot.record.depth.shape, 3)
        assert shot.record.colour.std() > 10
        assert run.images.before(shot.time - 0.01) is None
        for camera in ("overhead", None):
            found = run.images.before(run.end, camera)
            assert found is not None and found.time == run.images.times[-1]
        assert run.images.before(run.end, "side") is None
        assert run.images[:5][0].time == shot.time


def test_the_gripper_opens_and_closes(sorted_run: Path) -> None:
    with Run(sorted_run) as run:
        assert run.gripper.widths.shape == run.gripper.times.shape == (len(run.ticks),)
        assert run.gripper.widths.max() > 0.06
        for pick in run.picks:
            nearest = run.gripper.widths[np.searchsorted(run.gripper.times, pick.time)]
            assert nearest == pytest.approx(pick.width, abs=0.002)
        column = run.joints.column("panda_joint4")
        assert np.ptp(run.joints.positions[:, column]) > 0.1
        with pytest.raises(PicktreeError, match=r"^no joint 'elbow'; the log has: panda_joint1, "):
            run.joints.column("elbow")


def test_a_run_draws_itself(sorted_run: Path) -> None:
    with Run(sorted_run) as run:
        picture = run.picture(1.0, (160, 100), view="top", show="both")
        assert picture.shape == (100, 160, 3) and picture.std() > 10


def test_what_is_printed_is_short_and_telling(sorted_run: Path) -> None:
    with Run(sorted_run) as run:
        assert run.result is not None
        total = run.result.items.total
        assert repr(run) == (
            f"<Run {run.path}: sort by colour, seed 0, {run.end:.1f} s, success, "
            f"{total} of {total} items sorted>"
        )
        assert repr(run.ticks) == f"<{len(run.ticks)} ticks, 0.00 … {run.ticks.times[-1]:.2f} s>"
        assert repr(run.ticks[0]).startswith("<tick 0 at 0.00 s: RUNNING, Main/")
        assert repr(run.images).startswith(f"<{len(run.images)} images by overhead, ")
        assert repr(run.at(run.end)).startswith(f"<<tick {len(run.ticks) - 1} at ")
        assert repr(run.wrenches) == f"<{len(run.ticks)} readings of the wrist>"


def test_a_run_that_was_cut_off_says_so(log_path: Path) -> None:
    with Run(log_path) as run:
        assert repr(run) == f"<Run {log_path}: sort by colour, seed 7, 3.0 s, no result: the log was cut off>"


@pytest.mark.parametrize(
    ("robot", "fingers"),
    [
        (b"gripper: {joints: [panda_joint7]}", ("panda_joint7",)),
        (b"gripper: [", ("panda_finger_joint1", "panda_finger_joint2")),
        (b"name: an arm without a gripper", ("panda_finger_joint1", "panda_finger_joint2")),
    ],
)
def test_the_joints_of_arm_and_gripper_are_those_of_the_robot_file(
    sorted_run: Path, monkeypatch: pytest.MonkeyPatch, robot: bytes, fingers: tuple[str, ...]
) -> None:
    """A joint's name decides where the robot file names no fingers."""
    with Run(sorted_run) as run:
        monkeypatch.setattr(run.log, "attachment", {"robot.yaml": robot}.__getitem__)
        arm, gripper = run.joint_names
        assert gripper == fingers
        assert {*arm, *gripper} == set(run.joints.names)
        columns = [run.joints.column(name) for name in fingers]
        np.testing.assert_array_equal(run.gripper.widths, run.joints.positions[:, columns].sum(axis=1))


def test_the_hinges_of_a_linkage_are_no_joints_of_the_arm_and_no_opening(
    sorted_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = b"joints: {panda_joint1: {}, panda_joint2: {}}\ngripper: {linkage: {drive: panda_finger_joint1}}"
    with Run(sorted_run) as run:
        monkeypatch.setattr(run.log, "attachment", {"robot.yaml": robot}.__getitem__)
        assert run.joint_names == (("panda_joint1", "panda_joint2"), ())
        assert len(run.gripper.times) == 0
