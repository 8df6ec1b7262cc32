"""Speed: CPU time of commands and runs, beside a reference that is measured in the same moments.

The second table has the CPU seconds of the runs by part of the work.

    python benchmarks/speed.py --runs 5                          # make bench
    python benchmarks/speed.py --only "sort_by_colour,check" --against ../before
    python benchmarks/speed.py --only "sort_by_colour,sort_past_obstacles" --cores 2 --runs 3

Each round measures the reference before and after each command: a fixed computation of pybullet and Python
without picktree. The ratio to it says more than seconds, which vary with machine and load. `--against`
measures another checkout in alternation, which has an environment of its own in .venv; the last columns are
the ratios to it. Rounds of a clean checkout are kept by commit.

`--cores N` measures the ticks of runs instead, on one core, on two, and so on up to N: each run once by the
wall clock and once by the CPU time of the thread that ticks, which other programs hardly change.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from _campaign import REFERENCE_COST, ROOT, Row, campaign, finished, options, reference, seeds
from picktree.logs import RunLog
from picktree.session.environment import revision

PARTS = ("physics", "control", "planning", "perception", "rendering", "tree", "logging", "rest")
"""Parts of a run's CPU time; `rest` is its start and end, and what no other part counts."""
BY_PART = """
import json, sys, time
time.perf_counter = time.thread_time  # before any module takes the clock
from picktree import __main__
from picktree.session import Session

def run(session):
    result = real(session)
    print(json.dumps(session.timer.stopwatch.seconds()), file=sys.stderr)
    return result

real, Session.run = Session.run, run
__main__.main()
"""
"""Program that runs `picktree`, and writes the CPU time of a run by part as its last line on stderr, s."""


@dataclass(frozen=True)
class Measured:
    """A command whose CPU time is measured, in a process of its own."""

    name: str
    words: tuple[str, ...]
    """Words of the command; {seed}, {out} and {log}, the log of the round's first run, are replaced."""
    cost: float
    """Its CPU time for the forecast, s."""

    @property
    def runs(self) -> bool:
        """Whether it is a run with a result."""
        return self.words[0] == "run"


def _run(name: str, mission: str, cost: float, *words: str) -> Measured:
    line = ("run", f"examples/{mission}.yaml", "--seed", "{seed}", "--out", "{out}", "--json", *words)
    return Measured(name, line, cost)


BY_WALL = BY_PART.replace("time.perf_counter = time.thread_time", "pass")
"""As BY_PART, by the wall clock."""
LONG_TICK = 0.02
"""Time of a tick from which it counts as long, s."""


MEASURED = (
    _run("sort_by_colour", "sort_by_colour", 7.5, "--scene", "three_bins"),
    _run("dense", "sort_by_colour", 11.0, "--scene", "dense"),
    _run("kinematic", "sort_by_colour", 6.0, "--scene", "three_bins", "--backend", "kinematic"),
    _run("sort_tirelessly", "sort_tirelessly", 12.0),
    _run("sort_past_obstacles", "sort_past_obstacles", 12.0),
    _run("continuous_sort", "continuous_sort", 12.0, "--limit", "90 s"),
    _run("first tick", "one_pick", 3.0, "--limit", "50 ms"),
    Measured("help", ("--help",), 0.3),
    Measured("check", ("check", "examples/one_pick.yaml"), 1.5),
    Measured("explain", ("explain", "{log}"), 1.7),
    Measured("report", ("report", "{log}", "-o", "{out}/report.html"), 3.0),
    Measured("export", ("export", "{log}", "--to", "csv", "-o", "{out}/tables"), 3.0),
)


@dataclass(frozen=True)
class Round:
    """One measurement of each command."""

    seed: int
    names: tuple[str, ...]
    against: str | None
    """Another checkout; None: there is none."""
    state: str
    """Commit; of a checkout with changes, or with another one beside it, the time of the measurement, too."""


@dataclass(frozen=True)
class TickRound:
    """One measurement of the ticks of each run, on that number of cores."""

    seed: int
    names: tuple[str, ...]
    cores: int
    state: str
    """As of a `Round`."""


