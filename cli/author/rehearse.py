"""picktree rehearse"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from ..terminal.output import keep_stdout, painter


def rehearse(
    mission: Annotated[Path, typer.Argument(metavar="MISSION", help="Mission file.")],
    cases: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Cases file.", show_default="cases/MISSION beside the mission"),
    ] = None,
    case: Annotated[
        list[str] | None, typer.Option("--case", metavar="NAME", help="Only this case; may be repeated.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Verdicts without traces.")] = False,
    full_coverage: Annotated[
        bool, typer.Option("--full-coverage", help="Exit code 1 also when a node or branch is not reached.")
    ] = False,
    causes: Annotated[
        bool, typer.Option("--causes", help="List the declared causes that no case raises.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
) -> None:
    """Rehearse a mission without physics: its leaves answer as the cases say. Exit code 1: a case failed."""
    answer = keep_stdout() if json else None

    from ...authoring.rehearsal.rehearse import rehearse_files
    from ...authoring.rehearsal.verdict.rehearsal_result import to_json_text
    from ...authoring.rehearsal.verdict.rehearsal_text import to_text
    from ...files.diagnostics.fault_rendering import fault_lines

    result = rehearse_files(mission, cases, case or ())
    if result.warnings:
        print(fault_lines(result.warnings, painter(sys.stderr)), file=sys.stderr)
    if answer is None:
        print(to_text(result, quiet=quiet, causes=causes))
    else:
        with answer:
            answer.write(to_json_text(result))
    if not result.passed or (full_coverage and not result.coverage.full):
        raise typer.Exit(1)
