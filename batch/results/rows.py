"""Rows of a job's results: one of `jobs`, and many of the other tables."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

from pydantic import TypeAdapter, ValidationError

from ...errors import PicktreeError
from ...logs.episodes.episode import End
from ...logs.run_result import RunStatus

Phase: TypeAlias = Literal["observe", "think", "move", "grasp", "place", "recover", "other"]
JobStatus: TypeAlias = RunStatus | Literal["crashed"]
"""End of a job: that of its run, or `crashed` when every attempt was without a result."""


@dataclass(frozen=True, slots=True)
class JobItemRow:
    """One real item, and the scorer's finding. `x`, `y`: place in the world at its arrival, m."""

    item: str
    kind: str
    form: str
    colour: str
    x: float
    y: float
    arrived: float
    """Simulated time of the item's first presence, s; 0.0: at the start."""
    destination: str | None
    bin: str | None
    verdict: Literal["sorted", "misplaced", "left"]


@dataclass(frozen=True, slots=True)
class JobPickRow:
    """One closing of the fingers."""

    time: float
    object: str
    held: bool
    node: str


@dataclass(frozen=True, slots=True)
class JobFailureRow:
    """One failure with its disposition."""

    time: float
    node: str
    cause: str
    message: str
    item: str
    fate: str
    handled_by: str
    seconds_lost: float | None


@dataclass(frozen=True, slots=True)
class EpisodeRow:
    """One observed cause with the result of its recovery."""

    time: float
    cause: str
    node: str
    item: str
    ended: End
    handler: str
    """Handler that ran last; empty: none."""
    tried: str
    by: str
    tries: int
    seconds: float


@dataclass(frozen=True, slots=True)
class PlantedRow:
    """One injected fault, with the first failure after it."""

    time: float
    fault: str
    message: str
    item: str
    cause: str
    after: float | None
    ended: End | Literal[""]


@dataclass(frozen=True, slots=True)
class JobPlanRow:
    """One request to the planner."""

    time: float
    request: str
    planner: str
    outcome: str
    checks: int
    thinking: float
    duration: float


@dataclass(frozen=True, slots=True)
class JobTimingRow:
    """Simulated time that a run spent in one phase, s."""

    phase: Phase
    seconds: float


@dataclass(frozen=True, slots=True)
class CrashRow:
    """One attempt at a job without a result."""

    attempt: int
    reason: str
    last_tick: int | None
    folder: str
    """Folder of the run with its log, relative to the batch's folder; empty when it was not kept."""


@dataclass(frozen=True, slots=True)
class JobRow:
    """Result of a job."""

    status: JobStatus
    message: str
    digest: str
    attempts: int
    items_total: int | None
    items_sorted: int | None
    items_misplaced: int | None
    items_left: int | None
    picks_tried: int | None
    picks_held: int | None
    sim_seconds: float | None
    cpu_seconds: float | None
    wall_seconds: float | None
    last_tick: int | None
    """Number of the last tick in the log; None: no log."""
    root_cause: str = ""
    look_at: str = ""
    """One line on what to look at."""
    folder: str = ""
    """Folder of the run with its log, relative to the batch's folder; empty when it was not kept."""


@dataclass(frozen=True, slots=True)
class JobRows:
    """All rows of one job."""

    job: JobRow
    items: tuple[JobItemRow, ...] = ()
    picks: tuple[JobPickRow, ...] = ()
    failures: tuple[JobFailureRow, ...] = ()
    episodes: tuple[EpisodeRow, ...] = ()
    planted: tuple[PlantedRow, ...] = ()
    plans: tuple[JobPlanRow, ...] = ()
    timings: tuple[JobTimingRow, ...] = ()
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