def measure(command: Measured, checkout: Path, values: Mapping[str, object], program: str = BY_PART) -> Row:
    """Run a command of a checkout once: its CPU time, and for a run what its result says.

    Raises RuntimeError for a command that was not carried out.
    """
    words = [word.format(**values) for word in command.words]
    python = sys.executable if checkout == ROOT else str(checkout / ".venv" / "bin" / "python")
    before = os.times()
    done = subprocess.run(
        [python, *(("-c", program) if command.runs else ("-m", "picktree")), *words],
        cwd=checkout,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONHASHSEED": "0"},
    )
    after = os.times()
    if done.returncode not in (0, 1):
        raise RuntimeError(f"picktree {' '.join(words)}: exit code {done.returncode}\n{done.stderr}")
    used = after.children_user + after.children_system - before.children_user - before.children_system
    if not command.runs:
        return {"cpu": used}
    result = json.loads(done.stdout)
    parts = json.loads(done.stderr.splitlines()[-1])
    known = {part: parts.get(part, 0.0) for part in PARTS[:-1]}
    return {
        "cpu": used,
        "parts": known | {"rest": used - sum(known.values())},
        "log": result["log"],
        "simulated": result["sim_seconds"],
        "run_cpu": result["cpu_seconds"],
        "wall": result["wall_seconds"]["total"],
    }


def ticks(job: TickRound, out: Path) -> Row:
    """Measure the ticks of each run by both clocks, on the first cores that this process may use."""
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: job.cores])
    measured: dict[str, Row] = {}
    with TemporaryDirectory(prefix="ticks-") as folder:
        for command in (command for command in MEASURED if command.name in job.names):
            measured[command.name] = {}
            for clock, program in (("wall", BY_WALL), ("cpu", BY_PART)):
                values = {"seed": job.seed, "out": f"{folder}/{clock}", "log": ""}
                row = measure(command, ROOT, values, program)
                with closing(RunLog(row["log"])) as log:
                    times = [at.record.total for at in log.timings()]
                measured[command.name][clock] = {"wall": row["wall"], "ticks": times}
    return {"measured": measured}


def tick_table(rows: Sequence[Row], names: Sequence[str]) -> str:
    """Return the table of ticks in Markdown: medians over the rounds on each number of cores."""
    head = [
        "",
        "cores",
        "wall s",
        *(f"{what}, {clock}" for clock in CLOCKS.values() for what in TICK_FIGURES),
    ]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for name in names:
        for cores in sorted({row["job"]["cores"] for row in rows}):
            each: list[Row] = [row["measured"][name] for row in rows if row["job"]["cores"] == cores]
            cells = [name, str(cores), f"{median(row['wall']['wall'] for row in each):.1f}"]
            for clock in CLOCKS:
                times = [row[clock]["ticks"] for row in each]
                count, long = (
                    median(map(len, times)),
                    median(sum(t > LONG_TICK for t in run) for run in times),
                )
                cells.append(f"{long:.0f} of {count:.0f}")
                cells.append(f"{1000 * median(map(max, times)):.0f}")
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


CLOCKS = {"wall": "wall", "cpu": "CPU"}
TICK_FIGURES = (f"ticks above {1000 * LONG_TICK:.0f} ms", "longest, ms")


def one(job: Round, out: Path) -> Row:
    """Measure each command once, here and in the other checkout in turn."""
    checkouts = {"here": ROOT, **({"there": Path(job.against).absolute()} if job.against else {})}
    logs = dict.fromkeys(checkouts, "")
    measured: dict[str, Row] = {}
    with TemporaryDirectory(prefix="speed-") as folder:
        for checkout in checkouts:
            Path(folder, checkout).mkdir()
        before = reference()
        for command in (command for command in MEASURED if command.name in job.names):
            row: Row = {}
            for checkout, path in checkouts.items():
                values = {"seed": job.seed, "out": f"{folder}/{checkout}", "log": logs[checkout]}
                row[checkout] = measure(command, path, values)
                logs[checkout] = logs[checkout] or row[checkout].get("log", "")
            after = reference()
            measured[command.name] = {**row, "reference": (before + after) / 2}
            before = after
    return {"measured": measured}


