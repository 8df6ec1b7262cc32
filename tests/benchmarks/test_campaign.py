"""Campaigns: what is run again and what is not, across kills, changed sources and limits."""

from __future__ import annotations

import fcntl
import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from picktree.apps.batch.executor import Event, JobFailed, JobFinished, JobOrder

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
PROGRAM = """
import os, sys, time
from dataclasses import dataclass
from pathlib import Path
sys.path.insert(0, {benchmarks!r})
from _campaign import campaign, options, seeds

@dataclass(frozen=True)
class Job:
    seed: int
    size: tuple[int, ...]

def one(job, folder):
    (Path({place!r}) / f"ran-{{job.seed}}-{{time.time_ns()}}").touch()
    if (Path({place!r}) / "slow").exists() and len([*Path({place!r}).glob("ran-*")]) > 2:
        time.sleep(60)
    if (Path({place!r}) / "broken").exists() and job.seed == 1:
        raise ValueError("no good")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "log.txt").write_text(f"log of {{job.seed}}")
    return {{"square": job.seed ** 2}}

def main(words=None):
    given = options(__file__, "Squares.", runs=2).parse_args(words)
    jobs = [Job(seed, (1, 2)) for seed in seeds(given)]
    rows = campaign(given, jobs, one, cost=0.1, short=lambda row: row["square"])
    print([row.get("crash") or row["square"] for row in rows])

if __name__ == "__main__":
    main()
"""


class InThisProcess:
    """Executor without workers: an order is carried out when it is submitted."""

    slots = 1

    def __init__(self, attempt: Callable[[JobOrder], bytes]) -> None:
        self._attempt = attempt
        self._events: list[Event] = []

    def submit(self, order: JobOrder) -> None:
        try:
            content = self._attempt(order)
        except ValueError as error:
            self._events.append(JobFailed(order, f"ValueError: {error}"))
            return
        order.result.write_bytes(content)
        self._events.append(JobFinished(order))

    def wait(self, seconds: float) -> Sequence[Event]:
        events, self._events = self._events, []
        return events

    def stop(self) -> None: ...

    def close(self) -> None: ...


class Squares:
    """Campaign of a program in a folder of its own, with the workers that a test chooses."""

    def __init__(
        self, place: Path, campaign: ModuleType, monkeypatch: pytest.MonkeyPatch, capture: Any
    ) -> None:
        self.place, self.out = place, place / "results"
        self._program = place / "squares.py"
        self._program.write_text(PROGRAM.format(benchmarks=str(BENCHMARKS), place=str(place)))
        self._capture = capture
        monkeypatch.setattr(campaign, "executor", lambda given: InThisProcess(campaign.attempt))
        monkeypatch.setattr(sys, "path", [*sys.path])
        spec = importlib.util.spec_from_file_location("squares", self._program)
        assert spec is not None and spec.loader is not None
        self._module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "squares", self._module)
        monkeypatch.setitem(sys.modules, "_campaign", campaign)
        spec.loader.exec_module(self._module)

    def run(self, *words: str) -> tuple[str, str]:
        """Run in this process, and return what is written to stdout and stderr."""
        try:
            self._module.main(["--out", str(self.out), "--workers", "1", *words])
        except SystemExit as end:
            print(end.code, file=sys.stderr)
        out, err = self._capture.readouterr()
        return out, err

    def command(self, *words: str) -> list[str]:
        """Return the command line that runs it with workers."""
        return [sys.executable, str(self._program), "--workers", "1", "--out", str(self.out), *words]

    def runs(self) -> int:
        """Number of runs until now."""
        return len(list(self.place.glob("ran-*")))

    def lines(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in (self.out / "results.jsonl").read_text().splitlines()]

    def change(self) -> None:
        """Make the program another one."""
        self._program.write_text(self._program.read_text() + "ANOTHER = 1\n")


