"""Tables of a batch's results: one declaration for the database, the exports and the documents."""

from __future__ import annotations

from dataclasses import dataclass

from ...analysis.export.tables.row_types import Column, Kind
from .views import VIEWS

VERSION = 3
"""Version of tables and views, in `PRAGMA user_version`."""
_SQL: dict[Kind, str] = {"int": "INTEGER", "float": "REAL", "bool": "INTEGER", "text": "TEXT"}


@dataclass(frozen=True, slots=True)
class TableOf:
    """One table. `key`: columns that identify a row; empty where only its position does."""

    name: str
    meaning: str
    """Meaning of a row."""
    columns: tuple[Column, ...]
    key: tuple[str, ...] = ()
    index: tuple[str, ...] = ()
    """Columns with an index."""

    def to_sql(self) -> str:
        """Return the CREATE statements; their comments remain in the database."""
        declared = [_declared(column, default=self.name == "jobs") for column in self.columns]
        width = max(map(len, declared)) + 1
        lines = [
            f"    {words + ',':<{width}}  -- {column.meaning}" + (f", {column.unit}" if column.unit else "")
            for words, column in zip(declared, self.columns, strict=True)
        ]
        lines += [f"    PRIMARY KEY ({', '.join(self.key)}),"] if self.key else []
        if self.name != "jobs":
            lines.append("    FOREIGN KEY (job) REFERENCES jobs,")
        # The last declaration has no comma.
        last = lines[-1].partition(",  -- ")
        lines[-1] = f"{last[0]}  -- {last[2]}" if last[1] else lines[-1].removesuffix(",")
        made = [f"CREATE TABLE {self.name} (  -- {self.meaning}", *lines, ") STRICT;"]
        made += [f"CREATE INDEX {self.name}_by_{name} ON {self.name} ({name});" for name in self.index]
        return "\n".join(made)


def _text(name: str, meaning: str, *, optional: bool = False) -> Column:
    return Column(name, "text", optional, "", meaning)


def _count(name: str, meaning: str, *, optional: bool = False) -> Column:
    return Column(name, "int", optional, "", meaning)


def _number(name: str, unit: str, meaning: str, *, optional: bool = False) -> Column:
    return Column(name, "float", optional, unit, meaning)


