"""Run in another process that the studio follows: its picture, and one connection for all viewers."""

from __future__ import annotations

import asyncio
import base64
import itertools
import json
import logging
import math
import time
from collections import deque
from collections.abc import AsyncIterator, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeAlias

import orjson

from picktree.analysis.report import Packable, Section, pack, row, stage_panel
from picktree.authoring import mission_chart
from picktree.files import PicktreeError
from picktree.logs import RunLog, log_files, log_records, topics
from picktree.logs.recording import foxglove_messages
from picktree.session import attach_socket
from picktree.trees.loading import NodeRegistry
from picktree.world.robot_model import robot_file

from .calls import JsonValue

LogMessage: TypeAlias = tuple[str, int, bytes]
"""Topic, simulated ns, payload."""
MAX_ROWS: Final = 1500
"""Number of readings that a new viewer receives."""
MAX_LINES: Final = 1000
MAX_TRANSITIONS: Final = 4000
_POSE_DIGITS: Final = 5
_BODY_TOPICS: Final = frozenset({topics.OBJECTS.name, topics.TRUTH.name})


class RunPicture:
    """State of one run for its viewers, and the changes since the last look.

    `take` notes a message; `changes` returns what is new, and `whole` all of it, as JSON values.
    """

    def __init__(self, tcp_link: str = "") -> None:
        """`tcp_link`: the link whose speed is shown; empty: none."""
        self._tcp_link = tcp_link
        self._registry = NodeRegistry()
        self._state: dict[str, JsonValue] = {}
        """Values of which the last one counts, by their names in an event."""
        self._changed: set[str] = set()
        self._nodes: dict[str, list[JsonValue]] = {}
        self._board: dict[str, JsonValue] = {}
        self._frames: dict[str, list[float]] = {}
        self._looks: dict[str, str] = {}
        self._images: dict[str, JsonValue] = {}
        self._new: dict[str, dict[str, JsonValue]] = {}
        """Changed entries of the tables, by table."""
        self._rows: deque[JsonValue] = deque(maxlen=MAX_ROWS)
        self._lines: deque[JsonValue] = deque(maxlen=MAX_LINES)
        self._transitions: deque[JsonValue] = deque(maxlen=MAX_TRANSITIONS)
        self._fresh: dict[str, list[JsonValue]] = {"rows": [], "lines": [], "transitions": []}
        self._last: dict[str, LogMessage] = {}
        """Last messages that are decoded only for a viewer."""
        self._fixed: tuple[log_records.PartRecord, ...] = ()
        self._shapes: dict[tuple[object, ...], str] = {}
        self._force: Sequence[float] = ()
        self._before: tuple[float, Sequence[float]] | None = None

    # Messages of the log.

    def take(self, message: LogMessage, *, whole: bool = False) -> None:
        """Note a message; `whole`: it is the last of its topic, which a follower receives first."""
        topic, at, data = message
        match topic:
            case topics.TICK.name:
                self._take_tick(at / 1e9, orjson.loads(data), whole=whole)
            case topics.NODES.name:
                self._take_states(orjson.loads(data)["nodes"])
            case topics.TREE.name:
                self._take_tree(orjson.loads(data))
            case topics.WRENCH.name:
                force = orjson.loads(data)["force"]
                self._force = [force["x"], force["y"], force["z"]]
            case topics.TF.name:
                self._last[topic] = message
                self._add_row(at / 1e9, data)
            case topics.LOG.name:
                line = foxglove_messages.read_log(data)
                self._add("lines", self._lines, [at / 1e9, line.level, line.name, line.message])
            case topics.EVENTS.name:
                event = orjson.loads(data)
                self._add("lines", self._lines, [at / 1e9, event["kind"], event["node"], event["message"]])
            case _ if topic in _BODY_TOPICS or topic.endswith("/colour"):
                self._last[topic] = message
            case _:
                pass

    def _take_tree(self, tree: Mapping[str, Any]) -> None:
        nodes: list[JsonValue] = []
        for node in tree["nodes"]:
            known = self._registry.find(node["id"])
            symbol = "control" if node["children"] else "action"
            symbol = mission_chart.symbol_of(known.declaration) if known else symbol
            nodes.append({key: node[key] for key in ("path", "id", "name", "children")} | {"symbol": symbol})
        kept = {node["path"] for node in tree["nodes"]}
        self._nodes = {path: state for path, state in self._nodes.items() if path in kept}
        self.set("tree", nodes)

    def _take_tick(self, time: float, tick: Mapping[str, Any], *, whole: bool) -> None:
        self.set("time", time)
        self._take_states(tick["transitions"])
        for write in tick["writes"]:
            self._put("board", self._board, write["key"], write["value"])
        if whole:
            return
        for each in tick["transitions"]:
            if each["update"]:
                continue
            passed = [time, each["path"], each["status"], each["subject"], each["cause"], each["message"]]
            self._add("transitions", self._transitions, passed)

    def _take_states(self, nodes: Iterable[Mapping[str, Any]]) -> None:
        for node in nodes:
            state = [node["status"], node["ticked"], node["message"], node["cause"]]
            self._put("nodes", self._nodes, node["path"], state)

    def _add_row(self, time: float, data: bytes) -> None:
        """Note force at the wrist, N, and the speed of the tool's link, m/s."""
        speed: float | None = None
        if self._tcp_link:
            place = next((p for name, p in foxglove_messages.read_rows(data) if name == self._tcp_link), None)
            if place is not None:
                if self._before is not None and time > self._before[0]:
                    speed = math.dist(place[:3], self._before[1][:3]) / (time - self._before[0])
                self._before = (time, place)
        force = math.hypot(*self._force) if self._force else None
        self._add("rows", self._rows, [time, force, speed])

    # What the socket says besides.

    def set(self, name: str, value: JsonValue) -> None:
        """Set a value of which only the last one counts."""
        if name not in self._state or self._state[name] != value:
            self._state[name] = value
            self._changed.add(name)

    def take_stop(self, statuses: Mapping[str, str], blackboard: Mapping[str, JsonValue]) -> None:
        for path, status in statuses.items():
            before = self._nodes.get(path, ["", False, "", ""])
            self._put("nodes", self._nodes, path, [status, *before[1:]])
        for key, value in blackboard.items():
            self._put("board", self._board, key, value)

    def say(self, time: float, kind: str, text: str) -> None:
        """Add a line that is not in the log, such as the refusal of an edit."""
        self._add("lines", self._lines, [time, kind, "", text])

    # For the viewers.

    def changes(self) -> dict[str, JsonValue]:
        """Return the changes since the last call; empty without changes."""
        self._decode()
        event: dict[str, JsonValue] = {name: self._state[name] for name in self._changed}
        event.update({name: entries for name, entries in self._new.items() if entries})
        for name, fresh in self._fresh.items():
            if fresh:
                event[name] = fresh
                self._fresh[name] = []
        self._changed, self._new = set(), {}
        return event

    def whole(self) -> dict[str, JsonValue]:
        """Return everything, for a new viewer, or one that was too slow."""
        return {
            **self._state,
            "whole": True,
            "nodes": dict(self._nodes),
            "board": dict(self._board),
            "frames": dict(self._frames),
            "looks": dict(self._looks),
            "images": dict(self._images),
            "rows": list(self._rows),
            "lines": list(self._lines),
            "transitions": list(self._transitions),
        }

    def _put(self, table: str, entries: dict[str, Any], key: str, value: JsonValue) -> None:
        if key not in entries or entries[key] != value:
            entries[key] = value
            self._new.setdefault(table, {})[key] = value

    def _add(self, name: str, kept: deque[JsonValue], value: JsonValue) -> None:
        kept.append(value)
        self._fresh[name].append(value)
        if len(self._fresh[name]) > MAX_TRANSITIONS:  # nobody has looked for long
            del self._fresh[name][: MAX_TRANSITIONS // 2]

    def _decode(self) -> None:
        """Decode the last messages of poses, bodies and pictures."""
        last, self._last = self._last, {}
        for topic, at, data in last.values():
            if topic == topics.TF.name:
                for link, place in foxglove_messages.read_rows(data):
                    pose = [round(value, _POSE_DIGITS) for value in place]
                    self._put("frames", self._frames, link, pose)
            elif topic in _BODY_TOPICS:
                scene = foxglove_messages.read_scene(data)
                self._fixed = scene.fixed or self._fixed
                name = "belief" if topic == topics.OBJECTS.name else "truth"
                self.set(name, [self._body(body) for body in scene.bodies])
            else:
                picture = foxglove_messages.read_image(data)
                kind = "png" if picture.startswith(b"\x89PNG") else "jpeg"
                url = f"data:image/{kind};base64,{base64.b64encode(picture).decode()}"
                self._put("images", self._images, topic.split("/")[2], {"at": at / 1e9, "url": url})

    def _body(self, body: log_records.BodyRecord) -> JsonValue:
        return {
            "id": body.id,
            "kind": body.kind,
            "colour": body.colour,
            "role": body.role,
            "place": body.place,
            "held": body.attached,
            "confidence": round(body.confidence, 3),
            "look": self._look(body),
            "pose": [round(value, _POSE_DIGITS) for value in row(body.pose)],
        }

    def _look(self, body: log_records.BodyRecord) -> str:
        """Return the name of a body's form and colour; a new one is packed for the page."""
        form = (repr(body.shape), body.colour, body.role, body.blocks)
        name = self._shapes.get(form)
        if name is None:
            name = self._shapes[form] = str(len(self._shapes))
            look: dict[str, Packable] = {
                "shape": stage_panel.packed_body(body, self._fixed),
                "colour": stage_panel.rgb(body.colour),
                "role": body.role,
            }
            self._put("looks", self._looks, name, pack([Section("look", look)]))
        return name


PERIOD: Final = 0.05
"""Interval between two events for a viewer, wall s."""
DISCONNECT_DELAY: Final = 10.0
"""Time for which the connection stays when the last viewer has left, wall s; a stop lasts as long."""
HISTORY: Final = 120.0
"""Simulated time before the first viewer that is read completely from the log, s; earlier only lines."""
MAX_VIEWERS: Final = 16
"""Number of viewers of one run."""
_REPLY_TIME: Final = 30.0
"""Time for the answer to a command, wall s: it comes at the end of a tick, which may plan for long."""
_MAX_LINE: Final = 1 << 26
_BACKLOG: Final = 40
"""Number of events that wait for a viewer, above which it receives everything anew."""
_LINE_TOPICS: Final = (topics.LOG.name, topics.EVENTS.name)
_HISTORY_TOPICS: Final = (
    topics.NODES.name,
    topics.TICK.name,
    topics.WRENCH.name,
    topics.TF.name,
    *_LINE_TOPICS,
)
_LOG_TRIES: Final = 40
_LOG_PERIOD: Final = 0.05
"""Number of looks at the log until it has what the run has sent, and the interval between them, wall s."""
_LOG: Final = logging.getLogger("picktree.apps.studio")


class FollowedRun:
    """Connection to one run, and its picture for the viewers.

    It steers, so that stops and questions wait for its viewers. It ends with the run, or some time after the
    last viewer has left; the run then continues.
    """

    def __init__(self, folder: Path) -> None:
        """Raises PicktreeError when the run cannot be attached. It is connected by `begin`."""
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
        """Connect, and read what the log has of the time before. Raises PicktreeError."""
        connection = await asyncio.to_thread(attach_socket.connect_to_run, self.folder)
        connection.setblocking(False)
        reader, self._writer = await asyncio.open_unix_connection(sock=connection, limit=_MAX_LINE)
        self._writer.write(b'{"steer": true, "follow": true}\n')
        first: list[_Received] = []
        try:
            while not (first and "statuses" in first[-1][0]):
                first.append(await _receive(reader))
        except (EOFError, OSError, ValueError):
            raise PicktreeError(f"{self.folder}: the run is not in progress") from None
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
                self._leaving = asyncio.get_running_loop().call_later(DISCONNECT_DELAY, self.leave)

    async def command(self, line: str) -> str:
        """Carry out a command line of `picktree attach`; return its output.

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
        """End the connection; the run continues."""
        self.ended = True
        if self._writer is not None:
            self._writer.close()
        for task in self._tasks:
            task.cancel()
        while self._replies:
            reply = self._replies.popleft()
            if not reply.done():
                reply.set_exception(PicktreeError("the run has ended"))
        for viewer in self._viewers:
            viewer.arrived.set()

    def stage(self) -> str:
        """Return robot and fixed parts for the page, packed; read from the log, which takes a moment."""
        with RunLog(log_files.find_log(self.folder)) as log:
            models = log.robot_model()
            links = [model.link for model in models]
            scene = log.belief_at(log.end) or log.truth_at(log.end)
            fixed = scene.record.fixed if scene is not None else ()
            data = {
                "models": [
                    packed for model in models if (packed := stage_panel.packed_link(model)) is not None
                ],
                "links": list(links),
                "tool": stage_panel.packed_tool(log, links),
                "fixed": stage_panel.packed_fixed(log, fixed),
            }
        return pack([Section("stage", data)])

    # The connection.

    def _start_picture(self, until: float, first: Sequence[_Received]) -> None:
        """Make the picture of the last minutes of the log up to a time, simulated s, and take what the run
        sent first.

        The log has each message within a second. The symbols of the tree's nodes need all modules of nodes,
        which take 0.1 s and more to import.
        """
        for _ in range(_LOG_TRIES):
            with RunLog(log_files.find_log(self.folder)) as log:
                if log.end >= until - 1e-6:
                    break
            time.sleep(_LOG_PERIOD)
        with RunLog(log_files.find_log(self.folder)) as log:
            link = ""
            with suppress(PicktreeError):
                tcp = robot_file.read_tcp(log.attachment("robot.yaml").decode("utf-8", "replace"), log.path)
                link = "" if tcp is None else tcp.link
            self._picture = picture = RunPicture(link)
            info = log.run
            picture.set("run", {"mission": info.mission, "scene": info.scene, "robot": info.robot,
                                "seed": info.seed, "backend": info.backend})  # fmt: skip
            begin = max(0.0, until - HISTORY)
            before = log.messages(_LINE_TOPICS, None, begin, newest_first=True)
            lines = [each for each in itertools.islice(before, MAX_LINES) if each.time < round(begin * 1e9)]
            recent = log.messages(_HISTORY_TOPICS, begin, until)
            for message in itertools.chain(reversed(lines), recent):
                picture.take((message.topic, message.time, message.data))
        for received, messages in first:
            self._take(received, messages)

    async def _read(self, reader: asyncio.StreamReader) -> None:
        """Receive the run's messages until its end."""
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
                picture.take_stop(statuses, blackboard)
            case {"breakpoints": breakpoints}:
                picture.set("breakpoints", breakpoints)
            case {"told": text, "time": now}:
                picture.say(now, "told", text)
            case {"state": text, "done": done, "total": total, "figures": figures}:
                picture.set("progress", {"text": text, "done": done, "total": total, "figures": figures})
            case {"end": status}:
                picture.set("status", status)
            case _:
                pass

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
