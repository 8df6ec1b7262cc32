"""Layout of one log, as the file that Lichtblick and Foxglove import: format, lanes, panels, 3-D views."""

from __future__ import annotations

import functools
import json
import math
import operator
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NotRequired, TypeAlias, TypedDict, cast

import numpy as np

from picktree.analysis import Run
from picktree.logs import RunLog, log_records, topics
from picktree.logs.recording import WORLD
from picktree.world import TRUTH_COLOUR, Array, corners


class CameraState(TypedDict):
    """Camera of a 3-D panel; degrees and m. It orbits `targetOffset`; the file keeps `target`, but viewers
    ignore it."""

    distance: float
    perspective: bool
    phi: float
    """Angle from the vertical, degrees."""
    target: list[float]
    targetOffset: list[float]
    targetOrientation: list[float]
    thetaOffset: float
    fovy: float
    near: float
    far: float


class Grid(TypedDict):
    layerId: Literal["foxglove.Grid"]
    instanceId: str
    label: str
    visible: bool
    frameLocked: bool
    frameId: str
    size: float
    divisions: int
    lineWidth: float
    color: str
    position: list[float]
    rotation: list[float]


class Entities(TypedDict):
    """Display of a topic of scene updates."""

    visible: bool
    color: NotRequired[str]
    """Colour with alpha, in place of the entities' own."""
    showOutlines: NotRequired[bool]


class Frustum(TypedDict):
    """Display of a topic of camera calibrations."""

    visible: bool
    color: str
    distance: float
    """Length of the frustum, m."""


class TopicVisibility(TypedDict):
    visible: bool


class FrameAxes(TypedDict):
    axisScale: float
    showLabel: bool


class ThreeDeeScene(TypedDict):
    syncCamera: bool
    transforms: FrameAxes


class ThreeDee(TypedDict):
    cameraState: CameraState
    followMode: Literal["follow-none"]
    followTf: str
    scene: ThreeDeeScene
    transforms: dict[str, TopicVisibility]
    """Visibility of frames, by `frame:NAME`."""
    topics: dict[str, Entities | Frustum]
    layers: dict[str, Grid]
    foxglovePanelTitle: str


class StateSeries(TypedDict):
    value: str
    label: str
    timestampMethod: Literal["receiveTime"]


class StateTransitions(TypedDict):
    isSynced: bool
    paths: list[StateSeries]
    foxglovePanelTitle: str


class Series(TypedDict):
    value: str
    label: str
    enabled: bool
    timestampMethod: Literal["receiveTime"]


class PlotPanel(TypedDict):
    paths: list[Series]
    showXAxisLabels: bool
    showYAxisLabels: bool
    showLegend: bool
    legendDisplay: Literal["floating", "left"]
    showPlotValuesInLegend: bool
    isSynced: bool
    xAxisVal: Literal["timestamp"]
    sidebarDimension: int
    foxglovePanelTitle: str


class RawMessages(TypedDict):
    topicPath: str
    diffMethod: Literal["custom", "previous message"]
    diffTopicPath: str
    showFullMessageForDiff: bool
    diffEnabled: bool
    foxglovePanelTitle: str


class LogPanel(TypedDict):
    searchTerms: list[str]
    minLogLevel: int
    topicToRender: str
    foxglovePanelTitle: str


class ImageMode(TypedDict):
    imageTopic: str
    calibrationTopic: str


class Image(TypedDict):
    imageMode: ImageMode
    foxglovePanelTitle: str


class Split(TypedDict):
    direction: Literal["row", "column"]
    first: str | Split
    second: str | Split
    splitPercentage: float


class TabEntry(TypedDict):
    title: str
    layout: str | Split


class Tab(TypedDict):
    activeTabIdx: int
    tabs: list[TabEntry]


class Playback(TypedDict):
    speed: float


Panel = ThreeDee | StateTransitions | PlotPanel | RawMessages | LogPanel | Image | Tab


class LayoutFile(TypedDict):
    configById: dict[str, Panel]
    """Panels by `TYPE!NAME`."""
    globalVariables: dict[str, str]
    userNodes: dict[str, str]
    playbackConfig: Playback
    layout: str | Split


