"""A mission on a robot in another process: MuJoCo in lockstep, with its own score."""

from __future__ import annotations

import csv
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from picktree.analysis import Run
from picktree.analysis.explain import explain, to_text
from picktree.apps.commissioning import RobotTestResult, test_external_robot
from picktree.drivers import ExternalHardware, measurement_path, protocol, read_measurement
from picktree.files import PicktreeError
from picktree.logs import RunLog, RunResult
from picktree.session import Execution, Observer, PresetAnswers, RunRequest, Session
from picktree.world import GripperCommand, Pose, Tick
from picktree.world.robot_model import RobotModel, load_robot
from picktree.world.scene import load_scene

from .served_cell import ServedCell, served, write_cell

pytest.importorskip("mujoco")
EXAMPLES = Path(__file__).parents[2] / "examples"


def test_a_mission_sorts_all_items_in_another_engine(tmp_path: Path) -> None:
    with served(write_cell(tmp_path)) as cell:
        request = RunRequest(
            EXAMPLES / "sort_by_colour.yaml",
            scene="sort_small",
            out=tmp_path / "runs",
            robot_at=cell.address,
            limit=60.0,
        )
        result = Session(request).run()
    assert (cell.score["sorted"], cell.score["total"], cell.score["stop"]) == (4, 4, "NONE")
    assert cell.score["greatest_force"] < 60.0
    # picktree never sees that score: it counts what it believes, and says so.
    assert (result.status, result.items.sorted, result.items.total, result.as_believed) == (
        "success",
        4,
        4,
        True,
    )
    assert "items       4 of 4 sorted, 0 misplaced, 0 left, as the robot believes" in result.to_text()
    assert json.loads((result.folder / "result.json").read_text())["as_believed"] is True
    # Nothing is told about a truth that the log does not have.
    with Run(result.log) as run:
        told = to_text(run, explain(run), str(result.log))
    assert "4 of 4 items are where they belong, as the robot believes" in " ".join(told.split())
    assert "truly" not in told
    with RunLog(result.log) as log:
        assert log.run.backend == "robot" and log.run.physics["engine"].startswith("MuJoCo")
        assert list(log.truths()) == []


class Killer(Observer):
    """Observer that kills the robot's process after some simulated time."""

    def __init__(self, cell: ServedCell, at: float) -> None:
        self._cell, self._at = cell, at

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        if now >= self._at:
            self._cell.kill()


def one_pick(cell: ServedCell, folder: Path, *observers: Observer, speed: float = 1.0) -> RunResult:
    mission = EXAMPLES / "one_pick.yaml"
    request = RunRequest(mission, scene="sort_small", out=folder / "runs", robot_at=cell.address, speed=speed)
    return Session(request, observers=observers).run()


def test_a_robot_that_is_gone_or_stops_by_itself_ends_the_run_with_a_result(tmp_path: Path) -> None:
    """The log is sealed, the reason is told, and the mission's goal is not reached."""
    file = write_cell(tmp_path)
    with served(file) as cell:
        gone = one_pick(cell, tmp_path, Killer(cell, 1.0), speed=0.1)
    file.write_text(json.dumps({**json.loads(file.read_text()), "force": 1.0}))
    with served(file) as cell:
        pushed = one_pick(cell, tmp_path)
    reasons = ("connection", "s: the force at the wrist was too great")
    for result, reason in zip((gone, pushed), reasons, strict=True):
        assert (result.status, result.reached, result.as_believed) == ("stopped", False, True)
        assert result.message.startswith(f"the robot at {cell.address}") and reason in result.message
        assert result.to_text().startswith(f"stopped: the robot's own side ended the run: {result.message}")
        assert json.loads((result.folder / "result.json").read_text())["status"] == "stopped"
        with Run(result.log) as run:
            told = to_text(run, explain(run), str(result.log))
            assert run.result is not None and run.result.message == result.message
        assert reason in " ".join(told.split())

    limits = np.array([limit.velocity for limit in load_robot("panda", tmp_path).limits])
    with RunLog(gone.log) as log:
        assert log.run.physics["speed"] == "10 %"
        fastest = max(float((np.abs(each.record.velocity[:7]) / limits).max()) for each in log.joints())
    assert 0.03 < fastest < 0.105  # the bound of `--speed`


