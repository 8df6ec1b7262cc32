"""Frames of a film drawn by several processes, and had in order."""

from __future__ import annotations

import multiprocessing
import signal
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import TracebackType

import numpy as np

from ....errors import PicktreeError
from ....logs.schema.records import LinkMesh
from ..captions import write
from ..frames import Frame
from ..rasterizer import Picture
from ..scene_view import Scenery
from ..viewpoint import View

_AHEAD = 2
"""Frames that wait at each process: none stands idle, and few are in memory."""


@dataclass(frozen=True, slots=True)
class Setup:
    """What all frames of a film have in common."""

    robot: tuple[LinkMesh, ...]
    view: View
    size: tuple[int, int]


class Painters:
    """Use it as a context manager. With one process everything is drawn in this one."""

    def __init__(self, setup: Setup, processes: int) -> None:
        self._setup, self._count = setup, processes
        self._painters: list[tuple[BaseProcess, Connection]] = []

    def __enter__(self) -> Painters:
        if self._count > 1:
            # Started anew, because a fork would take over locks of libraries' threads.
            context = multiprocessing.get_context("spawn")
            for _ in range(self._count):
                ours, theirs = context.Pipe()
                process = context.Process(target=_paint, args=(theirs, self._setup), daemon=True)
                process.start()
                theirs.close()
                self._painters.append((process, ours))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process, line in self._painters:
            line.close()
            if kind is not None:
                process.terminate()
        for process, _ in self._painters:
            process.join()
        self._painters.clear()

    def pictures(self, frames: Iterable[Frame]) -> Iterator[Picture]:
        """RGB (h, w, 3) of each frame, in order. Raises PicktreeError when a process dies."""
        if not self._painters:
            scenery = _scenery(self._setup)
            for frame in frames:
                yield _drawn(scenery, frame)
            return
        waiting: deque[Connection] = deque()
        for number, frame in enumerate(frames):
            if len(waiting) == _AHEAD * len(self._painters):
                yield self._received(waiting.popleft())
            line = self._painters[number % len(self._painters)][1]
            try:
                line.send(frame)
            except OSError:
                raise _died() from None
            waiting.append(line)
        while waiting:
            yield self._received(waiting.popleft())

    def _received(self, line: Connection) -> Picture:
        width, height = self._setup.size
        try:
            data = line.recv_bytes()
        except (EOFError, OSError):
            raise _died() from None
        return np.frombuffer(data, np.uint8).reshape(height, width, 3)


def _died() -> PicktreeError:
    return PicktreeError("a process that draws frames has died; --processes 1 does without others")


def _paint(line: Connection, setup: Setup) -> None:
    """Life of a process: draw what comes until nothing does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who started it decides
    scenery = _scenery(setup)
    try:
        while True:
            frame: Frame = line.recv()
            line.send_bytes(_drawn(scenery, frame).tobytes())
    except (EOFError, OSError):
        return


def _scenery(setup: Setup) -> Scenery:
    return Scenery(setup.robot, setup.view, setup.size)


def _drawn(scenery: Scenery, frame: Frame) -> Picture:
    picture = scenery.picture(frame.shown)
    write(picture, frame.caption)
    return picture
