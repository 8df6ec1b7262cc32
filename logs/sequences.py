"""Ticks and images of a log, read as they are asked for."""

from __future__ import annotations

import bisect
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

from ..errors import PicktreeError
from .run_log import At, RunLog, Shot
from .schema import topics
from .schema.records import Tick

_SLACK = 1e-9


@dataclass(frozen=True, slots=True, repr=False)
class TickAt:
    """A tick with its number, 0 for the first of the log, and its simulated time, s."""

    number: int
    time: float
    record: Tick

    def __repr__(self) -> str:
        at = f", {self.record.tip} runs" if self.record.tip else ""
        return f"<tick {self.number} at {self.time:.2f} s: {self.record.root_status}{at}>"


class Ticks(Sequence[TickAt]):
    """The ticks of a log, read one by one as they are asked for.

    Going through all of them (`for tick in ticks`, or a slice) is many times as fast as asking for each.
    """

    def __init__(self, log: RunLog) -> None:
        self._log = log
        self.times: tuple[float, ...] = tuple(
            message.time / 1e9 for message in log.messages([topics.TICK.name])
        )
        """Simulated s."""

    def __repr__(self) -> str:
        return f"<{len(self)} ticks{_span(self.times)}>"

    def __len__(self) -> int:
        return len(self.times)

    @overload
    def __getitem__(self, index: int) -> TickAt: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[TickAt, ...]: ...
    def __getitem__(self, index: int | slice) -> TickAt | tuple[TickAt, ...]:
        numbers = range(len(self))[index]
        if isinstance(numbers, range):
            return self._several(numbers)
        time = self.times[numbers]
        found = self._log.tick_at(time)
        assert found is not None
        return TickAt(numbers, time, found.record)

    def __iter__(self) -> Iterator[TickAt]:
        for number, at in enumerate(self._log.ticks()):
            yield TickAt(number, at.time, at.record)

    def number_at(self, time: float) -> int:
        """The last tick at `time` (simulated s) or before; the first for a time before it.

        Raises PicktreeError when the log holds no tick.
        """
        if not self.times:
            raise PicktreeError(f"{self._log.path}: the log holds no tick")
        return max(bisect.bisect_right(self.times, time + _SLACK) - 1, 0)

    def _several(self, numbers: range) -> tuple[TickAt, ...]:
        if not numbers:
            return ()
        low, high = min(numbers), max(numbers)
        read = self._log.ticks(self.times[low], self.times[high])
        span = {number: TickAt(number, at.time, at.record) for number, at in enumerate(read, low)}
        return tuple(span[number] for number in numbers)


class Shots(Sequence[At[Shot]]):
    """The images of a log, of all its cameras in order of time, decoded one by one as they are asked for."""

    def __init__(self, log: RunLog) -> None:
        self._log = log
        cameras = {topics.depth_topic(camera).name: camera for camera in log.cameras}
        index = [(message.time / 1e9, cameras[message.topic]) for message in log.messages(list(cameras))]
        self.times: tuple[float, ...] = tuple(time for time, _ in index)
        """Simulated s."""
        self.cameras: tuple[str, ...] = tuple(camera for _, camera in index)
        """By image, which took it."""

    def __repr__(self) -> str:
        by = f" by {', '.join(sorted(set(self.cameras)))}" if self.cameras else ""
        return f"<{len(self)} images{by}{_span(self.times)}>"

    def __len__(self) -> int:
        return len(self.times)

    @overload
    def __getitem__(self, index: int) -> At[Shot]: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[At[Shot], ...]: ...
    def __getitem__(self, index: int | slice) -> At[Shot] | tuple[At[Shot], ...]:
        if isinstance(index, slice):
            return tuple(self[number] for number in range(*index.indices(len(self))))
        number = range(len(self))[index]
        time = self.times[number]
        # Its three messages have one stamp.
        return next(self._log.shots(self.cameras[number], time - _SLACK, time + _SLACK))

    def before(self, time: float, camera: str | None = None) -> At[Shot] | None:
        """The last image at `time` (simulated s) or before, of that camera or of any; None when none was
        taken by then."""
        for number in range(bisect.bisect_right(self.times, time + _SLACK) - 1, -1, -1):
            if camera is None or self.cameras[number] == camera:
                return self[number]
        return None


def _span(times: Sequence[float]) -> str:
    return f", {times[0]:.2f} … {times[-1]:.2f} s" if times else ""
