"""Benchmark of explanations: is the cause that `picktree explain` names first the true one?

    python benchmarks/explanations.py                    # the seeds for development; goes on where it stopped
    python benchmarks/explanations.py --only 'camera*' --runs 2 --minutes 10
    python benchmarks/explanations.py --final            # the seeds that are kept for the end
    python benchmarks/explanations.py --minutes 0        # score what is there, run nothing

The cases and their true causes are in explanations.yaml, written before anything was run. Each run is
explained from a log without the events of its faults, and scored by the root cause that stands first:

- `right`: code and subject are those of the table; of two causes, both are named, the costlier one first.
- `partly`: right code, other subject; a code that is near; one of two causes, or both in the wrong order.
- `does not tell`: no cause is named, or the finding itself says so.
- `wrong`: another cause.

A run in which nothing went wrong counts for none of these. Each stated confidence is held against the rate
that docs/explain.md gives it. Logs are kept: those that other code has explained are explained again, and not
run again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

from _campaign import Row, blind, campaign, explaining, options, rate
from _explanation_cases import Case, counted, load
from picktree.analysis.explain.confidence import LIKELY_RATE
from picktree.analysis.explain.explanation import CONFIDENCES
from picktree.session import sources

COST_A_RUN = 9.0
"""CPU seconds of a run and its two explanations, for the forecast."""
COST_ANEW = 2.0
"""CPU seconds of explaining a log again."""
KILL_SPREAD = 0.3
"""Simulated time between the ends of two seeds of a killed run, s."""
PACE = "3"
"""Simulated seconds a second of a process that is killed or looked at from outside."""
PATIENCE = 300.0
"""Wall time after which such a process is given up, s."""
SEEDS = 5
"""Seeds of a case for development, and as many for the end."""


@dataclass(frozen=True)
class Job:
    """Run of a case, and its explanation."""

    case: str
    seed: int
    table: str
    """Hash of what is run."""
    explains: str
    """Hash of the sources that explain."""


def one(job: Job, folder: Path) -> Row:
    """Run a job unless its log is there, and explain it: the row of the results."""
    case = cases()[job.case]
    place = log_folder(job, folder.parent)
    ran_on = case.ends == "goes_on"
    told = while_running(case, job, place) if ran_on else explained(recorded(case, job, place))
    return {"case": job.case, **told}


@cache
def cases() -> Mapping[str, Case]:
    return {case.name: case for case in load()}


@cache
def _running() -> str:
    return _digest(sources())


def _digest(of: object) -> str:
    return hashlib.sha256(repr(of).encode()).hexdigest()[:12]


def log_folder(job: Job, logs: Path) -> Path:
    """Return the folder of a run's files and log: the same one whatever explains it."""
    return logs / f"{job.case}-{job.seed}-{job.table}-{_running()}"


def recorded(case: Case, job: Job, place: Path) -> Path:
    """Return the folder of the job's run, which is made unless it is there."""
    done = place / "done"
    if done.exists():
        return Path(done.read_text())
    shutil.rmtree(place, ignore_errors=True)
    case.write(place)
    if case.ends:
        command = _command(case, job, place)
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
            if case.ends == "killed":
                _await(case, job, place, process)
                process.kill()
            _, said = process.communicate()
        if process.returncode != -signal.SIGKILL:
            raise RuntimeError(f"it was not killed: exit code {process.returncode}, {said.decode()[-200:]}")
        folder = _run_folder(place)
    else:
        folder = _run(case, job, place)
    done.write_text(str(folder))
    return folder


def _run(case: Case, job: Job, place: Path) -> Path:
    from picktree.session import RunRequest, Session

    faults = place / "faults.yaml"
    request = RunRequest(
        mission=place / "mission.yaml",
        seed=job.seed,
        backend=case.backend,  # pyright: ignore[reportArgumentType]
        faults=faults if faults.exists() else None,
        out=place / "runs",
        limit=case.limit,
    )
    return Session(request).run().folder


