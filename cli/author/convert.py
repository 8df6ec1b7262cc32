"""picktree convert"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...errors import PicktreeError


def convert(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A mission, or an XML file.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="OUT", help="Where the other form goes.", show_default="stdout"),
    ] = None,
) -> None:
    """Turn a mission into XML of BehaviorTree.CPP 4 and Groot2, and such XML into a mission."""
    from ...authoring.xml.conversion import convert as converted

    text = converted(file)
    if out is None:
        print(text, end="")
        return
    if out.exists() and out.samefile(file):
        raise PicktreeError(f"{out} is the file that is read; give another one with -o")
    try:
        out.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise PicktreeError(f"{out} cannot be written: {error.strerror or error}") from None
