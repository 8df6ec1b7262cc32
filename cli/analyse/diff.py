"""picktree diff"""

from __future__ import annotations

from typing import Annotated

import typer

from ..terminal.output import keep_stdout


def diff(
    a: Annotated[str, typer.Argument(metavar="A", help="Log file, a run's folder, or `last`.")],
    b: Annotated[str, typer.Argument(metavar="B", help="The run that it is compared with.")],
    json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
) -> None:
    """Where two runs part, and in what they differ. Exit code 0: they are identical; 1: they differ."""
    answer = keep_stdout() if json else None

    from ...analysis.compare.diff import diff as compare
    from ...analysis.compare.diff_text import to_json_text, to_text
    from ...analysis.run import Run

    with Run(a) as one, Run(b) as other:
        found = compare(one, other)
    if answer is None:
        print(to_text(found))
    else:
        with answer:
            answer.write(to_json_text(found))
    if not found.same:
        raise typer.Exit(1)