def _command(case: Case, job: Job, place: Path) -> list[str]:
    words = [sys.executable, "-m", "picktree", "run", str(place / "mission.yaml")]
    words += ["--seed", str(job.seed), "--backend", case.backend, "--out", str(place / "runs")]
    words += ["--pace", PACE] if case.ends != "kills_itself" else []
    return words + (["--faults", str(place / "faults.yaml")] if case.faults else [])


def _run_folder(place: Path) -> Path:
    return next((place / "runs").glob("*/"))


def _await(case: Case, job: Job, place: Path, process: subprocess.Popen[bytes]) -> Path:
    """Return the run's folder as soon as its log reaches the job's time."""
    from picktree.analysis import Run
    from picktree.files import PicktreeError

    at = case.at + KILL_SPREAD * (job.seed % 10)
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until and process.poll() is None:
        time.sleep(0.5)
        try:
            with Run(_run_folder(place)) as run:
                if run.last_tick >= at:
                    return _run_folder(place)
        except (PicktreeError, OSError, StopIteration):
            continue  # nothing is written yet
    process.kill()
    raise RuntimeError(f"the run did not get to {at:.1f} s as it should: exit code {process.poll()}")


def while_running(case: Case, job: Job, place: Path) -> Row:
    """Explain a run while its process goes on; it is always run anew."""
    shutil.rmtree(place, ignore_errors=True)
    case.write(place)
    command = _command(case, job, place)
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        told = explained(_await(case, job, place, process))
        ended = process.poll()
        process.kill()
    if ended is not None:
        raise RuntimeError(f"the run had ended when it was explained, with exit code {ended}")
    return told


def explained(folder: Path) -> Row:
    """Return what `picktree explain --json` says of a run, from a log that holds no event of a fault.

    `quoted` counts the root causes that quote a fault when the log holds it.
    """
    from picktree.analysis import Run
    from picktree.analysis.explain import explain, to_json_text

    with blind(folder) as run:
        told = json.loads(to_json_text(run, explain(run, faults=False)))
    with Run(folder) as run:
        shown = explain(run)
        struck = _struck(run)
    keys = ("cause", "title", "item", "ended_run", "reasons")
    return {
        "status": told["outcome"]["status"],
        "failures": len(told["failures"]),
        "struck": struck,
        "causes": [
            {key: each[key] for key in keys} | {"confidence": each.get("confidence", "")}
            for each in told["root_causes"]
        ],
        "quoted": sum(bool(each.planted) for each in shown.root_causes),
        "log": str(folder),
    }


def _struck(run: object) -> list[dict[str, str]]:
    """Return the true items that faults struck: id, kind, colour."""
    from picktree.analysis import Run
    from picktree.world.event_types import FaultEvent

    assert isinstance(run, Run)
    ids = {at.record.item for at in run.events if isinstance(at.record, FaultEvent) and at.record.item}
    bodies = {body.id: body for at in run.log.truths() for body in at.record.bodies if body.id in ids}
    return [{"id": id_, "kind": body.kind, "colour": body.colour} for id_, body in bodies.items()]


def wanted(given: argparse.Namespace) -> list[Job]:
    """Return the jobs, one seed of all cases after the other."""
    chosen = [case for case in cases().values() if not given.only or _chosen(case.name, given.only)]
    offset, explains = int(given.final), explaining()
    return [
        Job(case.name, case.seeds + 2 * n + offset, _digest(case.inputs), explains)
        for n in range(given.first, given.first + given.runs)
        for case in chosen
    ]


