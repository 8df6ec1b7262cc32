"""Export of a run's log as tables (csv, Parquet) or as a Rerun recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from picktree.analysis import Run
from picktree.files import file_system
from picktree.logs import optional_import
from picktree.world import Plain

from .run_tables import TABLES
from .table_files import cells, counts_text, write_tables

Form: TypeAlias = Literal["csv", "parquet", "rerun"]


@dataclass(frozen=True, slots=True)
class Exported:
    """Written files. `rows` is the number of rows by file, only for tables."""

    form: Form
    output: Path
    rows: Mapping[Path, int]
    notes: tuple[str, ...] = ()
    """Sentences about data that the log lacks."""

    def to_text(self) -> str:
        lines = [f"note: {note}" for note in self.notes]
        if self.form == "rerun":
            return "\n".join([*lines, str(self.output)])
        return "\n".join([*lines, counts_text(self.rows, 7)])

    def to_json(self) -> dict[str, Plain]:
        return {
            "to": self.form,
            "output": str(self.output.absolute()),
            "tables": {path.stem: count for path, count in self.rows.items()},
            "notes": list(self.notes),
        }


def export(run: Run, form: Form, output: Path) -> Exported:
    """Write the run to `output`: a folder for tables, a file for Rerun.

    Raises PicktreeError when it cannot be written or a library is missing; no partial file remains.
    """
    notes = tuple(_notes(run))
    if form == "rerun":
        with optional_import("rerun", "rerun", "An export to Rerun"):
            from .rerun_recording import write_rerun
        with file_system.whole([output], output) as (beside,):
            write_rerun(run, beside)
        return Exported(form, output, {}, notes)
    counts = write_tables(form, output, TABLES, lambda table: map(cells, table.rows(run)))
    return Exported(form, output, counts, notes)


def _notes(run: Run) -> Iterator[str]:
    if run.recovered:
        yield run.recovered
