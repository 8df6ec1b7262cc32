"""Tables of a batch's results and SQL views on them: one declaration for the database, exports, documents."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import TypeAdapter, ValidationError

from picktree.analysis.explain import FailureStory
from picktree.analysis.export import columns, row_type, table_files
from picktree.files import PicktreeError
from picktree.logs import ACTIVITIES, Assist, FigureCounts, RunStatus
from picktree.world import Plan, event_types

CELL_SIZE = 0.05
"""Side of a cell of the table, m."""
_CELL_OFFSET = 1000
"""Offset larger than any cell number: SQLite's cast rounds towards zero, so numbers must be positive."""


def cell_of(coordinate: str) -> str:
    """Return SQL for the number of a coordinate's cell. 1e-9: 0.3 / 0.05 is a little less than 6."""
    return f"(CAST({coordinate} / {CELL_SIZE} + 1e-9 + {_CELL_OFFSET} AS INTEGER) - {_CELL_OFFSET})"


@dataclass(frozen=True, slots=True)
class SqlView:
    name: str
    question: str
    sql: str
    """Statement that creates the view."""


def _read_views() -> tuple[SqlView, ...]:
    text = (Path(__file__).parent / "views.sql").read_text(encoding="utf-8")
    found = re.finditer(r"^CREATE VIEW (\w+) AS  -- (.*)\n[^;]*;", text, re.MULTILINE)
    return tuple(SqlView(view[1], view[2], view[0]) for view in found)


VIEWS = _read_views()
VERSION = 4
"""Version of tables and views, in `PRAGMA user_version`."""
Phase: TypeAlias = Literal["observe", "think", "move", "grasp", "place", "recover", "other"]
JobStatus: TypeAlias = RunStatus | Literal["crashed"]
"""End of a job: that of its run, or `crashed` when every attempt was without a result."""
Time: TypeAlias = Annotated[float, table_files.ColumnDoc("simulated time", "s")]
Node: TypeAlias = Annotated[str, table_files.ColumnDoc("path of the node in the tree")]
Cause: TypeAlias = Annotated[str, table_files.ColumnDoc("cause, such as grasp.slipped")]
Message: TypeAlias = Annotated[str, table_files.ColumnDoc("sentence about it")]
Item: TypeAlias = Annotated[str, table_files.ColumnDoc("object concerned, by the robot's name")]
Position: TypeAlias = Annotated[
    float, table_files.ColumnDoc("place of the item's arrival, in the world", "m")
]
Folder: TypeAlias = Annotated[
    str,
    table_files.ColumnDoc(
        "folder of the run with its log, relative to the batch's folder; empty when not kept"
    ),
]
LastTick: TypeAlias = Annotated[int | None, table_files.ColumnDoc("number of the last tick in the log")]


@dataclass(frozen=True, slots=True)
class JobItemRow:
    item: Annotated[str, table_files.ColumnDoc("name in the simulation")]
    kind: Annotated[str, table_files.ColumnDoc("kind in the scene's catalogue")]
    form: Annotated[str, table_files.ColumnDoc("box, cylinder, …")]
    colour: Annotated[str, table_files.ColumnDoc("name of the colour")]
    x: Position
    y: Position
    arrived: Annotated[
        float,
        table_files.ColumnDoc(
            "simulated time at which the item appears; 0 when it is there from the start", "s"
        ),
    ]
    destination: Annotated[str | None, table_files.ColumnDoc("bin of its destination")]
    bin: Annotated[str | None, table_files.ColumnDoc("bin in which the item ended")]
    verdict: Annotated[
        Literal["sorted", "misplaced", "left", "no destination"],
        table_files.ColumnDoc("sorted, misplaced, left, no destination"),
    ]


@dataclass(frozen=True, slots=True)
class JobPickRow(row_type(event_types.PickEvent, "time object held node", node=Node)):
    """Closing of the fingers on an object."""


