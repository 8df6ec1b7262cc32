"""Command lines of picktree, each in a process forked from this one.

The imports of a command cost more than most commands. A fork has those of this process already, and nothing
that it changes reaches the tests: folder, signals, globals. Few tests start `python -m picktree` as a new
interpreter: those whose subject it is.
"""

from __future__ import annotations

import errno
import fcntl
import gc
import multiprocessing
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import tempfile
import termios
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NoReturn

from picktree.__main__ import main
from picktree.apps.batch import die_with_parent, local_executor
from picktree.apps.batch.job_process import flush_output
from picktree.apps.batch.local_executor import load, serve

PATIENCE = 120.0
"""Wall s after which an event counts as one that never comes."""


@dataclass(frozen=True)
class Streams:
    """File descriptors that become 0, 1 and 2 of a command."""

    stdin: int
    stdout: int
    stderr: int
    terminal: bool = False
    """`stdin` is the terminal of the command's session, as of one that was typed."""
    closed: tuple[int, ...] = ()
    """File descriptors that belong to the tests alone."""


class Command:
    """`picktree WORDS` in a process of its own."""

    def __init__(
        self,
        words: Sequence[str],
        streams: Streams,
        folder: Path | None = None,
        environment: Mapping[str, str | None] | None = None,
    ) -> None:
        """Start it in a folder. A variable that is None is taken out of the environment."""
        _load()
        flush_output()
        self.words = tuple(words)
        self.code: int | None = None
        """Exit code as `subprocess` has it: that of a signal is negative. None: not known to have ended."""
        self.pid = os.fork()
        if self.pid == 0:
            _be(self.words, streams, folder, environment or {})

    def ended(self) -> bool:
        if self.code is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.code = os.waitstatus_to_exitcode(status) if pid else None
        return self.code is not None

    def end(self) -> int:
        """Return the exit code when it has ended."""
        until(self.ended, f"the end of {self.words}")
        assert self.code is not None
        return self.code


def call(
    words: Sequence[str], folder: Path | None = None, typed: str = "", *, one_stream: bool = False
) -> subprocess.CompletedProcess[str]:
    """Run `picktree WORDS` to its end. `one_stream`: stderr goes where stdout goes."""
    with (
        tempfile.TemporaryFile() as stdin,
        tempfile.TemporaryFile() as stdout,
        tempfile.TemporaryFile() as stderr,
    ):
        stdin.write(typed.encode())
        stdin.seek(0)
        errors = (stdout if one_stream else stderr).fileno()
        command = Command(words, Streams(stdin.fileno(), stdout.fileno(), errors), folder)
        _, status = os.waitpid(command.pid, 0)
        stdout.seek(0)
        stderr.seek(0)
        code = os.waitstatus_to_exitcode(status)
        return subprocess.CompletedProcess(words, code, stdout.read().decode(), stderr.read().decode())


