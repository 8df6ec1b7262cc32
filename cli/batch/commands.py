"""picktree batch"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from ...errors import PicktreeError
from ..options import JsonWritten
from ..terminal.output import StatusLine, end_with, keep_stdout, print_answer, program
from .run import run

batch = typer.Typer(help="Run many jobs, and ask what came of them.", no_args_is_help=True)
batch.command()(run)
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="The batch's folder.")]


@batch.command()
def query(
    folder: Folder,
    sql: Annotated[str, typer.Argument(metavar="SQL", help="A SELECT on the tables and views.")],
    json: Json = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """Answer a question in SQL. docs/batches.md lists tables and views."""
    if json and csv:
        raise PicktreeError("--json and --csv exclude each other")
    from ...batch.results.store import RESULTS_FILE, Store

    with Store(folder / RESULTS_FILE) as store:
        table = store.query(sql)
    if json:
        print(table.to_json_text(), end="")
    elif csv:
        print(table.to_csv(), end="")
    else:
        print(table.to_text())


@batch.command()
def summary(
    folder: Folder,
    json: Json = False,
) -> None:
    """Success with intervals, picks an hour, causes, and the worst jobs."""
    from ...batch.results.store import RESULTS_FILE, Store
    from ...batch.statistics.summary import summarise

    with Store(folder / RESULTS_FILE) as store:
        found = summarise(store)
    print(found.to_json_text() if json else f"{found.to_text()}\n", end="")


@batch.command()
def report(
    folder: Folder,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="HTML file to write.")],
    runs: Annotated[
        int,
        typer.Option(min=0, help="Of how many of the worst runs a report is made, where their log was kept."),
    ] = 5,
) -> None:
    """Write the batch as one page: rates with intervals, where the time goes, causes, the worst runs."""
    from ...batch.report import write_report

    write_report(folder, output, runs)
    print(output)


@batch.command()
def export(
    folder: Folder,
    to: Annotated[Literal["csv", "parquet"], typer.Option("--to", help="Form of the files.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FOLDER", help="Folder for the files, one a table.")
    ],
    json: JsonWritten = False,
) -> None:
    """Write every table as a CSV or Parquet file, for pandas, DuckDB or a spreadsheet."""
    from ...batch.results.store import RESULTS_FILE, Store
    from ...batch.results.store import export as write

    with Store(folder / RESULTS_FILE) as store:
        written = write(store, to, output)
    print(written.to_json_text() if json else f"{written.to_text()}\n", end="")


@batch.command()
def compare(
    a: Annotated[str, typer.Argument(metavar="A", help="A batch's folder, or FOLDER@RECIPE.")],
    b: Annotated[str, typer.Argument(metavar="B", help="Another.")],
    partings: Annotated[
        int, typer.Option(min=0, help="For how many of the seeds that changed sides to tell where they part.")
    ] = 3,
    remake: Annotated[
        bool, typer.Option("--remake", help="Run jobs again for that whose logs were not kept.")
    ] = False,
    unpaired: Annotated[
        bool, typer.Option("--unpaired", help="As independent runs, though they share seeds.")
    ] = False,
    json: Json = False,
) -> None:
    """Compare two recipes, paired by seed where they share them. Exit code 1: they differ by more than chance
    explains."""
    from ...batch.statistics.comparison import compare_recipes
    from ...batch.statistics.comparison_text import json_text_of, text_of, with_divergences
    from ...batch.statistics.differences import read_recipe

    answer = keep_stdout() if json else None
    recipes = read_recipe(a), read_recipe(b)
    with StatusLine() as line:
        found = with_divergences(
            compare_recipes(*recipes, unpaired=unpaired),
            *recipes,
            partings,
            remake=remake,
            say=lambda what: line.say(f"running it again: {what}"),
        )
    print_answer(answer, lambda: text_of(found, program()), lambda: json_text_of(found))
    end_with(not found.differ)
