"""Live view: every recorded message of the log over a Foxglove WebSocket on this machine.

It sends the recorder's own bytes, so it has the log's topics, schemas and times. A late client receives the
last message of each topic that holds a state. Nothing in here delays the run: messages that a client does not
take in time are dropped for it, the oldest first.
"""

from __future__ import annotations

import queue
import threading
import time

import foxglove
from foxglove.websocket import Capability, ChannelView, Client, ServerListener

from picktree.files import PicktreeError
from picktree.logs import Topic, topics

from .observer import Observer
from .session_recording import LastMessages

LIVE_HOST = "127.0.0.1"
DEFAULT_LIVE_PORT = 8765
"""Default port of Foxglove and Lichtblick."""
_MAX_BACKLOG = 8192
"""Maximum number of messages that wait for a client: about a minute and a half of simulated time."""
_CLOSING_TIME = 0.5
"""Wall seconds at the end in which clients take the messages that wait for them."""


class LiveServer(Observer):
    """WebSocket server, from its creation until it is closed; a context manager.

    Raises PicktreeError when the port is not available. `port` 0 takes any free port.
    """

    def __init__(self, port: int = DEFAULT_LIVE_PORT, name: str = "picktree") -> None:
        self._context = foxglove.Context()
        self._channels: dict[str, foxglove.Channel] = {}
        self._last = LastMessages()
        self._now = 0
        self._met = False
        self._lock = threading.Lock()
        self._wanted: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        for topic in topics.FIXED:
            self._channel(topic)
        try:
            self._server = foxglove.start_server(
                name=name,
                host=LIVE_HOST,
                port=port,
                capabilities=[Capability.Time],
                server_listener=_Listener(self._wanted),
                context=self._context,
                message_backlog_size=_MAX_BACKLOG,
            )
        except (RuntimeError, OverflowError) as error:
            raise PicktreeError(
                f"no live view on port {port}: {_reason(error)}; give another with --live-port"
            ) from None
        self._resender = threading.Thread(target=self._resend, name="live view", daemon=True)
        self._resender.start()

    @property
    def url(self) -> str:
        return f"ws://{LIVE_HOST}:{self._server.port}"

    def recorded(self, topic: Topic, at: int, data: bytes, in_digest: bool) -> None:
        """Send a recorded message; `at` is simulated ns."""
        with self._lock:
            self._last.keep(topic, at, data)
            self._channel(topic).log(data, log_time=at)
            if topic is topics.TICK:
                self._now = at
                self._server.broadcast_time(at)

    def close(self) -> None:
        """Stop the server, once; then the port is free."""
        if self._resender.is_alive():
            self._wanted.put(None)
            self._resender.join()
            time.sleep(_CLOSING_TIME if self._met else 0.0)
            self._server.stop()

    def __enter__(self) -> LiveServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _channel(self, topic: Topic) -> foxglove.Channel:
        channel = self._channels.get(topic.name)
        if channel is None:
            schema = foxglove.Schema(
                name=topic.schema, encoding=topic.schema_encoding, data=topic.schema_data()
            )
            channel = self._channels[topic.name] = foxglove.Channel(
                topic.name, schema=schema, message_encoding=topic.encoding, context=self._context
            )
        return channel

    def _resend(self) -> None:
        """Send the last messages of newly subscribed topics, in a thread of its own.

        The server's thread may not wait for the run's thread, and the run may be stopped.
        """
        while (name := self._wanted.get()) is not None:
            self._met = True
            with self._lock:
                for at, data in self._last.get(name, ()):
                    self._server.broadcast_time(self._now)
                    self._channels[name].log(data, log_time=at)


class _Listener(ServerListener):
    """Listener that queues the topics to which clients subscribe; called in the server's threads."""

    def __init__(self, wanted: queue.SimpleQueue[str | None]) -> None:
        self._wanted = wanted

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self._wanted.put(channel.topic)


def _reason(error: RuntimeError | OverflowError) -> str:
    if isinstance(error, OverflowError):
        return "there is no such port"
    if "in use" in str(error):
        return "something else listens there"
    if "ermission denied" in str(error):
        return "permission denied"
    return str(error)
