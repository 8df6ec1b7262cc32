"""Log file on disk: one MCAP file, or several by rotation, each of which opens by itself."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from ...files.errors import PicktreeError
from ..mcap.sealed_file import require_free_space
from ..mcap.writer import McapFile
from ..schema import topics
from ..schema.json_records import encode
from ..schema.records import Tick, TransitionRecord, WriteRecord
from ..schema.topics import Topic
from .foxglove_messages import with_stamp
from .rotated_log import NEXT_METADATA, PART_METADATA, PartInfo, Rotation, part_path

_STATE_TOPICS = (topics.TREE, topics.ROBOT, topics.OBJECTS, topics.TRUTH)
"""Topics whose last message holds until the next one."""
_TICK_TOPICS = (topics.JOINTS, topics.TF, topics.WRENCH, topics.CONTROL)
_CARRIED_TOPICS = frozenset(topic.name for topic in (*_STATE_TOPICS, *_TICK_TOPICS))


@dataclass(frozen=True, slots=True)
class CarriedFile:
    name: str
    media_type: str
    data: bytes


class RotationState:
    """Content that the next file of a rotated log must begin with.

    The next file begins at the last tick. It repeats that tick with every running node as beginning and with
    the whole blackboard, and the state of all other topics at its time.
    """

    def __init__(self) -> None:
        self._metadata: dict[str, Mapping[str, str]] = {}
        self._files: dict[str, CarriedFile] = {}
        self._messages: dict[str, tuple[int, bytes]] = {}
        self._writes: dict[str, WriteRecord] = {}
        self._running: dict[str, TransitionRecord] = {}
        self._tick: Tick | None = None
        self.time = -1
        """Time of the last tick, simulated ns; negative before the first."""

    def metadata(self, name: str, words: Mapping[str, str]) -> None:
        self._metadata[name] = dict(words)

    def file(self, file: CarriedFile, slot: str) -> None:
        """Keep an attached file, in place of an earlier one with the same slot."""
        self._files.pop(slot, None)
        self._files[slot] = file

    def message(self, topic: Topic, time: int, data: bytes) -> None:
        if topic.name in _CARRIED_TOPICS:
            self._messages[topic.name] = (time, data)

    def tick(self, time: int, tick: Tick) -> None:
        self.time, self._tick = time, tick
        for write in tick.writes:
            self._writes.pop(write.key, None)
            self._writes[write.key] = write
        for transition in tick.transitions:
            self._running.pop(transition.path, None)
            if transition.status == "RUNNING":
                self._running[transition.path] = transition

    def all_metadata(self) -> dict[str, Mapping[str, str]]:
        tree = self._messages.get(topics.TREE.name)
        now = {"picktree.tree": {"json": tree[1].decode()}} if tree else {}
        return {**self._metadata, **now}

    def all_files(self) -> tuple[CarriedFile, ...]:
        return tuple(self._files.values())

    def all_messages(self) -> list[tuple[Topic, bytes]]:
        """Return the messages that hold at `time`, with their topics."""
        found: list[tuple[Topic, bytes]] = []
        for topic in _STATE_TOPICS:
            if topic.name in self._messages:
                data = self._messages[topic.name][1]
                found.append((topic, data if topic is topics.TREE else with_stamp(data, self.time)))
        for topic in _TICK_TOPICS:
            time, data = self._messages.get(topic.name, (-1, b""))
            if time == self.time:
                found.append((topic, data))
        if self._tick is not None:
            whole = replace(
                self._tick,
                writes=tuple(self._writes.values()),
                transitions=tuple(self._running.values()),
            )
            found.append((topics.TICK, encode(whole)))
        return found


class Heartbeat:
    """Thread that calls `beat` every `interval` wall seconds until it is stopped or `beat` returns False."""

    def __init__(self, beat: Callable[[], bool], interval: float, name: str) -> None:
        self._beat = beat
        self._interval = interval
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread. Returns when the last beat is over."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while not self._stopped.wait(self._interval):
            if not self._beat():
                return


_HEARTBEAT_PERIOD = 0.2
_MAX_MESSAGE_AGE = 0.3
"""Wall seconds of `_HEARTBEAT_PERIOD`, the period of the heartbeat, and `_MAX_MESSAGE_AGE`, the longest
wait of a message.

