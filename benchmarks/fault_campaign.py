"""Campaign: each kind of fault on many seeds, with recovery and without. Is it noticed, rightly named, cured?

    python benchmarks/fault_campaign.py                        # the plan; goes on where it stopped
    python benchmarks/fault_campaign.py --runs 2 --first 900 --only 'slip*' --out /tmp/slips
    python benchmarks/fault_campaign.py --report               # the table of what is there
    python benchmarks/fault_campaign.py --report --markdown docs/fault-campaign.md

The plan is run as a batch (`picktree batch report` makes a page of it, too). A batch lets no fault kill its
jobs: those of `kill` are run once more by themselves, killed, and taken up by `picktree run --resume` where
there is recovery. Then each log is measured, and the table made: docs/fault-campaign.md says what its columns
count. Exit code 0: all targets are met.
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable, Sequence
from contextlib import closing, redirect_stdout
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from pathlib import Path
from statistics import median
from threading import Timer

from _campaign import CUT_OFF, REFERENCE_COST, ROOT, blind, executor, explaining, options, rate, reference
from _fault_measures import Cell, Measure, Measured, measured
from _fault_page import targets, to_page
from _fault_table import Line, line, to_text, total
from picktree.analysis import Run
from picktree.apps.batch import RESULTS_FILE, Batch, BatchPlan, Store, load_plan
from picktree.apps.cli.batch_progress import progress
from picktree.files import PicktreeError
from picktree.logs import RunResult
from picktree.session.environment import revision
from picktree.simulation import load_faults
from picktree.simulation.fault_entries import FaultExpectation

PLAN = ROOT / "benchmarks" / "campaign" / "plan.yaml"
COST_A_RUN = 7.0
"""CPU seconds of a run of four items on the reference machine, until runs are recorded."""
MB_A_RUN = 1.5
"""Size of a run's log, MB."""
PLAINLY = "sort_plainly"
"""Stem of the mission without recovery."""
TOLD = "told.json"
"""File with the outcome of a run that killed itself."""
ITEMS = 4
"""Number of items in the scene."""


@dataclass(frozen=True)
class Row:
    """A job of the batch, as far as the table needs it."""

    job: str
    mission: Path
    scene: str
    faults: Path | None
    seed: int
    status: str
    message: str
    total: int | None
    sorted: int | None
    misplaced: int | None
    seconds: float | None
    folder: str

    @property
    def fault(self) -> str:
        return self.faults.stem if self.faults else "none"

    @property
    def kills(self) -> bool:
        """Whether its fault is one that ends the process."""
        return self.fault.startswith("kill")


def main() -> int:
    given = _options().parse_args()
    try:
        return campaign(given)
    except PicktreeError as error:
        print(error, file=sys.stderr)
        return 2


def _options() -> argparse.ArgumentParser:
    parser = options(__file__, __doc__, runs=None, what="seeds of each fault; those of the plan unless given")
    parser.add_argument("--plan", type=Path, default=PLAN)
    parser.add_argument("--only", action="append", default=[], metavar="FAULT", help="as 'slip*'; repeatable")
    parser.add_argument("--without", action="append", default=[], metavar="FAULT")
    parser.add_argument("--side", choices=("with", "without", "both"), default="both", help="recovery")
    parser.add_argument("--report", action="store_true", help="run nothing: the table of what is there")
    parser.add_argument("--json", action="store_true", help="the table as one JSON object on stdout")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the page there, too")
    return parser


def campaign(given: argparse.Namespace) -> int:
    folder: Path = given.out
    if not given.report:
        with redirect_stdout(sys.stderr):  # the progress is no part of the report
            run(given, folder)
    if not (folder / RESULTS_FILE).exists():
        raise PicktreeError(f"{folder}: there is no campaign in it")
    jobs = read(folder)
    rows = [row for row in jobs if row.status != "waiting"]
    if not rows:
        raise PicktreeError(f"{folder}: no run has been finished yet")
    measures = measure(rows, folder)
    lines = table(rows, measures)
    found = targets(lines)
    if given.markdown:
        whole = to_page(lines, command=_command(), seeds=sorted({row.seed for row in rows}))
        beside = given.markdown.with_suffix(".part")
        beside.write_text(whole, encoding="utf-8")
        beside.replace(given.markdown)
    if given.json:
        told = {
            "lines": [each.to_json() for each in lines],
            "targets": [
                {"target": target.words, "measured": target.measured, "met": target.met} for target in found
            ],
            "runs": [one.to_json() for one in measures],
        }
        print(json.dumps(told, ensure_ascii=False, indent=2))
    else:
        if len(rows) < len(jobs):
            print(f"{CUT_OFF}{len(rows)} of {len(jobs)} runs have a result.\n")
        print(to_text(lines) + "\n")
        for recovery in _sides(lines):
            print("\n".join(_rates(total(lines, recovery))))
        for target in found:
            print(target.to_text())
    return 0 if all(target.met for target in found) else 1


