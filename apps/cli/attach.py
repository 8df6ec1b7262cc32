"""picktree attach"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .output import end_with

if TYPE_CHECKING:
    import socket


def attach(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Run folder, log file, or 'last'.")],
    watch: Annotated[
        bool, typer.Option("--watch", help="Only watch: read no commands, and never make the run wait.")
    ] = False,
) -> None:
    """Watch and steer a run in another process: pause, step, look, set breakpoints, answer.

    `help` lists the commands. Ctrl-D leaves; a stopped run then continues. Exit code 1: the run's process
    died.
    """
    from picktree.logs import log_files
    from picktree.session import attach_socket

    with attach_socket.connect_to_run(log_files.find_log(run).parent) as connection:
        end_with(_Conversation(connection, steer=not watch).hold())


class _Conversation:
    """Conversation of a user or a script with a run.

    Lines of a terminal are sent immediately. A line of a script is sent when the line before it has its reply
    and the run is stopped. After `pause`, `step`, `next` and `continue` it waits for the stop.
    """

    def __init__(self, connection: socket.socket, *, steer: bool) -> None:
        self._connection = connection
        self._steer = steer
        self._typed = steer and sys.stdin.isatty()
        self._input_over = False
        self._lines: list[str] = []
        self._rest = b""
        self._last = ""
        self._may_send = False
        """Whether the run is ready for a script's next line."""
        self._owed = 0
        """Number of replies that have not come yet."""
        self._shown = ("", "")
        self._status = ""

    def hold(self) -> bool:
        """Converse until the run or the input ends; return whether the connection ended as it should."""
        import select

        self._write({"steer": self._steer})
        received = b""
        while not (self._input_over and not self._lines and not self._owed):
            self._send_lines()
            reads = [self._connection] if self._input_over or not self._steer else [self._connection, 0]
            ready, _, _ = select.select(reads, [], [])
            if 0 in ready:
                self._read_input()
            if self._connection in ready:
                piece = self._receive()
                if not piece:
                    return self._ended()
                *lines, received = (received + piece).split(b"\n")
                for line in lines:
                    self._take(_message(line))
        return True

    def _receive(self) -> bytes:
        try:
            return self._connection.recv(1 << 16)
        except ConnectionError:
            return b""

    def _ended(self) -> bool:
        if self._status:
            self._say(f"the run has ended: {self._status}")
        else:
            self._say("the run's process has died, or has closed the connection; it left no result here")
        return bool(self._status)

    # Lines of the user.

    def _read_input(self) -> None:
        piece = os.read(0, 1 << 16)
        *lines, self._rest = (self._rest + piece).split(b"\n")
        if not piece:
            self._input_over = True
            lines = [self._rest] if self._rest else []
        self._lines += [line.decode(errors="replace").strip() for line in lines]

    def _send_lines(self) -> None:
        while self._lines and (self._typed or (self._may_send and not self._owed)):
            line = self._lines.pop(0) or self._last
            if not line:
                self._prompt()
                continue
            self._last = line
            self._may_send = False
            self._owed += 1
            if not self._typed:
                self._say(f"{self._text}{line}")
            self._write({"line": _with_whole_path(line)})

    def _write(self, message: Mapping[str, object]) -> None:
        import json
        from contextlib import suppress

        with suppress(OSError):  # What it said last can still be read.
            self._connection.sendall(json.dumps(message).encode() + b"\n")

    # Messages of the run.

    def _take(self, message: Mapping[str, Any]) -> None:
        match message:
            case {"run": folder, "time": now}:
                self._say(f"attached to {folder} at {now:.2f} s" + ("; `help` for help" * self._typed))
                self._may_send = True
            case {"reply": text, "goes_on": continues}:
                self._owed -= 1
                self._may_send = not continues
                self._say(text.rstrip("\n"))
            case {"stop": where}:
                self._may_send = True
                self._say(where)
            case {"question": question}:
                self._may_send = True
                self._say(f"Help is wanted: {question['reason']}\n  {question['situation']}")
                for number, choice in enumerate(question["choices"], 1):
                    self._say(f"  {number}  {choice}")
                if self._steer:
                    self._say("`answer TEXT` answers, with the number of an answer or with its beginning")
            case {"told": text, "time": now}:
                self._say(f"{now:8.2f} s  {text}")
            case {"state": progress, "time": now, "node": node, "failures": failures, "figures": figures}:
                self._show_state(progress, now, node, failures, figures)
                return
            case {"end": status}:
                self._status = status
                return
            case _:
                return
        self._prompt()

    def _show_state(self, progress: str, now: float, node: str, failures: list[str], figures: str) -> None:
        for failure in failures:
            self._say(f"{now:8.2f} s  {failure}")
        if progress != self._shown[0]:
            self._say(f"{now:8.2f} s  {figures}")
        if (progress, node) != self._shown:
            self._shown = (progress, node)
            self._say(f"{now:8.2f} s  {progress}, at {node}")

    _text = "(picktree) "

    def _prompt(self) -> None:
        if self._typed:
            print(self._text, end="", flush=True)

    def _say(self, text: str) -> None:
        if text:
            print(text, flush=True)


def _with_whole_path(line: str) -> str:
    """Return the line with the file of `take FILE` as an absolute path: the run may have another directory.

    >>> _with_whole_path("take /home/ada/pick.yaml")
    'take /home/ada/pick.yaml'
    """
    word, _, file = line.partition(" ")
    return f"{word} {os.path.abspath(file.strip())}" if word == "take" and file.strip() else line


def _message(line: bytes) -> Mapping[str, Any]:
    import json

    return json.loads(line)
