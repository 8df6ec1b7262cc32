"""Profile of a run: where its time goes, and that the run does not notice."""

from __future__ import annotations

import json
import threading
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from picktree.apps.cli import answer
from picktree.logs import RunLog
from picktree.session import Observer, Profiler, ResumeRequest, Resumption, RunRequest, Session
from picktree.session.execution import TICK_LENGTH
from picktree.session.profiler import NodeCost, RunProfile
from picktree.session.run_recipe import DEFAULT_TIME_LIMIT
from picktree.simulation import Backend
from picktree.simulation.kinematic import KinematicHardware
from picktree.trees import TickReport

MISSION = Path(__file__).parents[1] / "golden" / "one_item.yaml"
WORKING = '''\
"""Skills that take as much CPU time as a test says."""

import time

from picktree.robot import World
from picktree.trees import Decorator
from picktree.trees.control_flow import ChildFlow
from picktree.trees import In, port
from picktree.trees import Skill, Steps
from picktree.trees import NodeStatus


class Around(Decorator):
    """Take a CPU second before and half a one after each tick of the child."""

    flow = ChildFlow()
    example = "Around: {Work: {ticks: 3}}"

    def on_tick(self) -> NodeStatus:
        time.thread_time.spend(1.0)
        status = self.relay()
        time.thread_time.spend(0.5)
        return status


class Work(Skill):
    """Take one CPU second in each of some ticks."""

    ticks: In[int] = port("how many ticks", default=1)
    example = "Work: {ticks: 3}"

    def run(self, world: World) -> Steps:
        for _ in range(self.ticks):
            time.thread_time.spend(1.0)
            yield


NODES = (Around, Work)
'''
WORK = """\
picktree: 1
kind: mission
name: work
scene: sort_small
goal: sorted >= 0
plugins: [working.py]
trees:
  Main:
    Sequence:
      - Work: {name: Alone, ticks: 3}
      - Parallel:
          - Work: {name: Short, ticks: 2}
          - Work: {name: Long, ticks: 5}
      - Around: {Work: {name: Within, ticks: 2}}
      - CloseGripper: {force: 10 N}
"""
SCHEMA = {
    "type": "object",
    "required": ["$schema", "shared", "profiles"],
    "properties": {
        "$schema": {"const": "https://www.speedscope.app/file-format-schema.json"},
        "name": {"type": "string"},
        "exporter": {"type": "string"},
        "activeProfileIndex": {"type": "integer", "minimum": 0},
        "shared": {
            "type": "object",
            "required": ["frames"],
            "properties": {
                "frames": {
                    "type": "array",
                    "items": {
                        "type": "object",
                        "required": ["name"],
                        "properties": {"name": {"type": "string"}, "file": {"type": "string"}},
                        "additionalProperties": False,
                    },
                }
            },
        },
        "profiles": {
            "type": "array",
            "minItems": 1,
            "items": {
                "type": "object",
                "required": ["type", "name", "unit", "startValue", "endValue", "events"],
                "properties": {
                    "type": {"const": "evented"},
                    "name": {"type": "string"},
                    "unit": {"const": "seconds"},
                    "startValue": {"type": "number"},
                    "endValue": {"type": "number"},
                    "events": {
                        "type": "array",
                        "items": {
                            "type": "object",
                            "required": ["type", "frame", "at"],
                            "properties": {
                                "type": {"enum": ["O", "C"]},
                                "frame": {"type": "integer", "minimum": 0},
                                "at": {"type": "number", "minimum": 0},
                            },
                            "additionalProperties": False,
                        },
                    },
                },
                "additionalProperties": False,
            },
        },
    },
    "additionalProperties": False,
}
"""What speedscope's src/lib/file-format-spec.ts demands of evented profiles."""


