"""All tables of an export."""

from __future__ import annotations

from typing import Any

from . import row_types as rows
from . import table_rows as from_run
from .columns import Table

TABLES: tuple[Table[Any], ...] = (
    Table(
        "run", "a word of the run: what it was started with, and what came of it", rows.RunRow, from_run.about
    ),
    Table("ticks", "a tick of the tree", rows.TickRow, from_run.ticks),
    Table("visits", "an activation of a node, from its beginning to its end", rows.VisitRow, from_run.visits),
    Table("failures", "a failure with a cause, and what became of it", rows.FailureRow, from_run.failures),
    Table("items", "an item, as the robot believed", rows.ItemRow, from_run.items),
    Table("picks", "a closing of the fingers on an object", rows.PickRow, from_run.picks),
    Table("plans", "a request to the planner, and its answer", rows.PlanRow, from_run.plans),
    Table("candidates", "a candidate of a choice that was tried", rows.CandidateRow, from_run.candidates),
    Table("events", "something worth a line", rows.EventRow, from_run.events),
    Table(
        "objects", "an object, each second and whenever the belief changed", rows.ObjectRow, from_run.objects
    ),
    Table("joints", "a joint at a tick", rows.JointRow, from_run.joints),
    Table("wrenches", "the wrist at a tick", rows.WrenchRow, from_run.wrenches),
    Table("controls", "a joint of the arm at a tick, as commanded", rows.ControlRow, from_run.controls),
    Table("timings", "a tick by the wall clock", rows.TimingRow, from_run.timings),
)
"""In the order in which a reader wants them."""
