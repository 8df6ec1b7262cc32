"""Executor on the machines of a Ray cluster, or of a temporary one on this machine; its messages with the
driver.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.metadata import entry_points
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final, Literal, TypeAlias

from picktree.files import PicktreeError, file_system
from picktree.logs import optional_import
from picktree.session import environment, sources, versions
from picktree.trees.loading import GROUP

from .executor import Event, JobFailed, JobOrder

_WORKER_CODE: Final = ("apps/batch/*.py", "analysis/*.py", "analysis/explain/*.py")
"""Patterns of files that workers run but runs do not, and that `sources` therefore lacks."""
_NON_WORKER_FILE: Final = "apps/batch/report.py"
"""File within those that no worker needs."""


@dataclass(frozen=True, slots=True)
class Installation:
    """Versions and sources, equal on two machines that give the same rows for the same job, as far as
    known."""

    versions: Mapping[str, str]
    """Versions of the libraries, of installed plug-ins, and of Python."""
    sources: Mapping[str, str]
    """Start of the SHA-256 of each file of picktree, by path."""


def installed() -> Installation:
    plugins = {entry.dist.name: entry.dist.version for entry in entry_points(group=GROUP) if entry.dist}
    of_workers = (
        file
        for pattern in _WORKER_CODE
        for file in sorted(file_system.ROOT.glob(pattern))
        if file != file_system.ROOT / _NON_WORKER_FILE
    )
    python = "{}.{}".format(*sys.version_info)
    glibc = os.confstr("CS_GNU_LIBC_VERSION") or ""
    return Installation(
        {"python": python, "glibc": glibc.removeprefix("glibc "), **versions(), **plugins},
        {**sources(), **environment.hashes(of_workers)},
    )


def difference(here: Installation, there: Installation) -> str:
    """Return the difference that keeps jobs from running there; empty without a difference."""
    names = sorted({*here.versions, *there.versions})
    others = [
        f"{name} {there.versions.get(name, 'missing')}, here {here.versions.get(name, 'missing')}"
        for name in names
        if here.versions.get(name) != there.versions.get(name)
    ]
    if others:
        return f"it has {'; '.join(others)}"
    files = sorted(
        name for name in {*here.sources, *there.sources} if here.sources.get(name) != there.sources.get(name)
    )
    if files:
        more = " and more" if len(files) > 3 else ""
        return f"its picktree differs from the one here in {', '.join(files[:3])}{more}"
    return ""


@dataclass(frozen=True, slots=True)
class ClusterSettings:
    """First message of the batch."""

    address: str | None
    """Address of a running cluster; None: start one on this machine, and stop it at the end."""
    workers: int | None
    """Maximum number of concurrent workers; None: one for each CPU of the cluster."""
    folder: Path
    """Folder for this process alone."""
    output: Path
    """File with the output of this process."""
    here: Installation
    """Installation of the batch's machine."""


@dataclass(frozen=True, slots=True)
class Task:
    """Order for the driver."""

    order: JobOrder
    token: str
    """Content of the file `TOKEN` in the order's folder."""


@dataclass(frozen=True, slots=True)
class WorkerCount:
    """Present number of workers, with those that are about to start."""

    count: int


@dataclass(frozen=True, slots=True)
class ClusterRefusal:
    """Reason why the cluster cannot be used; the batch ends."""

    reason: str


STOP: Final = "stop"
"""Message to break off all running orders."""
TOKEN: Final = ".from-the-batch"
"""File in an order's folder: a worker that can remove it shares the folder with the batch."""
BatchMessage: TypeAlias = Task | Literal["stop"]
"""Message of the batch after its settings; the end of the connection shows that the batch is gone."""
DriverMessage: TypeAlias = WorkerCount | ClusterRefusal | Event
"""Message to the batch."""
_START_TIME_LIMIT = 180.0
"""Time limit for the start of a cluster, beyond the driver's own waits, wall s."""
_DRIVER_END_TIME_LIMIT = 30.0
"""Time limit for the driver's end, wall s."""
_OWN_CLUSTER_ENVIRONMENT: Final = {
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # on Linux too: every port is one of 127.0.0.1 alone
    "RAY_AUTH_MODE": "token",
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_enable_worker_prestart": "0",  # a foreman for each slot is all that is needed
    "RAY_prestart_worker_first_driver": "0",
    "RAY_worker_niceness": "0",  # jobs have the batch's priority, as those of local workers
}
"""Environment of a cluster on this machine alone, read when Ray is loaded."""
_LOG_PREFIX: Final = re.compile(r"^\[[^]]*\] (\S+:\d+: )?")
"""Prefix of Ray's log lines: time, process, place in its source."""
_MAX_FOLDER_LENGTH: Final = 20
"""Maximum length of a parent folder for Ray's files, characters."""
_DRIVER: Final = f"{__package__}.driver"


