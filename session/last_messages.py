"""Last messages of a log's topics, with which a late viewer begins."""

from __future__ import annotations

from typing import Final

from ..logs.schema import topics
from ..logs.schema.topics import Topic

_MOMENTARY_TOPICS: Final = frozenset(
    topic.name
    for topic in (topics.TIMING, topics.WRENCH, topics.PLAN, topics.CANDIDATES, topics.LOG, topics.EVENTS)
)
"""Topics of momentary events. The last message of any other topic still holds when a viewer comes."""


class LastMessages(dict[str, tuple[int, bytes]]):
    """Simulated ns and payload of the last message of each topic that holds a state, by the topic's name."""

    def keep(self, topic: Topic, at: int, data: bytes) -> None:
        """Keep a message in place of the topic's earlier one, if the topic holds a state."""
        if topic.name not in _MOMENTARY_TOPICS:
            self[topic.name] = (at, data)
