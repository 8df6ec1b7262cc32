"""Benchmark of explanations: is the cause that `picktree explain` names first the true one?

    python benchmarks/explanations.py                    # the seeds for development; goes on where it stopped
    python benchmarks/explanations.py --only 'camera*' --runs 2 --minutes 10
    python benchmarks/explanations.py --final            # the seeds that are kept for the end
    python benchmarks/explanations.py --report           # explain and score what is there, run nothing

The cases and their true causes are in explanations.yaml, written before anything was run. Each run is
explained from a log without the events of its faults, and scored by the root cause that stands first:

- `right`: code and subject are those of the table; of two causes, both are named, the costlier one first.
- `partly`: right code, other subject; a code that is near; one of two causes, or both in the wrong order.
- `does not tell`: no cause is named, or the finding itself says so.
- `wrong`: another cause.

A run in which nothing went wrong counts for none of these. Logs are kept: those that other code has explained
are explained again, and not run again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

from _campaign import ROOT, Row, rate
from _explanation_cases import Case, counted, load

COST_A_RUN = 9.0
"""CPU seconds of a run and its two explanations, for the forecast."""
COST_ANEW = 2.0
"""CPU seconds of explaining a log again."""
MB_A_RUN = 1.5
KILL_SPREAD = 0.3
"""Simulated time between the ends of two seeds of a killed run, s."""
PACE = "3"
"""Simulated seconds a second of a process that is killed or looked at from outside."""
PATIENCE = 300.0
"""Wall time after which such a process is given up, s."""


@dataclass(frozen=True)
class Job:
    case: Case
    seed: int
    folder: Path

    @property
    def at(self) -> float:
        """Simulated s at which the process is killed or looked at."""
        return self.case.at + KILL_SPREAD * (self.seed % 10)


def one(job: Job) -> Row:
    """Run a job unless its log is there, and explain it: the row of the results."""
    row: Row = {"case": job.case.name, "seed": job.seed, "code": code(), "crash": ""}
    began = time.process_time()
    try:
        if job.case.ends == "goes_on":
            row |= while_running(job)
        else:
            row |= explained(recorded(job))
    except Exception as error:  # noqa: BLE001  a crash is a figure of the benchmark
        row["crash"] = f"{type(error).__name__}: {error}"
    return row | {"cpu": round(time.process_time() - began, 2)}


@cache
def code() -> str:
    """Return a digest of what explains: logs of another one are explained anew."""
    digest = hashlib.sha256()
    for file in sorted([*(ROOT / "analysis").rglob("*.py"), *(ROOT / "logs").rglob("*.py")]):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def recorded(job: Job) -> Path:
    """Return the folder of the job's run, which is made unless it is there."""
    done = job.folder / "done"
    if done.exists():
        return Path(done.read_text())
    shutil.rmtree(job.folder, ignore_errors=True)
    job.case.write(job.folder)
    if job.case.ends:
        with subprocess.Popen(_command(job), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
            if job.case.ends == "killed":
                _await(job, process)
                process.kill()
            _, said = process.communicate()
        if process.returncode != -signal.SIGKILL:
            raise RuntimeError(f"it was not killed: exit code {process.returncode}, {said.decode()[-200:]}")
        folder = _run_folder(job)
    else:
        folder = _run(job)
    done.write_text(str(folder))
    return folder


def _run(job: Job) -> Path:
    from picktree.session.session import RunRequest, Session

    faults = job.folder / "faults.yaml"
    request = RunRequest(
        mission=job.folder / "mission.yaml",
        seed=job.seed,
        backend=job.case.backend,  # pyright: ignore[reportArgumentType]
        faults=faults if faults.exists() else None,
        out=job.folder / "runs",
        limit=job.case.limit,
    )
    return Session(request).run().folder


def _command(job: Job) -> list[str]:
    words = [sys.executable, "-m", "picktree", "run", str(job.folder / "mission.yaml")]
    words += ["--seed", str(job.seed), "--backend", job.case.backend, "--out", str(job.folder / "runs")]
    words += ["--pace", PACE] if job.case.ends != "kills_itself" else []
    return words + (["--faults", str(job.folder / "faults.yaml")] if job.case.faults else [])


def _run_folder(job: Job) -> Path:
    return next((job.folder / "runs").glob("*/"))


def _await(job: Job, process: subprocess.Popen[bytes]) -> Path:
    """Return the run's folder as soon as its log reaches the job's time."""
    from picktree.analysis import Run
    from picktree.errors import PicktreeError

    until = time.monotonic() + PATIENCE
    while time.monotonic() < until and process.poll() is None:
        time.sleep(0.5)
        try:
            with Run(_run_folder(job)) as run:
                if run.last_tick >= job.at:
                    return _run_folder(job)
        except (PicktreeError, OSError, StopIteration):
            continue  # nothing is written yet
    process.kill()
    raise RuntimeError(f"the run did not get to {job.at:.1f} s as it should: exit code {process.poll()}")


def while_running(job: Job) -> Row:
    """Explain a run while its process goes on; it is always run anew."""
    shutil.rmtree(job.folder, ignore_errors=True)
    job.case.write(job.folder)
    with subprocess.Popen(_command(job), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        told = explained(_await(job, process))
        ended = process.poll()
        process.kill()
    if ended is not None:
        raise RuntimeError(f"the run had ended when it was explained, with exit code {ended}")
    return told


def explained(folder: Path) -> Row:
    """Return what `picktree explain --json` says of a run, from a log that holds no event of a fault.

    `quoted` counts the root causes that quote a fault when the log holds it.
    """
    from functools import cached_property

    from picktree.analysis import Run
    from picktree.analysis.explain.explain import explain
    from picktree.analysis.explain.explanation_text import to_json_text
    from picktree.logs.run_log import Stamped
    from picktree.world.events.run_events import FaultEvent
    from picktree.world.journal import JournalEvent

    class Blind(Run):
        """A run whose log holds no word of a fault."""

        @cached_property
        def events(self) -> tuple[Stamped[JournalEvent], ...]:
            return tuple(at for at in super().events if not isinstance(at.record, FaultEvent))

    with Blind(folder) as run:
        blind = json.loads(to_json_text(run, explain(run, faults=False)))
    with Run(folder) as run:
        shown = explain(run)
        struck = _struck(run)
    keys = ("cause", "title", "item", "ended_run", "reasons")
    return {
        "status": blind["outcome"]["status"],
        "failures": len(blind["failures"]),
        "struck": struck,
        "causes": [
            {key: each[key] for key in keys} | {"confidence": each.get("confidence", "")}
            for each in blind["root_causes"]
        ],
        "quoted": sum(bool(each.planted) for each in shown.root_causes),
        "log": str(folder),
    }


def _struck(run: object) -> list[dict[str, str]]:
    """Return the true items that faults struck: id, kind, colour."""
    from picktree.analysis import Run
    from picktree.world.events.run_events import FaultEvent

    assert isinstance(run, Run)
    ids = {at.record.item for at in run.events if isinstance(at.record, FaultEvent) and at.record.item}
    bodies = {body.id: body for at in run.log.truths() for body in at.record.bodies if body.id in ids}
    return [{"id": id_, "kind": body.kind, "colour": body.colour} for id_, body in bodies.items()]


def wanted(given: argparse.Namespace) -> list[Job]:
    """Return the jobs, one seed of all cases after the other."""
    cases = [case for case in load() if not given.only or any(fnmatchcase(case.name, p) for p in given.only)]
    offset = 1 if given.final else 0
    return [
        Job(case, seed, given.out / case.name / str(seed))
        for n in range(given.first, given.first + given.runs)
        for case in cases
        for seed in [case.seeds + 2 * n + offset]
    ]


def run(jobs: Sequence[Job], rows: dict[tuple[str, int], Row], given: argparse.Namespace) -> None:
    """Run and explain what is to do, within the minutes, and add it to the rows and their file."""
    file, until = _results(given), time.monotonic() + 60 * given.minutes
    pending: set[Future[Row]] = set()

    def collect(done: set[Future[Row]]) -> None:
        for row in (future.result() for future in done):
            rows[row["case"], row["seed"]] = row
            with file.open("a") as lines:
                lines.write(json.dumps(row) + "\n")
            said = row["crash"] or ", ".join(each["cause"] for each in row["causes"]) or "nothing"
            print(f"  {row['case']} {row['seed']}: {said}", file=sys.stderr, flush=True)

    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(given.workers, context) as pool:
        for job in jobs:
            if len(pending) >= given.workers:
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                collect(done)
            if time.monotonic() > until:
                print("the minutes are over; the same command goes on", file=sys.stderr)
                break
            pending.add(pool.submit(one, job))
        collect(pending)


def _results(given: argparse.Namespace) -> Path:
    return given.out / ("final.jsonl" if given.final else "development.jsonl")


def read(given: argparse.Namespace) -> dict[tuple[str, int], Row]:
    """Return the results that are there, the last of each case and seed."""
    file = _results(given)
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    return {(row["case"], row["seed"]): row for row in rows}


def judged(row: Row, cases: dict[str, Case]) -> Row:
    """Return the row with its verdict."""
    case = cases[row["case"]]
    reason = (case.corrected or {}).get(row["seed"], "")
    verdict = "crash" if row["crash"] else "corrected" if reason else case.judge(row)
    expected = ", then ".join(each.causes[0] for each in case.expect)
    return row | {"verdict": verdict, "expected": expected, "why": case.why, "corrected": reason}


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
    lines += ["", "Confidence of the cause that is named first, and how often it was right"]
    stated: dict[str, list[bool]] = defaultdict(list)
    for row in scored:
        if row["causes"]:
            stated[str(row["causes"][0]["confidence"]) or "not stated"].append(row["verdict"] == "right")
    lines += [rate(f"  {word}", sum(hits), len(hits)) for word, hits in sorted(stated.items())]
    lines += ["", "Not right"]
    for row in sorted(scored, key=lambda row: row["verdict"]):
        if row["verdict"] != "right":
            first = row["causes"][0] if row["causes"] else {"cause": "nothing", "title": ""}
            lines.append(
                f"  {row['verdict']}: {row['case']} seed {row['seed']}: {first['cause']}: {first['title']}"
            )
    lines += [f"  crash: {row['case']} seed {row['seed']}: {row['crash']}" for row in rows if row["crash"]]
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=4, help="seeds of each case, of at most 5")
    parser.add_argument("--first", type=int, default=0, help="number of the first of them")
    parser.add_argument(
        "--only", action="append", default=[], metavar="CASE", help="as 'camera*'; repeatable"
    )
    parser.add_argument("--final", action="store_true", help="the seeds that are kept for the end")
    parser.add_argument("--minutes", type=float, default=1e6, help="begin nothing new after them")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "explanations")
    parser.add_argument("--report", action="store_true", help="run nothing; explain what is there")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the judged rows there")
    given = parser.parse_args()
    if given.runs + given.first > 5:
        parser.error("a case has five seeds for development, and five for the end")
    given.out = given.out.absolute()
    given.out.mkdir(parents=True, exist_ok=True)
    rows, jobs = read(given), wanted(given)
    old = [job for job in jobs if (known := rows.get((job.case.name, job.seed))) and known["code"] != code()]
    new = [] if given.report else [job for job in jobs if (job.case.name, job.seed) not in rows]
    cost = (len(new) * COST_A_RUN + len(old) * COST_ANEW) / 60
    print(
        f"{len(new)} of {len(jobs)} runs to do and {len(old)} logs to explain anew, "
        f"about {cost:.0f} CPU minutes on {given.workers} workers and {len(new) * MB_A_RUN:.0f} MB of logs; "
        f"in {given.out}",
        file=sys.stderr,
        flush=True,
    )
    run([*old, *new], rows, given)
    cases = {job.case.name: job.case for job in jobs}
    asked = [judged(rows[key], cases) for job in jobs if (key := (job.case.name, job.seed)) in rows]
    if given.json:
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(json.dumps(asked, ensure_ascii=False, indent=1))
    print(report(asked))
    return 0


if __name__ == "__main__":
    sys.exit(main())
