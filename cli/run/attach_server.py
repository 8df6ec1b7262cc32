"""Attach server: a Unix socket in the run's folder, over which other processes watch and steer the run.

Both sides send JSON objects, one a line. A client sends `{"steer": bool}` first, then `{"line": COMMAND}`.
The server sends `reply` to each command, and to all clients `run`, `state`, `stop`, `going`, `question`,
`told` and `end`.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import select
import socket
import time
from collections import deque
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Self

from ...errors import PicktreeError
from ...session.debugger import Debugger, DebuggerStop
from ...session.observer import Interrupter
from ..terminal.command_prompt import Command
from ..terminal.progress import deepest_running
from .operator_prompt import DebugPrompt, place

if TYPE_CHECKING:
    from ...logs.run_result import RunResult
    from ...session.execution import Execution
    from ...skill_world.operator_desk import OperatorQuestion
    from ...trees.running.runner import TickReport

SOCKET_NAME = "attach.sock"
"""Name of the socket in the run's folder."""
_STATE_PERIOD = 0.2
"""Maximum interval between two states that are sent while ticks come, wall s."""
_MAX_LINE = 1 << 16
"""Maximum length of a line of a client, bytes."""
_STATE_BACKLOG, _MAX_BACKLOG = 1 << 16, 1 << 22
"""Bytes that wait for a client, above which it receives no states, and above which it is disconnected."""


