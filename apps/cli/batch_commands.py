"""picktree batch"""

from __future__ import annotations

import shlex
import signal
import sys
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Literal, TextIO, TypeAlias

import typer

from picktree.files import FileError, PicktreeError

from .options import Backend, JsonWritten, JunitFile, Verify, faults_file, mission_file, plan_file
from .output import (
    StatusLine,
    end_with,
    json_text,
    keep_stdout,
    print_answer,
    program,
    require_place,
    show,
)

if TYPE_CHECKING:
    from picktree.apps.batch import Batch, BatchPlan, BatchSummary, Executor, LocalExecutor, RayExecutor


_PLAN_OPTIONS = (
    *("seeds", "scene", "robot", "faults", "set_", "backend", "verify"),
    *("limit", "wall_limit", "memory", "disk", "keep", "until", "by", "margin"),
)
"""Options that a plan file replaces."""
PlanArgument: TypeAlias = Annotated[
    Path | None, typer.Argument(metavar="[PLAN]", help="Plan file.", parser=plan_file)
]
Missions: TypeAlias = Annotated[
    list[Path] | None,
    typer.Option(metavar="FILE", help="Missions to be run, instead of a plan.", parser=mission_file),
]
Seeds: TypeAlias = Annotated[
    str, typer.Option(metavar="SEEDS", help="Seeds: 0:100 (100 not included), or 3,7.")
]
Scenes: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(metavar="SCENE", help="Scenes that replace the missions' own."),
]
Robots: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(metavar="ROBOT", help="Shipped robots or robot files that replace the scenes' own."),
]
FaultsFiles: TypeAlias = Annotated[
    list[str] | None, typer.Option(metavar="FILE", help="Faults file, or none; may be repeated.")
]
TriedSettings: TypeAlias = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=A,B", help="Values of a setting, as SortOne/Grasp.force=15,30."),
]
TimeLimit: TypeAlias = Annotated[str, typer.Option(metavar="TIME", help="Limit of a job's simulated time.")]
WallLimit: TypeAlias = Annotated[str, typer.Option(metavar="TIME", help="Limit of a job's wall time.")]
MemoryLimit: TypeAlias = Annotated[str, typer.Option(metavar="SIZE", help="Limit of a job's memory.")]
DiskLimit: TypeAlias = Annotated[str, typer.Option(metavar="SIZE", help="Limit of a job's written data.")]
KeptLogs: TypeAlias = Annotated[
    Literal["all", "failures", "none"], typer.Option(help="Jobs whose logs are kept.")
]
EndOfBatch: TypeAlias = Annotated[
    Literal["all", "decided"],
    typer.Option(help="End of the batch: all jobs were run, or the recipes are distinguished."),
]
DecidedBy: TypeAlias = Annotated[
    Literal["goal", "units"],
    typer.Option(help="Question that decides: goals reached, or units an hour."),
]
Margin: TypeAlias = Annotated[
    str, typer.Option(metavar="SHARE", help="Difference within which two recipes count as equal.")
]
Workers: TypeAlias = Annotated[
    int | None, typer.Option(min=1, help="Maximum number of concurrent jobs.", show_default="one a core")
]
ExecutorName: TypeAlias = Annotated[
    Literal["local", "ray"], typer.Option(help="Executor of the jobs: this machine, or a Ray cluster.")
]
ClusterAddress: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="HOST:PORT",
        help="Running Ray cluster with this machine in it, or auto.",
        show_default="a new cluster on this machine, for this batch",
    ),
]
NewFolder: TypeAlias = Annotated[
    Path | None, typer.Option(metavar="DIR", help="The batch's folder.", show_default="in runs/")
]
ResumedFolder: TypeAlias = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Resume the batch in this folder.")
]
JsonEvents: TypeAlias = Annotated[bool, typer.Option("--json", help="Print one event a line, as JSON.")]


