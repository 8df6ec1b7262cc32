"""Exporting a run: to a folder of tables, or to one file for Rerun."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from ...world.errors import PicktreeError
from ...world.journal import Plain
from ..extras import extra
from ..run import Run
from .columns import Table
from .tables import TABLES

Form: TypeAlias = Literal["csv", "parquet", "rerun"]
_Write: TypeAlias = Callable[[Path, Table[Any], Any], int]


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written. `rows` by file; of a file that is no table, what it holds besides is no number."""

    form: Form
    output: Path
    rows: Mapping[Path, int]
    notes: tuple[str, ...] = ()
    """What the log could not give."""

    def to_text(self) -> str:
        lines = [f"note: {note}" for note in self.notes]
        if self.form == "rerun":
            return "\n".join([*lines, str(self.output)])
        width = max(len(str(path)) for path in self.rows)
        return "\n".join(
            [*lines, *(f"{path!s:<{width}}  {count:>7} rows" for path, count in self.rows.items())]
        )

    def to_json(self) -> dict[str, Plain]:
        return {
            "to": self.form,
            "output": str(self.output.absolute()),
            "tables": {path.stem: count for path, count in self.rows.items()},
            "notes": list(self.notes),
        }


def export(run: Run, form: Form, output: Path) -> Exported:
    """Write the run to `output`: a folder for tables, a file for Rerun.

    Raises PicktreeError when it cannot be written or a library is missing; no half of a file remains.
    """
    notes = tuple(_notes(run))
    if form == "rerun":
        with extra("rerun", "rerun", "An export to Rerun"):
            from .rerun_file import write_rerun
        with _told(output), _whole([output]) as (unfinished,):
            write_rerun(run, unfinished)
        return Exported(form, output, {}, notes)
    write = _writer(form)
    with _told(output):
        output.mkdir(parents=True, exist_ok=True)
        paths = [output / f"{table.name}.{form}" for table in TABLES]
        with _whole(paths) as unfinished:
            counts = [
                write(path, table, table.rows(run)) for path, table in zip(unfinished, TABLES, strict=True)
            ]
    return Exported(form, output, dict(zip(paths, counts, strict=True)), notes)


def _writer(form: Literal["csv", "parquet"]) -> _Write:
    if form == "csv":
        from .csv_file import write_csv

        return write_csv
    with extra("parquet", "pyarrow", "An export to Parquet"):
        from .parquet_file import write_parquet
    return write_parquet


@contextmanager
def _told(output: Path) -> Generator[None]:
    try:
        yield
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise PicktreeError(f"{output} cannot be written: {reason}") from None


@contextmanager
def _whole(paths: list[Path]) -> Generator[list[Path]]:
    """Names beside them to write to; the files take their own names together when all are whole."""
    unfinished = [path.with_name(f".unfinished-{path.name}") for path in paths]
    try:
        yield unfinished
        for path, written in zip(paths, unfinished, strict=True):
            written.replace(path)
    finally:
        for path in unfinished:
            path.unlink(missing_ok=True)


def _notes(run: Run) -> Iterator[str]:
    if run.recovered:
        yield run.recovered
    if run.log.format < 2:
        yield "a log of format 1 has no transitions: what nodes did and how they failed is told in part"
