"""picktree snapshot"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def snapshot(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Log file, run folder, or 'last'.")],
    at: Annotated[float, typer.Option(metavar="SECONDS", min=0.0, help="Simulated time.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="PICTURE", help="PNG file to write.")],
) -> None:
    """Draw the scene at one moment of a run, from its log alone."""
    from ..logs.snapshot import snapshot as draw

    draw(log, at, output)
    print(output)
