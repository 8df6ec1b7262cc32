"""What a further file of a log repeats, so that it opens and is understood by itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..schema import topics
from ..schema.json_records import encode
from ..schema.records import Tick, Transition, Write
from ..schema.topics import Topic
from .foxglove_messages import restamped

_STATE = (topics.TREE, topics.ROBOT, topics.OBJECTS, topics.TRUTH)
"""What holds until it is written anew."""
_EACH_TICK = (topics.JOINTS, topics.TF, topics.WRENCH, topics.CONTROL)
_KEPT = frozenset(topic.name for topic in (*_STATE, *_EACH_TICK))


@dataclass(frozen=True, slots=True)
class CarriedFile:
    name: str
    media_type: str
    data: bytes


class CarriedOver:
    """Follows what is written to a log, and says how the next file is to begin.

    It begins as of the last tick: with that tick, in which every running node begins and the whole
    blackboard is written, and with the state of everything else at its time.
    """

    def __init__(self) -> None:
        self._metadata: dict[str, Mapping[str, str]] = {}
        self._files: dict[str, CarriedFile] = {}
        self._messages: dict[str, tuple[int, bytes]] = {}
        self._writes: dict[str, Write] = {}
        self._running: dict[str, Transition] = {}
        self._tick: Tick | None = None
        self.time = -1
        """Of the last tick, simulated ns; negative before the first."""

    def metadata(self, name: str, words: Mapping[str, str]) -> None:
        self._metadata[name] = dict(words)

    def file(self, file: CarriedFile, slot: str) -> None:
        """Of the files of a slot the last is carried over."""
        self._files.pop(slot, None)
        self._files[slot] = file

    def message(self, topic: Topic, time: int, data: bytes) -> None:
        if topic.name in _KEPT:
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
        """As of `time`."""
        found: list[tuple[Topic, bytes]] = []
        for topic in _STATE:
            if topic.name in self._messages:
                data = self._messages[topic.name][1]
                found.append((topic, data if topic is topics.TREE else restamped(data, self.time)))
        for topic in _EACH_TICK:
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