@dataclass(frozen=True, slots=True)
class JobFailureRow(
    row_type(
        FailureStory,
        "time node cause message item fate handled_by seconds_lost",
        handled_by=Annotated[str, table_files.ColumnDoc("attempted handlers, in order")],
        seconds_lost=Annotated[
            float | None,
            table_files.ColumnDoc(
                "simulated time that the episode lost, at its first failure; 0 at its later failures", "s"
            ),
        ],
    )
):
    """Failure, and its outcome."""


_Ended: TypeAlias = Annotated[
    event_types.End | Literal[""],
    table_files.ColumnDoc("outcome of the episode: cured, done_instead, given_up, unhandled or open"),
]


@dataclass(frozen=True, slots=True)
class EpisodeRow(
    row_type(
        event_types.EpisodeEvent,
        "time cause node item ended handler tried by tries seconds",
        time=Annotated[float, table_files.ColumnDoc("simulated time of the first failure", "s")],
        node=Annotated[str, table_files.ColumnDoc("path of the first failing node")],
        ended=_Ended,
        handler=Annotated[str, table_files.ColumnDoc("name of the last cure; empty without an attempt")],
        tried=Annotated[str, table_files.ColumnDoc("names of the cures that ran, in order")],
    )
):
    """Episode of a cause, with its cures and its outcome."""


@dataclass(frozen=True, slots=True)
class PlantedRow(
    row_type(
        event_types.FaultOutcomeEvent,
        "time fault message item cause after ended",
        message=Message,
        ended=_Ended,
    )
):
    """Injected fault, and the first failure after it."""


@dataclass(frozen=True, slots=True)
class JobPlanRow(row_type(Plan, "time request planner outcome checks thinking duration")):
    """Request to the planner."""


@dataclass(frozen=True, slots=True)
class JobTimingRow:
    phase: Annotated[Phase, table_files.ColumnDoc("observe, think, move, grasp, place, recover, other")]
    seconds: Annotated[float, table_files.ColumnDoc("simulated time spent in the phase", "s")]


@dataclass(frozen=True, slots=True)
class FigureRow:
    """Counts of the operators' figures of a job."""

    units: Annotated[int, table_files.ColumnDoc("number of items at their destination, as scored")]
    entered: Annotated[int, table_files.ColumnDoc("number of items that were grasped or failed")]
    first_pass: Annotated[
        int, table_files.ColumnDoc("number of units without a grasp in vain and without a failure")
    ]
    set_aside: Annotated[int, table_files.ColumnDoc("number of items set aside")]
    given_up: Annotated[int, table_files.ColumnDoc("number of items given up")]
    misplaced: Annotated[int, table_files.ColumnDoc("number of misplaced items, without crushed ones")]
    crushed: Annotated[int, table_files.ColumnDoc("number of crushed items")]
    answers: Annotated[int, table_files.ColumnDoc("number of answers of a person")]
    pauses: Annotated[int, table_files.ColumnDoc("number of pauses by a person")]
    take_overs: Annotated[int, table_files.ColumnDoc("number of missions or values that a person put in")]
    exchanges: Annotated[int, table_files.ColumnDoc("number of bins exchanged by hand")]
    moving: Annotated[float, table_files.ColumnDoc("simulated time in which arm or fingers move", "s")]
    thinking: Annotated[float, table_files.ColumnDoc("simulated time in which they rest to think", "s")]
    feed: Annotated[float, table_files.ColumnDoc("simulated time of waiting for the feed", "s")]
    recovering: Annotated[float, table_files.ColumnDoc("simulated time in handlers of failures", "s")]
    person: Annotated[float, table_files.ColumnDoc("simulated time of waiting for a person", "s")]

    @classmethod
    def of(cls, counts: FigureCounts) -> FigureRow:
        values: dict[str, Any] = {name: getattr(counts, name) for name in _COUNTS}
        values |= {column: counts.assists.get(kind, 0) for kind, column in _ASSISTS.items()}
        values |= {use: round(counts.activities.get(use, 0.0), 6) for use in ACTIVITIES}
        return cls(**values)

    def counts(self, seconds: float, times: tuple[float, ...]) -> FigureCounts:
        """Return the counts; `seconds`: duration of the run, `times`: time to done of each unit, simulated
        s."""
        return FigureCounts(
            seconds=seconds,
            **{name: getattr(self, name) for name in _COUNTS},
            assists={kind: n for kind, column in _ASSISTS.items() if (n := getattr(self, column))},
            activities={use: spent for use in ACTIVITIES if (spent := getattr(self, use))},
            times=times,
        )


