"""Run that goes on in another process, as the studio follows it: one connection for all of its viewers."""

from __future__ import annotations

import asyncio
import itertools
import json
import logging
import time
from collections import deque
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeAlias

from ...analysis.report.packing import Section, pack
from ...analysis.report.stage_panel import packed_fixed, packed_link, packed_tool
from ...files.errors import PicktreeError
from ...logs.log_paths import find_log
from ...logs.run_log import RunLog
from ...logs.schema import topics
from ...session.attach_socket import connect_to_run
from ...world.robot_model.loading import read_tcp
from .calls import JsonValue
from .run_picture import MAX_LINES, LogMessage, RunPicture

PERIOD: Final = 0.05
"""Interval between two events for a viewer, wall s."""
GRACE: Final = 10.0
"""Time for which the connection stays when the last viewer has left, wall s; a stop lasts as long."""
HISTORY: Final = 120.0
"""Simulated time before the first viewer of which all is read from the log, s; before it, the lines."""
MAX_VIEWERS: Final = 16
"""Number of viewers of one run."""
_REPLY_TIME: Final = 30.0
"""Time for the answer to a command, wall s: it comes at the end of a tick, which may plan for long."""
_MAX_LINE: Final = 1 << 26
_BACKLOG: Final = 40
"""Number of events that wait for a viewer, above which it receives everything anew."""
_LINE_TOPICS: Final = (topics.LOG.name, topics.EVENTS.name)
_HISTORY_TOPICS: Final = (topics.TICK.name, topics.WRENCH.name, topics.TF.name, *_LINE_TOPICS)
_LOG_TRIES: Final = 40
_LOG_PERIOD: Final = 0.05
"""Number of looks at the log until it has what the run has sent, and the time between them, wall s."""
_LOG: Final = logging.getLogger("picktree.apps.studio")