MAX_LEAF_LANES = 12
"""Maximum number of lanes of leaves."""
MAX_INNER_LANES = 5
"""Maximum number of lanes of nodes with children, besides the root."""


@dataclass(frozen=True, slots=True)
class Lane:
    """Lane of a node; `label` is the shortest end of the path that no other lane has."""

    path: str
    label: str


@dataclass(frozen=True, slots=True)
class _Activity:
    """Activity of the nodes over a run."""

    ticks: Mapping[str, int]
    """Number of ticks in which a node was busy: reached, and not idle."""
    failed: frozenset[str]
    """Nodes that failed with a cause."""
    began: Mapping[str, int]
    """Number of times that a node became busy."""
    leaves: frozenset[str]


def lanes(run: Run) -> tuple[Lane, ...]:
    """Return the root, the busiest leaves (failed ones first) and the busiest sub-trees, in the tree's order.

    Of nodes that wrap each other and are always busy together, one has a lane: the outermost, or the leaf.
    """
    nodes = _nodes(tree.record for tree in run.trees)
    if not nodes:
        return ()
    activity = _activity(run, frozenset(node.path for node in nodes if not node.children))
    root = nodes[0].path
    busy = [node for node in nodes if activity.ticks.get(node.path) and node.path != root]
    leaves = [node for node in busy if not node.children]
    inner = [node for node in busy if node.children and not _wraps_or_wrapped(node, activity)]

    def rank(node: log_records.TreeNode) -> tuple[bool, int]:
        return (node.path not in activity.failed, -activity.ticks[node.path])

    chosen = {root}
    chosen.update(node.path for node in sorted(leaves, key=rank)[:MAX_LEAF_LANES])
    chosen.update(
        node.path for node in sorted(inner, key=lambda n: -activity.ticks[n.path])[:MAX_INNER_LANES]
    )
    paths = [node.path for node in nodes if node.path in chosen]
    return tuple(Lane(path, label) for path, label in zip(paths, labels(paths), strict=True))


def labels(paths: Sequence[str]) -> tuple[str, ...]:
    """Return for each path its shortest end that no other path has.

    >>> labels(["Main", "Main/A/Grasp", "Main/B/Grasp"])
    ('Main', 'A/Grasp', 'B/Grasp')
    """
    ends = Counter(end for path in paths for end in _ends(path))
    return tuple(next((end for end in _ends(path) if ends[end] == 1), path) for path in paths)


def _ends(path: str) -> tuple[str, ...]:
    """Return the ends of the path, the shortest first, the whole path last."""
    parts = path.split("/")
    return tuple("/".join(parts[k:]) for k in range(len(parts) - 1, -1, -1))


def _nodes(trees: Iterable[log_records.Tree]) -> tuple[log_records.TreeNode, ...]:
    """Return the nodes of all trees of the run, each once, in its first form."""
    found: dict[str, log_records.TreeNode] = {}
    for tree in trees:
        for node in tree.nodes:
            found.setdefault(node.path, node)
    return tuple(found.values())


def _wraps_or_wrapped(node: log_records.TreeNode, activity: _Activity) -> bool:
    """Whether the node's parent, or a leaf below it, was busy at exactly the same times."""
    return any(
        activity.ticks[node.path] == activity.ticks.get(other)
        and activity.began[node.path] == activity.began[other]
        for other in (node.parent, *node.children)
        if other == node.parent or other in activity.leaves
    )


def _activity(run: Run, leaves: frozenset[str]) -> _Activity:
    """Return the activity from the ticks alone, which logs of every format have."""
    ticks, began = Counter[str](), Counter[str]()
    failed: set[str] = set()
    before: frozenset[str] = frozenset()
    for tick in run.ticks:
        busy = frozenset(n.path for n in tick.record.nodes if n.ticked and n.status != "IDLE")
        ticks.update(busy)
        began.update(busy - before)
        before = frozenset(n.path for n in tick.record.nodes if n.status == "RUNNING")
        failed.update(n.path for n in tick.record.nodes if n.ticked and n.status == "FAILURE" and n.cause)
    return _Activity(ticks, frozenset(failed), began, leaves)


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