def run(given: argparse.Namespace, folder: Path) -> None:
    """Run what is to do of the plan, then take up what was killed. Says first what it costs."""
    plan = asked(given)
    if (folder / RESULTS_FILE).exists():
        made = Batch.resume(folder)
        if given.runs or given.only or given.without or given.side != "both":
            have, want = _extent(made.plan), _extent(plan)
            if have != want:
                made.__exit__()
                raise PicktreeError(f"{folder} holds another campaign ({have[-1]}): give another --out")
    else:
        made = Batch.create(folder, plan)
    with made as batch, closing(executor(given)) as workers:
        costs = _costs(batch.store, mixed=given.mixed)
        to_do = len(batch.store.to_do())
        cpu = to_do * (median(costs) if costs else COST_A_RUN * reference() / REFERENCE_COST) / 60
        print(
            f"{to_do} of {len(batch.jobs)} runs to do, about {cpu:.0f} CPU minutes, "
            f"{cpu / workers.slots:.0f} minutes on {workers.slots} workers, and {to_do * MB_A_RUN:.0f} MB of "
            f"logs; {revision()}, in {folder}",
            file=sys.stderr,
            flush=True,
        )
        timer = Timer(60 * given.minutes, batch.finish) if given.minutes is not None else None
        if timer:
            timer.start()
        with progress(folder, sys.stderr if given.json else None) as seen:
            whole = batch.run(workers, seen)
        if timer:
            timer.cancel()
    if not whole and given.minutes is None:
        raise PicktreeError("it was stopped; the same command goes on")
    for row in read(folder):
        if row.kills and row.status != "waiting":
            kill(row, folder)


def _costs(store: Store, *, mixed: bool) -> list[float]:
    """Return the CPU times of the recorded runs, s. Raises PicktreeError when another commit made some."""
    made = store.query(
        "SELECT cpu_seconds, version FROM jobs JOIN versions USING (job) WHERE library = 'revision'"
    ).rows
    others = {str(commit) for _, commit in made} - {revision()}
    if others and not mixed:
        raise PicktreeError(
            f"{store.path.parent}: its runs are of {', '.join(sorted(others))}, and this is {revision()}: "
            "give another --out, or --mixed"
        )
    return [float(str(cpu)) for cpu, _ in made if cpu is not None]


def asked(given: argparse.Namespace) -> BatchPlan:
    """The plan, as far as it is wanted."""
    plan = load_plan(given.plan)
    faults = tuple(path for path in plan.faults if _wanted(path, given.only, given.without))
    if not faults:
        known = ", ".join(path.stem if path else "none" for path in plan.faults)
        raise PicktreeError(f"no fault of the plan is left; it has: {known}")
    missions = tuple(
        path
        for path in plan.missions
        if given.side == "both" or (path.stem == PLAINLY) == (given.side == "without")
    )
    seeds = tuple(range(given.first, given.first + given.runs)) if given.runs else plan.seeds
    return replace(plan, faults=faults, missions=missions, seeds=seeds)


def _wanted(path: Path | None, only: Sequence[str], without: Sequence[str]) -> bool:
    name = path.stem if path else "none"
    return (not only or any(fnmatch(name, each) for each in only)) and not any(
        fnmatch(name, each) for each in without
    )


def _extent(plan: BatchPlan) -> tuple[object, ...]:
    faults = [path.stem if path else "none" for path in plan.faults]
    seeds = f"{plan.seeds[0]}:{plan.seeds[-1] + 1}"
    missions = tuple(path.stem for path in plan.missions)
    return missions, tuple(faults), plan.seeds, f"{', '.join(faults)}; seeds {seeds}"


def read(folder: Path) -> list[Row]:
    """All jobs of the batch in the order of its plan."""
    with Store(folder / RESULTS_FILE) as store:
        found = store.query(
            "SELECT job, mission, scene, faults, seed, status, message, items_total, items_sorted, "
            "items_misplaced, sim_seconds, folder FROM jobs ORDER BY number"
        )
    return [
        Row(
            str(job),
            Path(str(mission)),
            str(scene),
            Path(str(faults)) if faults else None,
            *rest,  # type: ignore[arg-type]
        )
        for job, mission, scene, faults, *rest in found.rows
    ]


def kill(row: Row, folder: Path) -> None:
    """Run it by itself, so that its fault kills it; then go on with it as its user would, where there is
    recovery. What came of it stays in the campaign's folder."""
    place = _place(row, folder)
    if (place / TOLD).exists():
        return
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    before = _picktree(
        *("run", str(row.mission), "--scene", row.scene, "--faults", str(row.faults)),
        *("--seed", str(row.seed), "--out", str(place / "before")),
    )
    told: dict[str, object] = {"ended": before.returncode, "result": None}
    log = next((place / "before").glob("*/"), None)
    if before.returncode == -signal.SIGKILL and log is not None and row.mission.stem != PLAINLY:
        after = _picktree("run", "--resume", str(log), "--json", "--out", str(place / "after"))
        told |= {"resumed": after.returncode, "said": after.stderr}
        if after.returncode in (0, 1):
            told["result"] = after.stdout
    beside = place / "told.part"
    beside.write_text(json.dumps(told), encoding="utf-8")
    beside.replace(place / TOLD)
    print(
        f"seed {row.seed}: {row.mission.stem}, killed by itself: {told['ended']}", file=sys.stderr, flush=True
    )