def table(rows: Sequence[Row], names: Sequence[str], *, against: bool) -> str:
    """Return the table in Markdown: medians of all rounds, and medians of the ratios in each round.

    Ratios to the other checkout are of the CPU time, then of the simulated time.
    """
    head = ["", "CPU s", "range", "× reference", "simulated s", "simulated s a CPU s"]
    head += ["CPU × other", "simulated × other"] if against else []
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for name in names:
        each: list[Row] = [row["measured"][name] for row in rows]
        cpu = [row["here"]["cpu"] for row in each]
        cells = [
            name,
            f"{median(cpu):.2f}",
            f"{min(cpu):.2f} … {max(cpu):.2f}",
            f"{median(row['here']['cpu'] / row['reference'] for row in each):.2f}",
        ]
        runs = [row for row in each if "simulated" in row["here"]]
        speeds = [row["here"]["simulated"] / row["here"]["run_cpu"] for row in runs]
        cells.append(f"{median(row['here']['simulated'] for row in runs):.2f}" if runs else "")
        cells.append(f"{median(speeds):.1f}" if runs else "")
        if against:
            cells.append(_ratio(each, "cpu"))
            cells.append(_ratio(runs, "simulated") if runs else "")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def parts_table(rows: Sequence[Row], names: Sequence[str]) -> str:
    """Return the CPU seconds of the runs by part in Markdown, medians of all rounds; empty without runs."""
    lines = ["| CPU s | " + " | ".join(PARTS) + " |", "|---" * (1 + len(PARTS)) + "|"]
    for name in names:
        parts = [row["measured"][name]["here"].get("parts") for row in rows]
        if all(parts):
            cells = (f"{median(each[part] for each in parts):.2f}" for part in PARTS)
            lines.append("| " + " | ".join((name, *cells)) + " |")
    return "\n".join(lines) if len(lines) > 2 else ""


def _ratio(rows: Sequence[Row], figure: str) -> str:
    """Return the median ratio of a figure here to that in the other checkout."""
    return f"{median(row['here'][figure] / row['there'][figure] for row in rows):.3f}"


def needed(only: Sequence[str]) -> tuple[str, ...]:
    """Return the commands to be measured, in order. The first run is among them where others read its log.

    Raises ValueError for an unknown name.
    """
    known = [command.name for command in MEASURED]
    if unknown := [name for name in only if name not in known]:
        raise ValueError(f"there is no {', '.join(unknown)}; known: {', '.join(known)}")
    chosen = {name for name in known if name in only} or set(known)
    if any("{log}" in command.words for command in MEASURED if command.name in chosen):
        chosen.add(known[0])
    return tuple(name for name in known if name in chosen)


def main() -> int:
    parser = options(__file__, __doc__, runs=5, what="rounds; round N has seed N")
    parser.add_argument("--only", default="", metavar="NAMES", help="these commands, with commas between")
    parser.add_argument("--against", metavar="CHECKOUT", help="another checkout to compare with")
    parser.add_argument("--cores", type=int, metavar="N", help="measure ticks on 1 … N cores instead")
    parser.set_defaults(workers=1)
    given = parser.parse_args()
    try:
        names = needed([name.strip() for name in given.only.split(",") if name.strip()])
    except ValueError as error:
        parser.error(str(error))
    state = revision() or "installed"
    kept = "dirty" not in state and not given.against
    if given.cores:
        return _main_of_ticks(given, names, state if kept else f"{state} {time.time():.0f}")
    rounds = [
        Round(seed, names, given.against, state if kept else f"{state} {time.time():.0f}")
        for seed in seeds(given)
    ]
    times = 2 if given.against else 1
    cost = sum(REFERENCE_COST + times * command.cost for command in MEASURED if command.name in names)
    rows = finished(campaign(given, rounds, one, cost=cost, short=lambda row: f"{cpu_of(row):.0f} CPU s"))
    text = f"{table(rows, names, against=given.against is not None)}\n\n{parts_table(rows, names)}"
    print(f"{state}, {len(rows)} rounds\n\n{text}")
    (given.out / f"{state}.md").write_text(f"{text}\n", encoding="utf-8")
    return 0


def _main_of_ticks(given: argparse.Namespace, names: Sequence[str], state: str) -> int:
    """Measure the ticks of the named runs on 1 … N cores, and print their table."""
    runs = tuple(command.name for command in MEASURED if command.name in names and command.runs)
    rounds = [TickRound(seed, runs, n + 1, state) for seed in seeds(given) for n in range(given.cores)]
    cost = 2 * sum(command.cost for command in MEASURED if command.name in runs)
    rows = finished(
        campaign(given, rounds, ticks, cost=cost, short=lambda row: f"{len(row['measured'])} runs")
    )
    text = tick_table(rows, runs)
    print(f"{state}, {given.runs} rounds\n\n{text}")
    (given.out / f"{state}-ticks.md").write_text(f"{text}\n", encoding="utf-8")
    return 0


def cpu_of(row: Row) -> float:
    """Return the CPU time of a round, s."""
    return sum(
        each["reference"] + sum(each[checkout]["cpu"] for checkout in ("here", "there") if checkout in each)
        for each in row["measured"].values()
    )


if __name__ == "__main__":
    sys.exit(main())
