"""Completion of older checkpoints: counters and recording state, computed from the log itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ...logs.mcap.reader import RawMessage
from ...logs.recording.digest import Digest
from ...logs.recording.recorder import RecordingState
from ...logs.run_log import RunLog
from ...logs.run_record import RunRecord
from ...logs.schema import topics
from ...logs.visits import with_transitions
from ...world.journal import JournalEvent
from ..checkpoints import RunState
from ..run_tally import RunCounters

_TIME_TOLERANCE = 1e-6
"""Time below the length of a tick, s."""


def simulated_messages(
    log: RunLog, start: float | None = None, end: float | None = None
) -> Iterator[RawMessage]:
    """Yield the simulated messages later than `start` and up to `end` (simulated s), in order.

    For a run that resumes from a checkpoint, the messages that only describe the state there are left out.
    """
    fixed = {topic.name for topic in topics.FIXED if topic.simulated}
    wanted = [name for name in log.topics if name in fixed or name.startswith("/camera/")]
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
    coming = list(run.trees)
    events: dict[float, list[JournalEvent]] = {}
    for at in run.events:
        events.setdefault(at.time, []).append(at.record)
    ticks = run.log.ticks(end=time)
    for at in ticks if run.log.format >= 2 else with_transitions(ticks):
        while coming and coming[0].time <= at.time:
            tally.follow(coming.pop(0).record.nodes)
        now = events.get(at.time, ())
        leaves = frozenset(node.path for node in run.tree_at(at.time).nodes if not node.children)
        tally.take(at.time, now, at.record.nodes, leaves, at.record.transitions)
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