def _place(row: Row, folder: Path) -> Path:
    return folder.absolute() / "killed" / row.job


def _picktree(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "picktree", *words], capture_output=True, text=True)


def measure(rows: Sequence[Row], folder: Path) -> list[Measure]:
    """Measure each run, once."""
    known = Measured.read(folder / "measures.jsonl")
    cell: Cell | None = None
    explains = explaining()
    for number, row in enumerate(rows):
        if (one := known.by_job.get(row.job)) and one.explains == explains:
            continue
        if cell is None:
            print("measuring …", file=sys.stderr, flush=True)
            cell = Cell.of("sort_small")
        known.add(replace(_measure(row, folder, cell), explains=explains))
        if number % 100 == 99:
            print(f"  {number + 1} of {len(rows)}", file=sys.stderr, flush=True)
    return [known.by_job[row.job] for row in rows]


def _measure(row: Row, folder: Path, cell: Cell) -> Measure:
    told = Measure(
        row.job,
        row.fault,
        row.mission.stem != PLAINLY,
        row.seed,
        row.status,
        row.message,
        total=row.total,
        sorted=row.sorted,
        misplaced=row.misplaced,
        seconds=row.seconds,
        folder=row.folder,
    )
    if row.kills and (_place(row, folder) / TOLD).exists():
        return _measure_killed(told, _place(row, folder), cell)
    if not row.folder:
        return told
    return _of_log(told, folder / row.folder, cell)


def _of_log(told: Measure, folder: Path, cell: Cell) -> Measure:
    with Run(folder) as log:
        told = measured(told, log, cell)
    with blind(folder) as log:
        return replace(told, roots=tuple(root.cause for root in log.explanation.root_causes))


def _measure_killed(told: Measure, place: Path, cell: Cell) -> Measure:
    """Measure a run that killed itself, and the run that resumed it."""
    said = json.loads((place / TOLD).read_text(encoding="utf-8"))
    folder = next((place / "before").glob("*/"), None)
    told = replace(
        told, status="crashed", message=f"killed, exit code {said['ended']}", total=None, sorted=None
    )
    told = replace(told, killed=said["ended"] == -signal.SIGKILL, misplaced=None, seconds=None, folder="")
    if folder is None:
        return told
    root = place.parent.parent
    told = replace(_of_log(told, folder, cell), folder=str(folder.relative_to(root)))
    if said["result"] is None:
        return told
    ended = RunResult.from_json_text(said["result"], place / TOLD)
    told = replace(
        told,
        status=ended.status,
        message=ended.message,
        resumed=True,
        total=ended.items.total,
        sorted=ended.items.sorted,
        misplaced=ended.items.misplaced,
        seconds=ended.sim_seconds,
        failures=(),
        folder=str(ended.folder.relative_to(root)),
    )
    return _of_log(told, ended.folder, cell)


def table(rows: Sequence[Row], measures: Sequence[Measure]) -> list[Line]:
    """Both sides of each fault, in the order of the plan; then all together."""
    files = {row.fault: row.faults for row in rows}
    lines: list[Line] = []
    for fault, path in files.items():
        expect = (load_faults(path).expect if path else None) or FaultExpectation(())
        for recovery in (True, False):
            own = [one for one in measures if one.fault == fault and one.recovery == recovery]
            if own:
                lines.append(line(fault, recovery, own, expect, ITEMS, _force_limit()))
    if len(files) > 1:
        lines += [total(lines, side) for side in _sides(lines)]
    return lines


def _sides(lines: Iterable[Line]) -> list[bool]:
    return [side for side in (True, False) if any(each.recovery == side for each in lines)]


def _rates(side: Line) -> list[str]:
    """Return the lines of all faults of one side together."""
    return [
        "with recovery:" if side.recovery else "without recovery:",
        rate("  failure detected", side.detected, side.took_effect),
        rate("  failure reported", side.reported, side.detected),
        rate("  right root cause", side.right, side.to_explain),
        rate("  runs finished", side.finished, side.runs),
        rate("  items sorted of those that can be", side.sorted, side.sortable),
    ]


def _force_limit() -> float:
    from picktree.world.scene import load_scene

    return load_scene("sort_small", Path.cwd()).limits.force


def _command() -> str:
    """Return the command that repeats the campaign, wherever its runs are kept and however long it took."""
    words = list(sys.argv[1:])
    for passing in {"--out", "--minutes", "--workers"} & set(words):
        at = words.index(passing)
        del words[at : at + 2]
    return " ".join(["python", "benchmarks/fault_campaign.py", *words])


if __name__ == "__main__":
    sys.exit(main())
