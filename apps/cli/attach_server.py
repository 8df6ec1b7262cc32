"""Attach server: its clients, which are polled without waiting, and the messages to them."""

from __future__ import annotations

import contextlib
import io
import json
import select
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self, TypeAlias

import orjson

from picktree.files import PicktreeError
from picktree.logs import topics
from picktree.session import Debugger, DebuggerStop, Interrupter, LastMessages, attach_socket, mission_edits

from .command_prompt import Command
from .debug_prompt import DebugPrompt, place
from .progress import deepest_running

if TYPE_CHECKING:
    from picktree.logs import RunResult, Topic
    from picktree.robot import operator_desk
    from picktree.session import Execution
    from picktree.world import Tick

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
        """Whether stops and questions wait for this client; None: not yet declared."""
        self.follows = False
        """Whether it receives the messages of the log."""
        self.behind = False
        """Whether the client has missed messages since it received the whole state."""
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
        """Receive messages, send what waits, yield new clients. `timeout`: ms; None: until one comes."""
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


_STATE_PERIOD = 0.2
"""Maximum interval between two states that are sent while ticks come, wall s."""
_LOG_PERIOD = 0.04
"""Minimum interval between two sendings of the log, wall s: the ticks of a fast run are sent together."""
_NOT_FOLLOWED: Final = frozenset({topics.ROBOT.name, topics.STATE.name, topics.TIMING.name})
"""Topics that followers do not receive: the log has them."""


class AttachPrompt(DebugPrompt):
    """Commands of the debugger for attached processes, with those for a running or asking run."""

    def __init__(self, server: AttachServer) -> None:
        super().__init__(lambda _: "", io.StringIO())
        self._server = server
        self.offer(
            Command("pause", "stop at the end of the next tick", self._pause),
            Command("answer TEXT", "the answer when the mission asks for help", self._answer),
            Command("take FILE", "continue with this mission from the next item on", self._take),
            Command("halt", "bring the arm to rest, and interrupt the run", self._halt),
        )

    def respond(self, debugger: Debugger, stop: DebuggerStop, line: str) -> tuple[str, bool]:
        """Run a command line; return its output, and whether the run continues."""
        self._debugger, self._stop = debugger, stop
        with self.into(io.StringIO()) as out:
            continues = bool(line.strip()) and self.carry_out(line.strip())
        return out.getvalue(), continues

    def _pause(self, _: str) -> bool:
        if self._server.stopped:
            raise PicktreeError("the run is stopped already")
        self._debug.step()
        self._server.count_pause()
        return True

    def _answer(self, text: str) -> bool:
        self._server.take_answer(text)
        return False

    def _take(self, file: str) -> bool:
        if not file:
            raise PicktreeError("take what? A mission file, as 'take sort.yaml'")
        self._server.take_mission(Path(file))
        return self._show([mission_edits.TAKEN_LATER])

    def _halt(self, _: str) -> bool:
        self._server.halt()
        return True


