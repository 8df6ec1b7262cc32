"""Export of a run: to a folder of tables, or to one file for Rerun."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Literal, TypeAlias, TypeVar

from ...files.atomic_write import whole
from ...logs.optional_libraries import optional_import
from ...world.journal import Plain
from ..run import Run
from . import row_types, table_rows
from .table_files import Column, cells, columns, counts_text, write_tables

R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class TableSpec(Generic[R]):
    """Table; `row` is a dataclass whose fields are its columns."""

    name: str
    meaning: str
    """Meaning of a row."""
    row: type[R]
    rows: Callable[[Run], Iterable[R]]

    @property
    def columns(self) -> tuple[Column, ...]:
        return columns(self.row)


TABLES: tuple[TableSpec[Any], ...] = (
    TableSpec(
        "run",
        "a word of the run: what it was started with, and what came of it",
        row_types.RunRow,
        table_rows.run_rows,
    ),
    TableSpec("ticks", "a tick of the tree", row_types.TickRow, table_rows.ticks),
    TableSpec(
        "visits",
        "an activation of a node, from its beginning to its end",
        row_types.VisitRow,
        table_rows.visits,
    ),
    TableSpec(
        "failures", "a failure with a cause, and what became of it", row_types.FailureRow, table_rows.failures
    ),
    TableSpec("items", "an item, as the robot believed", row_types.ItemRow, table_rows.items),
    TableSpec("picks", "a closing of the fingers on an object", row_types.PickRow, table_rows.picks),
    TableSpec("plans", "a request to the planner, and its answer", row_types.PlanRow, table_rows.plans),
    TableSpec(
        "candidates", "a candidate of a choice that was tried", row_types.CandidateRow, table_rows.candidates
    ),
    TableSpec("events", "something worth a line", row_types.EventRow, table_rows.events),
    TableSpec(
        "objects",
        "an object, each second and whenever the belief changed",
        row_types.ObjectRow,
        table_rows.objects,
    ),
    TableSpec("joints", "a joint at a tick", row_types.JointRow, table_rows.joints),
    TableSpec("wrenches", "the wrist at a tick", row_types.WrenchRow, table_rows.wrenches),
    TableSpec(
        "controls", "a joint of the arm at a tick, as commanded", row_types.ControlRow, table_rows.controls
    ),
    TableSpec("timings", "a tick by the wall clock", row_types.TimingRow, table_rows.timings),
)
"""Tables in the order of interest for a reader."""


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
        with whole([output], output) as (beside,):
            write_rerun(run, beside)
        return Exported(form, output, {}, notes)
    counts = write_tables(form, output, TABLES, lambda table: map(cells, table.rows(run)))
    return Exported(form, output, counts, notes)


def _notes(run: Run) -> Iterator[str]:
    if run.recovered:
        yield run.recovered
    if run.log.format < 2:
        yield "a log of format 1 has no transitions: what nodes did and how they failed is told in part"
