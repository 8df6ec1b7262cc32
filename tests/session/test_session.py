"""Session: what a run leaves behind, and how it says no. On the kinematic backend, which is fast."""

from __future__ import annotations

import gc
import json
import os
import signal
import weakref
from dataclasses import replace
from pathlib import Path

import pytest

from picktree.files import FileError, PicktreeError
from picktree.logs import RunLog, RunResult
from picktree.session import Observer, RunRequest, Session, frozen_before_runs
from picktree.session.checkpoints import RunState
from picktree.session.execution import TICK_LENGTH
from picktree.session.run_recipe import read_recipe
from picktree.simulation import TrueBody
from picktree.trees import NodeStatus
from picktree.world import Tick

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
TOPICS = {
    "/bt/tree", "/bt/tick", "/timing", "/joint_states", "/tf", "/scene/robot", "/scene/objects",
    "/truth/objects", "/wrench", "/control", "/plan", "/candidates", "/events",
    "/camera/overhead/colour", "/camera/overhead/depth", "/camera/overhead/calibration",
}  # fmt: skip


def request(out: Path, mission: str = "one_pick", **options: object) -> RunRequest:
    return RunRequest(mission=EXAMPLES / f"{mission}.yaml", out=out, backend="kinematic", **options)  # type: ignore[arg-type]


ONE_ITEM = """\
picktree: 1
kind: scene
base: sort_small
checkpoint_every: 1
spawn: [{of: {block: 1}, colours: [red], area: {min: [0.44, -0.1], max: [0.46, -0.08]}}]
"""


class Interrupting(Observer):
    """Sends Ctrl-C while a tick is reported."""

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        if round(now / TICK_LENGTH) == 6:
            os.kill(os.getpid(), signal.SIGINT)


def test_nothing_of_a_run_is_kept_where_the_process_froze_its_libraries(tmp_path: Path) -> None:
    frozen_before_runs.cache_clear()
    gc.freeze()
    session = Session(request(tmp_path))
    world, tree = weakref.ref(session.execution.world), weakref.ref(session.execution.tree)
    session.run()
    del session
    gc.collect()
    assert (world(), tree()) == (None, None)


def test_a_run_with_a_planning_worker_is_the_run_without_one(tmp_path: Path) -> None:
    digests = {
        Session(request(tmp_path / name), planning_worker=worker).run().digest
        for name, worker in (("with", True), ("without", False))
    }
    assert len(digests) == 1


@pytest.mark.parametrize(
    ("rocks", "height", "waited"), [(0.0, 0.0, 0), (0.6, 0.0, 12), (0.6, 0.3, 12), (9.0, 0.0, 100)]
)
def test_what_still_moves_comes_to_rest_before_it_is_scored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rocks: float, height: float, waited: int
) -> None:
    """The last item is in its bin or falls into it; the wait is at most five seconds."""
    (tmp_path / "one.yaml").write_text(ONE_ITEM)
    session = Session(request(tmp_path, "sort_by_colour", scene=str(tmp_path / "one.yaml")))
    hardware, tree = session.execution.hardware, session.execution.tree
    truth, ended = hardware.truth, list[float]()

    def rocking() -> tuple[TrueBody, ...]:
        (body,) = truth()
        if tree.status is not NodeStatus.SUCCESS:
            return (body,)
        ended[:] = ended or [hardware.clock.now]
        spin = 2.0 if hardware.clock.now < ended[0] + rocks - 1e-9 else 0.0
        return (replace(body, spin=(0.0, spin, 0.0), pose=body.pose.shifted((0.0, 0.0, height))),)

    for name in ("truth", "recent_truth"):  # one for the wait, one for the score
        monkeypatch.setattr(hardware, name, rocking)
    result = session.run()
    assert result.sim_seconds == pytest.approx(ended[0] + waited * TICK_LENGTH)
    assert result.items.sorted == (rocks < 5.0 and height == 0.0)


