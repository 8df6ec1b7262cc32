"""Run: one run as an analyst has it, from its log alone."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import overload

import numpy as np
from numpy.typing import NDArray

from ..world.errors import PicktreeError
from . import topics
from .explaining.explanation import Explanation, FailureStory
from .records import Candidates, Event, LogLine, Plan, RunInfo, Scene, Tick, Tree
from .result import RunResult
from .run_log import At, RunLog
from .visits import Visit, visits_of


@dataclass(frozen=True, slots=True)
class TickAt:
    """A tick with its number, 0 for the first of the log, and its simulated time, s."""

    number: int
    time: float
    record: Tick


@dataclass(frozen=True, slots=True)
class Pick:
    """One closing of the fingers on an object, as the robot felt it."""

    time: float
    """Simulated s."""
    object: str
    held: bool
    node: str
    """Path of the node that closed them."""


@dataclass(frozen=True, slots=True, eq=False)
class JointSeries:
    """All readings of the joints: `times` (n,) s, the others (n, joints) in rad or m, per s, Nm or N."""

    names: tuple[str, ...]
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    efforts: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class WrenchSeries:
    """All readings of the external wrench at the wrist, in the world's axes: `times` (n,) s, `forces` (n, 3)
    N, `torques` (n, 3) Nm."""

    times: NDArray[np.float64]
    forces: NDArray[np.float64]
    torques: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ControlSeries:
    """What the arm's servo had been told: `times` (n,) s, `controllers` by tick, `references` and `errors`
    (n, joints) rad, NaN while torques were commanded. Empty for a log that does not tell."""

    times: NDArray[np.float64]
    controllers: tuple[str, ...]
    references: NDArray[np.float64]
    errors: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Moment:
    """What was at one tick."""

    tick: TickAt
    belief: Scene | None
    truth: Scene | None
    """Of the second before; the robot did not know it."""
    blackboard: Mapping[str, object]


class Ticks(Sequence[TickAt]):
    """The ticks of a log, read one by one as they are asked for."""

    def __init__(self, log: RunLog) -> None:
        self._log = log
        self.times: tuple[float, ...] = tuple(
            message.time / 1e9 for message in log.messages([topics.TICK.name])
        )
        """Simulated s."""

    def __len__(self) -> int:
        return len(self.times)

    @overload
    def __getitem__(self, index: int) -> TickAt: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[TickAt, ...]: ...
    def __getitem__(self, index: int | slice) -> TickAt | tuple[TickAt, ...]:
        if isinstance(index, slice):
            return tuple(self[number] for number in range(*index.indices(len(self))))
        number = range(len(self))[index]
        time = self.times[number]
        found = self._log.tick_at(time)
        assert found is not None
        return TickAt(number, time, found.record)

    def __iter__(self) -> Iterator[TickAt]:
        for number, at in enumerate(self._log.ticks()):
            yield TickAt(number, at.time, at.record)

    def number_at(self, time: float) -> int:
        """The last tick at `time` (simulated s) or before; the first for a time before it.

        Raises PicktreeError when the log holds no tick.
        """
        if not self.times:
            raise PicktreeError(f"{self._log.path}: the log holds no tick")
        return max(bisect.bisect_right(self.times, time + 1e-9) - 1, 0)


class Run:
    """One run. `where` is a log file, a run's folder, or `last`; `recovered` is a sentence when the file had
    not been finished, else empty.

    What it holds is read when it is asked for, and kept. Times are simulated seconds. Use it as a context
    manager, or `close` it. Raises PicktreeError for what is no log, and where the file is damaged.
    """

    def __init__(self, where: str | Path) -> None:
        self.log = RunLog(where)
        self.path = self.log.path
        self.recovered = self.log.recovered
        self.info: RunInfo = self.log.run

    def close(self) -> None:
        self.log.close()

    def __enter__(self) -> Run:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def end(self) -> float:
        """Time of the last message."""
        return self.log.end

    @cached_property
    def result(self) -> RunResult | None:
        """What the run came to; None when it was killed, or ended by a fault."""
        words = self.log.result
        return RunResult.from_json_text(words["json"], self.path) if "json" in words else None

    @cached_property
    def trees(self) -> tuple[At[Tree], ...]:
        """With the time of its first tick each; more than one when the mission was edited under the run."""
        return tuple(self.log.trees())

    def tree_at(self, time: float) -> Tree:
        """The tree that was ticked then."""
        trees = self.trees
        if not trees:
            raise PicktreeError(f"{self.path}: the log has no message on {topics.TREE.name}")
        return next((at.record for at in reversed(trees) if at.time <= time + 1e-9), trees[0].record)

    @cached_property
    def ticks(self) -> Ticks:
        return Ticks(self.log)

    @cached_property
    def visits(self) -> tuple[Visit, ...]:
        """What each node did, from its beginning to its end; in the order of the beginnings."""
        return visits_of(self.log)

    @cached_property
    def plans(self) -> tuple[At[Plan], ...]:
        return tuple(self.log.plans())

    @cached_property
    def candidates(self) -> tuple[At[Candidates], ...]:
        return tuple(self.log.candidates())

    @cached_property
    def events(self) -> tuple[At[Event], ...]:
        return tuple(self.log.events())

    @cached_property
    def lines(self) -> tuple[At[LogLine], ...]:
        return tuple(self.log.lines())

    @cached_property
    def picks(self) -> tuple[Pick, ...]:
        return tuple(
            Pick(at.time, str(at.record.data["object"]), bool(at.record.data["held"]), at.record.node)
            for at in self.events
            if at.record.kind == "pick"
        )

    @cached_property
    def explanation(self) -> Explanation:
        """Why it ended as it did: failures, root causes, items, what to look at."""
        from .explaining.explain import explain

        return explain(self)

    @property
    def failures(self) -> tuple[FailureStory, ...]:
        """Every failure with a cause, and what became of it; in the order of time."""
        return self.explanation.failures

    @cached_property
    def joints(self) -> JointSeries:
        read = [(at.time, at.record) for at in self.log.joints()]
        names = read[0][1].names if read else ()
        return JointSeries(
            names,
            np.array([time for time, _ in read]),
            np.array([joints.position for _, joints in read]).reshape(len(read), len(names)),
            np.array([joints.velocity for _, joints in read]).reshape(len(read), len(names)),
            np.array([joints.effort for _, joints in read]).reshape(len(read), len(names)),
        )

    @cached_property
    def wrenches(self) -> WrenchSeries:
        read = [(at.time, at.record) for at in self.log.wrenches()]
        return WrenchSeries(
            np.array([time for time, _ in read]),
            np.array([(w.force.x, w.force.y, w.force.z) for _, w in read]).reshape(len(read), 3),
            np.array([(w.torque.x, w.torque.y, w.torque.z) for _, w in read]).reshape(len(read), 3),
        )

    @cached_property
    def controls(self) -> ControlSeries:
        read = [(at.time, at.record) for at in self.log.controls()]
        joints = max((len(control.reference) for _, control in read), default=0)
        unknown = (float("nan"),) * joints
        return ControlSeries(
            np.array([time for time, _ in read]),
            tuple(control.controller for _, control in read),
            np.array([control.reference or unknown for _, control in read]).reshape(len(read), joints),
            np.array([control.error or unknown for _, control in read]).reshape(len(read), joints),
        )

    def at(self, time: float) -> Moment:
        """What was then: at the last tick at `time` or before."""
        tick = self.ticks[self.ticks.number_at(time)]
        belief, truth = self.log.belief_at(tick.time), self.log.truth_at(tick.time)
        return Moment(
            tick,
            belief.record if belief else None,
            truth.record if truth else None,
            self.blackboard_at(tick.time),
        )

    def blackboard_at(self, time: float) -> Mapping[str, object]:
        """All values by their full keys, after the last tick at `time` or before."""
        before = itertools.takewhile(lambda write: write[0] <= time + 1e-9, self._writes)
        return {key: value for _, key, value in before}

    @cached_property
    def _writes(self) -> tuple[tuple[float, str, object], ...]:
        busy = ((at.time, at.record) for at in self.log.busy_ticks() if at.record is not None)
        return tuple((time, w.key, w.value) for time, tick in busy for w in tick.writes)
