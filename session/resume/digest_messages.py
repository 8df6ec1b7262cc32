"""The messages of a log that are part of its digest."""

from __future__ import annotations

from collections.abc import Iterator

from ...logs.mcap.reader import RawMessage
from ...logs.run_log import RunLog
from ...logs.schema import topics

_JUST = 1e-6
"""Less than a tick, s."""


def simulated_messages(
    log: RunLog, start: float | None = None, end: float | None = None
) -> Iterator[RawMessage]:
    """In their order, later than `start` and up to `end` (simulated s); of a run that goes on from a
    checkpoint without those that only say how things stood there."""
    fixed = {topic.name for topic in topics.FIXED if topic.simulated}
    wanted = [name for name in log.topics if name in fixed or name.startswith("/camera/")]
    continues = log.run.continues
    after = [time for time in (start, continues.time if continues else None) if time is not None]
    begin = max(after) + _JUST if after else None
    return log.messages(wanted, begin, None if end is None else end + _JUST)
