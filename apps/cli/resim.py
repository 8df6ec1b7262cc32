"""picktree resim"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, TextIO

import typer

from .options import Log, OtherSettings, faults_file, mission_file
from .output import StatusLine, end_with, keep_stdout, print_answer, print_warnings
from .run import parse_parameters


def whatif(
    log: Log,
    at: Annotated[
        str,
        typer.Option(
            metavar="TICK",
            help="Tick or time: 412 or 20.6s. The run resumes from the last checkpoint before it.",
        ),
    ],
    mission: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Mission of the resumed run.", show_default="the same", parser=mission_file
        ),
    ] = None,
    set_: OtherSettings = None,
    faults: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Faults of the resumed run.", show_default="the same", parser=faults_file
        ),
    ] = None,
    no_faults: Annotated[bool, typer.Option("--no-faults", help="Resume without faults.")] = False,
    nominal: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART",
            help="Part that no fault affects, such as gripper, 'joint NAME', 'camera NAME' or 'mass ITEM'.",
        ),
    ] = None,
    noise: Annotated[
        int | None,
        typer.Option(min=1, help="Other sensor noise and planner seeds from TICK on: the variant's number."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for the folder of the new run.", show_default="runs"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print both outcomes as one JSON object.")] = False,
) -> None:
    """Resume a recorded run from a checkpoint with changes, and compare. Exit code 0: the goal is reached; 1:
    it is missed."""
    answer = keep_stdout() if json else None
    settings = parse_parameters(set_ or ())
    from picktree.files import PicktreeError

    if faults is not None and no_faults:
        raise PicktreeError("--faults and --no-faults exclude each other")
    from picktree.analysis import RunChanges, what_if

    parts = tuple(nominal or ())
    changes = RunChanges(mission, None, settings, faults, no_faults, nominal=parts, variant=noise)
    from .progress import run_display

    with run_display() as view:
        found = what_if(log, at, changes=changes, out=out, observers=(view,))
    print_warnings(found.warnings)
    print_answer(answer, found.to_text, found.to_json_text)
    end_with(found.status == "success", found.status)


def resim(
    log: Annotated[
        str, typer.Argument(metavar="LOG|DIR@JOB", help="Log file, run folder, 'last'; or a job of a batch.")
    ],
    until: Annotated[
        str | None, typer.Option(metavar="TICK", help="Tick (412) or time (20.6s) at which the run stops.")
    ] = None,
    mission: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Mission that replaces the recorded one.", parser=mission_file),
    ] = None,
    set_: OtherSettings = None,
    scene: Annotated[str | None, typer.Option(metavar="SCENE", help="Another scene.")] = None,
    faults: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Other faults.", parser=faults_file)
    ] = None,
    no_faults: Annotated[bool, typer.Option("--no-faults", help="No faults.")] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="Another seed.")] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Keep the new log, in a new folder inside DIR.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the comparison as one JSON object.")] = False,
) -> None:
    """Run a recorded run again, from its log alone, and compare. Exit code 0: identical; 1: it differs.

    DIR@JOB is a job of the batch in DIR: by its id or the beginning of it, or by seed=7 or LABEL,seed=7. It
    is run again from what the batch recorded, and its log is put where the batch would have kept it.
    """
    answer = keep_stdout() if json else None
    settings = parse_parameters(set_ or ())
    from picktree.files import PicktreeError

    if faults is not None and no_faults:
        raise PicktreeError("--faults and --no-faults exclude each other")
    if "@" in log and not Path(log).exists():
        changed = until or mission or set_ or scene or faults or no_faults or seed is not None
        _job_again(log, out, answer, alone=not changed)
        return
    from picktree.apps.batch import RESULTS_FILE

    if (Path(log) / RESULTS_FILE).is_file():
        raise PicktreeError(f"{log} is a batch: name one of its jobs, as {log}@seed=7")
    from picktree.analysis import RunChanges, resimulate

    changes = RunChanges(mission, scene, settings, faults, no_faults, seed)
    with StatusLine() as line:

        def progress(now: float, end: float) -> None:
            line.say(f"running again: {now:.1f} of {end:.1f} s")

        found = resimulate(log, changes=changes, until=until, out=out, progress=progress)
    if found.warnings:
        print(found.warnings, file=sys.stderr)
    print_answer(answer, found.to_text, found.to_json_text)
    end_with(found.identical)


def _job_again(where: str, out: Path | None, answer: TextIO | None, *, alone: bool) -> None:
    from picktree.apps.batch import rerun_job
    from picktree.files import PicktreeError

    if not alone:
        raise PicktreeError(
            "a job of a batch is run again without changes: for changes, first get its log by "
            f"resim {where}, then give that log"
        )
    with StatusLine() as line:
        line.say("running it again")
        found = rerun_job(where, out)
    print_answer(answer, found.to_text, found.to_json_text)
    end_with(found.identical)
