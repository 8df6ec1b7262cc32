"""Simulated times of a file that another program has written with the times of its own clock.

The messages of joints, frames, objects, images and log lines repeat the simulated time in their own stamps.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, Final

import numpy as np
import orjson
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from picktree.logs.mcap import McapReader, RawMessage

from . import topics

_SAMPLE: Final = 200
"""Number of messages whose stamps show which clock the file has."""
_LONGEST_RUN: Final = 365 * 86_400 * 1_000_000_000
"""First tick from which on a time is that of a wall clock, ns."""
_SMOOTHING: Final = 41
"""Number of ticks over which the number of a tick is compared with its time."""
_EACH_TICK: Final = (topics.TICK.name, topics.WRENCH.name, topics.CONTROL.name, topics.TIMING.name)
Times = NDArray[np.int64]


def restore_simulated_times(reading: McapReader, begin: int) -> None:
    """Give the messages of a file their simulated times.

    Times of a clock with another origin are shifted. When the messages were late by varying times, stamped
    ones take the times of their stamps, and others those of the ticks around. `begin`: simulated time (ns) at
    which a log without stamps begins. Raises PicktreeError where the file is damaged.
    """
    late = _lateness(reading, topics.JOINTS.name) or _lateness(reading, topics.TF.name) or [0]
    offset, spread = int(np.median(late)), max(late) - min(late)
    shift = offset if offset and (not spread or abs(offset) > spread) else 0
    first = next(reading.messages([topics.TICK.name]), None)
    if first is not None and first.time - shift > _LONGEST_RUN:
        shift = first.time - begin
    if not shift and not spread:
        return
    times = np.array([message.time for message in reading.messages()], np.int64) - shift
    reading.set_times(_stamped_times(reading, times, spread) if spread else times)


def _lateness(reading: McapReader, topic: str) -> list[int]:
    stamped = islice(_stamped(reading, [topic]), _SAMPLE)
    return [message.time - stamp for message, stamp in stamped if stamp is not None]


def _stamped(
    reading: McapReader, wanted: Sequence[str] | None = None
) -> Iterator[tuple[RawMessage, int | None]]:
    """Yield messages with their stamps, ns; None: it has none."""
    kinds = {channel.topic: topics.message_class(channel.schema) for channel in reading.channels}
    for message in reading.messages(wanted):
        kind = kinds[message.topic]
        try:
            read: Any = kind.FromString(message.data) if kind else None
        except DecodeError:
            read = None
        parts = [read, *getattr(read, "transforms", ())[:1], *getattr(read, "entities", ())[:1]]
        stamps = [each.timestamp.ToNanoseconds() for each in parts if hasattr(each, "timestamp")]
        yield message, stamps[0] if stamps else None


def _stamped_times(reading: McapReader, times: Times, spread: int) -> Times:
    """Return the simulated times of all messages. `times`: when they were written, at most `spread` ns apart
    from those of their ticks."""
    found = times.copy()
    stamped: list[int] = []
    each_tick: dict[str, list[int]] = {}
    others: list[tuple[int, RawMessage]] = []
    changes: dict[int, list[bytes]] = {}
    """Parts of the JSON that names what changed at the time of a tick, ns."""
    for place, (message, stamp) in enumerate(_stamped(reading)):
        if stamp is not None:
            found[place] = stamp
            stamped.append(place)
            if message.topic == topics.OBJECTS.name:
                changes.setdefault(stamp, []).append(b'"kind":"belief"')
        elif message.topic in _EACH_TICK:
            each_tick.setdefault(message.topic, []).append(place)
        else:
            others.append((place, message))
    ticks = np.unique(found[stamped])
    for places in each_tick.values():
        found[places] = _by_number(times[places], ticks)
    known = np.sort(np.concatenate((stamped, *each_tick.values())).astype(np.int64))
    in_file = reading.places()
    known = known[np.argsort(in_file[known])]
    timed = np.isin(known, each_tick.get(topics.TIMING.name, []))[1:]
    steps = np.diff(found[known])
    if timed.any() and (steps >= 0).all() and (steps[timed] > 0).all():
        places = [place for place, _ in others]  # in the order of the recorder, where a timing begins a tick
        before = np.searchsorted(in_file[known], in_file[places]) - 1
        found[places] = found[known[np.maximum(before, 0)]]
        return found
    numbered = zip(each_tick.get(topics.TICK.name, ()), reading.messages([topics.TICK.name]), strict=False)
    for place, message in numbered:
        for each in orjson.loads(message.data).get("transitions", ()):
            changes.setdefault(int(found[place]), []).append(f'{each["path"]}"'.encode())
    for place, message in others:
        found[place] = _nearest_change(int(times[place]), message.data, ticks, changes, spread)
    return found


def _nearest_change(
    time: int, data: bytes, ticks: Times, changes: Mapping[int, list[bytes]], spread: int
) -> int:
    """Return the time of the tick to which a message belongs.

    Of the ticks around it is one with a change that the message names, else one with any change, else the
    nearest.
    """

    def distance(tick: int) -> tuple[bool, bool, int]:
        return not any(name in data for name in changes.get(tick, ())), tick not in changes, abs(tick - time)

    first, stop = np.searchsorted(ticks, (time - spread, time + spread + 1))
    around = ticks[first:stop].tolist() or [int(ticks[_nearest(np.array([time]), ticks)[0]])]
    return min(around, key=distance)


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
    ahead = np.pad(_nearest(times, grid) - numbers, _SMOOTHING // 2, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(ahead, _SMOOTHING), axis=1)
    places = numbers + np.maximum.accumulate(middle.astype(np.int64))
    return grid[np.clip(places, 0, len(grid) - 1)]