def test_a_run_leaves_a_log_a_result_and_the_files_it_was_made_from(picked: RunResult) -> None:
    result = picked
    assert result.status == "success"
    assert (result.items.sorted, result.items.left) == (1, 3)
    assert json.loads((result.folder / "result.json").read_text()) == result.to_json()
    with RunLog(result.log) as log:
        assert set(log.topics) >= TOPICS
        assert {"mission.yaml", "scene.yaml", "robot.yaml", "robot.urdf"} <= set(log.attachments)
        assert log.digest() == result.digest
        ticks = list(log.ticks())
        times = [tick.time for tick in ticks]
        assert times == pytest.approx([k * 0.05 for k in range(len(ticks))])
        assert ticks[-1].record.root_status == "SUCCESS"
        assert {node.path for node in ticks[0].record.nodes} == {node.path for node in log.tree().nodes}


def test_checkpoints_are_in_the_log_and_can_be_read_back(tmp_path: Path) -> None:
    (tmp_path / "one.yaml").write_text(ONE_ITEM)
    session = Session(request(tmp_path, "sort_by_colour", scene=str(tmp_path / "one.yaml")))
    result = session.run()
    assert result.items.sorted == 1
    with RunLog(result.log) as log:
        names = [name for name in log.attachments if name.startswith("checkpoint-")]
        assert names == ["checkpoint-0001.json"]
        state = RunState.from_json(log.attachment(names[0]))
        moments = [e.time for e in log.events() if e.record.kind == "checkpoint"]
    assert state.items_done == 1
    assert moments == [pytest.approx(state.time + 0.05)]
    assert RunState.from_json(state.to_json()) == state
    session.execution.tree.halt()
    session.execution.tree.restore(state.tree)
    assert session.execution.tree.save() == state.tree


def test_an_interrupted_run_has_a_result_and_a_whole_log(tmp_path: Path) -> None:
    result = Session(request(tmp_path), observers=[Interrupting()]).run()
    assert result.status == "interrupted"
    with RunLog(result.log) as log:
        assert not log.recovered
        assert log.digest() == result.digest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_before_the_first_tick_leaves_a_whole_log(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(urdf: str) -> None:
        os.kill(os.getpid(), number)
        signal.pause()

    monkeypatch.setattr("picktree.logs.binary_gltf.link_meshes", interrupted)
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt):
        Session(request(tmp_path)).run()
    assert signal.getsignal(number) is before
    (path,) = tmp_path.glob("*/log.mcap")
    with RunLog(path) as log:
        assert not log.recovered
        assert log.result["ended"] == "KeyboardInterrupt"
        assert "Main" in {node.path for node in log.tree().nodes}


def test_the_scene_and_parameters_of_a_run_can_be_chosen(tmp_path: Path) -> None:
    chosen = request(tmp_path, "sort_by_colour", scene="sort_small", parameters={"rounds": "1"}, limit=0.2)
    with RunLog(Session(chosen).run().log) as log:
        assert (log.run.scene, log.run.parameters) == ("sort_small", {"rounds": "1"})


def test_a_mission_without_a_scene_needs_one(tmp_path: Path) -> None:
    mission = tmp_path / "bare.yaml"
    mission.write_text("picktree: 1\nkind: mission\ntrees: {Main: AlwaysSuccess}\n")
    with pytest.raises(PicktreeError) as caught:
        Session(RunRequest(mission=mission))
    assert str(caught.value) == f"{mission}: the mission names no scene; add 'scene:' or give --scene"


def test_a_run_refuses_the_mission_that_check_refuses(tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    head = "picktree: 1\nkind: mission\nscene: sort_small\ntrees:\n  Main:\n"

    def codes(main: str, **settings: str) -> list[str]:
        mission.write_text(f"{head}    {main}\n")
        try:
            read_recipe(RunRequest(mission, parameters=settings))
        except FileError as error:
            return [fault.code for fault in error.faults]
        return []

    assert codes("ForEach: {in: '{itms}', out: '{item}', do: {Log: {message: '{item}'}}}") == ["P301"]
    camera = "{ports: {eye: {type: string, default: lens}}, Observe: {camera: '{eye}'}}"
    assert codes(camera) == ["P240"]
    assert codes(camera, eye="overhead") == []


def test_a_folder_that_is_a_file_is_refused_before_anything_runs(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("")
    with pytest.raises(
        PicktreeError, match=r"the folder .*taken/one_pick-0-.* cannot be made: Not a directory"
    ):
        Session(request(taken))