class Terminal:
    """A terminal of 30 rows and 100 columns with a command in it."""

    def __init__(self, words: Sequence[str], kind: str = "xterm") -> None:
        self._ours, self._theirs = pty.openpty()
        fcntl.ioctl(self._theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 100, 0, 0))
        self._before = termios.tcgetattr(self._theirs)
        self.shown = ""
        """All output so far, without escape sequences."""
        self._seen = 0
        streams = Streams(self._theirs, self._theirs, self._theirs, terminal=True, closed=(self._ours,))
        # The two variables would count for more than the terminal's size.
        self._command = Command(words, streams, environment={"TERM": kind, "COLUMNS": None, "LINES": None})

    def press(self, keys: bytes) -> None:
        os.write(self._ours, keys)

    def until(self, part: str, press: bytes = b"") -> str:
        """Return what is shown from the last call on, when a text is part of it.

        `press` is typed each second until then.
        """
        self.wait(lambda: part in self.shown[self._seen :], repr(part), press)
        new, self._seen = self.shown[self._seen :], len(self.shown)
        return new

    def wait(self, happened: Callable[[], bool], what: str = "it", press: bytes = b"") -> None:
        """Read what is shown until something has happened."""

        def read() -> bool:
            self._read(1.0 if press else 0.05)
            if press and not happened():
                self.press(press)
            return happened()

        try:
            until(read, what)
        except AssertionError as error:
            raise AssertionError(f"{error}; the terminal shows:\n{self.shown}") from None

    def end(self) -> int:
        """Return the exit code when the command has ended. It must leave the terminal as it was."""
        self.wait(self._command.ended, "the end")
        self._read(0.0)
        assert termios.tcgetattr(self._theirs)[3] == self._before[3]
        self.close()
        return self._command.end()

    def close(self) -> None:
        """Close the terminal, under the command if it still runs."""
        os.close(self._theirs)
        os.close(self._ours)

    def end_after_closing(self) -> int:
        """Return the exit code of a command whose terminal was closed."""
        return self._command.end()

    def _read(self, seconds: float) -> None:
        """Read all that is there. Where there is nothing, wait so long for it."""
        while select.select([self._ours], [], [], seconds)[0]:
            try:
                piece = os.read(self._ours, 65536)
            except OSError as error:
                if error.errno != errno.EIO:
                    raise
                return
            self.shown += re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", piece.decode(errors="ignore"))
            seconds = 0.0


def until(happened: Callable[[], object], what: str = "it") -> None:
    """Wait until something has happened. Raises AssertionError when it does not happen."""
    end = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < end, f"{what} does not come within {PATIENCE:.0f} s"
        time.sleep(0.02)


@cache
def _load() -> None:
    """Load what commands load when they need it, once for all."""
    for module in (
        "picktree.apps.cli.app",
        "picktree.analysis.report.report",
        "picktree.analysis.render.renderer",
    ):
        import_module(module)
    load()
    gc.unfreeze()


def _be(
    words: Sequence[str], streams: Streams, folder: Path | None, environment: Mapping[str, str | None]
) -> NoReturn:
    """Be `picktree WORDS`, with `picktree` on the PATH."""
    code = 1
    try:
        die_with_parent(signal.SIGKILL)  # a test that fails leaves nothing behind
        if streams.terminal:
            os.setsid()
            fcntl.ioctl(streams.stdin, termios.TIOCSCTTY, 0)
        for number, descriptor in enumerate((streams.stdin, streams.stdout, streams.stderr)):
            os.dup2(descriptor, number)
        for descriptor in streams.closed:
            os.close(descriptor)
        sys.stdin = open(0, closefd=False)  # noqa: SIM115
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
        sys.stderr = open(2, "w", errors="backslashreplace", closefd=False, buffering=1)  # noqa: SIM115
        for name, value in environment.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value
        if folder is not None:
            os.chdir(folder)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        local_executor._started = forked_worker  # pyright: ignore[reportPrivateUsage]
        installed = Path(sys.executable).with_name("picktree")
        os.environ["PATH"] = f"{installed.parent}{os.pathsep}{os.environ['PATH']}"
        sys.argv = [str(installed), *words]
        main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:  # noqa: BLE001 - the border to the process
        traceback.print_exc()
    finally:
        flush_output()
        os._exit(code)


def forked_worker() -> local_executor._Worker:  # pyright: ignore[reportPrivateUsage]
    """Start a worker of a batch as a fork, instead of as a new interpreter that imports everything."""
    fork = multiprocessing.get_context("fork")
    ours, theirs = fork.Pipe()
    process = fork.Process(target=_serve, args=(ours, theirs))
    process.start()
    theirs.close()
    return local_executor._Worker(process, ours)  # pyright: ignore[reportPrivateUsage]


def _serve(ours: Connection, theirs: Connection) -> None:
    ours.close()  # else the worker would not hear that the batch closes its end
    serve(theirs)