def run(
    context: typer.Context,
    plan: PlanArgument = None,
    mission: Missions = None,
    seeds: Seeds = "0",
    scene: Scenes = None,
    robot: Robots = None,
    faults: FaultsFiles = None,
    set_: TriedSettings = None,
    backend: Backend = "physics",
    verify: Verify = False,
    limit: TimeLimit = "3600 s",
    wall_limit: WallLimit = "3600 s",
    memory: MemoryLimit = "4 GB",
    disk: DiskLimit = "10 GB",
    keep: KeptLogs = "failures",
    until: EndOfBatch = "all",
    by: DecidedBy = "goal",
    margin: Margin = "0.1",
    workers: Workers = None,
    executor: ExecutorName = "local",
    address: ClusterAddress = None,
    out: NewFolder = None,
    resume: ResumedFolder = None,
    junit: JunitFile = None,
    json: JsonEvents = False,
) -> None:
    """Run every combination of missions, scenes, faults and settings with every seed.

    The first Ctrl-C finishes the running jobs, the second stops immediately; --resume continues. Exit code 0:
    every job reached its goal; 1: one did not. With --until decided 0: the recipes are distinguished; 1: all
    seeds were not enough.
    """
    _require_one_source(context, plan, mission, resume)
    if address is not None and executor == "local":
        raise PicktreeError("--address names a Ray cluster: add --executor ray")
    require_place(junit)
    answer = keep_stdout() if json else None

    from picktree.apps.batch import Batch, load_plan, plan_of

    if resume is not None:
        resumed = Batch.resume(resume)
        with _executor(executor, workers, address) as hands:
            _carry_out(resumed, hands, answer, junit)
        return
    if plan is not None:
        batch_plan = load_plan(plan)
    else:
        options = {
            "scenes": scene,
            "robots": robot,
            "seeds": seeds,
            "backend": backend,
            "verify": verify,
            "limit": limit,
            "wall_limit": wall_limit,
            "memory": memory,
            "disk": disk,
            "keep": keep,
            "until": until,
            "by": by,
            "margin": margin,
        }
        batch_plan = plan_of(_matrix(mission or [], faults or [], set_ or [], options))
    with _executor(executor, workers, address) as hands:
        _carry_out(Batch.create(out or _new_folder(batch_plan), batch_plan), hands, answer, junit)


def _require_one_source(
    context: typer.Context, plan: Path | None, missions: list[Path] | None, resume: Path | None
) -> None:
    """Raise PicktreeError unless plan, missions or a batch to resume is given, without options of its own."""
    if sum([plan is not None, bool(missions), resume is not None]) != 1:
        raise PicktreeError("give one of: a plan file, --mission FILE, --resume DIR")
    if not missions:
        _refuse_what_a_plan_says(context, also=("out",) if resume is not None else ())


def _refuse_what_a_plan_says(context: typer.Context, also: Sequence[str]) -> None:
    """Raise PicktreeError for an option that would have no effect."""
    for name in (*_PLAN_OPTIONS, *also):
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            option = f"--{name.strip('_').replace('_', '-')}"
            whose = "the batch has its own value" if also else "the plan file has its own value"
            raise PicktreeError(f"{option} can only be given with --mission: {whose}")


def _executor(
    executor: Literal["local", "ray"], workers: int | None, address: str | None
) -> LocalExecutor | RayExecutor:
    """Return the executor. A cluster is connected before the batch is created."""
    if executor == "ray":
        from picktree.apps.batch import RayExecutor

        return RayExecutor(workers, address)

    from picktree.apps.batch import LocalExecutor

    return LocalExecutor(workers)


def _matrix(
    missions: list[Path], faults: list[str], settings: list[str], options: Mapping[str, object]
) -> Mapping[str, object]:
    """Return the keys of a plan file that correspond to the options."""
    from .run import parse_parameters

    return {
        "name": missions[0].stem,
        "missions": [str(file.absolute()) for file in missions],
        "faults": [name if name == "none" else str(faults_file(name).absolute()) for name in faults],
        "set": {name: value.split(",") for name, value in parse_parameters(settings).items()},
        **options,
    }


def _carry_out(made: Batch, executor: Executor, answer: TextIO | None, junit: Path | None) -> None:
    """Run all open jobs, show the progress, and end with the exit code."""
    from picktree.apps.batch import summarise, to_junit

    from .batch_progress import EventLines, discard, progress

    with made, _stopped_by_signals(made), progress(made.folder, answer) as seen:
        complete = made.run(executor, seen)
        summary = summarise(made.store)
        if junit is not None:
            show(to_junit(made.store), junit)
    try:
        if answer is not None:
            EventLines(answer).summary(summary)
        else:
            _show(made.folder, summary, complete)
    except OSError:  # nobody reads it
        discard(answer or sys.stdout)
    reached = made.decided if made.plan.until == "decided" else summary.reached
    end_with(reached, "" if complete else "interrupted")


def _show(folder: Path, summary: BatchSummary, complete: bool) -> None:
    quoted = shlex.quote(str(folder))
    print(summary.to_text())
    print(f"\nresults       {folder.absolute()}")
    print(f"look at them  {program()} batch query {quoted} 'SELECT * FROM worst'")
    if not complete:
        print(f"go on         {program()} batch run --resume {quoted}")
    sys.stdout.flush()


def _new_folder(plan: BatchPlan) -> Path:
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    return Path("runs") / f"batch-{plan.name.replace('/', '-')}-{stamp}"


@contextmanager
def _stopped_by_signals(made: Batch) -> Generator[None]:
    """Handle signals: Ctrl-C finishes running jobs, a second one and SIGTERM break them off.

    The loss of the terminal finishes running jobs, too; under nohup it has no effect.
    """
    handlers = {signal.SIGINT: made.stop, signal.SIGTERM: made.break_off, signal.SIGHUP: made.finish}

    def hear(number: int, frame: FrameType | None) -> None:
        handlers[signal.Signals(number)]()

    before = {number: signal.getsignal(number) for number in handlers}
    for number, handler in before.items():
        if number != signal.SIGHUP or handler != signal.SIG_IGN:
            signal.signal(number, hear)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


