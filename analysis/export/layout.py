"""Layout of one log, as the file that Lichtblick and Foxglove import."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...logs.recording.foxglove_messages import WORLD
from ...logs.run_log import RunLog
from ...logs.schema import topics
from ...logs.schema.records import Scene, Transform
from ...world.colours import TRUTH_COLOUR
from ...world.shapes import corners
from ...world.values import Array
from ..run import Run
from . import layout_panels
from .layout_format import CameraState, Entities, Frustum, Grid, LayoutFile, Panel, Split, TabEntry, ThreeDee

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


def _points(scene: Scene | None, transforms: Sequence[Transform]) -> Array:
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
    raw = [(p["foxglovePanelTitle"], desk.put("RawMessages", p)) for p in layout_panels.raw_messages(run)]
    texts = desk.tabs([("Running nodes", desk.put("RawMessages", layout_panels.running_nodes())), *raw])
    pictures = [(p["foxglovePanelTitle"], desk.put("Image", p)) for p in layout_panels.images(run)]
    right = _column([texts, *([desk.tabs(pictures)] if pictures else [])], 50.0)
    tree = desk.put("StateTransitions", layout_panels.state_transitions(run))
    drawn = [(p["foxglovePanelTitle"], desk.put("Plot", p)) for p in layout_panels.plots(run)]
    lines = desk.put("RosOut", layout_panels.log())
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