Together with the time that a checkpoint takes they stay below a second.
"""


class LogFile:
    """Writer of topics, files and metadata of one run. Times are ns and never decrease.

    All methods raise PicktreeError when the disk refuses or has refused.
    """

    def __init__(
        self,
        path: Path,
        *,
        rotation: Rotation,
        checkpoint: float = 1.0,
        chunk_bytes: int = 4 << 20,
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        require_free_space(path)
        self._first = path
        self._rotation = rotation
        self._carried = RotationState() if rotation else None
        self._number = 1
        self._start = 0
        """Time of the first tick that is new in the present file, simulated ns."""
        self._heartbeat: Heartbeat | None = None
        self._checkpoint, self._chunk_bytes, self._wall = checkpoint, chunk_bytes, wall
        self._channels: dict[str, int] = {}
        self._file = self._new_file(path, self._channels)

    def start_heartbeat(self) -> None:
        """Start the thread that brings each message to disk within a second, even when no further one
        follows."""
        self._heartbeat = Heartbeat(self._beat, _HEARTBEAT_PERIOD, "log")
        self._heartbeat.start()

    def stop_heartbeat(self) -> None:
        if self._heartbeat is not None:
            self._heartbeat.stop()

    @property
    def closed(self) -> bool:
        """Whether the file is finished, or given up because the disk refused."""
        return self._file.closed

    @property
    def failed(self) -> bool:
        """Whether the disk has refused a write."""
        return self._file.failed

    @property
    def part(self) -> int:
        """Number of the present file, from 1 on."""
        return self._number

    def message(self, topic: Topic, at: int, data: bytes) -> None:
        channel = self._channels.get(topic.name)
        if channel is None:
            channel = self._channels[topic.name] = self._file.channel(topic)
        self._file.message(channel, at, data)
        if self._carried is not None:
            self._carried.message(topic, at, data)

    def tick(self, at: int, tick: Tick) -> None:
        """Keep the content of a tick's message for the beginning of a further file."""
        if self._carried is not None:
            self._carried.tick(at, tick)

    def attachment(self, name: str, media_type: str, data: bytes, slot: str = "") -> None:
        """Write an attachment. A further part of the log repeats only the last one of each slot."""
        self._file.attachment(name, media_type, data)
        if self._carried is not None:
            self._carried.file(CarriedFile(name, media_type, data), slot or name)

    def metadata(self, name: str, words: Mapping[str, str]) -> None:
        self._file.metadata(name, words)
        if self._carried is not None:
            self._carried.metadata(name, words)

    def checkpoint(self) -> None:
        self._file.checkpoint()

    def finish(self) -> None:
        self._file.finish()

    def rotate_if_due(self, at: int, digest: str) -> None:
        """Continue in a further file when the present one has reached its limit. Call it between two
        ticks."""
        carried = self._carried
        if carried is None:
            return
        if carried.time < 0:
            self._check_limit()
            self._start = at
        elif at > carried.time >= self._start and self._full(at):
            self._rotate(carried, digest)
            self._start = at

    def _full(self, at: int) -> bool:
        size, seconds = self._rotation.size, self._rotation.seconds
        return bool((size and self._file.size >= size) or (seconds and at - self._start >= seconds * 1e9))

    def _check_limit(self) -> None:
        limit, begun = self._rotation.size, self._file.size
        if 0 < limit < 2 * begun:
            raise PicktreeError(
                f"{self._first}: each part of this log begins with {begun / 1e6:.1f} MB that it needs to "
                f"open by itself; rotate it at {-(-2 * begun // 10**6)} MB or more"
            )

    def _rotate(self, carried: RotationState, digest: str) -> None:
        self._file.checkpoint()
        path = part_path(self._first, self._number + 1)
        channels: dict[str, int] = {}
        file = self._new_file(path, channels)
        again = carried.all_messages()
        repeated = Counter(topic.name for topic, _ in again)
        part = PartInfo(self._number + 1, carried.time, digest, repeated)
        for name, words in carried.all_metadata().items():
            file.metadata(name, words)
        file.metadata(PART_METADATA, part.words())
        for carry in carried.all_files():
            file.attachment(carry.name, carry.media_type, carry.data)
        for topic, data in again:
            file.message(channels[topic.name], carried.time, data)
        file.checkpoint()
        before = self._file
        self._file, self._channels = file, channels
        self._number += 1
        before.metadata(NEXT_METADATA, {"part": path.name, "digest": digest})
        before.finish()

    def _new_file(self, path: Path, channels: dict[str, int]) -> McapFile:
        file = McapFile(path, checkpoint=self._checkpoint, chunk_bytes=self._chunk_bytes, wall=self._wall)
        channels.update((topic.name, file.channel(topic)) for topic in topics.FIXED)
        return file

    def _beat(self) -> bool:
        try:
            self._file.keep_up(_MAX_MESSAGE_AGE)
        except PicktreeError:
            return False  # the next write raises the error
        return not self._file.failed