_COUNTS = ("units", "entered", "first_pass", "set_aside", "given_up", "misplaced", "crushed")
_ASSISTS: Mapping[Assist, str] = {
    "answer": "answers",
    "pause": "pauses",
    "take_over": "take_overs",
    "exchange": "exchanges",
}
"""Columns of `FigureRow` by the kind of assist."""


@dataclass(frozen=True, slots=True)
class TimeToDoneRow:
    unit: Annotated[int, table_files.ColumnDoc("number of the unit, from 0, as the robot believes")]
    seconds: Annotated[
        float, table_files.ColumnDoc("simulated time from the end of the unit before to its own", "s")
    ]


@dataclass(frozen=True, slots=True)
class CrashRow:
    attempt: Annotated[int, table_files.ColumnDoc("number of the attempt, from 1")]
    reason: Annotated[
        str, table_files.ColumnDoc("reason of the attempt's end, and the node or line at that time")
    ]
    last_tick: Annotated[int | None, table_files.ColumnDoc("number of the last tick in the attempt's log")]
    folder: Folder


@dataclass(frozen=True, slots=True)
class JobRow:
    status: Annotated[
        JobStatus,
        table_files.ColumnDoc("success, incomplete, failure, timeout, paused, crashed; waiting: not yet run"),
    ]
    message: Annotated[str, table_files.ColumnDoc("sentence with the reason why the job failed or crashed")]
    digest: Annotated[
        str, table_files.ColumnDoc("digest of everything simulated; equal runs have equal digests")
    ]
    attempts: Annotated[int, table_files.ColumnDoc("number of attempts by workers")]
    items_total: Annotated[int | None, table_files.ColumnDoc("number of true items")] = None
    items_sorted: Annotated[int | None, table_files.ColumnDoc("number of items at their destination")] = None
    items_misplaced: Annotated[int | None, table_files.ColumnDoc("number of items in another bin")] = None
    items_left: Annotated[int | None, table_files.ColumnDoc("number of items outside of all bins")] = None
    picks_tried: Annotated[
        int | None, table_files.ColumnDoc("number of closings of the fingers on an object")
    ] = None
    picks_held: Annotated[int | None, table_files.ColumnDoc("number of closings that held the object")] = None
    sim_seconds: Annotated[float | None, table_files.ColumnDoc("simulated time", "s")] = None
    cpu_seconds: Annotated[float | None, table_files.ColumnDoc("CPU time", "s")] = None
    wall_seconds: Annotated[float | None, table_files.ColumnDoc("wall time", "s")] = None
    last_tick: LastTick = None
    root_cause: Annotated[
        str, table_files.ColumnDoc("root cause that cost the goal; without one, the first root cause")
    ] = ""
    look_at: Annotated[str, table_files.ColumnDoc("line on the root cause or first key moment")] = ""
    folder: Folder = ""


@dataclass(frozen=True, slots=True)
class JobRows:
    job: JobRow
    items: tuple[JobItemRow, ...] = ()
    picks: tuple[JobPickRow, ...] = ()
    failures: tuple[JobFailureRow, ...] = ()
    episodes: tuple[EpisodeRow, ...] = ()
    planted: tuple[PlantedRow, ...] = ()
    plans: tuple[JobPlanRow, ...] = ()
    timings: tuple[JobTimingRow, ...] = ()
    figures: tuple[FigureRow, ...] = ()
    times_to_done: tuple[TimeToDoneRow, ...] = ()
    versions: dict[str, str] = field(default_factory=dict[str, str])

    def to_json(self) -> bytes:
        return _ADAPTER.dump_json(self)

    @classmethod
    def from_json(cls, data: bytes, source: Path) -> JobRows:
        """Read rows from JSON. Raises PicktreeError when the data are no result of a job."""
        try:
            return _ADAPTER.validate_json(data)
        except ValidationError as error:
            raise PicktreeError(f"{source}: no result of a job: {error.errors()[0]['msg']}") from None