_JOB = _text("job", "id of the job")
TABLES = (
    TableOf(
        "jobs",
        "a job",
        (
            _text("job", "id: hash over everything that the job runs"),
            _count("number", "its place in the plan, from 0"),
            _text("variant", "recipe: what sets it apart from the others of the plan"),
            _text("mission", "path"),
            _text("scene", "name or path; empty: the mission's own"),
            _text("faults", "path; empty: none"),
            _text("settings", "JSON object"),
            _count("seed", "of all its randomness"),
            _text("recipe", "hash of all that it runs but the seed; recipes/HASH.zip holds it"),
            _text("status", "success, incomplete, failure, timeout, paused, crashed; waiting: not yet run"),
            _text("message", "why it failed or crashed, in a sentence"),
            _text("digest", "of all that happened; two equal runs have the same"),
            _count("attempts", "times that a worker tried it"),
            _count("items_total", "true items", optional=True),
            _count("items_sorted", "in the bin where they belong", optional=True),
            _count("items_misplaced", "in another bin", optional=True),
            _count("items_left", "in no bin", optional=True),
            _count("picks_tried", "closings of the fingers on an object", optional=True),
            _count("picks_held", "of these, with the object between them", optional=True),
            _number("sim_seconds", "s", "simulated time", optional=True),
            _number("cpu_seconds", "s", "CPU time", optional=True),
            _number("wall_seconds", "s", "wall time", optional=True),
            _count("last_tick", "number of the last tick in the log", optional=True),
            _text("root_cause", "of the first failure that was not cured"),
            _text("look_at", "one line on what to look at"),
            _text("folder", "of the run with its log, below the batch; empty: not kept"),
        ),
        key=("job",),
    ),
    TableOf(
        "items",
        "a true item, as the scorer found it",
        (
            _JOB,
            _text("item", "name in the simulation"),
            _text("kind", "in the scene's catalogue"),
            _text("form", "box, cylinder, …"),
            _text("colour", "name of the colour"),
            _number("x", "m", "where it lay when it arrived, in the world"),
            _number("y", "m", "where it lay when it arrived, in the world"),
            _number("arrived", "s", "simulated time at which it was there first; 0: at the start"),
            _text("destination", "bin where it belongs", optional=True),
            _text("bin", "where it ended", optional=True),
            _text("verdict", "sorted, misplaced, left"),
        ),
        key=("job", "item"),
    ),
    TableOf(
        "picks",
        "a closing of the fingers, as the robot felt it",
        (
            _JOB,
            _number("time", "s", "simulated"),
            _text("object", "as the robot calls it"),
            Column("held", "bool", False, "", "whether it was between the fingers"),
            _text("node", "path in the tree"),
        ),
        index=("job",),
    ),
    TableOf(
        "failures",
        "a failure, and what became of it",
        (
            _JOB,
            _number("time", "s", "simulated"),
            _text("node", "path in the tree"),
            _text("cause", "as grasp.slipped"),
            _text("message", "in a sentence"),
            _text("item", "that it was about, as the robot calls it"),
            _text("fate", "cured, passed_over, branched, ended, open"),
            _text("handled_by", "handlers that were tried, in order"),
            _number("seconds_lost", "s", "simulated time until its fate was decided", optional=True),
        ),
        index=("job", "cause"),
    ),
    TableOf(
        "episodes",
        "a cause that was seen, what was tried against it, and what came of it",
        (
            _JOB,
            _number("time", "s", "simulated, of its first failure"),
            _text("cause", "as grasp.slipped"),
            _text("node", "path of the node that failed first"),
            _text("item", "that it was about, as the robot calls it"),
            _text("ended", "cured, given_up, unhandled, open"),
            _text("handler", "what was tried last; empty: nothing"),
            _text("tried", "all that was tried, one after the other"),
            _text("by", "path of the node that took it up last; empty: nobody"),
            _count("tries", "runs after the failure that were to succeed"),
            _number("seconds", "s", "simulated time lost"),
        ),
        index=("job", "cause"),
    ),
    TableOf(
        "planted",
        "a fault that was planted in the simulation, and what failed first after it",
        (
            _JOB,
            _number("time", "s", "simulated"),
            _text("fault", "its kind, as slip"),
            _text("message", "in a sentence"),
            _text("item", "name in the simulation; empty: it is about none"),
            _text("cause", "of the first failure after it; empty: nothing failed"),
            _number("after", "s", "from the fault to that failure", optional=True),
            _text("ended", "what became of that failure, as in episodes; empty: nothing failed"),
        ),
        index=("job",),
    ),
    TableOf(
        "plans",
        "a request to the planner",
        (
            _JOB,
            _number("time", "s", "simulated"),
            _text("request", "what was asked for"),
            _text("planner", "that answered"),
            _text("outcome", "found, or why not"),
            _count("checks", "of collisions"),
            _number("thinking", "s", "simulated time that it took"),
            _number("duration", "s", "of the motion"),
        ),
        index=("job",),
    ),
    TableOf(
        "timings",
        "a phase of a job",
        (
            _JOB,
            _text("phase", "observe, think, move, grasp, place, recover, other"),
            _number("seconds", "s", "simulated time spent in it"),
        ),
        key=("job", "phase"),
    ),
    TableOf(
        "crashes",
        "a try at a job that came to no result; of a job that succeeded when it was tried again, too",
        (
            _JOB,
            _count("attempt", "1 for the first"),
            _text("reason", "why it ended, and where it was then"),
            _count("last_tick", "number of the last tick in its log", optional=True),
            _text("folder", "of the run with its log, below the batch; empty: not kept"),
        ),
        key=("job", "attempt"),
    ),
    TableOf(
        "versions",
        "a library that a job was run with",
        (_JOB, _text("library", "name"), _text("version", "of it")),
        key=("job", "library"),
    ),
)
_DEFAULTS = {"status": "DEFAULT 'waiting'", "attempts": "DEFAULT 0"} | dict.fromkeys(
    ("message", "digest", "root_cause", "look_at", "folder"), "DEFAULT ''"
)
"""Defaults of a job that was not run yet."""


def _declared(column: Column, *, default: bool) -> str:
    words = [column.name, _SQL[column.kind], "" if column.optional else "NOT NULL"]
    words.append(_DEFAULTS.get(column.name, "") if default else "")
    return " ".join(word for word in words if word)


def schema() -> str:
    """Return the SQL that creates all tables and views."""
    return "\n".join([*(table.to_sql() for table in TABLES), *(view.to_sql() for view in VIEWS)])
