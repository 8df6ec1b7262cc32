"""picktree export"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from ..terminal.output import keep_stdout


def layout(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Log file, run folder, or 'last'.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="JSON file; without: text, here.")
    ] = None,
) -> None:
    """Write a layout for Foxglove and Lichtblick, made for this log's tree, joints and cameras."""
    from ...analysis.export.layout import layout as make
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


def export(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Log file, run folder, or 'last'.")],
    to: Annotated[
        Literal["csv", "parquet", "rerun"],
        typer.Option("--to", help="Tables as csv or parquet files, or a recording for Rerun."),
    ],
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="PATH", help="Folder for the tables; .rrd file for Rerun."),
    ],
    json: Annotated[bool, typer.Option("--json", help="Print what was written as one JSON object.")] = False,
) -> None:
    """Export a log: tables of ticks, visits, failures, picks, plans, …; or a recording for Rerun."""
    answer = keep_stdout() if json else None
    import json as encoding

    from ...analysis.export.run_export import export as write
    from ...analysis.run import Run

    with Run(log) as run:
        written = write(run, to, output)
    if answer is None:
        print(written.to_text())
    else:
        with answer:
            answer.write(encoding.dumps(written.to_json(), ensure_ascii=False, indent=2) + "\n")
