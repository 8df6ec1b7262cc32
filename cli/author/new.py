"""picktree new"""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Annotated, Literal

import typer

from ..terminal.output import program


def new(
    kind: Annotated[Literal["mission", "scene", "plugin"], typer.Argument(help="What is begun.")],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where; made where there is none.")],
) -> None:
    """Write a commented start that passes all checks: a mission, a scene, or a skill of one's own."""
    from .starter_files import STARTS, write_start

    written = write_start(kind, folder)
    widest = max(len(part.name) for part in written)
    print(f"written to {folder}:")
    for part in written:
        print(f"  {part.name.ljust(widest)}  {part.doc}")
    print("what to type next:")
    for command in STARTS[kind].commands:
        print(f"  {program()} {_typed(command, folder)}")


def _typed(command: str, folder: Path) -> str:
    """The command with the folder in it, as a shell takes it; relative to where the user is."""
    inside = "" if folder.resolve() == Path.cwd() else f"{folder}{os.sep}"
    known = {"{.}": str(folder)}
    if (folder / "mission.yaml").exists():
        known["MISSION"] = f"{inside}mission.yaml"
    return shlex.join(known.get(word, word.replace("{}", inside)) for word in command.split())