batch = typer.Typer(help="Run many jobs, and query their results.", no_args_is_help=True)
batch.command()(run)
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="The batch's folder.")]


@batch.command()
def plan(
    file: Annotated[Path, typer.Argument(metavar="PLAN", help="Plan file.")],
    runs: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder with batches whose jobs give the expected costs.")
    ] = Path("runs"),
    workers: Workers = None,
    stdin: Annotated[
        bool,
        typer.Option(
            "--stdin", help="Read the plan's text from stdin; its paths count from the place of PLAN."
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Check a plan, and show its matrix and its expected cost, without running it."""
    from picktree.apps.batch import check_plan, forecast, recorded_batches
    from picktree.files.yaml import read_document

    text = sys.stdin.read() if stdin else None
    try:
        place = file if stdin else plan_file(str(file))
        wanted = check_plan(read_document(place.absolute(), "plan", text)).required()
    except FileError as error:
        if json:
            print(json_text({"faults": [asdict(fault) for fault in error.faults]}), end="")
            raise typer.Exit(2) from None
        raise
    found = forecast(wanted, recorded_batches(runs), workers)
    print(json_text(found.to_json()) if json else f"{found.to_text()}\n", end="")


@batch.command()
def query(
    folder: Folder,
    sql: Annotated[str, typer.Argument(metavar="SQL", help="A SELECT on the tables and views.")],
    json: Json = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """Run an SQL query on the results. docs/batches.md lists tables and views."""
    if json and csv:
        raise PicktreeError("--json and --csv exclude each other")
    from picktree.apps.batch import RESULTS_FILE, Store

    with Store(folder / RESULTS_FILE) as store:
        table = store.query(sql)
    if json:
        print(table.to_json_text(), end="")
    elif csv:
        print(table.to_csv(), end="")
    else:
        print(table.to_text())


@batch.command()
def summary(
    folder: Folder,
    json: Json = False,
) -> None:
    """Print success with intervals, units an hour, causes, and the worst jobs."""
    from picktree.apps.batch import RESULTS_FILE, Store, summarise

    with Store(folder / RESULTS_FILE) as store:
        found = summarise(store)
    print(found.to_json_text() if json else f"{found.to_text()}\n", end="")


@batch.command()
def report(
    folder: Folder,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="HTML file to write.")],
    runs: Annotated[
        int,
        typer.Option(
            min=0, help="Maximum number of the worst runs that get a report, if their log was kept."
        ),
    ] = 5,
) -> None:
    """Write the batch as one page: rates with intervals, time by phase, causes, the worst runs."""
    from picktree.apps.batch import write_report

    write_report(folder, output, runs)
    print(output)


@batch.command()
def export(
    folder: Folder,
    to: Annotated[Literal["csv", "parquet"], typer.Option("--to", help="Form of the files.")],
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="FOLDER", help="Folder for the files, one file for each table."
        ),
    ],
    json: JsonWritten = False,
) -> None:
    """Write every table as a CSV or Parquet file, for pandas, DuckDB or a spreadsheet."""
    from picktree.apps.batch import RESULTS_FILE, Store
    from picktree.apps.batch import export as write

    with Store(folder / RESULTS_FILE) as store:
        written = write(store, to, output)
    print(written.to_json_text() if json else f"{written.to_text()}\n", end="")


@batch.command()
def compare(
    a: Annotated[str, typer.Argument(metavar="A", help="A batch's folder, or FOLDER@RECIPE.")],
    b: Annotated[str, typer.Argument(metavar="B", help="Batch's folder, or FOLDER@RECIPE, to compare with.")],
    partings: Annotated[
        int, typer.Option(min=0, help="Maximum number of changed seeds whose divergence is searched.")
    ] = 3,
    remake: Annotated[
        bool,
        typer.Option(
            "--remake", help="If a job's log was not kept, run the job again to find the divergence."
        ),
    ] = False,
    unpaired: Annotated[
        bool, typer.Option("--unpaired", help="Compare as independent runs, even with shared seeds.")
    ] = False,
    json: Json = False,
) -> None:
    """Compare two recipes, paired by seed where they share them. Exit code 1: they differ by more than chance
    explains."""
    from picktree.apps.batch import compare_recipes, json_text_of, read_recipe, text_of, with_divergences

    answer = keep_stdout() if json else None
    recipes = read_recipe(a), read_recipe(b)
    with StatusLine() as line:
        found = with_divergences(
            compare_recipes(*recipes, unpaired=unpaired),
            *recipes,
            partings,
            remake=remake,
            say=lambda what: line.say(f"running it again: {what}"),
        )
    print_answer(answer, lambda: text_of(found, program()), lambda: json_text_of(found))
    end_with(not found.differ)