@contextmanager
def socket_address(folder: Path) -> Generator[str]:
    """Return an address of the socket that is short, however long the folder's path is.

    The address of a Unix socket has at most 108 bytes.
    """
    descriptor = os.open(folder, os.O_PATH | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{descriptor}/{SOCKET_NAME}"
    finally:
        os.close(descriptor)


class _Client:
    """Connection to one attached process."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.steers: bool | None = None
        """Whether stops and questions wait for it; None: it has not said so yet."""
        self.outgoing = bytearray()
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


class AttachPrompt(DebugPrompt):
    """Commands of the debugger for attached processes, with those for a run that goes on or asks."""

    def __init__(self, server: AttachServer) -> None:
        super().__init__(lambda _: "", io.StringIO())
        self._server = server
        self.offer(
            Command("pause", "stop at the end of the next tick", self._pause),
            Command("answer TEXT", "the answer when the mission asks for help", self._answer),
        )

    def respond(self, debugger: Debugger, stop: DebuggerStop, line: str) -> tuple[str, bool]:
        """Run a command line; return its output, and whether the run goes on."""
        self._debugger, self._stop = debugger, stop
        with self.into(io.StringIO()) as out:
            goes_on = bool(line.strip()) and self.carry_out(line.strip())
        return out.getvalue(), goes_on

    def _pause(self, _: str) -> bool:
        if self._server.stopped:
            raise PicktreeError("the run is stopped already")
        self._debug.step()
        return True

    def _answer(self, text: str) -> bool:
        self._server.take_answer(text)
        return False


class AttachServer(Interrupter):
    """Server of attached processes, polled after each tick: no thread, and one system call when nobody is
    attached. A context manager.

    A stop or a question lasts until a steering client continues or answers, or until none is attached. The
    run is the same with and without clients, unless they interrupt it or answer. Where the file system has
    no sockets, nobody can attach.
    """

    def __init__(self) -> None:
        self._listener: socket.socket | None = None
        self._path: Path | None = None
        self._poll = select.poll()
        self._clients: dict[int, _Client] = {}
        self._commands: deque[tuple[_Client, str]] = deque()
        self._prompt = AttachPrompt(self)
        self._debugger = Debugger(self._stop_there, at_start=False, file_breakpoints=False)
        self._run: Execution | None = None
        self._hooked = False
        self._standing: Mapping[str, object] | None = None
        """Message of the present stop or question; None: the run goes on."""
        self._question: OperatorQuestion | None = None
        self._given: str | None = None
        self._state: tuple[str, str] = ("", "")
        self._state_sent = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    @property
    def stopped(self) -> bool:
        return self._standing is not None and self._question is None

    def take_answer(self, text: str) -> None:
        """Answer the pending question. Raises PicktreeError when there is none, or no such choice."""
        if self._question is None:
            raise PicktreeError("no question waits for an answer")
        choice = self._question.choice(text)
        if choice is None:
            known = ", ".join(self._question.choices)
            raise PicktreeError(f"{text!r} is none of the answers; write a number or one of these: {known}")
        self._given = choice

    # Called by the session.

    def started(self, run: Execution, folder: Path) -> None:
        self._run, self._path = run, folder.absolute() / SOCKET_NAME
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
        try:
            os.fchmod(listener.fileno(), 0o600)  # Linux: the mode of the file that `bind` makes.
            with socket_address(folder) as address:
                listener.bind(address)
            listener.listen()
        except OSError:
            listener.close()
            return
        self._listener = listener
        self._poll.register(listener, select.POLLIN)

    def edited(self, run: Execution) -> None:
        if self._hooked:
            self._debugger.follow(run.tree)

    def ticked(self, now: float, report: TickReport, items_done: int, items_total: int) -> None:
        if self._listener is None:
            return
        if self._hooked:
            self._debugger.pause_after_tick()
        self._exchange(0)
        while self._commands:
            self._carry_out(DebuggerStop("tick"))
        if self._clients:
            self._send_state(now, report, items_done, items_total)

    def told(self, now: float, text: str) -> None:
        self._send_all({"told": text, "time": now})

    def answer(self, question: OperatorQuestion) -> str | None:
        if self._listener is None:
            return None
        self._exchange(0)
        self._question, self._given = question, None
        self._wait({"question": question.to_json()}, DebuggerStop("tick"))
        self._question = None
        return self._given

    def finished(self, result: RunResult) -> None:
        self._send_all({"end": result.status})
        self._close()

    # Stops.

    def _stop_there(self, debugger: Debugger, stop: DebuggerStop) -> None:
        self._wait({"stop": place(debugger.tree, stop), "when": stop.when, "path": stop.path}, stop)

    def _wait(self, standing: Mapping[str, object], stop: DebuggerStop) -> None:
        """Carry out commands until the run goes on: by a command, an answer, or because nobody steers."""
        if not self._steered:
            return
        self._standing = standing
        self._send_all(standing)
        try:
            while self._steered:
                while self._commands:
                    goes_on = self._carry_out(stop)
                    if self._given is not None if self._question else goes_on:
                        return
                self._exchange(None)
        finally:
            self._standing = None
            self._send_all({"going": True})

    @property
    def _steered(self) -> bool:
        return any(client.steers for client in self._clients.values())

    def _carry_out(self, stop: DebuggerStop) -> bool:
        """Carry out the next command; return whether the run goes on. Raises KeyboardInterrupt for `quit`."""
        client, line = self._commands.popleft()
        try:
            text, goes_on = self._prompt.respond(self._debugger, stop, line)
        except KeyboardInterrupt:
            self._send(client, {"reply": "", "goes_on": True})
            raise
        self._send(client, {"reply": text, "goes_on": goes_on and self._question is None})
        return goes_on

    # Messages.

    def _exchange(self, timeout: int | None) -> None:
        """Accept clients, receive their lines, send what waits for them. `timeout`: ms; None: until one
        comes."""
        for descriptor, event in self._poll.poll(timeout):
            client = self._clients.get(descriptor)
            if client is None:
                self._accept()
                continue
            try:
                if event & ~select.POLLOUT:
                    for line in client.lines():
                        self._receive(client, json.loads(line))
            except (OSError, ValueError, TypeError, KeyError, RecursionError):
                self._drop(client)
            else:
                self._flush(client)

    def _accept(self) -> None:
        assert self._listener is not None and self._run is not None and self._path is not None
        try:
            connection, _ = self._listener.accept()
        except OSError:  # It has gone again.
            return
        connection.setblocking(False)
        client = self._clients[connection.fileno()] = _Client(connection)
        self._poll.register(connection, select.POLLIN)
        if not self._hooked:
            self._hooked = True
            self._debugger.attach(self._run.tree)
        self._state = ("", "")
        self._send(client, {"run": str(self._path.parent), "time": self._run.world.clock.now})
        if self._standing is not None:
            self._send(client, self._standing)

    def _receive(self, client: _Client, message: Mapping[str, object]) -> None:
        """Take a message. Raises KeyError, TypeError for one that is not in the protocol."""
        if client.steers is None:
            client.steers = bool(message["steer"])
            return
        line = message["line"]
        if not client.steers or not isinstance(line, str):
            raise TypeError("a client that watches sends no commands")
        self._commands.append((client, line))

    def _send_state(self, now: float, report: TickReport, done: int, total: int) -> None:
        """Send where the run stands: at each change, and a few times per second of wall time."""
        assert self._run is not None
        leaves = self._run.tree.leaves
        failures = [
            f"{node.path}: {node.cause}: {node.message}"
            for node in report.nodes
            if node.cause and node.ticked and node.status == "FAILURE" and node.path in leaves
        ]
        state = (self._run.tally.progress(total), deepest_running(report.nodes))
        if state == self._state and not failures and time.monotonic() - self._state_sent < _STATE_PERIOD:
            return
        self._state, self._state_sent = state, time.monotonic()
        self._send_all(
            {
                "state": state[0],
                "time": now,
                "done": done,
                "total": total,
                "node": state[1],
                "failures": failures,
            },
            limit=_STATE_BACKLOG,
        )

    def _send_all(self, message: Mapping[str, object], limit: int = _MAX_BACKLOG) -> None:
        """Send to all clients. A client with more bytes waiting than `limit` does not receive it."""
        for client in tuple(self._clients.values()):
            if len(client.outgoing) <= limit:
                self._send(client, message)

    def _send(self, client: _Client, message: Mapping[str, object]) -> None:
        client.outgoing += json.dumps(message).encode() + b"\n"
        self._flush(client)

    def _flush(self, client: _Client) -> None:
        descriptor = client.connection.fileno()
        if descriptor < 0:
            return
        try:
            client.flush()
        except OSError:
            client.outgoing.clear()
            self._drop(client)
            return
        if len(client.outgoing) > _MAX_BACKLOG:
            self._drop(client)
            return
        self._poll.modify(descriptor, select.POLLIN | (select.POLLOUT if client.outgoing else 0))

    def _drop(self, client: _Client) -> None:
        """Disconnect a client. Its commands that wait are not carried out."""
        descriptor = client.connection.fileno()
        if descriptor < 0:
            return
        self._poll.unregister(descriptor)
        del self._clients[descriptor]
        self._commands = deque(each for each in self._commands if each[0] is not client)
        client.connection.close()

    def _close(self) -> None:
        for client in tuple(self._clients.values()):
            self._drop(client)
        if self._listener is not None and self._path is not None:
            self._listener.close()
            self._listener = None
            self._path.unlink(missing_ok=True)
