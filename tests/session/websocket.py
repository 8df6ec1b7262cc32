"""A WebSocket client of its own, so that the live view is met as a viewer meets it: RFC 6455 on a socket."""

from __future__ import annotations

import base64
import json
import os
import socket
import struct
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

_TEXT, _BINARY, _CLOSE, _PING, _PONG = 1, 2, 8, 9, 10


@dataclass(frozen=True)
class Received:
    topic: str
    time: int
    data: bytes


@dataclass
class Client:
    """Speaks `foxglove.sdk.v1`: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md"""

    port: int
    channels: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    """What was advertised, by topic."""
    info: dict[str, Any] = field(default_factory=dict[str, Any])
    clock: int = -1
    _topics: dict[int, str] = field(default_factory=dict[int, str])
    _kept: list[tuple[int, bytes]] = field(default_factory=list[tuple[int, bytes]])

    def __enter__(self) -> Client:
        self._socket = socket.create_connection(("127.0.0.1", self.port), timeout=300)
        key = base64.b64encode(os.urandom(16)).decode()
        self._socket.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{self.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
        )
        self._buffer = b""
        while b"\r\n\r\n" not in self._buffer:
            self._buffer += self._socket.recv(65536)
        head, self._buffer = self._buffer.split(b"\r\n\r\n", 1)
        assert b" 101 " in head.split(b"\r\n")[0], head
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def wait_for(self, topics: Iterable[str]) -> None:
        """Until all of these are advertised."""
        while not set(topics) <= set(self.channels):
            assert self.receive() is None

    def subscribe(self, topics: Iterable[str]) -> None:
        """Returns when the server has heard of it."""
        wanted = [{"id": self.channels[t]["id"] + 1000, "channelId": self.channels[t]["id"]} for t in topics]
        self._topics.update({self.channels[t]["id"] + 1000: t for t in topics})
        self._send(_TEXT, json.dumps({"op": "subscribe", "subscriptions": wanted}).encode())
        self._send(_PING, b"heard?")  # it is answered after what was sent before
        while (frame := self._frame())[0] != _PONG:
            self._kept.append(frame)

    def receive(self) -> Received | None:
        """The next message of a topic; None for what else the server has to say."""
        opcode, data = self._kept.pop(0) if self._kept else self._frame()
        if opcode == _PING:
            self._send(_PONG, data)
        elif opcode == _TEXT:
            said = json.loads(data)
            if said["op"] == "serverInfo":
                self.info = said
            elif said["op"] == "advertise":
                self.channels.update({channel["topic"]: channel for channel in said["channels"]})
        elif opcode == _BINARY and data[0] == 2:
            (self.clock,) = struct.unpack_from("<Q", data, 1)
        elif opcode == _BINARY and data[0] == 1:
            subscription, time = struct.unpack_from("<IQ", data, 1)
            return Received(self._topics[subscription], time, data[13:])
        elif opcode == _CLOSE:
            raise ConnectionError("closed by the server")
        return None

    def messages(self, count: int) -> list[Received]:
        """The next so many messages."""
        found: list[Received] = []
        while len(found) < count:
            message = self.receive()
            if message is not None:
                found.append(message)
        return found

    def rest(self) -> list[Received]:
        """All messages until the server ends."""
        found: list[Received] = []
        try:
            while True:
                message = self.receive()
                if message is not None:
                    found.append(message)
        except ConnectionError:
            return found

    def _frame(self) -> tuple[int, bytes]:
        first, second = self._take(2)
        assert first & 0x80, "a message in parts"
        size = second & 0x7F
        if size == 126:
            (size,) = struct.unpack(">H", self._take(2))
        elif size == 127:
            (size,) = struct.unpack(">Q", self._take(8))
        return first & 0x0F, self._take(size)

    def _take(self, count: int) -> bytes:
        while len(self._buffer) < count:
            more = self._socket.recv(1 << 20)
            if not more:
                raise ConnectionError("the server is gone")
            self._buffer += more
        data, self._buffer = self._buffer[:count], self._buffer[count:]
        return data

    def _send(self, opcode: int, data: bytes) -> None:
        mask = os.urandom(4)
        size = bytes([0x80 | len(data)]) if len(data) < 126 else b"\xfe" + struct.pack(">H", len(data))
        masked = bytes(byte ^ mask[k % 4] for k, byte in enumerate(data))
        self._socket.sendall(bytes([0x80 | opcode]) + size + mask + masked)
