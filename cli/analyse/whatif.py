"""picktree whatif"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..run.run import parse_parameters
from ..terminal.output import keep_stdout, painter

if TYPE_CHECKING:
    from ..terminal.progress import RunDisplay


def whatif(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Log file, run folder, or 'last'.")],
    at: Annotated[
        str,
        typer.Option(metavar="TICK", help="It goes on from the last checkpoint by then: 412 or 20.6s."),
    ],
    mission: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The mission from there on.", show_default="the same")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="Other parameter of the mission.")
    ] = None,
    faults: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Faults from there on.", show_default="the same")
    ] = None,
    no_faults: Annotated[bool, typer.Option("--no-faults", help="No faults from there on.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where the new run's folder is made.", show_default="runs"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print both outcomes as one JSON object.")] = False,
) -> None:
    """Let a recorded run go on from a checkpoint with something changed, and compare. Exit code 0: the goal
    is reached; 1: it is missed."""
    answer = keep_stdout() if json else None
    settings = parse_parameters(set_ or ())
    from ...errors import PicktreeError

    if faults is not None and no_faults:
        raise PicktreeError("--faults and --no-faults exclude each other")
    from ...analysis.resim.changes import RunChanges
    from ...analysis.resim.whatif import what_if

    changes = RunChanges(mission, None, settings, faults, no_faults)
    with _view() as view:
        found = what_if(log, at, changes=changes, out=out, watcher=view)
    if found.warnings:
        from ...files.diagnostics.fault_rendering import fault_lines

        print(fault_lines(found.warnings, painter(sys.stderr)), file=sys.stderr)
    if answer is None:
        print(found.to_text())
    else:
        with answer:
            answer.write(found.to_json_text())
    if found.status == "interrupted":
        raise typer.Exit(130)
    if found.status != "success":
        raise typer.Exit(1)


def _view() -> RunDisplay:
    from rich.console import Console

    from ..terminal.progress import LinesDisplay, LiveDisplay

    console = Console(stderr=True, highlight=False)
    return LiveDisplay(console) if console.is_terminal else LinesDisplay(console)