class RayExecutor:
    """Executor of a Ray cluster. A context manager that ends the workers, and a cluster that it started."""

    def __init__(self, slots: int | None = None, address: str | None = None) -> None:
        """`address`: that of a running cluster with this machine as a node; None: start one here.

        `slots`: maximum number of workers, by default one for each CPU of the cluster. Raises PicktreeError
        when there is no such cluster, a node has another installation, or ray is not installed.
        """
        with optional_import("ray", "ray", "A batch on a Ray cluster"):
            if find_spec("ray") is None:
                raise ModuleNotFoundError("No module named 'ray'", name="ray")
        self._where = f"the Ray cluster at {address}" if address else "the Ray cluster of this batch"
        self._folder = _short_folder()
        self._output = self._folder.with_suffix(".out")
        self._orders: dict[Path, JobOrder] = {}
        self._lost: list[Event] = []
        self._slots = 0
        self._batch, self._driver = self._start_driver(own=address is None)
        try:
            self._send(ClusterSettings(address, slots, self._folder, self._output, installed()))
            until = time.monotonic() + _START_TIME_LIMIT
            while not self._slots and time.monotonic() < until:
                self._event_of(self._received(1.0))
            if not self._slots:
                raise PicktreeError(f"{self._where} did not start within {_START_TIME_LIMIT:.0f} s")
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> RayExecutor:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def slots(self) -> int:
        """Number of concurrent orders; it changes when nodes join and leave."""
        return self._slots

    def submit(self, order: JobOrder) -> None:
        folder = order.folder.absolute()
        token = secrets.token_hex(16)
        self._orders[folder] = order
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / TOKEN).write_text(token)
        except OSError as error:
            self._lost.append(JobFailed(order, f"{folder}: {error.strerror}"))
            return
        self._send(Task(replace(order, folder=folder, recipe=order.recipe.absolute()), token))

    def wait(self, seconds: float) -> Sequence[Event]:
        events, self._lost = self._lost, []
        until = time.monotonic() + seconds
        while True:
            left = 0.0 if events else max(0.0, until - time.monotonic())
            news = self._received(left)
            event = self._event_of(news)
            if event is not None:
                events.append(event)
            elif news is None and (events or time.monotonic() >= until):
                return events

    def stop(self) -> None:
        self._send(STOP)

    def close(self) -> None:
        self._batch.close()
        if not self._slots:
            self._driver.kill()
        try:
            self._driver.wait(_DRIVER_END_TIME_LIMIT)
        except subprocess.TimeoutExpired:
            self._driver.kill()  # what it started goes with it
            self._driver.wait()
        shutil.rmtree(self._folder, ignore_errors=True)
        self._output.unlink(missing_ok=True)

    def _start_driver(self, *, own: bool) -> tuple[Connection, subprocess.Popen[bytes]]:
        """Start the driver in a separate session, so that Ctrl-C reaches the batch alone."""
        ours, theirs = socket.socketpair()
        extra = {**_OWN_CLUSTER_ENVIRONMENT, "RAY_AUTH_TOKEN": secrets.token_hex(32)} if own else {}
        with theirs, self._output.open("wb") as output:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", _DRIVER, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                env={**os.environ, **extra},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )
        return Connection(ours.detach()), process

    def _send(self, message: BatchMessage | ClusterSettings) -> None:
        with suppress(OSError):  # `wait` finds out
            self._batch.send(message)

    def _received(self, seconds: float) -> DriverMessage | None:
        """Return the next message; None: none within that time. Raises PicktreeError when the cluster is
        gone."""
        try:
            if not self._batch.poll(seconds):
                return None
            return self._batch.recv()
        except (EOFError, OSError):
            raise PicktreeError(f"{self._where} is gone{self._last_words()}; --resume continues") from None

    def _event_of(self, news: DriverMessage | None) -> Event | None:
        match news:
            case None:
                return None
            case WorkerCount(count):
                self._slots = count
                return None
            case ClusterRefusal(reason):
                raise PicktreeError(reason)
            case _:
                return replace(news, order=self._orders.pop(news.order.folder))

    def _last_words(self) -> str:
        """Return the first sentence of the last line that the driver printed; empty without output."""
        try:
            lines = self._output.read_text(errors="replace").strip().splitlines()
        except OSError:
            return ""
        return f": {_LOG_PREFIX.sub('', lines[-1]).partition('. ')[0]}" if lines else ""


def _short_folder() -> Path:
    """Create a short temporary folder: Ray creates sockets deep in it, whose paths have at most 107 bytes."""
    place = tempfile.gettempdir()
    return Path(
        tempfile.mkdtemp(prefix="picktree-ray-", dir=place if len(place) <= _MAX_FOLDER_LENGTH else "/tmp")
    )
