"""Command-line application: the commands, and the conversion of outcomes to exit codes.

0: done. 1: the answer is no. 2: bad input. 3: a fault of picktree. 130: interrupted.
"""

from __future__ import annotations

import logging
import os
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from inspect import cleandoc
from typing import Annotated, Any, cast

import typer
from typer.core import TyperCommand, TyperGroup

from picktree.files import FileError, PicktreeError, file_system

from . import run as run_command
from .analyse_commands import diff, explain, export, layout, replay, report, runs, snapshot, video
from .attach import attach
from .author_commands import check, explain_code, lsp, nodes, rehearse, render, schema
from .batch_commands import batch
from .cache import cache
from .commission import calibrate, cell, plan, robot
from .convert import convert
from .new import new
from .options import HelpGroups, grouped_command
from .output import painter
from .resim import resim, whatif
from .run import run
from .studio import studio

COMMANDS: Mapping[str, Callable[..., None] | typer.Typer] = {
    "attach": attach,
    "calibrate": calibrate,
    "cell": cell,
    "check": check,
    "convert": convert,
    "diff": diff,
    "explain": explain,
    "explain-code": explain_code,
    "export": export,
    "layout": layout,
    "new": new,
    "lsp": lsp,
    "nodes": nodes,
    "plan": plan,
    "rehearse": rehearse,
    "render": render,
    "replay": replay,
    "report": report,
    "resim": resim,
    "run": run,
    "runs": runs,
    "schema": schema,
    "snapshot": snapshot,
    "studio": studio,
    "video": video,
    "whatif": whatif,
    "batch": batch,
    "robot": robot,
    "cache": cache,
}
"""Commands and groups of commands by name, in the order of the help."""
HELP_GROUPS: Mapping[str, HelpGroups] = {"run": run_command.HELP_GROUPS}
"""Groups of options in the help of commands that have many."""


class _Group(TyperGroup):
    """Group that builds only the called command: all commands would take as long as the rest of the start.
    For its help, and to find the nearest name, it has commands without options."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        for name, made in COMMANDS.items():
            text = made.info.help if isinstance(made, typer.Typer) else made.__doc__
            self.add_command(TyperCommand(name, help=cleandoc(text or "")))

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        name, command, rest = super().resolve_command(ctx, args)
        return name, command if name is None else _built(name), rest


def _built(name: str) -> Callable[..., Any]:
    alone, made = _typer(), COMMANDS[name]
    if isinstance(made, typer.Typer):
        alone.add_typer(made, name=name)
        return cast("TyperGroup", typer.main.get_command(alone)).commands[name]
    alone.command(name, cls=grouped_command(groups) if (groups := HELP_GROUPS.get(name)) else None)(made)
    return typer.main.get_command(alone)


def _typer(**options: Any) -> typer.Typer:
    return typer.Typer(
        add_completion=False,
        rich_markup_mode=None,  # importing rich would triple the time of --help
        pretty_exceptions_enable=False,
        **options,
    )


app = _typer(
    help="Behaviour-tree missions for robot arms: run them in simulation, look into their logs.",
    no_args_is_help=True,
    cls=_Group,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from picktree import __version__

        print(f"picktree {__version__}")
        raise typer.Exit


@app.callback()
def _picktree(  # pyright: ignore[reportUnusedFunction] - typer calls it
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None: ...


@lru_cache
def _command() -> Callable[..., object]:
    """Build the application, once in a process."""
    return typer.main.get_command(app)


def _error_text(error: PicktreeError) -> str:
    if not isinstance(error, FileError):
        return str(error)
    from picktree.files import fault_lines

    return fault_lines(error.faults, painter(sys.stderr))


def _require_utf8(arguments: Sequence[str]) -> None:
    """Raise PicktreeError when an argument or the current folder is not in UTF-8."""
    for argument in arguments:
        file_system.require_utf8(argument)
    with suppress(FileNotFoundError):  # the current folder was deleted
        file_system.require_utf8(os.getcwd())


class _StderrHandler(logging.Handler):
    """Handler that writes messages to the present stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        print(self.format(record), file=sys.stderr, flush=True)


def _report_slow_work() -> None:
    """Send reports of slow file reading to stderr."""
    reading = logging.getLogger("picktree.world")
    if not reading.handlers:
        reading.addHandler(_StderrHandler())
        reading.setLevel(logging.INFO)
        reading.propagate = False  # the studio has a handler for all


def answer(arguments: Sequence[str]) -> int:
    """Run one command line and return the exit code."""
    _report_slow_work()
    try:
        _require_utf8(arguments)
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