def test_each_motion_is_confirmed_and_a_no_ends_the_run(tmp_path: Path) -> None:
    """The arm stands still until the answer, and no recovery goes around a no."""
    with served(write_cell(tmp_path)) as cell:
        mission = EXAMPLES / "one_pick.yaml"
        at = tmp_path / "runs"
        request = RunRequest(mission, scene="sort_small", out=at, robot_at=cell.address, confirm=True)
        result = Session(request, observers=[PresetAnswers(["move", "end the run"])]).run()
    assert result.status == "interrupted" and result.picks.tried == 0
    assert "/Pick" in result.message or "Grasp" in result.message
    assert result.message.endswith("was not confirmed: end the run")
    with RunLog(result.log) as log:
        moved = {each.record.controller for each in log.controls()}
    assert moved == {"Hold", "Track"}


class Lines(Observer):
    """Observer that keeps the lines for displays."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def notified(self, now: float, text: str) -> None:
        self.lines += text.splitlines()


def test_a_shadow_shows_what_it_would_send_and_sends_nothing(tmp_path: Path) -> None:
    """It ends where the fingers would close, and names the set-point that the robot would refuse."""
    file, seen = write_cell(tmp_path, seed=3), Lines()
    cell_text = json.loads(file.read_text())
    cell_text["workspace"][2] = 0.2
    file.write_text(json.dumps(cell_text))
    with served(file) as cell:
        mission = EXAMPLES / "one_pick.yaml"
        request = RunRequest(mission, "sort_small", out=tmp_path / "runs", robot_at=cell.address, shadow=True)
        result = Session(request, observers=[seen]).run()
    assert (cell.score["time"], cell.score["greatest_force"]) == (0.0, 0.0)
    assert (result.status, result.picks.tried) == ("interrupted", 0)
    assert "the fingers would close" in result.message
    rows = list(csv.reader((result.folder / "shadow.csv").open()))
    first, last = (np.array(row[1:8], float) for row in (rows[1], rows[-1]))
    home = np.array(cell_text["robot"]["home"])
    assert first == pytest.approx(home, abs=1e-6)
    # Where the fingers would close there is an item: the belief comes from the cell's own picture.
    model = RobotModel(load_robot("panda", tmp_path))
    tool = np.array(model.tcp(last).position)
    assert min(np.linalg.norm(tool - item["at"]) for item in cell_text["items"]) < 0.03
    assert float(rows[-1][8]) == pytest.approx(float(np.abs(last - home).max()), abs=2e-3)
    assert any(line.startswith("refused") and "the tool leaves the workspace" in line for line in seen.lines)
    assert any(line.startswith("would send ") for line in seen.lines)


class Mistake(Observer):
    """Observer that makes the robot believe that an item is in its bin."""

    def started(self, run: Execution, folder: Path) -> None:
        self._made = False
        self._scene, self._bins = run.world.scene, run.recipe.scene.bins

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        scene = self._scene
        if items_total and not self._made:
            self._made = True
            item = next(each for each in scene.objects if each.role == "item")
            bin_id = scene.destination(item.id)
            assert bin_id is not None
            inside = next(each.pose for each in self._bins if each.id == bin_id)
            pose = Pose((inside.position[0], inside.position[1], 0.05))
            scene.put(replace(item, pose=pose, place=bin_id), "believed wrongly")


def test_the_last_look_corrects_what_the_robot_believes(tmp_path: Path) -> None:
    """An item that is believed in its bin, but lies on the table, is not counted as sorted."""
    mission = tmp_path / "look.yaml"
    mission.write_text(
        "picktree: 1\nkind: mission\nname: look\ntrees:\n  Main:\n    Observe: {camera: overhead}\n"
    )
    with served(write_cell(tmp_path)) as cell:
        request = RunRequest(mission, scene="sort_small", out=tmp_path / "runs", robot_at=cell.address)
        result = Session(request, observers=[Mistake()]).run()
    with RunLog(result.log) as log:
        believed = [
            sum(b.place != "table" for b in scene.record.bodies if b.role == "item")
            for scene in log.beliefs()
        ]
    assert max(believed) == 1
    assert (result.items.sorted, result.items.left) == (0, 4)
    assert cell.score["sorted"] == 0


def test_a_robot_that_is_not_the_scenes_is_refused(tmp_path: Path) -> None:
    scene = load_scene("sort_small", tmp_path)
    with served(write_cell(tmp_path)) as cell:
        with pytest.raises(PicktreeError) as raised:
            ExternalHardware(scene, load_robot("xarm6", tmp_path), cell.address)
        said = str(raised.value)
        assert said.startswith(f"the robot at {cell.address} has the joints panda_joint1, panda_joint2")
        assert said.endswith("but xarm6 has joint1, joint2, joint3, joint4, joint5, joint6")


def test_where_nobody_listens_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("picktree.drivers.external_hardware.CONNECT_TIME", 0.0)
    scene, robot = load_scene("sort_small", tmp_path), load_robot("panda", tmp_path)
    with pytest.raises(PicktreeError) as raised:
        ExternalHardware(scene, robot, str(tmp_path / "no.sock"))
    assert str(raised.value) == (
        f"no robot at {tmp_path}/no.sock: No such file or directory; start its process first"
    )
    with pytest.raises(PicktreeError) as raised:
        ExternalHardware(scene, robot, "robot")
    assert str(raised.value) == (
        "--robot-at: 'robot' is no address: write a path, as /tmp/robot.sock, or 127.0.0.1:5577"
    )


def test_the_robot_is_tested_before_the_first_mission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sound cell passes; a hand of another mass, and late fingers, are named with the measured value."""
    monkeypatch.chdir(tmp_path)
    cell, robot = write_cell(tmp_path), load_robot("panda", tmp_path)
    with served(cell) as one:
        sound = external_robot_verdicts(one.address)
    assert sound.good, sound.to_text()
    found = read_measurement(tmp_path / "panda.measured.json")
    assert found is not None and found.engine.startswith("MuJoCo") and found.refused == ()
    assert found.wrench_noise == pytest.approx(0.05, rel=0.3)  # the cell's own
    with served(cell, hand_mass_error=0.3, gripper_latency=0.4) as other:
        verdicts = external_robot_verdicts(other.address)
    failed = {verdict.name: verdict for verdict in verdicts.verdicts if not verdict.good}
    assert set(failed) == {"weight of the hand", "gripper"}
    weight = failed["weight of the hand"]
    kilograms = float(weight.measured.removesuffix(" kg, by the model 1.010 kg"))
    assert kilograms == pytest.approx(1.25, abs=0.01)  # the plant's own
    assert weight.change.startswith(f"enter {kilograms:.3f} kg for the hand in the robot file")
    late = read_measurement(measurement_path(robot))
    assert late is not None and late.gripper_start == pytest.approx(0.41, abs=0.02)
    scene = load_scene("sort_small", tmp_path)
    with served(cell) as another:
        hardware = ExternalHardware(scene, robot, another.address, measured=late)
        hardware.gripper.command(GripperCommand(0.08, 20.0))  # it is open: nothing moves
        busy = [hardware.gripper.read().busy]
        for _ in range(100):
            hardware.step()
            busy.append(hardware.gripper.read().busy)
        hardware.close()
    assert 80 < busy.count(True) < 86 and not busy[-1]