class FakeCpuClock:
    """CPU clock of the main thread that only a test advances, s."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def spend(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def worked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunProfile:
    """Profile of the mission `work`, in which a step of the simulation takes 10 CPU ms."""
    clock = FakeCpuClock()
    monkeypatch.setattr("time.thread_time", clock)
    step = KinematicHardware.step

    def dear_step(hardware: KinematicHardware) -> None:
        clock.spend(0.01)
        step(hardware)

    monkeypatch.setattr(KinematicHardware, "step", dear_step)
    (tmp_path / "working.py").write_text(WORKING)
    (tmp_path / "work.yaml").write_text(WORK)
    profiler = Profiler()
    request = RunRequest(tmp_path / "work.yaml", backend="kinematic", out=tmp_path)
    assert Session(request, observers=[profiler]).run().reached
    return profiler.profile


def costs(profile: RunProfile) -> dict[str, NodeCost]:
    return {cost.path.rpartition("/")[2]: cost for cost in profile.nodes()}


def test_time_counts_for_the_node_that_took_it_or_for_which_it_passed(worked: RunProfile) -> None:
    found = costs(worked)
    alone = found["Alone"]
    assert (alone.starts, alone.simulated) == (1, pytest.approx(0.15))
    assert alone.parts["nodes"] == 3.0
    steps = alone.parts["physics"] / 0.01
    assert steps == pytest.approx(36)  # 3 ticks of 12 control periods
    assert alone.cpu == pytest.approx(3.36)
    assert found["Within"].parts["nodes"] == pytest.approx(2.0)
    assert found["Around"].parts["nodes"] == pytest.approx(2.0 + 3 * 1.5)  # ends with the third tick
    assert found["Main"].parts["nodes"] == pytest.approx(10.0 + 6.5)
    assert found["Main"].cpu == pytest.approx(sum(worked.cpu_parts.values()))
    assert found["Main"].simulated == pytest.approx(worked.simulated[0].end)


def test_of_leaves_at_once_the_first_pays_for_physics_and_each_has_its_simulated_time(
    worked: RunProfile,
) -> None:
    short, long, both = (costs(worked)[name] for name in ("Short", "Long", "Parallel"))
    assert [each.parts["nodes"] for each in (short, long, both)] == pytest.approx([2.0, 5.0, 7.0])
    assert short.parts["physics"] == pytest.approx(2 * 0.12)
    assert long.parts["physics"] == pytest.approx(3 * 0.12)
    assert [round(each.simulated, 6) for each in (short, long, both)] == [0.10, 0.25, 0.25]
    beside = {
        tuple(worked.frames[frame].name for frame in stack): round(seconds, 6)
        for stack, seconds in worked.simulated[1].totals.items()
        if stack
    }
    assert beside == {("Main", "Sequence", "Parallel", "Long", "rest"): 0.10}


def test_simulated_time_is_told_apart_by_what_the_robot_does(worked: RunProfile) -> None:
    closing = costs(worked)["CloseGripper"].simulated
    assert closing > 0.1
    assert worked.simulated_parts == {"rest": pytest.approx(0.5), "gripper": pytest.approx(closing)}


def profiled(out: Path, backend: Backend) -> tuple[str, Session, RunProfile]:
    profiler = Profiler()
    session = Session(RunRequest(MISSION, backend=backend, out=out), observers=[profiler])
    return session.run().digest, session, profiler.profile


@pytest.mark.parametrize("backend", ["kinematic", "physics"])
def test_a_run_is_the_same_with_and_without_a_profile(backend: Backend, tmp_path: Path) -> None:
    digest, session, profile = profiled(tmp_path, backend)
    assert Session(RunRequest(MISSION, backend=backend, out=tmp_path)).run().digest == digest
    world, hardware = session.execution.world, session.execution.hardware
    assert session.execution.stopwatch.follower is None
    assert not any("step" in vars(each) for each in (hardware, *session.execution.tree.nodes))
    assert not any("charge" in vars(each) for each in (world.plan, world.thinking))
    assert "close" not in vars(world.gripper)
    assert {"physics", "control", "planning", "perception", "rendering", "recording", "nodes"} < set(
        profile.cpu_parts
    )
    assert {"arm: Track", "gripper", "perception", "rest"} <= set(profile.simulated_parts)
    with RunLog(session.folder / "log.mcap") as log:
        ticks = [at.record for at in log.ticks()]
    starts = Counter(t.path for tick in ticks for t in tick.transitions if t.status == "RUNNING")
    assert {cost.path: cost.starts for cost in profile.nodes()} == starts


def test_a_resumed_run_is_profiled_from_where_it_goes_on(tmp_path: Path) -> None:
    request = RunRequest(MISSION.with_name("all_items.yaml"), backend="kinematic", out=tmp_path)
    whole = Session(request).run()
    begun = Session(replace(request, limit=3.5)).run()
    profiler = Profiler()
    with Resumption(ResumeRequest(begun.folder, out=tmp_path, limit=DEFAULT_TIME_LIMIT)) as resumption:
        since = resumption.since
        result = resumption.session([profiler]).run()
    assert result.digest == whole.digest
    assert since > 0.0
    profile = profiler.profile
    assert profile.simulated[0].end == pytest.approx(result.sim_seconds - since)
    (main, *_) = profile.nodes()
    assert (main.path, main.starts) == ("Main", 0)  # it has started before
    assert main.simulated == pytest.approx(result.sim_seconds - since)


class Spinning(Observer):
    """Observer with a thread that computes until it has taken 20 CPU ms."""

    def ticked(self, now: float, report: TickReport, items_done: int, items_total: int) -> None:
        if round(now / TICK_LENGTH) == 10:
            self.thread = threading.Thread(target=self._spin, name="spinner")
            self.thread.start()
            self.done.wait()
        elif round(now / TICK_LENGTH) == 60:
            self.stop.set()
            self.thread.join()

    def __init__(self) -> None:
        self.done, self.stop = threading.Event(), threading.Event()

    def _spin(self) -> None:
        while time.thread_time() < 0.02:
            pass
        self.done.set()
        self.stop.wait()


def test_another_thread_has_a_time_line_of_its_own_nested_by_what_ran(tmp_path: Path) -> None:
    profiler = Profiler()
    request = RunRequest(MISSION, backend="kinematic", out=tmp_path)
    Session(request, observers=[profiler, Spinning()]).run()
    profile = profiler.profile
    (line,) = (each for each in profile.threads if each.name == "thread spinner")
    names = [[profile.frames[frame].name for frame in stack] for stack in line.totals]
    assert all(stack[0] == "Main" and stack[-1] == "thread spinner" for stack in names)
    assert line.end == pytest.approx(sum(line.totals.values()))
    assert "\n  thread spinner " in profile.to_text()


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], RunProfile]:
    """Content of a speedscope file, and the profile from which it was written."""
    folder = tmp_path_factory.mktemp("profile")
    _, _, profile = profiled(folder, "kinematic")
    profile.write(folder / "run.json")
    return json.loads((folder / "run.json").read_text()), profile


def durations(profile: dict[str, Any]) -> Iterator[tuple[tuple[int, ...], float]]:
    """Each stack of an evented profile with the time until the next event; the profile must be balanced."""
    stack: list[int] = []
    at = profile["startValue"]
    for event in profile["events"]:
        assert event["at"] >= at
        yield tuple(stack), event["at"] - at
        at = event["at"]
        if event["type"] == "O":
            stack.append(event["frame"])
        else:
            assert stack.pop() == event["frame"]
    assert not stack
    assert profile["endValue"] >= at


def test_the_file_is_one_of_speedscope(written: tuple[dict[str, Any], RunProfile]) -> None:
    content, profile = written
    jsonschema.validate(content, SCHEMA)
    names = [each["name"] for each in content["profiles"]]
    assert names[0] == "CPU time, main thread"
    assert names[-1] == "simulated time"
    lines = [*profile.threads, *profile.simulated]
    for each, line in zip(content["profiles"], lines, strict=True):
        found: Counter[tuple[int, ...]] = Counter()
        for stack, seconds in durations(each):
            found[stack] += seconds  # type: ignore[assignment]
        assert {stack for stack in found if stack} >= {s for s, total in line.totals.items() if total > 1e-6}
        for stack, total in line.totals.items():
            assert found[stack] == pytest.approx(total, abs=1e-4)


def test_frames_are_nested_as_the_tree_is(written: tuple[dict[str, Any], RunProfile]) -> None:
    content, _ = written
    frames = content["shared"]["frames"]
    nested = 0
    for profile in content["profiles"]:
        for stack, _ in durations(profile):
            paths = [frames[frame].get("file", "") for frame in stack]
            nodes = [path for path in paths if path]
            assert paths[: len(nodes)] == nodes  # parts are within nodes, never around them
            assert [path.count("/") for path in nodes] == list(range(len(nodes)))
            assert all(below.startswith(f"{above}/") for above, below in pairwise(nodes))
            nested = max(nested, len(nodes))
    assert nested >= 5


def test_the_command_prints_tables_and_writes_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "run.speedscope.json"
    line = ["run", str(MISSION), "--backend", "kinematic", "--out", str(tmp_path / "runs")]
    assert answer([*line, "--json", "--profile", str(file)]) == 0
    shown = capsys.readouterr().err
    jsonschema.validate(json.loads(file.read_text()), SCHEMA)
    text = shown[shown.index("profile     one item, seed 0\nCPU time") :]
    assert "\n  start of the program " in text
    assert "\n  physics " in text
    assert "s, by what the robot does\n  arm: Track " in text
    rows = [each.split() for each in text.splitlines()]
    header = next(row for row in rows if row[:2] == ["node", "starts"])
    assert {"physics", "planning", "recording", "other"} <= set(header)
    main = next(row for row in rows if row[0] == "Main")
    assert main[1] == "1"


@pytest.mark.parametrize(
    ("file", "reason"),
    [("gone/run.json", "there is no folder {}/gone"), (".", "it is a folder")],
)
def test_a_file_that_cannot_be_written_is_refused_before_the_run(
    file: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["run", str(MISSION), "--out", str(tmp_path / "runs"), "--profile", str(tmp_path / file)]
    assert answer(line) == 2
    expected = f"{tmp_path / file}: the profile cannot be written: {reason.format(tmp_path)}\n"
    assert capsys.readouterr().err == expected
    assert not (tmp_path / "runs").exists()
