"""Origin of a file's times: another program may have written the times of its own clock.

The messages of joints, frames and objects repeat the simulated time in their own stamps.
"""

from __future__ import annotations

import itertools
from statistics import median
from typing import Any, Final

from google.protobuf.message import DecodeError

from ..mcap.reader import McapReader
from ..schema import topics

_STAMPED: Final = (topics.JOINTS, topics.TF, topics.OBJECTS)
_SAMPLE: Final = 50
"""Number of messages that are compared with their stamps."""
_LONGEST_RUN: Final = 365 * 86_400 * 1_000_000_000
"""First tick from which on a time is that of a wall clock, ns."""


def clock_offset(reading: McapReader, begin: int) -> int:
    """Return the difference between the file's times and simulated time, ns.

    `begin`: simulated time (ns) at which the log of a file without stamps begins. Raises PicktreeError where
    the file is damaged.
    """
    offset = next((found for topic in _STAMPED if (found := _stamp_offset(reading, topic)) is not None), 0)
    first = next(reading.messages([topics.TICK.name]), None)
    if first is not None and first.time - offset > _LONGEST_RUN:
        return first.time - begin
    return offset


def _stamp_offset(reading: McapReader, topic: topics.Topic) -> int | None:
    """Return the difference between the messages' times and their stamps, ns; None without stamps.

    It is 0 when the differences vary by more than their middle: the messages were late.
    """
    kind = topics.message_class(topic.schema)
    differences: list[int] = []
    for message in itertools.islice(reading.messages([topic.name]), _SAMPLE):
        try:
            read: Any = kind.FromString(message.data) if kind else None
            parts = [read, *getattr(read, "transforms", ())[:1], *getattr(read, "entities", ())[:1]]
            stamps = [each.timestamp.ToNanoseconds() for each in parts if hasattr(each, "timestamp")]
        except (DecodeError, ValueError):
            continue
        differences += [message.time - stamp for stamp in stamps]
    if not differences:
        return None
    middle = round(median(differences))
    return middle if abs(middle) > max(differences) - min(differences) else 0
