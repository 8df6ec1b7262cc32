"""Clients of the attach server: connections that are polled without waiting, and the messages to them."""

from __future__ import annotations

import contextlib
import json
import select
import socket
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, TypeAlias

import orjson

_MAX_LINE: Final = 1 << 16
"""Maximum length of a line of a client, bytes."""
STATE_BACKLOG: Final = 1 << 16
"""Bytes that wait for a client, above which it receives no states."""
_FOLLOWER_BACKLOG: Final = 1 << 20
"""Bytes that wait for a follower, above which it receives no messages of the log until they are sent."""
_MAX_BACKLOG: Final = 1 << 22
"""Bytes that wait for a client, above which it is disconnected."""

LogMessage: TypeAlias = tuple[str, int, bytes]
"""Topic, simulated ns, payload."""


class Client:
    """Connection to one attached process."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.steers: bool | None = None
        """Whether stops and questions wait for it; None: it has not said so yet."""
        self.follows = False
        """Whether it receives the messages of the log."""
        self.behind = False
        """Whether messages were left out for it since it received the whole state."""
        self.outgoing = bytearray()
        self.polled_for_room = False
        """Whether the poll waits for room to send."""
        self._incoming = bytearray()

    def lines(self) -> list[bytes]:
        """Return the lines that have arrived. Raises OSError or ValueError when the connection is over."""
        piece = self.connection.recv(_MAX_LINE)
        if not piece:
            raise ConnectionResetError
        self._incoming += piece
        *lines, rest = self._incoming.split(b"\n")
        if len(rest) > _MAX_LINE:
            raise ValueError("a line is too long")
        self._incoming = bytearray(rest)
        return [bytes(line) for line in lines]

    def flush(self) -> None:
        """Send what can be sent without waiting. Raises OSError when the connection is over."""
        with contextlib.suppress(BlockingIOError):
            while self.outgoing:
                del self.outgoing[: self.connection.send(self.outgoing)]


class Clients:
    """Attached clients by descriptor, with the listening socket; one system call looks at all of them."""

    def __init__(
        self, receive: Callable[[Client, Mapping[str, object]], None], dropped: Callable[[Client], None]
    ) -> None:
        """`receive` takes a message; it raises KeyError or TypeError for one that is not in the protocol.
        `dropped` is called with a client that was disconnected."""
        self._receive, self._dropped = receive, dropped
        self._poll = select.poll()
        self._listener: socket.socket | None = None
        self._clients: dict[int, Client] = {}
        self.follows = False
        """Whether a client follows the log."""

    def __iter__(self) -> Iterator[Client]:
        return iter(tuple(self._clients.values()))

    def __bool__(self) -> bool:
        return bool(self._clients)

    @property
    def listens(self) -> bool:
        return self._listener is not None

    def listen(self, listener: socket.socket) -> None:
        """Take clients from a listening socket that does not block."""
        self._listener = listener
        self._poll.register(listener, select.POLLIN)

    def exchange(self, timeout: int | None) -> Iterator[Client]:
        """Receive the clients' messages, send what waits for them; yield new clients. `timeout`: ms; None:
        until something comes."""
        for descriptor, event in self._poll.poll(timeout):
            client = self._clients.get(descriptor)
            if client is None:
                yield from self._accepted()
                continue
            try:
                if event & ~select.POLLOUT:
                    for line in client.lines():
                        self._receive(client, json.loads(line))
            except (OSError, ValueError, TypeError, KeyError, RecursionError):
                self.drop(client)
            else:
                self._flush(client)

    def _accepted(self) -> Iterator[Client]:
        assert self._listener is not None
        try:
            connection, _ = self._listener.accept()
        except OSError:  # It has gone again.
            return
        connection.setblocking(False)
        client = self._clients[connection.fileno()] = Client(connection)
        self._poll.register(connection, select.POLLIN)
        yield client

    def send_all(self, message: Mapping[str, object], limit: int = _MAX_BACKLOG) -> None:
        """Send to all clients. A client with more bytes waiting than `limit` does not receive it."""
        for client in self:
            if len(client.outgoing) <= limit:
                self.send(client, message)

    def send(self, client: Client, message: Mapping[str, object], payloads: bytes = b"") -> None:
        client.outgoing += json.dumps(message).encode() + b"\n" + payloads
        self._flush(client)

    def send_log(self, messages: Sequence[LogMessage], whole: Callable[[], Sequence[LogMessage]]) -> None:
        """Send messages of the log to those who follow it.

        A client that does not take them in time misses messages, and receives `whole` once it has taken what
        it was sent.
        """
        sizes = [[topic, at, len(data)] for topic, at, data in messages]
        header = {"messages": sizes, "wall": time.time()}
        frame = orjson.dumps(header) + b"\n" + b"".join([data for _, _, data in messages])
        for client in self:
            if not client.follows:
                continue
            if client.behind and not client.outgoing:
                client.behind = False
                self.send_whole(client, whole())
            elif client.behind or len(client.outgoing) > _FOLLOWER_BACKLOG:
                client.behind = True
                self._flush(client)
            else:
                client.outgoing += frame
                self._flush(client)

    def send_whole(self, client: Client, messages: Sequence[LogMessage]) -> None:
        """Send the last messages of all topics, as the beginning of what a client follows."""
        header = {"messages": [[topic, at, len(data)] for topic, at, data in messages], "whole": True}
        self.send(client, header, b"".join([data for _, _, data in messages]))

    def _flush(self, client: Client) -> None:
        descriptor = client.connection.fileno()
        if descriptor < 0:
            return
        try:
            client.flush()
        except OSError:
            client.outgoing.clear()
            self.drop(client)
            return
        if len(client.outgoing) > _MAX_BACKLOG:
            self.drop(client)
            return
        if client.polled_for_room != bool(client.outgoing):
            client.polled_for_room = bool(client.outgoing)
            self._poll.modify(descriptor, select.POLLIN | (select.POLLOUT if client.outgoing else 0))

    def drop(self, client: Client) -> None:
        """Disconnect a client."""
        descriptor = client.connection.fileno()
        if descriptor < 0:
            return
        self._poll.unregister(descriptor)
        del self._clients[descriptor]
        self.follows = any(each.follows for each in self)
        self._dropped(client)
        client.connection.close()

    def close(self) -> None:
        """Disconnect all clients and take no further ones."""
        for client in self:
            self.drop(client)
        if self._listener is not None:
            self._listener.close()
            self._listener = None
