"""Picture of a run that goes on: what a page shows of it, kept up to date by the messages of its log."""

from __future__ import annotations

import base64
import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeAlias

import orjson

from ...analysis.report.packing import Packable, Section, pack, row
from ...analysis.report.stage_panel import packed_body, rgb
from ...authoring.drawing.chart import symbol_of
from ...logs.recording import foxglove_messages
from ...logs.schema import topics
from ...logs.schema.records import BodyRecord, PartRecord
from ...trees.loading.registry import NodeRegistry
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
        """Last messages that are decoded only when somebody looks."""
        self._fixed: tuple[PartRecord, ...] = ()
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
            symbol = symbol_of(known.declaration) if known else "control" if node["children"] else "action"
            nodes.append(
                {
                    "path": node["path"],
                    "id": node["id"],
                    "name": node["name"],
                    "symbol": symbol,
                    "children": list(node["children"]),
                }
            )
        kept = {node["path"] for node in tree["nodes"]}
        self._nodes = {path: state for path, state in self._nodes.items() if path in kept}
        self.set("tree", nodes)

    def _take_tick(self, time: float, tick: Mapping[str, Any], *, whole: bool) -> None:
        self.set("time", time)
        for node in tick["nodes"]:
            state = [node["status"], node["ticked"], node["message"], node["cause"]]
            self._put("nodes", self._nodes, node["path"], state)
        for write in tick["writes"]:
            self._put("board", self._board, write["key"], write["value"])
        if whole:
            return
        for each in tick["transitions"]:
            passed = [time, each["path"], each["status"], each["subject"], each["cause"], each["message"]]
            self._add("transitions", self._transitions, passed)

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

    def stand(self, statuses: Mapping[str, str], blackboard: Mapping[str, JsonValue]) -> None:
        """Take statuses and blackboard as they are at a stop."""
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
        """Return what has changed since the last call; empty when nothing has."""
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
        """Return everything, for a viewer that comes, or that was too slow."""
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

    def _body(self, body: BodyRecord) -> JsonValue:
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

    def _look(self, body: BodyRecord) -> str:
        """Return the name of a body's form and colour; a new one is packed for the page."""
        form = (repr(body.shape), body.colour, body.role, body.blocks)
        name = self._shapes.get(form)
        if name is None:
            name = self._shapes[form] = str(len(self._shapes))
            look: dict[str, Packable] = {
                "shape": packed_body(body, self._fixed),
                "colour": rgb(body.colour),
                "role": body.role,
            }
            self._put("looks", self._looks, name, pack([Section("look", look)]))
        return name