def _chosen(name: str, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def judged(row: Row, table: Mapping[str, Case]) -> Row:
    """Return the row with its verdict."""
    case = table[row["job"]["case"]]
    reason = (case.corrected or {}).get(row["seed"], "")
    verdict = "crash" if "crash" in row else "corrected" if reason else case.judge(row)
    expected = ", then ".join(each.causes[0] for each in case.expect)
    known: Row = {"case": case.name, "expected": expected, "why": case.why, "corrected": reason}
    return {**row, **known, "verdict": verdict}


def report(rows: Sequence[Row]) -> str:
    """Return the rates, what was said instead, and the calibration of the confidence."""
    scored = [row for row in rows if row["verdict"] in counted(())]
    out = Counter(row["verdict"] for row in rows if row not in scored)
    lines = [f"{len(rows)} runs of {len({row['case'] for row in rows})} cases, {len(scored)} scored"]
    lines += [f"  left out: {verdict} {number}" for verdict, number in sorted(out.items())]
    counts = counted(row["verdict"] for row in scored)
    lines += [rate(verdict, number, len(scored)) for verdict, number in counts.items()]
    faulty = [row for row in scored if row["struck"] or row["quoted"]]
    lines.append(rate("a fault is quoted", sum(bool(row["quoted"]) for row in faulty), len(faulty)))
    lines += ["", "Expected, and what was named first"]
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for row in scored:
        first = row["causes"][0]["cause"] if row["causes"] else "nothing"
        table[row["expected"]][f"{first} ({row['verdict']})"] += 1
    width = max(map(len, table), default=0)
    for expected, firsts in sorted(table.items()):
        told = ", ".join(f"{first} {number}" for first, number in firsts.most_common())
        lines.append(f"  {expected:<{width}}  {told}")
    lines += [
        "",
        "Confidence of the cause that is named first, and how often it was right",
        *calibration(scored),
    ]
    lines += ["", "Not right"]
    for row in sorted(scored, key=lambda row: row["verdict"]):
        if row["verdict"] != "right":
            first = row["causes"][0] if row["causes"] else {"cause": "nothing", "title": ""}
            lines.append(
                f"  {row['verdict']}: {row['case']} seed {row['seed']}: {first['cause']}: {first['title']}"
            )
    lines += [f"  crash: {row['case']} seed {row['seed']}: {row['crash']}" for row in rows if "crash" in row]
    return "\n".join(lines)


def calibration(scored: Sequence[Row]) -> list[str]:
    """Return a line for each stated confidence: its rate, and whether that of likely causes holds."""
    stated: dict[str, list[bool]] = defaultdict(list)
    for row in scored:
        if row["causes"]:
            stated[str(row["causes"][0]["confidence"])].append(row["verdict"] == "right")
    lines: list[str] = []
    for word in CONFIDENCES:
        hits = stated[word]
        line = rate(f"  {word}", sum(hits), len(hits))
        if hits and word == "likely":
            holds = "holds" if sum(hits) >= LIKELY_RATE * len(hits) else "does NOT hold"
            line += f"; documented at least {100 * LIKELY_RATE:.0f} %: {holds}"
        lines.append(line)
    return lines


def main() -> int:
    parser = options(__file__, __doc__, runs=4, what=f"seeds of each case, at most {SEEDS}")
    parser.add_argument(
        "--only", action="append", default=[], metavar="CASE", help="as 'camera*'; repeatable"
    )
    parser.add_argument("--final", action="store_true", help="the seeds that are kept for the end")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the judged rows there")
    given = parser.parse_args()
    if given.runs + given.first > SEEDS:
        parser.error(f"--first and --runs count the {SEEDS} seeds of a case")
    logs = given.out / "logs"
    rows = campaign(
        given,
        wanted(given),
        one,
        cost=lambda job: COST_ANEW if (log_folder(job, logs) / "done").exists() else COST_A_RUN,
        short=lambda row: ", ".join(each["cause"] for each in row["causes"]) or "nothing",
    )
    asked = [judged(row, cases()) for row in rows]
    if given.json:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(json.dumps(asked, ensure_ascii=False, indent=1))
    print(report(asked))
    return 0


if __name__ == "__main__":
    sys.exit(main())
