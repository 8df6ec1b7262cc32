"""picktree explain"""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from ..terminal.output import keep_stdout, painter, program


def explain(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Log file, run folder, or 'last'.")],
    everything: Annotated[
        bool, typer.Option("--all", help="Tell each failure and each item by itself.")
    ] = False,
    hide_faults: Annotated[
        bool, typer.Option("--hide-faults", help="Do not quote faults that were planted in the simulation.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the explanation as one JSON object.")
    ] = False,
) -> None:
    """Say why a run ended as it did: root causes, failures, items, and what to look at."""
    answer = keep_stdout() if as_json else None

    from ...analysis.explain.explain import explain as find_out
    from ...analysis.explain.text.rendering import to_json_text, to_text
    from ...analysis.run import Run

    with Run(log) as run:
        found = find_out(run, faults=not hide_faults)
        if answer is not None:
            with answer:
                answer.write(to_json_text(run, found))
            return
        paint = painter(sys.stdout)
        print(to_text(run, found, log, program=program(), paint=paint, everything=everything))
