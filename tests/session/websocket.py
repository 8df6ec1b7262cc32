"""A client of the live view that speaks `foxglove.sdk.v1`, as a viewer does.

https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

PATIENCE = 300.0


@dataclass(frozen=True)
class Received:
    topic: str
    time: int
    data: bytes


@dataclass
class Client:
    port: int
    most: int | None = None
    """Number of messages after which it does not listen until they are received; None: it always listens."""
    channels: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    """What was advertised, by topic."""
    info: dict[str, Any] = field(default_factory=dict[str, Any])
    clock: int = -1
    _topics: dict[int, str] = field(default_factory=dict[int, str])

    def __enter__(self) -> Client:
        self._connection = connect(
            f"ws://127.0.0.1:{self.port}",
            subprotocols=[Subprotocol("foxglove.sdk.v1")],
            max_size=None,
            max_queue=self.most,
            ping_interval=None,
            close_timeout=0.1,
        )
        self._socket = self._connection.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.__exit__(None, None, None)

    def wait_for(self, topics: Iterable[str]) -> None:
        """Until all of these are advertised."""
        while not set(topics) <= set(self.channels):
            assert self.receive() is None

    def subscribe(self, topics: Iterable[str]) -> None:
        """Returns when the server has heard of it."""
        wanted = {self.channels[topic]["id"] + 1000: topic for topic in topics}
        self._topics.update(wanted)
        subscriptions = [{"id": number, "channelId": number - 1000} for number in wanted]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
        assert self._socket.ping().wait(PATIENCE)  # it is answered after what was sent before

    def receive(self) -> Received | None:
        """The next message of a topic; None for what else the server has to say."""
        data = self._socket.recv(PATIENCE)
        if isinstance(data, str):
            said = json.loads(data)
            if said["op"] == "serverInfo":
                self.info = said
            elif said["op"] == "advertise":
                self.channels.update({channel["topic"]: channel for channel in said["channels"]})
        elif data[0] == 2:
            (self.clock,) = struct.unpack_from("<Q", data, 1)
        elif data[0] == 1:
            subscription, time = struct.unpack_from("<IQ", data, 1)
            return Received(self._topics[subscription], time, data[13:])
        return None

    def _received(self) -> Iterator[Received]:
        try:
            while True:
                if (message := self.receive()) is not None:
                    yield message
        except ConnectionClosed:
            return

    def messages(self, count: int) -> list[Received]:
        """The next so many messages."""
        received = self._received()
        return [next(received) for _ in range(count)]

    def rest(self) -> list[Received]:
        """All messages until the server ends."""
        return list(self._received())
