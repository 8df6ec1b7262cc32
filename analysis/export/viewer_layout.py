"""Layout of one log for Lichtblick and Foxglove: the shipped file with the run's tree, joints, cameras and
scene.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from picktree.analysis import Run
from picktree.files import short_names
from picktree.logs import RunLog, log_records, node_visits, topics
from picktree.logs.recording import WORLD
from picktree.world import Array, TreeNode, corners

_TEMPLATE = Path(__file__).with_suffix(".json")
MAX_LEAF_LANES = 12
"""Maximum number of lanes of leaves."""
MAX_INNER_LANES = 5
"""Maximum number of lanes of nodes with children, besides the root."""
_LANE_EVENTS = ("fault", "step", "pick", "recovery", "item_done", "safety_stop", "mission_edited")
"""Kinds of event that have a lane where the log holds any."""
_VIEW_MARGIN = 1.15
"""Factor by which the view is larger than the scene's sphere."""
_EMPTY_SCENE_BOX = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]])


@dataclass(frozen=True, slots=True)
class ViewerLayout:
    file: Mapping[str, Any]
    """Content of the layout file."""

    @property
    def lanes(self) -> int:
        """Number of lanes of statuses and events."""
        return len(self.file["configById"]["StateTransitions!tree"]["paths"])

    @property
    def panels(self) -> Mapping[str, Mapping[str, Any]]:
        """Panels by id, `TYPE!NAME`, without tab containers."""
        return {key: p for key, p in self.file["configById"].items() if not key.startswith("Tab!")}

    def to_json_text(self) -> str:
        """Return the file as JSON, with a trailing newline."""
        return json.dumps(self.file, ensure_ascii=False, indent=1, allow_nan=False) + "\n"


def layout(run: Run) -> ViewerLayout:
    """Return the layout for the run's own tree, joints, cameras and scene. Raises PicktreeError for a damaged
    log.
    """
    template = _TEMPLATE.read_text(encoding="utf-8")
    if run.log.format == 2:
        template = template.replace(f"{topics.NODES.name}.", f"{topics.TICK.name}.")
    file: dict[str, Any] = json.loads(template)
    panels = file["configById"]
    panels["StateTransitions!tree"]["paths"] += _status_series(run)
    for name, series in _joint_series(run).items():
        panels[name]["paths"] = series
    for panel in (panels["3D!belief"], panels["3D!truth"]):
        _fit_scene(panel, run.log)
    for camera in run.log.cameras:
        for quantity, topic in (
            ("colour", topics.colour_topic(camera)),
            ("depth", topics.depth_topic(camera)),
        ):
            title, key = f"{camera}, {quantity}", f"Image!{camera}_{quantity}"
            mode = {"imageTopic": topic.name, "calibrationTopic": topics.calibration_topic(camera).name}
            panels[key] = {"imageMode": mode, "foxglovePanelTitle": title}
            panels["Tab!images"]["tabs"].append({"title": title, "layout": key})
    return ViewerLayout(file)


def _status_series(run: Run) -> list[dict[str, Any]]:
    """Return lanes for the chosen nodes, and for each kind of event in the log."""
    happened = {at.record.kind for at in run.events}
    nodes = [(label, literal(path)) for path, label in lanes(run).items()]
    states = "nodes" if run.log.format == 2 else "transitions"
    paths = [
        (label, f"{topics.TICK.name}.{states}[:]{{path=={name}}}.status") for label, name in nodes if name
    ]
    paths += [
        (kind.replace("_", " "), f'{topics.EVENTS.name}{{kind=="{kind}"}}.message')
        for kind in _LANE_EVENTS
        if kind in happened
    ]
    return [{"value": value, "label": label, "timestampMethod": "receiveTime"} for label, value in paths]


def _joint_series(run: Run) -> dict[str, list[dict[str, Any]]]:
    """Return the series of the plots that name joints, by panel."""
    arm, fingers = run.joint_names

    def series(joints: Iterable[str], quantity: str, unit: str = "") -> list[dict[str, Any]]:
        return [
            _series(name + unit, f"{topics.JOINTS.name}.joints[:]{{name=={quoted}}}.{quantity}")
            for name in joints
            if (quoted := literal(name)) is not None
        ]

    return {
        "Plot!positions": series(arm, "position"),
        "Plot!velocities": series(arm, "velocity"),
        "Plot!tracking": [_series(name, f"{topics.CONTROL.name}.error[{k}]") for k, name in enumerate(arm)],
        "Plot!opening": series(fingers[:1], "position", " (m)"),
        "Plot!grip_force": series(fingers[:1], "effort", " (N)"),
    }


