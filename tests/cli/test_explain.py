"""`picktree explain`: text for a reader, JSON for a program, exit codes."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from picktree.apps.cli import answer
from picktree.logs.log_records import RunInfo
from picktree.logs.recording import Recorder
from picktree.session import RunRequest, Session
from picktree.world import NodeState, OtherEvent, Tick, Transition, Tree, TreeNode

EXAMPLES = Path(__file__).parents[2] / "examples"
FAULTS = """\
picktree: 1
kind: faults
faults:
  - {fault: remove, when: {node: Grasp, start: 2, delay: 500 ms}, target: {nearest_to: object}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run in which the second item is snatched away; do not change it."""
    out = tmp_path_factory.mktemp("runs")
    (out / "faults.yaml").write_text(FAULTS, encoding="utf-8")
    text = (EXAMPLES / "one_pick.yaml").read_text(encoding="utf-8")
    mission = out / "two_picks.yaml"
    mission.write_text(text.replace("most: 1", "most: 2").replace(">= 1", ">= 2"), encoding="utf-8")
    request = RunRequest(mission=mission, seed=3, backend="kinematic", faults=out / "faults.yaml", out=out)
    return Session(request).run().folder


def test_text(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert answer(["explain", str(folder)]) == 0
    text = capfd.readouterr().out
    parts = [part.splitlines() for part in text.split("\n\n")]
    headings = ["failure: ", "Root cause", "Failures (1: 1 ended", "Recovery (1 ep", "Items (4, ", "Look at"]
    assert all(part[0].startswith(heading) for part, heading in zip(parts, headings, strict=True))
    for line in (
        "     [item.gone] Possible. This ended the run (red_ball_1): 1 failure at 7.60 s, 3.2 s lost.",
        "     - a fault was planted: at 4.85 s: item_02 is snatched away",
        "     7.60 s  Grasp of red_ball_1: grasp.missed",
        "             truth: red_ball_1 is nowhere any more",
        "             planted: item_02 is snatched away (2.8 s before)",
        "  grasp.missed     1      0             3.2  nobody",
        "     4.85 s  item_02 is snatched away: grasp.missed 2.8 s later, not handled",
        "  blue_plate_1  done  0.15 s seen; 3.55 s held; 4.30 s placed into blue_bin (truly in blue_bin,",
    ):
        assert line in text.splitlines()
    assert parts[-1][1].startswith(
        "     4.80 s  red_ball_1 was taken away between 4.8 and 5.0 s: the robot's"
    )
    assert re.search(rf"step through it  .* replay {folder} --at 4\.80\n", text)
    assert max(map(len, text.partition("Look at")[0].splitlines())) <= 96


def test_json(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert answer(["explain", str(folder), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert list(found) == ["outcome", "failures", "recovery", "root_causes", "items", "look_at", "with_truth"]
    assert {"status": "failure", "mission": "one pick", "items_sorted": 1, "items_total": 4}.items() <= found[
        "outcome"
    ].items()
    (failure,) = found["failures"]
    assert {"time", "node", "cause", "message", "evidence", "handled_by", "cured"} <= set(failure)
    assert (failure["time"], failure["cause"], failure["cured"]) == (7.6, "grasp.missed", False)
    assert failure["evidence"]["object"] == "red_ball_1"
    assert [cause["cause"] for cause in found["root_causes"]] == ["item.gone"]
    assert [look["time"] for look in found["look_at"]] == [4.8, 7.6]


def test_planted_faults_can_be_hidden(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert answer(["explain", str(folder), "--hide-faults"]) == 0
    hidden = capfd.readouterr().out
    assert "planted" not in hidden
    assert "red_ball_1 was taken away between 4.8 and 5.0 s" in hidden


def test_a_folder_of_runs(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for name in ("a", "b"):
        shutil.copytree(folder, tmp_path / "runs" / name)
    (tmp_path / "runs" / "log.mcap.txt").write_text("no log")
    (tmp_path / "runs" / "c").mkdir()
    (tmp_path / "runs" / "c" / "log.mcap").write_bytes(b"not a log at all, whatever it is called")
    assert answer(["explain", str(tmp_path / "runs")]) == 0
    text = capfd.readouterr().out
    assert text.startswith(f"2 runs in {tmp_path}/runs: 2 failure; ")
    assert "item.gone     2      2      2" in text
    assert re.search(rf"     possible 2; .* explain {tmp_path}/runs/[ab]\n", text)
    assert answer(["explain", str(tmp_path / "runs"), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    (cause,) = found["causes"]
    assert (found["runs"], found["statuses"], len(found["unreadable"])) == (2, {"failure": 2}, 1)
    assert (cause["cause"], cause["runs"], cause["first"], cause["items"]) == ("item.gone", 2, 2, 2)
    assert cause["confidence"] == {"possible": 2}
    assert cause["title"].startswith("red_ball_1 was taken away between 4.8 and 5.0 s")
    assert Path(cause["typical"]).parent == tmp_path / "runs"


def test_a_run_that_was_killed(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    whole = (folder / "log.mcap").read_bytes()
    (tmp_path / "log.mcap").write_bytes(whole[: len(whole) * 9 // 10])
    assert answer(["explain", str(tmp_path), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["outcome"]["status"] == "killed"
    assert "without a result: the process was killed" in found["outcome"]["sentence"]
    assert found["outcome"]["items_total"] is None
    assert len(found["outcome"]["notes"]) == 1
    assert found["root_causes"][0]["cause"] == "run.killed"


def many(path: Path, failures: int) -> Path:
    """A log in which one node fails that often, and a loop passes over each."""
    nodes = Tree((TreeNode("Main", "ForEach", "Main", "", ("Main/Grasp",)),
                  TreeNode("Main/Grasp", "Grasp", "Grasp", "Main")))  # fmt: skip
    status = (NodeState("Main", "ForEach", "RUNNING", True), NodeState("Main/Grasp", "Grasp", "IDLE", True))
    script: Mapping[int, Sequence[Transition]] = {0: [Transition("Main", "RUNNING")]}
    with Recorder(path, RunInfo("made up", "nowhere", "none", 0, "kinematic", 0.05)) as recorder:
        recorder.tree(nodes)
        for k in range(2 * failures + 2):
            cause = ("grasp.missed", "grasp.slipped", "planning.no_path")[k // 2 % 3]
            said = script.get(k) or (
                [Transition("Main/Grasp", "RUNNING", subject=f"red_ball_{k // 2 % 8}")]
                if k % 2
                else [
                    Transition("Main/Grasp", "FAILURE", cause=cause, origin="Main/Grasp", message="no luck")
                ]
            )
            if k and k % 2 == 0:
                recorder.entry(
                    k * 0.05, OtherEvent("passed over", "Main", name="handled", extra={"cause": cause})
                )
            recorder.tick(k * 0.05, Tick("RUNNING", "Main", status, (), tuple(said)))
    return path


def test_three_hundred_failures_are_told_in_groups(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    log = many(tmp_path / "log.mcap", 300)
    assert answer(["explain", str(log)]) == 0
    text = capfd.readouterr().out
    assert "Failures (300: 300 passed over)" in text
    told = text.partition("Failures (")[2].partition("Look at")[0]
    assert told.count("Grasp of red_ball_") == 12
    assert text.count(" more failures of the same kind, at ") == 12
    assert "… 144 more failures of 12 other kinds" in text
    assert "… 17 more root causes with lower costs (--all)" in text
    assert "--all describes each failure separately." in text
    assert len(text.splitlines()) < 150
    assert answer(["explain", str(log), "--all"]) == 0
    whole = capfd.readouterr().out
    assert whole.partition("Failures (")[2].partition("Look at")[0].count("Grasp of red_ball_") == 300


def test_help_comes_fast_and_names_the_command() -> None:
    ran = subprocess.run(
        [sys.executable, "-c", "from picktree.apps.cli import answer; import sys;"
         "answer(['explain', '--help']); assert 'numpy' not in sys.modules"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "Explain the end of a run" in ran.stdout


@pytest.mark.parametrize(
    ("name", "content", "asked", "said"),
    [
        ("other.txt", b"", ".", "{0}: there is no log.mcap in this folder"),
        ("log.mcap", b"not a log at all, whatever it is called", ".", "{0}/log.mcap: "),
        ("other.txt", b"", "no.mcap", "{0}/no.mcap: there is no such log"),
        ("results.sqlite", b"", ".", "`picktree batch report {0}`"),
        ("results.sqlite", b"", ".", "`picktree resim {0}@seed=0`"),
    ],
)
def test_what_is_no_run_is_one_sentence(
    name: str, content: bytes, asked: str, said: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(content)
    assert answer(["explain", str(tmp_path / asked)]) == 2
    out, error = capfd.readouterr()
    assert (out, error.count("\n")) == ("", 1)
    assert said.format(tmp_path) in error