_ADAPTER = TypeAdapter(JobRows)
_SQL: dict[table_files.Kind, str] = {"int": "INTEGER", "float": "REAL", "bool": "INTEGER", "text": "TEXT"}


@dataclass(frozen=True, slots=True)
class TableOf:
    """Table. `key`: columns that identify a row; empty where only its position does."""

    name: str
    meaning: str
    """Meaning of a row."""
    columns: tuple[table_files.Column, ...]
    key: tuple[str, ...] = ()
    index: tuple[str, ...] = ()
    """Columns with an index."""
    row: type | None = None
    """Type of its rows; None: they have none of their own."""

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


def _text(name: str, meaning: str) -> table_files.Column:
    return table_files.Column(name, "text", False, "", meaning)


def _table(
    name: str, meaning: str, row: type, *, key: tuple[str, ...] = (), index: tuple[str, ...] = ()
) -> TableOf:
    return TableOf(name, meaning, (_JOB, *columns(row)), key, index, row)


_JOB = _text("job", "id of the job")
TABLES = (
    TableOf(
        "jobs",
        "a job",
        (
            _text("job", "id: hash of the job's complete input"),
            table_files.Column("number", "int", False, "", "index in the plan, from 0"),
            _text("variant", "label of the recipe: its differences from the plan's other recipes"),
            _text("mission", "path of the mission"),
            _text("scene", "name or path of the scene; empty: the mission's own"),
            _text("robot", "name or path of the robot; empty: the scene's own"),
            _text("faults", "path of the faults file; empty: none"),
            _text("settings", "settings as a JSON object"),
            table_files.Column("seed", "int", False, "", "seed of all random numbers"),
            _text("recipe", "hash of the job's input without the seed; recipes/HASH.zip holds this input"),
            *columns(JobRow),
        ),
        key=("job",),
    ),
    _table("items", "a true item, with the scorer's verdict", JobItemRow, key=("job", "item")),
    _table("picks", "a closing of the fingers, as the robot measured it", JobPickRow, index=("job",)),
    _table("failures", "a failure with its outcome", JobFailureRow, index=("job", "cause")),
    _table(
        "episodes",
        "an episode of a cause, with its cures and its outcome",
        EpisodeRow,
        index=("job", "cause"),
    ),
    _table(
        "planted",
        "an injected fault with the first failure after it",
        PlantedRow,
        index=("job",),
    ),
    _table("plans", "a request to the planner", JobPlanRow, index=("job",)),
    _table("timings", "a phase of a job", JobTimingRow, key=("job", "phase")),
    _table("figures", "counts of the operators' figures of a job", FigureRow, key=("job",)),
    _table("times_to_done", "a unit that was done", TimeToDoneRow, key=("job", "unit")),
    _table(
        "crashes",
        "an attempt at a job that gave no result, even if a later attempt gave one",
        CrashRow,
        key=("job", "attempt"),
    ),
    TableOf(
        "versions",
        "a library used by a job",
        (_JOB, _text("library", "name"), _text("version", "version of the library")),
        key=("job", "library"),
    ),
)
CHILDREN: Final[Mapping[str, type]] = {
    table.name: table.row for table in TABLES if table.row is not None and table.row is not CrashRow
}
"""Rows of the tables with many of a job."""
_DEFAULTS = {"status": "DEFAULT 'waiting'", "attempts": "DEFAULT 0"} | dict.fromkeys(
    ("message", "digest", "root_cause", "look_at", "folder"), "DEFAULT ''"
)
"""Defaults of a job that was not run yet."""


def _declared(column: table_files.Column, *, default: bool) -> str:
    words = [column.name, _SQL[column.kind], "" if column.optional else "NOT NULL"]
    words.append(_DEFAULTS.get(column.name, "") if default else "")
    return " ".join(word for word in words if word)


def schema() -> str:
    """Return the SQL that creates all tables and views."""
    return "\n".join([*(table.to_sql() for table in TABLES), *(view.sql for view in VIEWS)])
