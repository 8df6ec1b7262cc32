"""Command-line application: the commands, and the conversion of outcomes to exit codes.

0: done. 1: the answer is no. 2: bad input. 3: a fault of picktree. 130: interrupted.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Sequence
from functools import cache
from typing import Annotated

import typer

from ..errors import PicktreeError
from ..files.marks import FileError
from .analyse.commands import diff, explain, export, layout, replay, report, snapshot, video
from .analyse.resim import resim, whatif
from .author.commands import check, convert, explain_code, nodes, rehearse, render, schema
from .author.new import new
from .batch.commands import batch
from .commission import calibrate, plan, robot
from .run.run import run
from .terminal.output import painter

app = typer.Typer(
    help="Behaviour-tree missions for robot arms: run them in simulation, look into their logs.",
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,  # importing rich would triple the time of --help
    pretty_exceptions_enable=False,
)
app.add_typer(batch, name="batch")
app.command()(calibrate)
app.command()(check)
app.command()(convert)
app.command()(diff)
app.command()(explain)
app.command()(explain_code)
app.command()(export)
app.command()(layout)
app.command()(new)
app.command()(nodes)
app.command()(plan)
app.command()(rehearse)
app.command()(render)
app.command()(replay)
app.command()(report)
app.command()(resim)
app.add_typer(robot, name="robot")
app.command()(run)
app.command()(schema)
app.command()(snapshot)
app.command()(video)
app.command()(whatif)


def _show_version(wanted: bool) -> None:
    if wanted:
        from .. import __version__

        print(f"picktree {__version__}")
        raise typer.Exit


@app.callback()
def _picktree(  # pyright: ignore[reportUnusedFunction] - typer calls it
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None: ...


@cache
def _command() -> Callable[..., object]:
    """Build the commands with all their options, once in a process."""
    return typer.main.get_command(app)


def _error_text(error: PicktreeError) -> str:
    if not isinstance(error, FileError):
        return str(error)
    from ..files.diagnostics.fault_rendering import fault_lines

    return fault_lines(error.faults, painter(sys.stderr))


def answer(arguments: Sequence[str]) -> int:
    """Run one command line and return the exit code."""
    try:
        _command()(args=list(arguments), prog_name="picktree")
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    except PicktreeError as error:
        print(_error_text(error), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except Exception:  # noqa: BLE001 - the border to the shell: a fault of ours is exit code 3
        traceback.print_exc()
        print(
            "This is a fault of picktree, not of your input; please report it with the lines above.",
            file=sys.stderr,
        )
        return 3
    return 0