def test_a_robot_with_wrong_signs_gets_no_mission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test finds the sign by the hand's weight, and the run refuses by the file of the test."""
    monkeypatch.chdir(tmp_path)
    take = ExternalHardware._take

    def turned(self: ExternalHardware, state: protocol.State) -> None:
        take(self, replace(state, wrench=tuple(-each for each in state.wrench)))

    cell = write_cell(tmp_path)
    with served(cell) as one, monkeypatch.context() as patch:
        patch.setattr(ExternalHardware, "_take", turned)
        module = sys.modules[test_external_robot.__module__]
        patch.setattr(module, "_small_motions", module._effort)  # these do not judge the wrist
        patch.setattr(module, "_latencies", lambda bench: ())
        patch.setattr(module, "_gripper", lambda bench: ())
        assert not external_robot_verdicts(one.address).good
    with served(cell) as other, pytest.raises(PicktreeError) as raised:
        one_pick(other, tmp_path)
    assert str(raised.value) == (
        f"the robot at {other.address} failed its test: the force has the wrong sign: send what hand and "
        "load exert on the wrist; mend it and repeat `picktree robot test --robot-at`"
    )
    (tmp_path / "panda.measured.json").write_text('{"robot": "panda"}')
    with pytest.raises(PicktreeError, match=r"panda\.measured\.json: engine: Field required"):
        one_pick(other, tmp_path)


def external_robot_verdicts(address: str) -> RobotTestResult:
    return test_external_robot("panda", "sort_small", address)


test_external_robot.__test__ = False  # type: ignore[attr-defined]
