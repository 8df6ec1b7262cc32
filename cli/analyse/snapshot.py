"""picktree snapshot"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer


def snapshot(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Log file, run folder, or 'last'.")],
    at: Annotated[float, typer.Option(metavar="SECONDS", min=0.0, help="Simulated time.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="PICTURE", help="PNG file to write.")],
    size: Annotated[str, typer.Option(metavar="WxH", help="In pixels.")] = "1280x800",
    view: Annotated[
        str,
        typer.Option(
            metavar="VIEW",
            help="corner, front, left, right, top, close, or AZIMUTH,ELEVATION,DISTANCE (degrees, metres).",
        ),
    ] = "corner",
    show: Annotated[
        Literal["belief", "truth", "both"],
        typer.Option(help="What the robot believes, what is true, or both: the truth as outlines."),
    ] = "belief",
) -> None:
    """Draw the scene at one moment of a run, from its log alone."""
    from ...analysis.render.snapshot import snapshot as draw
    from ...analysis.render.viewpoint import parse_size, parse_view
    from ...logs.run_log import RunLog

    with RunLog(log) as opened:
        if opened.recovered:
            print(opened.recovered, file=sys.stderr)
        draw(opened, at, output, parse_size(size), parse_view(view), show=show)
    print(output)
