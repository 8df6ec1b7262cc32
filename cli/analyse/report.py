"""picktree report"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def report(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Log file, run folder, or 'last'.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="PAGE", help="HTML file to write.")],
    open_it: Annotated[bool, typer.Option("--open", help="Open it in the browser.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Say what was written as one JSON object.")] = False,
) -> None:
    """Write a run as one HTML page: 3-D replay, tree, lanes, failures, plots, images. It needs no network."""
    import json

    from ...analysis.report.report import write_report
    from ...analysis.run import Run
    from ...errors import PicktreeError

    if output.suffix.lower() not in (".html", ".htm"):
        raise PicktreeError(f"{output}: a report is an HTML page; name it {output.with_suffix('.html').name}")
    with Run(log) as run:
        written = write_report(run, output)
    print(json.dumps(written.to_json()) if as_json else written.to_text())
    if open_it:
        typer.launch(output.absolute().as_uri())