@pytest.fixture
def squares(
    tmp_path: Path,
    program: Callable[[str], ModuleType],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Squares:
    return Squares(tmp_path, program("_campaign"), monkeypatch, capsys)


def test_a_worker_with_another_checkout_refuses_to_run(
    squares: Squares, program: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = program("_campaign")

    def elsewhere(order: JobOrder) -> bytes:
        squares.change()
        return campaign.attempt(order)

    monkeypatch.setattr(campaign, "executor", lambda given: InThisProcess(elsewhere))
    _, err = squares.run("--runs", "1")
    assert "the checkout of this machine is another" in err
    assert squares.runs() == 0


def test_a_checkout_that_is_edited_stops_the_campaign_and_loses_no_run(
    squares: Squares, program: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = program("_campaign")

    def edited(order: JobOrder) -> bytes:
        content: bytes = campaign.attempt(order)
        squares.change()
        return content

    monkeypatch.setattr(campaign, "executor", lambda given: InThisProcess(edited))
    out, err = squares.run("--runs", "3")
    assert out.endswith("[0]\n") and "1 of 3 runs have a result" in out
    assert "the checkout is being edited: no further run begins\nit was stopped" in err
    assert [line["row"] for line in squares.lines()] == [{"seed": 0, "square": 0}]


def test_finished_runs_are_not_run_again_and_more_may_be_asked_for(squares: Squares) -> None:
    out, err = squares.run("--runs", "2")
    assert out == "[0, 1]\n"
    assert "2 of 2 runs to do, about 0.0 CPU minutes" in err
    out, err = squares.run("--runs", "3")
    assert out == "[0, 1, 4]\n"
    assert "1 of 3 runs to do" in err
    assert squares.runs() == 3
    assert [line["job"] for line in squares.lines()] == [{"seed": n, "size": [1, 2]} for n in range(3)]
    assert all(line["commit"] and line["code"] for line in squares.lines())
    assert sorted(file.read_text() for file in squares.out.glob("logs/*/log.txt")) == [
        f"log of {n}" for n in range(3)
    ]


def test_a_killed_campaign_goes_on_and_a_cut_line_costs_its_run_alone(squares: Squares) -> None:
    (squares.place / "slow").touch()
    process = subprocess.Popen(squares.command("--runs", "3"), stderr=subprocess.DEVNULL)
    while squares.runs() < 3:
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert len(squares.lines()) == 2
    results = squares.out / "results.jsonl"
    os.truncate(results, results.stat().st_size - 7)
    (squares.place / "slow").unlink()
    out, err = squares.run("--runs", "3")
    assert "2 of 3 runs to do" in err
    assert out == "[0, 1, 4]\n"
    _, err = squares.run("--runs", "3")
    assert "to do" not in err or "0 of 3 runs to do" in err  # what was written after the cut line can be read


def test_results_of_other_sources_are_run_again_or_counted_when_asked(squares: Squares) -> None:
    squares.run("--runs", "1")
    commit = squares.lines()[0]["commit"]
    squares.change()
    _, err = squares.run("--runs", "1", "--mixed")
    assert "0 of 1 runs to do" in err
    assert squares.runs() == 1
    _, err = squares.run("--runs", "1")
    assert f"results of other sources are not counted (1 of {commit}); --mixed counts them" in err
    assert squares.runs() == 2


def test_a_run_that_raises_is_a_result_and_is_tried_again(squares: Squares) -> None:
    (squares.place / "broken").touch()
    assert squares.run("--runs", "3")[0] == "[0, 'ValueError: no good', 4]\n"
    (squares.place / "broken").unlink()
    assert squares.run("--runs", "3")[0] == "[0, 1, 4]\n"
    assert squares.runs() == 4


def test_no_run_begins_after_the_limit_of_time(squares: Squares) -> None:
    out, err = squares.run("--minutes", "0")
    assert out == ""
    assert err.endswith("it was stopped: the same command goes on\nthere is no result yet\n")
    assert squares.runs() == 0


def test_the_forecast_is_that_of_recorded_runs_at_the_speed_of_this_machine(
    squares: Squares, program: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(program("_campaign"), "reference", lambda: 0.5)
    squares.run("--runs", "1")
    (squares.out / "results.jsonl").write_text(json.dumps(squares.lines()[0] | {"cpu": 60.0}) + "\n")
    monkeypatch.setattr(program("_campaign"), "reference", lambda: 1.0)  # half as fast
    _, err = squares.run("--runs", "4", "--minutes", "0")
    assert "3 of 4 runs to do, about 6.0 CPU minutes, 6.0 minutes on 1 workers" in err


def test_a_campaign_that_was_cut_off_says_so_before_its_result(squares: Squares) -> None:
    squares.run("--runs", "2")
    assert (
        squares.run("--runs", "3", "--minutes", "0")[0] == "Cut off: 2 of 3 runs have a result.\n\n[0, 1]\n"
    )


def test_two_campaigns_do_not_share_a_folder(squares: Squares) -> None:
    squares.out.mkdir()
    with (squares.out / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert squares.run()[1].endswith("results: another process runs this campaign\n")


@pytest.mark.parametrize(("option", "address"), [("local", None), ("10.0.0.1:6379", "10.0.0.1:6379")])
def test_a_campaign_takes_the_ray_cluster_of_its_option(
    program: Callable[[str], ModuleType],
    monkeypatch: pytest.MonkeyPatch,
    option: str,
    address: str | None,
) -> None:
    """`tests/batch/test_ray.py` runs one on a cluster."""
    monkeypatch.setattr("picktree.apps.batch.RayExecutor", lambda *given: given)
    given = program("_campaign").options(__file__, "", runs=1).parse_args(["--ray", option, "--workers", "3"])
    assert program("_campaign").executor(given) == (3, address)