def _series(label: str, value: str) -> dict[str, Any]:
    return {"value": value, "label": label, "enabled": True, "timestampMethod": "receiveTime"}


def literal(text: str) -> str | None:
    """Return the text as a value in a filter of a message path.

    None when it has both kinds of quote, since none can be escaped.
    """
    if '"' not in text:
        return f'"{text}"'
    return f"'{text}'" if "'" not in text else None


def _fit_scene(panel: dict[str, Any], log: RunLog) -> None:
    """Aim a 3-D panel's camera at the scene, hide the axes of all frames, and show each camera's frustum."""
    frames = log.transforms_at(log.end)
    scene = log.belief_at(log.end)
    points = _scene_points(scene.record if scene else None, frames.record if frames else ())
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(np.linalg.norm(high - low))
    aim_camera(panel["cameraState"], (low + high) / 2, size / 2)
    panel["layers"]["grid"]["size"] = max(2.0, 2.0 * math.ceil(size))
    names = (WORLD, *dict.fromkeys(t.child for at in log.transforms() for t in at.record))
    panel["transforms"] = {f"frame:{name}": {"visible": False} for name in names}
    for camera in log.cameras:
        frustum = {"visible": True, "color": "#7c6bff", "distance": 0.12}
        panel["topics"][topics.calibration_topic(camera).name] = frustum


def aim_camera(state: dict[str, Any], centre: Array, radius: float) -> None:
    """Let the camera of a 3-D panel see a sphere about `centre` (m, in the world) as large as possible.

    The panel puts its camera at `centre` + `distance` · (−sin φ sin θ, −sin φ cos θ, cos φ).
    """
    state["distance"] = round(_VIEW_MARGIN * radius / math.sin(math.radians(state["fovy"] / 2)), 3)
    state["targetOffset"] = [round(float(c), 3) for c in centre]


def _scene_points(scene: log_records.Scene | None, transforms: Sequence[log_records.Transform]) -> Array:
    """Return the corners of the believed bodies and the origins of all links, in the world (n, 3), m.

    Of the fixed parts only those of bins and tiles count, since the table reaches far beyond the scene.
    """
    found: list[Array] = [np.array(t.pose.position)[None] for t in transforms]
    if scene is not None:
        placed = [(body.shape, body.pose) for body in scene.bodies]
        placed += [(part.shape, part.pose) for part in scene.fixed if "/" in part.id]
        found += [pose.apply(corners(shape)) for shape, pose in placed]
    return np.concatenate(found) if found else _EMPTY_SCENE_BOX


def lanes(run: Run) -> Mapping[str, str]:
    """Return the root, the busiest leaves (failed ones first) and the busiest sub-trees, in the tree's order.

    The keys are paths, the values short names.

    Of nodes that wrap each other and are always busy together, one has a lane: the outermost, or the leaf.
    """
    nodes: dict[str, TreeNode] = {}
    for tree in run.trees:
        for node in tree.record.nodes:
            nodes.setdefault(node.path, node)
    if not nodes:
        return {}
    visits: dict[str, list[node_visits.Visit]] = {}
    for visit in run.account.visits:
        visits.setdefault(visit.path, []).append(visit)
    ticks = {path: [(visit.first, visit.last) for visit in each] for path, each in visits.items()}
    spent = {path: sum(last - first + 1 for first, last in each) for path, each in ticks.items()}
    failed = {visit.path for visit in run.account.visits if visit.outcome == "FAILURE" and visit.cause}
    root = next(iter(nodes))
    busy = [node for path, node in nodes.items() if path in spent and path != root]
    leaves = [node.path for node in busy if not node.children]

    def repeated(node: TreeNode) -> bool:
        """Whether the node's parent, or a leaf below it, was busy at exactly the same times."""
        others = (node.parent, *(child for child in node.children if child in leaves))
        return any(ticks[node.path] == ticks.get(other) for other in others)

    inner = [node.path for node in busy if node.children and not repeated(node)]
    chosen = {
        root,
        *sorted(leaves, key=lambda path: (path not in failed, -spent[path]))[:MAX_LEAF_LANES],
        *sorted(inner, key=lambda path: -spent[path])[:MAX_INNER_LANES],
    }
    return short_names(path for path in nodes if path in chosen)