class AttachServer(Interrupter):
    """Server of attached processes, polled after each tick: no thread, and one system call when nobody is
    attached. A context manager.

    A stop or a question lasts until a steering client continues or answers, or until none is attached. The
    run is the same with and without clients, unless they interrupt it or answer. Where the file system has
    no sockets, nobody can attach.
    """

    def __init__(self, *, waits: bool = False) -> None:
        """`waits`: a question waits until a client comes and answers, also when none is attached."""
        self._waits = waits
        self._path: Path | None = None
        self._clients = Clients(self._receive, self._forget)
        self._commands: deque[tuple[Client, str]] = deque()
        self._prompt = AttachPrompt(self)
        self._debugger = Debugger(self._stop_there, at_start=False, file_breakpoints=False)
        self._run: Execution | None = None
        self._hooked = False
        self._standing: Mapping[str, object] | None = None
        """Message of the present stop or question; None: the run is not stopped."""
        self._question: operator_desk.OperatorQuestion | None = None
        self._given: str | None = None
        self._halts = False
        self._state: tuple[str, str] = ("", "")
        self._state_sent = 0.0
        self._reported: object = None
        """Reports of the nodes in the last state."""
        self._last = LastMessages()
        self._new: list[LogMessage] = []
        """Messages of the log since the last tick that were not sent to followers yet."""
        self._log_sent = 0.0
        self._breakpoints: Sequence[object] = ()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    @property
    def stopped(self) -> bool:
        return self._standing is not None and self._question is None

    def take_answer(self, text: str) -> None:
        """Answer the pending question. Raises PicktreeError without a question or without such a choice."""
        if self._question is None:
            raise PicktreeError("no question waits for an answer")
        choice = self._question.choice(text)
        if choice is None:
            known = ", ".join(self._question.choices)
            raise PicktreeError(f"{text!r} is not among the answers; write a number or one of these: {known}")
        self._given = choice

    def take_mission(self, file: Path) -> None:
        """Take over the mission of a file when the run is quiescent. Raises PicktreeError with its faults."""
        assert self._run is not None
        self.pending = mission_edits.read_replacement(self._run, file)

    def count_pause(self) -> None:
        """Count a pause of the run by a person."""
        assert self._run is not None
        self._run.tally.figures.assist("pause")

    def halt(self) -> None:
        """End the run after the present tick, with the arm at rest."""
        self._halts = True

    # Called by the session.

    def started(self, run: Execution, folder: Path) -> None:
        self._run, self._path = run, folder.absolute() / attach_socket.SOCKET_NAME
        with contextlib.suppress(OSError):
            self._clients.listen(attach_socket.listen_in(folder.absolute()))

    def edited(self, run: Execution) -> None:
        if self._hooked:
            self._debugger.follow(run.tree)

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        if not self._clients.listens:
            return
        if self._clients.follows and time.monotonic() - self._log_sent >= _LOG_PERIOD:
            self._send_log()
        if self._hooked:
            self._debugger.pause_after_tick()
        self._exchange(0)
        while self._commands:
            self._carry_out(DebuggerStop("tick"))
        if self._clients:
            self._send_state(now, report, items_done, items_total)

    def notified(self, now: float, text: str) -> None:
        self._clients.send_all({"told": text, "time": now})

    def recorded(self, topic: Topic, at: int, data: bytes, in_digest: bool) -> None:
        self._last.keep(topic, at, data)
        if self._clients.follows and _followed(topic.name):
            self._new.append((topic.name, at, data))

    def halts(self) -> bool:
        return self._halts

    def answer(self, question: operator_desk.OperatorQuestion) -> str | None:
        if not self._clients.listens:
            return None
        self._exchange(0)
        self._question, self._given = question, None
        self._wait({"question": question.to_json()}, DebuggerStop("tick"))
        self._question = None
        return self._given

    def finished(self, result: RunResult) -> None:
        self._send_log()
        self._clients.send_all({"end": result.status})
        self._close()

    # Stops.

    def _stop_there(self, debugger: Debugger, stop: DebuggerStop) -> None:
        now = debugger.tree.root.world.clock.now
        where = place(debugger.tree, stop)
        self._wait({"stop": where, "when": stop.when, "path": stop.path, "time": now}, stop)

    def _wait(self, standing: Mapping[str, object], stop: DebuggerStop) -> None:
        """Carry out commands until the run continues: by a command, an answer, or without a steering
        client."""
        if not self._is_awaited():
            return
        self._standing = standing
        self._send_log()
        self._send_standing()
        self._clients.send_all(standing)
        try:
            while self._is_awaited():
                while self._commands:
                    continues = self._carry_out(stop)
                    if self._halts or (self._given is not None if self._question else continues):
                        return
                self._exchange(None)
        finally:
            self._standing = None
            self._clients.send_all({"going": True})

    def _is_awaited(self) -> bool:
        """Whether a client may end the present stop or question."""
        return (self._waits and self._question is not None) or any(client.steers for client in self._clients)

    def _carry_out(self, stop: DebuggerStop) -> bool:
        """Carry out the next command; return whether the run continues. Raises KeyboardInterrupt for
        `quit`."""
        client, line = self._commands.popleft()
        try:
            text, continues = self._prompt.respond(self._debugger, stop, line)
        except KeyboardInterrupt:
            self._clients.send(client, {"reply": "", "goes_on": True})
            raise
        self._clients.send(client, {"reply": text, "goes_on": continues and self._question is None})
        self._send_breakpoints()
        if not continues:
            self._send_standing()
        return continues

    # Messages.

    def _exchange(self, timeout: int | None) -> None:
        """Welcome clients, receive lines, send what waits. `timeout`: ms; None: until one comes."""
        for client in self._clients.exchange(timeout):
            self._welcome(client)

    def _welcome(self, client: Client) -> None:
        assert self._run is not None and self._path is not None
        if not self._hooked:
            self._hooked = True
            self._debugger.attach(self._run.tree)
        self._state = ("", "")
        self._clients.send(client, {"run": str(self._path.parent), "time": self._run.world.clock.now})
        if self._standing is not None:
            self._clients.send(client, self._standing)

    def _receive(self, client: Client, message: Mapping[str, object]) -> None:
        """Take a message. Raises KeyError, TypeError for one that is not in the protocol."""
        if client.steers is None:
            client.steers = bool(message["steer"])
            if message.get("follow"):
                self._begin_following(client)
            return
        line = message["line"]
        if not client.steers or not isinstance(line, str):
            raise TypeError("a client that watches sends no commands")
        self._commands.append((client, line))

    def _forget(self, client: Client) -> None:
        """Leave out the commands of a client that has gone."""
        self._commands = deque(each for each in self._commands if each[0] is not client)

    # The log, for those who follow it.

    def _begin_following(self, client: Client) -> None:
        """Send the state of the run to a new follower."""
        self._send_log()
        client.follows = self._clients.follows = True
        self._clients.send_whole(client, self._whole())
        self._clients.send(client, {"breakpoints": self._breakpoints})
        self._clients.send(client, self._board())

    def _whole(self) -> Sequence[LogMessage]:
        held = [(name, at, data) for name, last in self._last.items() for at, data in last if _followed(name)]
        return sorted(held, key=lambda each: each[1])

    def _send_log(self) -> None:
        new, self._new = self._new, []
        self._log_sent = time.monotonic()
        if new:
            self._clients.send_log(new, self._whole)

    def _board(self) -> Mapping[str, object]:
        """Return the present statuses and blackboard: at a stop within a tick no message has them yet."""
        assert self._run is not None
        tree = self._run.tree
        statuses = {node.path: str(node.state) for node in tree.nodes}
        return {"statuses": statuses, "blackboard": tree.blackboard.save()}

    def _send_standing(self) -> None:
        """Send statuses and blackboard to followers."""
        if self._clients.follows:
            board = self._board()
            for client in self._clients:
                if client.follows and len(client.outgoing) <= STATE_BACKLOG:
                    self._clients.send(client, board)

    def _send_breakpoints(self) -> None:
        """Send the breakpoints to all clients when they have changed."""
        known = self._debugger.breakpoints
        breakpoints = [{"number": n, "path": b.path, "when": b.when} for n, b in known.items()]
        if breakpoints != self._breakpoints:
            self._breakpoints = breakpoints
            self._clients.send_all({"breakpoints": breakpoints})

    def _send_state(self, now: float, report: Tick, done: int, total: int) -> None:
        """Send the run's state: at each change, and a few times per second of wall time."""
        assert self._run is not None
        recent = time.monotonic() - self._state_sent < _STATE_PERIOD
        if recent and report.nodes is self._reported:  # the same tuple while nothing in it changes
            return
        self._reported = report.nodes
        leaves = self._run.tree.leaves
        failures = [
            f"{node.path}: {node.cause}: {node.message}"
            for node in report.nodes
            if node.cause and node.ticked and node.status == "FAILURE" and node.path in leaves
        ]
        tally = self._run.tally
        state = (tally.progress(total), deepest_running(report.nodes))
        if state == self._state and not failures and recent:
            return
        self._state, self._state_sent = state, time.monotonic()
        self._clients.send_all(
            {
                "state": state[0],
                "time": now,
                "done": done,
                "total": total,
                "node": state[1],
                "figures": tally.operator_figures(now).to_text(),
                "failures": failures,
            },
            limit=STATE_BACKLOG,
        )

    def _close(self) -> None:
        listened = self._clients.listens
        self._clients.close()
        if listened and self._path is not None:
            self._path.unlink(missing_ok=True)


def _followed(topic: str) -> bool:
    """Whether followers receive the messages of a topic."""
    return topic not in _NOT_FOLLOWED and not topic.endswith("/depth")
