"""picktree render"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Annotated

import typer

from ..terminal.output import show


def render(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Mission file.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="PICTURE", help="A .svg, .html, .dot or .txt file; without: text, here."
        ),
    ] = None,
    expand: Annotated[
        bool, typer.Option("--expand", help="Write each sub-tree out wherever it is called.")
    ] = False,
) -> None:
    """Draw a mission: its trees, ports, conditions, and what recovers from which failure."""
    from ...authoring.drawing.chart_builder import chart_of_file
    from ...authoring.drawing.formats.file_formats import drawing_text, suffix_of
    from ...authoring.drawing.formats.text import DEFAULT_COLUMNS, text

    suffix = suffix_of(output.name) if output is not None else ".txt"
    charted = chart_of_file(file)
    if output is None:
        columns = (
            shutil.get_terminal_size((DEFAULT_COLUMNS, 0)).columns if sys.stdout.isatty() else DEFAULT_COLUMNS
        )
        show(text(charted, columns=columns, expand=expand), None)
        return
    show(drawing_text(charted, suffix, expand=expand), output)
    print(output)
