"""Commands that answer from logs: diff, explain, layout, export, report, replay, runs, snapshot, video."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TextIO

import typer

from .options import JsonAnswer, JsonResult, JsonWritten, Log, Show, View, WithoutTruth, run_log
from .output import StatusLine, end_with, json_text, keep_stdout, painter, print_answer, program

if TYPE_CHECKING:
    from picktree.logs import run_index


def diff(
    a: Annotated[
        str,
        typer.Argument(
            metavar="A", help="Log file, run folder, 'last', or a batch's job: DIR@seed=7.", parser=run_log
        ),
    ],
    b: Annotated[str, typer.Argument(metavar="B", help="The run to compare LOG with.", parser=run_log)],
    json: JsonResult = False,
) -> None:
    """Compare two runs: their divergence and all differences. Exit code 0: they are identical; 1: they
    differ."""
    answer = keep_stdout() if json else None

    from picktree.analysis import Run
    from picktree.analysis.compare import diff as compare
    from picktree.analysis.compare import run_diff

    with Run(a) as one, Run(b) as other:
        found = compare(one, other)
    print_answer(answer, lambda: run_diff.to_text(found), lambda: run_diff.to_json_text(found))
    end_with(found.same)


def explain(
    log: Log,
    everything: Annotated[
        bool, typer.Option("--all", help="Describe each failure and each item separately.")
    ] = False,
    hide_faults: Annotated[
        bool, typer.Option("--hide-faults", help="Do not list the injected faults.")
    ] = False,
    without_truth: WithoutTruth = False,
    prove_it: Annotated[
        bool,
        typer.Option("--prove", help="Continue the run with and without a root cause; print the verdict."),
    ] = False,
    cause: Annotated[
        str,
        typer.Option(metavar="CAUSE", help="Root cause to prove: its number in the output, or its code."),
    ] = "1",
    bound: Annotated[
        float,
        typer.Option(
            metavar="SECONDS", min=1.0, help="Simulated time after the failure that a proof may take."
        ),
    ] = 60.0,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the explanation, or the proof, as one JSON object.")
    ] = False,
) -> None:
    """Explain the end of a run: root causes, failures, items, key moments.

    For a folder with many runs: their root causes, grouped and counted, with a typical run of each.
    """
    answer = keep_stdout() if as_json else None
    if prove_it:
        _prove(log, answer, cause, bound, truth=False if without_truth else None)
        return

    from picktree.analysis.explain import holds_runs

    if holds_runs(log):
        _explain_runs(Path(log), answer, truth=False if without_truth else None)
        return

    from picktree.analysis import Run
    from picktree.analysis.explain import explain as find_out
    from picktree.analysis.explain import to_json_text, to_text

    with Run(log) as run:
        found = find_out(run, faults=not hide_faults, truth=False if without_truth else None)
        print_answer(
            answer,
            lambda: to_text(
                run, found, log, program=program(), paint=painter(sys.stdout), everything=everything
            ),
            lambda: to_json_text(run, found),
        )


def _prove(log: str, answer: TextIO | None, cause: str, bound: float, truth: bool | None) -> None:
    from picktree.analysis import prove

    with StatusLine() as line:
        proof = prove(
            log,
            cause=cause,
            truth=truth,
            bound=bound,
            forecast=lambda costs: print(f"proof: {costs.to_text()}", file=sys.stderr),
            progress=lambda number, now: line.say(f"continuation {number}: {now:.1f} s"),
        )
    print_answer(answer, proof.to_text, proof.to_json_text)


def _explain_runs(folder: Path, answer: TextIO | None, truth: bool | None) -> None:
    from picktree.analysis.explain import explain_runs, runs_json_text, runs_text
    from picktree.apps.batch import dropped_logs

    dropped = dropped_logs(folder, program())
    with StatusLine() as line:
        found = explain_runs(folder, line.say, [dropped] if dropped else [], truth=truth)
    print_answer(
        answer,
        lambda: runs_text(found, program(), painter(sys.stdout)),
        lambda: runs_json_text(found),
    )


def runs(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder whose runs are listed.")] = Path(
        "runs"
    ),
    where: Annotated[
        str | None,
        typer.Option(
            metavar="CONDITION",
            help="Condition on the listed runs, as \"status == 'failure' and lost > 20\".",
        ),
    ] = None,
    keep: Annotated[int, typer.Option(min=0, metavar="N", help="Leave out the N newest runs.")] = 0,
    prune: Annotated[bool, typer.Option("--prune", help="Delete the runs that are listed.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Delete without asking.")] = False,
    json: JsonAnswer = False,
) -> None:
    """List the runs below a folder, newest first: mission, seed, status, items sorted, time lost, cause.

    A condition has the names status, mission, scene, robot, backend, seed, sorted, total, misplaced, held,
    seconds, lost, cause, causes, age (days) and folder.
    """
    answer = keep_stdout() if json else None

    from picktree.files import PicktreeError
    from picktree.logs import line, run_index

    if prune and where is None and not keep:
        raise PicktreeError("--prune deletes the listed runs: choose them with --where CONDITION or --keep N")
    index = run_index.RunIndex(folder)
    found: list[run_index.RunRow] = []
    for number, row in enumerate(index.select(None if where is None else run_index.RunFilter.parse(where))):
        if number < keep:
            continue
        if answer is None:
            print(line(row) if found else f"{run_index.heading()}\n{line(row)}", flush=not found)
        found.append(row)
    refused = _prune(index, found, yes=yes) if prune else []
    for sentence in refused:
        print(sentence, file=sys.stderr)
    if not found and answer is None:
        none = "no run that meets the condition" if where or keep else "no run yet"
        print(f"{folder}: {none}; `picktree run MISSION` makes one")
    if answer is not None:
        with answer:
            answer.write(json_text([row.to_json() for row in found]))
    end_with(not refused)


def _prune(index: run_index.RunIndex, found: Sequence[run_index.RunRow], *, yes: bool) -> list[str]:
    """Delete runs after a confirmation; return reasons of kept runs. Raises PicktreeError without a
    terminal."""
    from picktree.files import PicktreeError

    size = f"{len(found)} runs, {sum(row.size for row in found) / 1e6:.1f} MB"
    if found and not yes:
        if not sys.stdin.isatty():
            raise PicktreeError(
                f"--prune would delete {size}; give --yes when there is no terminal to confirm it"
            )
        if not typer.confirm(f"Delete {size}?", err=True):
            return []
    refused: list[str] = []
    for row in found:
        try:
            index.delete(row)
        except PicktreeError as error:
            refused.append(str(error))
    print(f"{len(found) - len(refused)} of {size} deleted", file=sys.stderr)
    return refused


def layout(
    log: Annotated[
        str | None, typer.Argument(metavar="[LOG]", help="Ignored: one layout fits every log.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="JSON file; without it, text on stdout."),
    ] = None,
) -> None:
    """Write the layout for Foxglove and Lichtblick: scene, tree, plots, images, events."""
    from picktree.analysis.export import LAYOUT_FILE
    from picktree.files import file_system

    text = LAYOUT_FILE.read_text(encoding="utf-8")
    if output is None:
        print(text, end="")
        return
    with file_system.whole([output], output) as (beside,):
        beside.write_text(text, encoding="utf-8")
    print(f"{output}: open it in Lichtblick or Foxglove beside the log")


def export(
    log: Log,
    to: Annotated[
        Literal["csv", "parquet", "rerun"],
        typer.Option("--to", help="Tables as csv or parquet files, or a recording for Rerun."),
    ],
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="PATH", help="Folder for the tables; .rrd file for Rerun."),
    ],
    json: JsonWritten = False,
) -> None:
    """Export a log: tables of ticks, visits, failures, picks, plans, …; or a recording for Rerun."""
    answer = keep_stdout() if json else None

    from picktree.analysis import Run
    from picktree.analysis.export import export as write

    with Run(log) as run:
        written = write(run, to, output)
    print_answer(answer, written.to_text, lambda: json_text(written.to_json()))


def report(
    log: Log,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="PAGE", help="HTML file to write.")],
    open_it: Annotated[bool, typer.Option("--open", help="Open it in the browser.")] = False,
    without_truth: WithoutTruth = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the written file as one JSON object.")
    ] = False,
) -> None:
    """Write a run as one HTML page: 3-D replay, tree, lanes, failures, plots, images. It needs no network."""
    import json

    from picktree.analysis import Run
    from picktree.analysis.report import write_report
    from picktree.files import PicktreeError

    if output.suffix.lower() not in (".html", ".htm"):
        raise PicktreeError(f"{output}: a report is an HTML page; name it {output.with_suffix('.html').name}")
    with Run(log, truth=False if without_truth else None) as run:
        if run.recovered:
            print(run.recovered, file=sys.stderr)
        written = write_report(run, output)
    print(json.dumps(written.to_json()) if as_json else written.to_text())
    if open_it:
        typer.launch(output.absolute().as_uri())


def replay(
    log: Log,
    at: Annotated[
        float, typer.Option(metavar="TIME", min=0.0, help="First displayed time, simulated s.")
    ] = 0.0,
) -> None:
    """Step through a run by commands: ticks, failures, tree, events, belief. `help` lists the commands."""
    from picktree.analysis import Run

    from .command_prompt import line_reader
    from .replay_stepper import ReplayStepper

    with Run(log) as run:
        if run.recovered:
            print(run.recovered, file=sys.stderr)
        stepper = ReplayStepper(run, at, line_reader(sys.stdout), sys.stdout)
        stepper.show_here()
        stepper.converse()


def snapshot(
    log: Log,
    at: Annotated[float, typer.Option(metavar="SECONDS", min=0.0, help="Simulated time.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="PICTURE", help="PNG file to write.")],
    size: Annotated[str, typer.Option(metavar="WxH", help="Size in pixels.")] = "1280x800",
    view: View = "corner",
    show: Show = "belief",
) -> None:
    """Draw the scene at one moment of a run, from its log alone."""
    from picktree.analysis.render import parse_size, parse_view
    from picktree.analysis.render import snapshot as draw
    from picktree.logs import RunLog

    with RunLog(log) as opened:
        if opened.recovered:
            print(opened.recovered, file=sys.stderr)
        draw(opened, at, output, parse_size(size), parse_view(view), show=show)
    print(output)


def video(
    log: Log,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILM", help="A .mp4 or .gif file.")],
    start: Annotated[
        float | None,
        typer.Option(
            "--from",
            metavar="SECONDS",
            min=0.0,
            help="Simulated time.",
            show_default="the beginning of the log",
        ),
    ] = None,
    end: Annotated[
        float | None,
        typer.Option("--to", metavar="SECONDS", help="Simulated time.", show_default="the end of the run"),
    ] = None,
    speed: Annotated[
        float, typer.Option(metavar="TIMES", help="Simulated seconds per second of the film.")
    ] = 1.0,
    fps: Annotated[
        int | None, typer.Option(min=1, max=60, help="Frames in a second.", show_default="20, GIF 10")
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Size in pixels.", show_default="960x600, GIF 640x400")
    ] = None,
    view: View = "corner",
    show: Show = "belief",
    processes: Annotated[
        int | None,
        typer.Option(min=1, help="Drawing processes.", show_default="one per processor, at most 4"),
    ] = None,
    json: JsonWritten = False,
) -> None:
    """Make a film of a run, from its log alone, with captions: running nodes, progress and failures."""
    answer = keep_stdout() if json else None

    from picktree.analysis.render import FilmRequest, film, parse_size, parse_view
    from picktree.logs import RunLog
    from picktree.logs.recording import Interrupts

    request = FilmRequest(
        start=start,
        end=end,
        speed=speed,
        fps=fps,
        size=parse_size(size) if size else None,
        view=parse_view(view),
        show=show,
        processes=processes or min(os.cpu_count() or 1, 4),
    )
    with Interrupts(), RunLog(log) as opened, StatusLine() as line:
        if opened.recovered:
            print(opened.recovered, file=sys.stderr)
        made = film(opened, output, request, _film_progress(line) if line.on else None)
    print_answer(answer, made.to_text, lambda: json_text(made.to_json()))


def _film_progress(line: StatusLine) -> Callable[[int, int], None]:
    """Return a function that shows the number of frames and the remaining time."""
    began = last_report = time.monotonic()

    def tell(done: int, count: int) -> None:
        nonlocal last_report
        now = time.monotonic()
        if now - last_report > 0.3 and done < count:
            last_report = now
            line.say(f"frame {done} of {count}, {(now - began) / done * (count - done):.0f} s left")

    return tell
