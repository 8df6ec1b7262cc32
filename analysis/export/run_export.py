"""Export of a run: to a folder of tables, or to one file for Rerun."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from ...files.atomic_write import whole
from ...logs.optional_libraries import optional_import
from ...world.journal import Plain
from ..run import Run
from .tables import row_types, table_rows
from .tables.row_types import TableSpec

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
_Write: TypeAlias = Callable[[Path, TableSpec[Any], Any], int]


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

    Raises PicktreeError when it cannot be written or a library is missing; no partial file remains.
    """
    notes = tuple(_notes(run))
    if form == "rerun":
        with optional_import("rerun", "rerun", "An export to Rerun"):
            from .rerun.recording import write_rerun
        with whole([output], output) as (beside,):
            write_rerun(run, beside)
        return Exported(form, output, {}, notes)
    write = _writer(form)
    paths = [output / f"{table.name}.{form}" for table in TABLES]
    with whole(paths, output) as beside:
        output.mkdir(parents=True, exist_ok=True)
        counts = [write(path, table, table.rows(run)) for path, table in zip(beside, TABLES, strict=True)]
    return Exported(form, output, dict(zip(paths, counts, strict=True)), notes)


def _writer(form: Literal["csv", "parquet"]) -> _Write:
    if form == "csv":
        from .tables.csv_file import write_csv

        return write_csv
    with optional_import("parquet", "pyarrow", "An export to Parquet"):
        from .tables.parquet_file import write_parquet
    return write_parquet


def _notes(run: Run) -> Iterator[str]:
    if run.recovered:
        yield run.recovered
    if run.log.format < 2:
        yield "a log of format 1 has no transitions: what nodes did and how they failed is told in part"
