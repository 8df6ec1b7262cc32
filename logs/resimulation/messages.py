"""The messages of a log that are part of its digest."""

from __future__ import annotations

from collections.abc import Iterator

from .. import topics
from ..mcap_reading import RawMessage
from ..run_log import RunLog

_JUST = 1e-6
"""Less than a tick, s."""


def simulated_messages(
    log: RunLog, start: float | None = None, end: float | None = None
) -> Iterator[RawMessage]:
    """In their order, from `start` to `end` (simulated s, both inclusive); of a run that goes on from a
    checkpoint without those that only say how things stood there."""
    fixed = {topic.name for topic in topics.FIXED if topic.simulated}
    wanted = [name for name in log.topics if name in fixed or name.startswith("/camera/")]
    continues = log.run.continues
    begin = start
    if continues is not None:
        begin = max(continues.time + _JUST, start or 0.0)
    return log.messages(wanted, begin, None if end is None else end + _JUST)