_AZIMUTH, _ELEVATION = -30.0, 25.0
"""Direction of the camera as seen from the scene, degrees; the azimuth is about z, from +x."""
_FOV = 45.0
_VIEW_MARGIN = 1.15
"""Factor by which the view is larger than the scene's sphere."""
TRUTH_COLOUR_CODE = f"#{bytes(round(255 * share) for share in TRUTH_COLOUR).hex()}59"
"""Colour of the ground truth over the belief."""
_EMPTY_SCENE_BOX = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]])


def three_dee(log: RunLog, title: str, *, truth: bool) -> ThreeDee:
    """Return a 3-D panel with the belief; `truth` adds the tinted ground truth. The panels' cameras move
    together."""
    frames = log.transforms_at(log.end)
    transforms = frames.record if frames is not None else ()
    shown: dict[str, Entities | Frustum] = {
        topics.ROBOT.name: {"visible": True},
        topics.OBJECTS.name: {"visible": True},
        topics.TRUTH.name: {"visible": truth, "color": TRUTH_COLOUR_CODE, "showOutlines": True},
    }
    for camera in log.cameras:
        shown[topics.calibration_topic(camera).name] = {
            "visible": True,
            "color": "#7c6bff",
            "distance": 0.12,
        }
    scene = log.belief_at(log.end)
    size, centre = _extent(_points(scene.record if scene is not None else None, transforms))
    grid: Grid = {
        "layerId": "foxglove.Grid",
        "instanceId": "grid",
        "label": "Grid",
        "visible": True,
        "frameLocked": True,
        "frameId": WORLD,
        "size": max(2.0, 2.0 * math.ceil(size)),
        "divisions": 20,
        "lineWidth": 1.0,
        "color": "#248eff55",
        "position": [0.0, 0.0, 0.0],
        "rotation": [0.0, 0.0, 0.0],
    }
    return {
        "cameraState": camera_state(centre, size / 2),
        "followMode": "follow-none",
        "followTf": WORLD,
        "scene": {"syncCamera": True, "transforms": {"axisScale": 0.1, "showLabel": False}},
        "transforms": {f"frame:{name}": {"visible": False} for name in _frames(log)},
        "topics": shown,
        "layers": {"grid": grid},
        "foxglovePanelTitle": title,
    }


def camera_state(centre: Array, radius: float) -> CameraState:
    """Return a camera that sees a sphere about `centre` (m, in the world) as large as possible.

    The panel puts its camera at `centre` + `distance` · (−sin φ sin θ, −sin φ cos θ, cos φ).
    """
    return {
        "distance": round(_VIEW_MARGIN * radius / math.sin(math.radians(_FOV / 2)), 3),
        "perspective": True,
        "phi": 90.0 - _ELEVATION,
        "target": [0.0, 0.0, 0.0],
        "targetOffset": [round(float(c), 3) for c in centre],
        "targetOrientation": [0.0, 0.0, 0.0, 1.0],
        "thetaOffset": -(_AZIMUTH + 90.0),
        "fovy": _FOV,
        "near": 0.01,
        "far": 5000.0,
    }