class FollowedRun:
    """Connection to one run, and its picture for the viewers.

    It steers, so that stops and questions wait for its viewers. It ends with the run, or some time after the
    last viewer has left; the run then goes on.
    """

    def __init__(self, folder: Path) -> None:
        """Raises PicktreeError when the run is not going on, or cannot be attached. It is connected by
        `begin`."""
        self.folder = folder
        self.ended = False
        """Whether the connection has ended."""
        self._picture = RunPicture()
        self._viewers: list[_Viewer] = []
        self._replies: deque[asyncio.Future[str]] = deque()
        self._writer: asyncio.StreamWriter | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._leaving: asyncio.TimerHandle | None = None

    async def begin(self) -> None:
        """Connect, and read what the log has of the time before. Raises PicktreeError as the constructor of a
        socket does."""
        connection = await asyncio.to_thread(connect_to_run, self.folder)
        connection.setblocking(False)
        reader, self._writer = await asyncio.open_unix_connection(sock=connection, limit=_MAX_LINE)
        self._writer.write(b'{"steer": true, "follow": true}\n')
        first: list[_Received] = []
        try:
            while not (first and "statuses" in first[-1][0]):
                first.append(await _receive(reader))
        except (EOFError, OSError, ValueError):
            raise PicktreeError(f"{self.folder}: the run is not going on") from None
        began = max((at for _, log in first for _, at, _ in log), default=0)
        await asyncio.to_thread(self._start_picture, began / 1e9, first)
        self._tasks = [asyncio.create_task(self._read(reader)), asyncio.create_task(self._publish())]

    # Viewers.

    async def events(self) -> AsyncIterator[JsonValue]:
        """Yield everything at first, then changes. Raises PicktreeError when too many watch the run."""
        if len(self._viewers) >= MAX_VIEWERS:
            raise PicktreeError(f"{MAX_VIEWERS} pages watch this run already")
        if self._leaving is not None:
            self._leaving.cancel()
            self._leaving = None
        viewer = _Viewer()
        self._viewers.append(viewer)
        try:
            yield {**self._whole(), "viewers": len(self._viewers)}
            while not (self.ended and not viewer.waiting):
                await viewer.arrived.wait()
                viewer.arrived.clear()
                if len(viewer.waiting) > _BACKLOG:
                    viewer.waiting.clear()
                    yield self._whole()
                while viewer.waiting:
                    yield viewer.waiting.popleft()
        finally:
            self._viewers.remove(viewer)
            if not self._viewers and not self.ended:
                self._leaving = asyncio.get_running_loop().call_later(GRACE, self.leave)

    async def command(self, line: str) -> str:
        """Carry out a command line of `picktree attach`; return what it says.

        Raises PicktreeError when the run has ended, or does not answer.
        """
        if "\n" in line or len(line) > 20_000:
            raise PicktreeError("a command is one line")
        if self._writer is None or self.ended:
            raise PicktreeError("the run has ended")
        reply = asyncio.get_running_loop().create_future()
        self._replies.append(reply)
        self._writer.write(json.dumps({"line": line}).encode() + b"\n")
        try:
            return await asyncio.wait_for(asyncio.shield(reply), _REPLY_TIME)
        except TimeoutError:
            raise PicktreeError(f"the run has not answered for {_REPLY_TIME:g} s") from None

    def leave(self) -> None:
        """End the connection; the run goes on."""
        self.ended = True
        if self._writer is not None:
            self._writer.close()
        for task in self._tasks:
            task.cancel()
        self._end_replies()
        for viewer in self._viewers:
            viewer.arrived.set()

    def stage(self) -> str:
        """Return robot and fixed parts for the page, packed; read from the log, which takes a moment."""
        with RunLog(find_log(self.folder)) as log:
            models = log.robot_model()
            links = [model.link for model in models]
            scene = log.belief_at(log.end) or log.truth_at(log.end)
            fixed = scene.record.fixed if scene is not None else ()
            data = {
                "models": [packed for model in models if (packed := packed_link(model)) is not None],
                "links": list(links),
                "tool": packed_tool(log, links),
                "fixed": packed_fixed(log, fixed),
            }
        return pack([Section("stage", data)])

    # The connection.

    def _start_picture(self, until: float, first: Sequence[_Received]) -> None:
        """Make the picture before `until`, simulated s, and take what the run sent first.

        The symbols of the tree's nodes need all modules of nodes, which take 0.1 s and more to import.
        """
        self._picture = self._first_picture(until)
        for message, log in first:
            self._take(message, log)

    def _first_picture(self, until: float) -> RunPicture:
        """Return a picture with the last minutes of the log up to a time, simulated s.

        The log has each message within a second.
        """
        for _ in range(_LOG_TRIES):
            with RunLog(find_log(self.folder)) as log:
                if log.end >= until - 1e-6:
                    break
            time.sleep(_LOG_PERIOD)
        with RunLog(find_log(self.folder)) as log:
            link = ""
            with suppress(PicktreeError):
                tcp = read_tcp(log.attachment("robot.yaml").decode("utf-8", "replace"), log.path)
                link = "" if tcp is None else tcp.link
            picture = RunPicture(link)
            info = log.run
            picture.set("run", {"mission": info.mission, "scene": info.scene, "robot": info.robot,
                                "seed": info.seed, "backend": info.backend})  # fmt: skip
            begin = max(0.0, until - HISTORY)
            before = log.messages(_LINE_TOPICS, None, begin, newest_first=True)
            lines = [each for each in itertools.islice(before, MAX_LINES) if each.time < round(begin * 1e9)]
            recent = log.messages(_HISTORY_TOPICS, begin, until)
            for message in itertools.chain(reversed(lines), recent):
                picture.take((message.topic, message.time, message.data))
        return picture

    async def _read(self, reader: asyncio.StreamReader) -> None:
        """Take what the run sends, until it ends."""
        try:
            while True:
                self._take(*await _receive(reader))
        except (OSError, EOFError, ValueError):
            pass
        except Exception:  # noqa: BLE001 - the viewers are told, and the server goes on
            _LOG.exception("%s: the connection to the run ends", self.folder)
        finally:
            self._picture.set("ended", True)
            self._send(self._picture.changes())
            self.leave()

    def _take(self, message: Mapping[str, Any], log: Sequence[LogMessage]) -> None:
        for each in log:
            self._picture.take(each, whole="whole" in message)
        if "wall" in message:
            self._picture.set("wall", message["wall"])
        elif not log:
            self._hear(message)

    def _hear(self, message: Mapping[str, Any]) -> None:
        picture = self._picture
        match message:
            case {"reply": text}:
                if self._replies:
                    reply = self._replies.popleft()
                    if not reply.done():
                        reply.set_result(text)
            case {"stop": where, "path": path, "when": when, "time": now}:
                picture.set("time", now)
                picture.set("stop", {"where": where, "path": path, "when": when})
            case {"question": question}:
                picture.set("question", question)
            case {"going": _}:
                picture.set("stop", None)
                picture.set("question", None)
            case {"statuses": statuses, "blackboard": blackboard}:
                picture.stand(statuses, blackboard)
            case {"breakpoints": breakpoints}:
                picture.set("breakpoints", breakpoints)
            case {"told": text, "time": now}:
                picture.say(now, "told", text)
            case {"state": text, "done": done, "total": total}:
                picture.set("progress", {"text": text, "done": done, "total": total})
            case {"end": status}:
                picture.set("status", status)
            case _:
                pass

    def _end_replies(self) -> None:
        while self._replies:
            reply = self._replies.popleft()
            if not reply.done():
                reply.set_exception(PicktreeError("the run has ended"))

    async def _publish(self) -> None:
        while True:
            await asyncio.sleep(PERIOD)
            if self._viewers:
                self._send(self._picture.changes())

    def _whole(self) -> dict[str, JsonValue]:
        self._send(self._picture.changes())
        for viewer in self._viewers[-1:]:
            viewer.waiting.clear()
        return self._picture.whole()

    def _send(self, event: dict[str, JsonValue]) -> None:
        if event:
            for viewer in self._viewers:
                viewer.waiting.append(event)
                viewer.arrived.set()


_Received: TypeAlias = tuple[Mapping[str, Any], Sequence[LogMessage]]
"""Object that the run has sent, and the messages of the log behind it."""


async def _receive(reader: asyncio.StreamReader) -> _Received:
    """Return the next object. Raises EOFError at the end, OSError and ValueError for a broken connection."""
    line = await reader.readline()
    if not line:
        raise EOFError
    message = json.loads(line)
    sizes = message.get("messages", ())
    return message, [(topic, at, await reader.readexactly(size)) for topic, at, size in sizes]


class _Viewer:
    """Events that wait for one page."""

    def __init__(self) -> None:
        self.waiting: deque[JsonValue] = deque(maxlen=_BACKLOG + 1)
        self.arrived = asyncio.Event()
