"""Simulated times of a file that another program has written with the times of its own clock.

The messages of joints, frames, objects, images and log lines repeat the simulated time in their own stamps.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any, Final

import numpy as np
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from ..mcap.reader import McapReader
from ..schema import topics

_SAMPLE: Final = 200
"""Number of messages whose stamps show which clock the file has."""
_LONGEST_RUN: Final = 365 * 86_400 * 1_000_000_000
"""First tick from which on a time is that of a wall clock, ns."""
_SMOOTHING: Final = 41
"""Number of ticks over which the number of a tick is compared with its time."""

Times = NDArray[np.int64]


def restore_simulated_times(reading: McapReader, begin: int) -> None:
    """Give the messages of a file their simulated times.

    Times of a clock with another origin are shifted. When the messages were late by varying times, stamped
    ones take the times of their stamps, and others those of the ticks around. `begin`: simulated time (ns) at
    which a log without stamps begins. Raises PicktreeError where the file is damaged.
    """
    clock = next((topic for topic in (topics.JOINTS, topics.TF) if _differences(reading, topic)), None)
    if clock is not None:
        late = _differences(reading, clock)
        offset = int(np.median(late))
        reading.shift(-offset if offset and (min(late) == max(late) or abs(offset) > np.ptp(late)) else 0)
        if min(late) != max(late):
            reading.set_times(_times(reading, clock))
    first = next(reading.messages([topics.TICK.name]), None)
    if first is not None and first.time > _LONGEST_RUN:
        reading.shift(begin - first.time)


def _differences(reading: McapReader, topic: topics.Topic) -> list[int]:
    return [time - stamp for time, stamp in islice(_stamps(reading, topic), _SAMPLE) if stamp is not None]


def _stamps(reading: McapReader, topic: topics.Topic) -> Iterator[tuple[int, int | None]]:
    """Yield time and stamp of each message, ns; None: it has none."""
    kind = topics.message_class(topic.schema)
    for message in reading.messages([topic.name]) if kind is not None else ():
        try:
            read: Any = kind.FromString(message.data) if kind else None
        except DecodeError:
            yield message.time, None
            continue
        parts = [read, *getattr(read, "transforms", ())[:1], *getattr(read, "entities", ())[:1]]
        stamps = [each.timestamp.ToNanoseconds() for each in parts if hasattr(each, "timestamp")]
        yield message.time, stamps[0] if stamps else None


def _times(reading: McapReader, clock: topics.Topic) -> Mapping[str, Times]:
    """Return the simulated times of the messages by topic. `clock`: topic with a stamped message a tick."""
    grid = np.unique([time if stamp is None else stamp for time, stamp in _stamps(reading, clock)])
    found: dict[str, Times] = {}
    for channel in reading.channels:
        topic = topics.Topic(channel.topic, channel.schema, "protobuf")
        times = np.array(reading.times(channel.topic), np.int64)
        stamps = [time if stamp is None else stamp for time, stamp in _stamps(reading, topic)]
        if len(stamps) == len(times):
            found[channel.topic] = np.array(stamps, np.int64)
        elif channel.topic in _EACH_TICK:
            found[channel.topic] = _by_number(times, grid)
        else:
            found[channel.topic] = grid[_nearest(times, grid)]
    return found


_EACH_TICK: Final = (topics.TICK.name, topics.WRENCH.name, topics.CONTROL.name, topics.TIMING.name)


def _nearest(times: Times, grid: Times) -> Times:
    after = np.clip(np.searchsorted(grid, times), 1, max(len(grid) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(grid) - 1)
    return np.where(times - grid[before] <= grid[after] - times, before, after)


def _by_number(times: Times, grid: Times) -> Times:
    """Return the times on the grid of messages that come once a tick, in their order.

    The difference between the number of a message and that of the nearest tick only grows where messages
    were left out. Its median over many ticks is exact.
    """
    numbers = np.arange(len(times))
    if not len(times):
        return times
    ahead = np.pad(_nearest(times, grid) - numbers, _SMOOTHING // 2, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(ahead, _SMOOTHING), axis=1)
    places = numbers + np.maximum.accumulate(middle.astype(np.int64))
    return grid[np.clip(places, 0, len(grid) - 1)]
