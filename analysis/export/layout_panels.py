"""Panels besides the 3-D one: lanes of statuses, plots, raw messages, images, log lines; and their message
paths.

Message paths, as Lichtblick's and Foxglove's panels take them, are a topic, then fields, slices and filters:
`/bt/tick.nodes[:]{path=="Main/Grasp"}.status`, `/joint_states.joints[:]{name=="j1"}.position`. The parser
reads the grammar of Lichtblick's `message-path` package without variables and without modifiers.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

from ...logs.schema import topics
from ..run import Run
from .layout_format import Image, LogPanel, PlotPanel, RawMessages, Series, StateSeries, StateTransitions
from .layout_lanes import lanes

Value: TypeAlias = str | int | bool


@dataclass(frozen=True, slots=True)
class Field:
    name: str


@dataclass(frozen=True, slots=True)
class Slice:
    """Elements `start` to `end`, both inclusive; to the last when `end` is None."""

    start: int
    end: int | None


@dataclass(frozen=True, slots=True)
class Filter:
    """Selection of the values that have this value at this field; `path` is one or more names."""

    path: tuple[str, ...]
    operator: str
    value: Value


Part: TypeAlias = Field | Slice | Filter


@dataclass(frozen=True, slots=True)
class MessagePath:
    topic: str
    parts: tuple[Part, ...] = ()


_TOPIC = re.compile(r"(?:/[a-zA-Z0-9_-]*)+|[a-zA-Z0-9_-]+(?:/[a-zA-Z0-9_-]*)*")
_FIELD = re.compile(r"\.([a-zA-Z0-9_-]+)")
_SLICE = re.compile(r"\[(-?\d+)?(:)?(-?\d+)?\]")
_FILTER = re.compile(
    r"\{([a-zA-Z0-9_-]+(?:\.[a-zA-Z0-9_-]+)*)(==|!=|>=|<=|>|<)(?:\"([^\"]*)\"|'([^']*)'|(-?\d+)|(true|false))\}"
)

_COMPARE: Mapping[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq, "!=": operator.ne, ">=": operator.ge, "<=": operator.le, ">": operator.gt,
    "<": operator.lt,
}  # fmt: skip


def literal(text: str) -> str | None:
    """Return the text as a value in a filter.

    None when it has both kinds of quote, since none can be escaped.
    """
    if '"' not in text:
        return f'"{text}"'
    return f"'{text}'" if "'" not in text else None


def parse(text: str) -> MessagePath:
    """Parse a message path. Raises ValueError, with the place, for text that the viewers do not understand.

    >>> parse('/wrench.force.z').parts
    (Field(name='force'), Field(name='z'))
    """
    topic = _TOPIC.match(text)
    if topic is None:
        raise ValueError(f"{text!r}: begins with no topic")
    parts: list[Part] = []
    at = topic.end()
    while at < len(text):
        at = _part(text, at, parts)
    return MessagePath(topic[0], tuple(parts))


def _part(text: str, at: int, parts: list[Part]) -> int:
    """Read one part into `parts`, and return the place after it."""
    if found := _FIELD.match(text, at):
        parts.append(Field(found[1]))
    elif (found := _SLICE.match(text, at)) and parts and isinstance(parts[-1], Field) and found[0] != "[]":
        start, colon, end = found.groups()
        first = 0 if start is None else int(start)
        last = first if colon is None else None if end is None else int(end)
        parts.append(Slice(first, last))
    elif found := _FILTER.match(text, at):
        path, compare, double, single, number, truth = found.groups()
        value: Value = truth == "true"
        if double is not None or single is not None:
            value = double if double is not None else single
        elif number is not None:
            value = int(number)
        parts.append(Filter(tuple(path.split(".")), compare, value))
    else:
        raise ValueError(f"{text!r}: no field, slice or filter at {text[at:]!r}")
    return found.end()


def values(path: MessagePath, message: object) -> tuple[object, ...]:
    """Return the values that a panel shows of a message (mappings, sequences, plain values) of the path's
    topic."""
    return tuple(_values(path.parts, message))


def _values(parts: tuple[Part, ...], value: object) -> Iterator[object]:
    if value is None:
        return
    if not parts:
        yield value
        return
    part, rest = parts[0], parts[1:]
    match part:
        case Field(name):
            yield from _values(rest, _field(value, name))
        case Slice(start, end):
            elements = _elements(value)
            stop = len(elements) - 1 if end is None else min(end, len(elements) - 1)
            for k in range(start, stop + 1):
                if -len(elements) <= k:
                    yield from _values(rest, elements[k])
        case Filter():
            if _matches(part, value):
                yield from _values(rest, value)


def _matches(wanted: Filter, value: object) -> bool:
    for name in wanted.path:
        value = _field(value, name)
    comparable = isinstance(value, str) if isinstance(wanted.value, str) else isinstance(value, (int, float))
    return comparable and _COMPARE[wanted.operator](value, wanted.value)


def _field(value: object, name: str) -> object:
    return cast("Mapping[str, object]", value).get(name) if isinstance(value, Mapping) else None


def _elements(value: object) -> Sequence[object]:
    """Return the elements of a list; none for another value."""
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return cast("Sequence[object]", value)
    return ()


_LANE_EVENTS = ("fault", "pick", "recovery", "item_done", "safety_stop", "mission_edited")
"""Kinds of event that have a lane where the log holds any."""


def state_transitions(run: Run) -> StateTransitions:
    """Return lanes for the root, for the chosen nodes, and for each kind of event in the log."""
    paths = [_transition("root status", f"{topics.TICK.name}.root_status")]
    for lane in lanes(run):
        name = literal(lane.path)
        if name is not None:
            paths.append(_transition(lane.label, f"{topics.TICK.name}.nodes[:]{{path=={name}}}.status"))
    happened = {at.record.kind for at in run.events}
    paths += [
        _transition(kind.replace("_", " "), f'{topics.EVENTS.name}{{kind=="{kind}"}}.message')
        for kind in _LANE_EVENTS
        if kind in happened
    ]
    return {"isSynced": True, "paths": paths, "foxglovePanelTitle": "Tree"}


def plots(run: Run) -> tuple[PlotPanel, ...]:
    """Return plots of wrench, positions, velocities, tracking error, gripper and wall time, as far as the log
    has them."""
    held = {name for name, info in run.log.topics.items() if info.messages}
    made: list[PlotPanel] = []
    if topics.WRENCH.name in held:
        force = [(f"f{axis} (N)", f"{topics.WRENCH.name}.force.{axis}") for axis in "xyz"]
        torque = [(f"t{axis} (Nm)", f"{topics.WRENCH.name}.torque.{axis}") for axis in "xyz"]
        made.append(_plot("Wrench", [*force, *torque, ("|f| (N)", f"{topics.WRENCH.name}.magnitude")]))
    arm, fingers = run.joint_names
    if arm:
        made.append(_plot("Joints (rad)", _of_joints(arm, "position")))
        made.append(_plot("Velocity (rad/s)", _of_joints(arm, "velocity")))
    if topics.CONTROL.name in held:
        errors = [(name, f"{topics.CONTROL.name}.error[{k}]") for k, name in enumerate(arm)]
        made.append(_plot("Tracking error (rad)", errors))
    if fingers:
        finger = fingers[:1]
        opening = [(f"{name} (m)", path) for name, path in _of_joints(finger, "position")]
        load = [(f"{name} (N)", path) for name, path in _of_joints(finger, "effort")]
        made.append(_plot("Gripper: half of the opening", opening))
        made.append(_plot("Grip force", load))
    if topics.TIMING.name in held:
        parts = ("total", "physics", "control", "planning", "perception", "recording")
        made.append(_plot("Wall time (s)", [(part, f"{topics.TIMING.name}.{part}") for part in parts]))
    return tuple(made)


def running_nodes() -> RawMessages:
    return _raw("Running nodes", f'{topics.TICK.name}.nodes[:]{{status=="RUNNING"}}')


def raw_messages(run: Run) -> tuple[RawMessages, ...]:
    """Return panels of events, plans, candidates and writes to the blackboard, as far as the log has them."""
    held = {name for name, info in run.log.topics.items() if info.messages}
    wanted = (
        ("Failing nodes", topics.TICK.name, '.nodes[:]{status=="FAILURE"}'),
        ("Blackboard writes", topics.TICK.name, ".writes"),
        ("Events", topics.EVENTS.name, ""),
        ("Plans", topics.PLAN.name, ""),
        ("Candidates", topics.CANDIDATES.name, ""),
    )
    return tuple(_raw(title, topic + rest) for title, topic, rest in wanted if topic in held)


def images(run: Run) -> tuple[Image, ...]:
    """Return panels of colour and depth for each camera."""
    return tuple(
        {
            "imageMode": {
                "imageTopic": topic.name,
                "calibrationTopic": topics.calibration_topic(camera).name,
            },
            "foxglovePanelTitle": f"{camera}, {what}",
        }
        for camera in run.log.cameras
        for what, topic in (("colour", topics.colour_topic(camera)), ("depth", topics.depth_topic(camera)))
    )


def log() -> LogPanel:
    return {
        "searchTerms": [],
        "minLogLevel": 1,
        "topicToRender": topics.LOG.name,
        "foxglovePanelTitle": "Failures and recoveries",
    }


def _of_joints(names: Iterable[str], quantity: str) -> list[tuple[str, str]]:
    return [
        (name, f"{topics.JOINTS.name}.joints[:]{{name=={quoted}}}.{quantity}")
        for name in names
        if (quoted := literal(name)) is not None
    ]


def _transition(label: str, value: str) -> StateSeries:
    return {"value": value, "label": label, "timestampMethod": "receiveTime"}


def _plot(title: str, paths: Sequence[tuple[str, str]]) -> PlotPanel:
    series: list[Series] = [
        {"value": value, "label": label, "enabled": True, "timestampMethod": "receiveTime"}
        for label, value in paths
    ]
    return {
        "paths": series,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "left",
        "showPlotValuesInLegend": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 200,
        "foxglovePanelTitle": title,
    }


def _raw(title: str, path: str) -> RawMessages:
    return {
        "topicPath": path,
        "diffMethod": "custom",
        "diffTopicPath": "",
        "showFullMessageForDiff": False,
        "diffEnabled": False,
        "foxglovePanelTitle": title,
    }