def _extent(points: Array) -> tuple[float, Array]:
    """Return the diagonal (m) and the centre of the box about all points (n, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    return float(np.linalg.norm(high - low)), (low + high) / 2


def _points(scene: log_records.Scene | None, transforms: Sequence[log_records.Transform]) -> Array:
    """Return the corners of the believed bodies and the origins of all links, in the world (n, 3), m.

    Of the fixed parts only those of bins and tiles count, since the table reaches far beyond the scene.
    """
    found: list[Array] = [np.array(t.pose.position)[None] for t in transforms]
    if scene is not None:
        placed = [(body.shape, body.pose) for body in scene.bodies]
        placed += [(part.shape, part.pose) for part in scene.fixed if "/" in part.id]
        found += [pose.apply(corners(shape)) for shape, pose in placed]
    return np.concatenate(found) if found else _EMPTY_SCENE_BOX


def _frames(log: RunLog) -> tuple[str, ...]:
    """Return all frames of the run in the order in which they appeared; their axes are hidden, as they would
    cover the scene."""
    return (WORLD, *dict.fromkeys(t.child for at in log.transforms() for t in at.record))


@dataclass(frozen=True, slots=True)
class ViewerLayout:
    file: LayoutFile

    @property
    def lanes(self) -> int:
        """Number of lanes of statuses and events."""
        return sum(len(paths_of(panel)) for key, panel in self.panels if key.startswith("StateTransitions!"))

    @property
    def panels(self) -> tuple[tuple[str, Panel], ...]:
        """Panels with their ids, `TYPE!NAME`, without tab containers."""
        return tuple((key, p) for key, p in self.file["configById"].items() if not key.startswith("Tab!"))

    def to_json_text(self) -> str:
        """Return the file as JSON, with a trailing newline."""
        return json.dumps(self.file, ensure_ascii=False, indent=1, allow_nan=False) + "\n"


class _Desk:
    """Collection of panels under the ids by which the arrangement names them."""

    def __init__(self) -> None:
        self.panels: dict[str, Panel] = {}

    def put(self, kind: str, panel: Panel) -> str:
        number = sum(1 for key in self.panels if key.startswith(f"{kind}!"))
        key = f"{kind}!picktree{number}"
        self.panels[key] = panel
        return key

    def tabs(self, entries: Sequence[tuple[str, str]]) -> str:
        """Return one panel itself, several as tabs; a pair is the tab's title and the panel."""
        if len(entries) == 1:
            return entries[0][1]
        tabs: list[TabEntry] = [{"title": title, "layout": panel} for title, panel in entries]
        return self.put("Tab", {"activeTabIdx": 0, "tabs": tabs})


def layout(run: Run) -> ViewerLayout:
    """Return the layout for the run's own tree, topics, joints and cameras. Raises PicktreeError for a
    damaged log."""
    desk = _Desk()
    view = desk.tabs(
        [
            ("Belief", desk.put("3D", three_dee(run.log, "Belief", truth=False))),
            ("Belief and truth", desk.put("3D", three_dee(run.log, "Truth in magenta", truth=True))),
        ]
    )
    raw = [(p["foxglovePanelTitle"], desk.put("RawMessages", p)) for p in raw_messages(run)]
    texts = desk.tabs([("Running nodes", desk.put("RawMessages", running_nodes())), *raw])
    pictures = [(p["foxglovePanelTitle"], desk.put("Image", p)) for p in images(run)]
    right = _column([texts, *([desk.tabs(pictures)] if pictures else [])], 50.0)
    tree = desk.put("StateTransitions", state_transitions(run))
    drawn = [(p["foxglovePanelTitle"], desk.put("Plot", p)) for p in plots(run)]
    lines = desk.put("RosOut", log())
    below = _column([*([desk.tabs(drawn)] if drawn else []), lines], 60.0)
    return ViewerLayout(
        {
            "configById": desk.panels,
            "globalVariables": {},
            "userNodes": {},
            "playbackConfig": {"speed": 1.0},
            "layout": _split(
                "column", _split("row", view, right, 62.0), _split("row", tree, below, 50.0), 55.0
            ),
        }
    )


def _column(panes: Sequence[str], percentage: float) -> str | Split:
    """Return the panes below each other, the first with that share of the height, percent."""
    first, *others = panes
    return functools.reduce(lambda above, pane: _split("column", above, pane, percentage), others, first)


def _split(
    direction: Literal["row", "column"], first: str | Split, second: str | Split, percentage: float
) -> Split:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": percentage}


def paths_of(panel: Panel) -> tuple[str, ...]:
    """Return the message paths that a panel shows, without whole topics."""
    if "paths" in panel:
        return tuple(path["value"] for path in panel["paths"])
    return (panel["topicPath"],) if "topicPath" in panel else ()
