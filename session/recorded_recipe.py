"""Recorded recipe: a run that can be repeated from its log alone.

Older checkpoints are completed: counters and recording state are computed from the log itself.
The edits and the operator's actions are repeated at their times.
"""

from __future__ import annotations

import re
import tempfile
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from picktree.files import PicktreeError
from picktree.logs import Digest, RunLog, RunRecord, fixed_of, log_records, topics
from picktree.logs.mcap import RawMessage
from picktree.logs.recording import RecordingState
from picktree.robot import operator_desk
from picktree.trees import Mission, runner
from picktree.world import JournalEvent, Tick, event_types

from .checkpoints import RunState
from .debugger import EntryChange, set_entry
from .execution import Execution
from .observer import Interrupter, ReloadMessage
from .run_recipe import Recipe, StartCheckpoint, Unpacking
from .run_tally import RunCounters
from .session_recording import START_ATTACHMENT

_CHECKPOINT: Final = re.compile(r"checkpoint-\d+\.json")
_TIME_TOLERANCE: Final = 1e-6
"""Tolerance of time comparisons, simulated s."""


class RecordedRun:
    """Recipe, checkpoints, edits and actions of the operator in one log.

    Its files are unpacked into a folder that exists until `close`.

    Raises PicktreeError where the log lacks something, FileError for a file that is no longer accepted.
    """

    def __init__(self, run: RunRecord) -> None:
        self.run = run
        self.folder = tempfile.TemporaryDirectory(prefix="picktree-")
        """Folder of the unpacked files."""
        self._unpacking = Unpacking(run.log, Path(self.folder.name))
        self._edits = list(_edits(run))

    def close(self) -> None:
        self.folder.cleanup()

    def __enter__(self) -> RecordedRun:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def recipe(self) -> Recipe:
        """Return the recipe with which the run started, at time 0 or at the checkpoint of another run."""
        info, log = self.run.info, self.run.log
        if info.seed is None:
            raise PicktreeError(
                f"{log.path}: the log lacks its metadata, and with them the seed, so it cannot be run again; "
                "keep the metadata when a log is filtered"
            )
        start = None
        if info.continues is not None:
            start = StartCheckpoint(RunState.from_json(log.attachment(START_ATTACHMENT)), info.continues)
        return self._unpacking.recipe(info.seed, start)

    def edits(self, since: float = -1.0) -> RecordedEdits:
        """Return the edits that were taken over during the run later than `since`, simulated s."""
        later = [(time, files) for time, files in self._edits if time > since + _TIME_TOLERANCE]
        return RecordedEdits(self.run.path, Path(self.folder.name), later)

    def operator(self, since: float = -1.0) -> RecordedOperator:
        """Return an operator with the answers and the changes of the blackboard later than `since`, simulated
        s."""
        answers: list[tuple[str, str]] = []
        changes: list[tuple[float, EntryChange]] = []
        for at in self.run.log.events(since + _TIME_TOLERANCE if since >= 0.0 else None):
            event = at.record
            if isinstance(event, event_types.OperatorAnswerEvent):
                answers.append((event.node, event.answer))
            elif isinstance(event, event_types.BlackboardSetEvent):
                changes.append((at.time, EntryChange(event.key, event.value, event.passes, event.node)))
        return RecordedOperator(answers, changes)

    def checkpoints(self) -> tuple[str, ...]:
        """Return the names of the log's checkpoints in order of time."""
        return tuple(sorted(name for name in self.run.log.attachments if _CHECKPOINT.fullmatch(name)))

    def state(self, checkpoint: str) -> RunState:
        return complete_state(RunState.from_json(self.run.log.attachment(checkpoint)), self.run)

    def last_checkpoint(self, time: float) -> tuple[str, RunState] | None:
        """Return name and state of the last checkpoint at `time` (simulated s) or before; None when there is
        none."""
        before: tuple[str, RunState] | None = None
        for name in self.checkpoints():
            state = RunState.from_json(self.run.log.attachment(name))
            if state.time <= time + _TIME_TOLERANCE:
                before = (name, state)
        return None if before is None else (before[0], complete_state(before[1], self.run))

    def from_checkpoint(self, name: str, state: RunState) -> Recipe:
        """Return a recipe that starts from this checkpoint, with the version of the mission at its time."""
        recipe = self.recipe()
        edits = [files for time, files in self._edits if time <= state.time + _TIME_TOLERANCE]
        if edits:
            recipe = replace(recipe, mission=self._unpacking.mission(edits[-1]))
        assert state.recording is not None
        log = str(self.run.path.absolute())
        continues = log_records.ResumedFrom(log, name, state.time, state.items_done, state.recording.digest)
        return replace(recipe, start=StartCheckpoint(state, continues))


def _edits(run: RunRecord) -> Iterator[tuple[float, str]]:
    """Yield time (simulated s) and folder in the log of each version of the mission that took over.

    Each has its tree in the log. Events before the first version are not read: a log of hours, once read,
    keeps gigabytes until it is closed.
    """
    for tree in run.trees[1:2]:
        for at in run.log.events(tree.time):
            if isinstance(at.record, event_types.MissionEditedEvent):
                yield at.time, at.record.files


