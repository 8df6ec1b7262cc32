"""Profile of a run: where its time goes, and that the run does not notice."""

from __future__ import annotations

import pstats
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from picktree.apps.cli import answer
from picktree.logs import RunLog
from picktree.session import Profiler, ResumeRequest, Resumption, RunRequest, Session
from picktree.session.profiler import NodeCost
from picktree.session.run_recipe import DEFAULT_TIME_LIMIT
from picktree.simulation import Backend

MISSION = Path(__file__).parents[1] / "golden" / "one_item.yaml"
PARALLEL = """\
picktree: 1
kind: mission
name: work
scene: sort_small
goal: sorted >= 0
trees:
  Main:
    Sequence:
      - Parallel:
          - Sleep: {name: Short, msec: 100 ms}
          - Sleep: {name: Long, msec: 250 ms}
      - CloseGripper: {force: 10 N}
"""


def profiled(mission: Path, out: Path, backend: Backend = "kinematic") -> tuple[str, Session, Profiler]:
    profiler = Profiler()
    session = Session(RunRequest(mission, backend=backend, out=out), observers=[profiler])
    return session.run().digest, session, profiler


def test_simulated_time_passes_for_each_running_node(tmp_path: Path) -> None:
    (tmp_path / "work.yaml").write_text(PARALLEL)
    _, session, profiler = profiled(tmp_path / "work.yaml", tmp_path)
    costs = {path.rpartition("/")[2]: cost for path, cost in profiler.nodes.items()}
    short, long, both, main = (costs[name] for name in ("Short", "Long", "Parallel", "Main"))
    assert [round(each.simulated, 6) for each in (short, long, both)] == [0.10, 0.25, 0.25]
    assert main.simulated == pytest.approx(session.execution.world.clock.now)
    assert profiler.activities == {"rest": pytest.approx(main.simulated)}
    assert [each.starts for each in (short, long, both, main)] == [1, 1, 1, 1]
    assert main.wall > both.wall > short.wall > 0.0


@pytest.mark.parametrize("backend", ["kinematic", "physics"])
def test_a_run_is_the_same_with_and_without_a_profile(backend: Backend, tmp_path: Path) -> None:
    digest, session, profiler = profiled(MISSION, tmp_path, backend)
    assert Session(RunRequest(MISSION, backend=backend, out=tmp_path)).run().digest == digest
    assert {"physics", "control", "planning", "perception", "rendering", "recording", "nodes"} < set(
        profiler.parts
    )
    assert {"arm: Track", "rest"} <= set(profiler.activities)
    with RunLog(session.folder / "log.mcap") as log:
        ticks = [at.record for at in log.ticks()]
    starts = Counter(t.path for tick in ticks for t in tick.edges if t.starts)
    assert {path: cost.starts for path, cost in profiler.nodes.items() if cost.starts} == starts


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
    main: NodeCost = profiler.nodes["Main"]
    assert main.starts == 0  # it has started before
    assert main.simulated == pytest.approx(result.sim_seconds - since)
    assert sum(profiler.activities.values()) == pytest.approx(result.sim_seconds - since)


def test_the_command_prints_tables_and_writes_the_functions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "run.prof"
    line = ["run", str(MISSION), "--backend", "kinematic", "--out", str(tmp_path / "runs")]
    assert answer([*line, "--json", "--profile", str(file)]) == 0
    shown = capsys.readouterr().err
    functions = {name for _, _, name in pstats.Stats(str(file)).stats}  # type: ignore[attr-defined]
    assert {"pass_time", "step_tick"} <= functions
    text = shown[shown.index("profile     one item, seed 0\nwall time") :]
    assert "\n  physics " in text
    assert "s, by the arm's controller\n  arm: Track " in text
    rows = [each.split() for each in text.splitlines()]
    assert ["node", "starts", "simulated", "s", "ticks", "s"] in rows
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
