"""picktree layout"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def layout(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Log file, run folder, or 'last'.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="JSON file; without: text, here.")
    ] = None,
) -> None:
    """Write a layout for Foxglove and Lichtblick, made for this log's tree, joints and cameras."""
    from ...analysis.export.layout.layout import layout as make
    from ...analysis.run import Run
    from ...files.atomic_write import whole

    with Run(log) as run:
        if run.recovered:
            print(run.recovered, file=sys.stderr)
        made = make(run)
    if output is None:
        print(made.to_json_text(), end="")
        return
    with whole([output], output) as (beside,):
        beside.write_text(made.to_json_text(), encoding="utf-8")
    print(f"{output}: {len(made.panels)} panels, {made.lanes} lanes")