class RecordedEdits(Interrupter):
    """Versions of a mission that were taken over during a run, each at its time.

    They are unpacked into `folder`, from a log that need not stay open until then.
    """

    def __init__(self, log: Path, folder: Path, edits: list[tuple[float, str]]) -> None:
        self._log = log
        self._folder = folder
        self._edits = edits

    def look(self, current: Mission, now: float) -> tuple[ReloadMessage, ...]:
        # One version at a time, at its time: loading a plug-in of a later version replaces the one that runs.
        if self._edits and now >= self._edits[0][0] - _TIME_TOLERANCE:
            with RunLog(self._log) as log:
                self.pending = Unpacking(log, self._folder).mission(self._edits.pop(0)[1])
        return ()


def simulated_messages(
    log: RunLog, start: float | None = None, end: float | None = None
) -> Iterator[RawMessage]:
    """Yield the simulated messages later than `start` and up to `end` (simulated s), in order.

    For a run that resumes from a checkpoint, the messages that only describe the state there are left out.
    """
    wanted = [name for name in log.topics if topics.is_simulated(name)]
    continues = log.run.continues
    after = [time for time in (start, continues.time if continues else None) if time is not None]
    begin = max(after) + _TIME_TOLERANCE if after else None
    return log.messages(wanted, begin, None if end is None else end + _TIME_TOLERANCE)


def complete_state(state: RunState, run: RunRecord) -> RunState:
    """Return the state with counters and recording state.

    The path that the arm followed last stays unknown, so a retreat along it is impossible.
    """
    if state.tally is None:
        state = replace(state, tally=tally_of(run, state.time).state())
    if state.recording is None:
        state = replace(state, recording=_recording(run, state.time))
    return state


def tally_of(run: RunRecord, time: float) -> RunCounters:
    """Return the counters of the run up to `time`, simulated s."""
    tally = RunCounters()
    tally.figures.fixed = fixed_of(run.log)
    coming = list(run.trees)
    events: dict[float, list[JournalEvent]] = {}
    for at in run.events:
        events.setdefault(at.time, []).append(at.record)
    for at in run.log.ticks(end=time):
        while coming and coming[0].time <= at.time:
            tally.follow(coming.pop(0).record.nodes)
        now = events.get(at.time, ())
        leaves = frozenset(node.path for node in run.tree_at(at.time).nodes if not node.children)
        tally.take(at.time, now, leaves, at.record.edges, run.motions.get(at.time))
    return tally


def _recording(run: RunRecord, time: float) -> RecordingState:
    believed, true = run.log.belief_at(time), run.log.truth_at(time)
    tick, frames = run.log.tick_at(time), run.log.transforms_at(time)
    nodes = tick.record.nodes if tick else ()
    failing = sorted(n.path for n in nodes if n.status == "FAILURE" and n.cause and n.ticked)
    digest = Digest()
    for message in simulated_messages(run.log, end=time):
        digest.add(message.topic, message.time, message.data)
    return RecordingState(
        believed.time if believed else -1.0,
        true.time if true else -1.0,
        tuple(failing),
        tuple((t.child, t.pose) for t in (frames.record if frames else ()) if t.child.startswith("camera/")),
        digest.hex,
    )


class RecordedOperator(Interrupter):
    """Operator that repeats the answers and the changes of blackboard entries of a log.

    An answer is for the node that asked. When another node asks, or the choices do not contain the answer, it
    gives no answer from then on. A change comes at its tick, after as many starts and ends of nodes; in a
    tick with fewer, after it. A change that the tree of another mission does not accept is left out.
    """

    def __init__(
        self, answers: Iterable[tuple[str, str]] = (), changes: Iterable[tuple[float, EntryChange]] = ()
    ) -> None:
        """`answers`: pairs of the asking node's path and the answer. `changes`: with their times, simulated
        s, in order."""
        self._answers = deque(answers)
        self._changes = deque(changes)
        self._passes = 0
        self._run: Execution | None = None

    def started(self, run: Execution, folder: Path) -> None:
        self._run = run
        if self._changes:
            run.tree.on_start.insert(0, self._pass)
            run.tree.on_end.insert(0, self._pass)

    def answer(self, question: operator_desk.OperatorQuestion) -> str | None:
        if self._answers:
            node, recorded = self._answers.popleft()
            if node == question.node and recorded in question.choices:
                return recorded
            self._answers.clear()
        return None

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        """Make the changes that were made after this tick; the log has them in the next one."""
        if self._changes and self._run is not None:
            self._make_due(now + self._run.world.tick)

    def look(self, current: Mission, now: float) -> tuple[ReloadMessage, ...]:
        """Make the changes that are late; called before a tick."""
        self._passes = 0
        self._make_due(now)
        return ()

    def _make_due(self, now: float) -> None:
        """Make the changes before the tick at `now`, simulated s, and those whose place never came."""
        while self._changes:
            time, change = self._changes[0]
            if time > now + _TIME_TOLERANCE or (change.passes > 0 and time > now - _TIME_TOLERANCE):
                break
            self._make(self._changes.popleft()[1])

    def _pass(self, _: str) -> None:
        """Make the changes that came after this start or end of a node."""
        assert self._run is not None
        self._passes += 1
        now = self._run.world.clock.now
        while self._changes:
            time, change = self._changes[0]
            if time > now + _TIME_TOLERANCE or change.passes != self._passes:
                return
            self._make(self._changes.popleft()[1])

    def _make(self, change: EntryChange) -> None:
        assert self._run is not None
        tree = self._run.tree
        try:
            runner.checked_value(tree, change.key, change.value)
        except PicktreeError:
            return
        set_entry(tree, change)
