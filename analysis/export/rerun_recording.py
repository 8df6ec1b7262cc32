"""Rerun recording of a run, with a blueprint that arranges it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from ..run import Run
from .layout_lanes import lanes
from .rerun_stage import TIMELINE, RerunWriter, camera_entity, write_stage
from .row_types import run_rows

_IDLE = "IDLE"
_STATES: Mapping[str, int] = {
    "RUNNING": 0x3D8BFDFF,
    "SUCCESS": 0x2E9E5BFF,
    "FAILURE": 0xD8433BFF,
    "HALTED": 0xC98A1AFF,
    "SKIPPED": 0x8A8F98FF,
    _IDLE: 0x00000000,
}
_STATE_STYLE = rr.StateConfiguration(
    values=list(_STATES),
    colors=np.array(list(_STATES.values()), dtype=np.uint32),
    visible=[state != _IDLE for state in _STATES],
)
_AXES = ("x", "y", "z")
_COLOURS = (0xE0443EFF, 0x2E9E5BFF, 0x3D8BFDFF, 0xC98A1AFF, 0x8E5BD0FF, 0x17A2A8FF, 0xC2528BFF, 0x6B7A8FFF)
"""Colours of the series of a plot, in order: x red, y green, z blue."""


def write_signals(sheet: RerunWriter, run: Run) -> None:
    _lanes(sheet, run)
    _signals(sheet, run)
    sheet.always("/about", rr.TextDocument(_about(run), media_type="text/markdown"))
    for at in run.lines:
        text = f"{at.record.message}  [{at.record.name}]" if at.record.name else at.record.message
        sheet.at(at.time, "/log", rr.TextLog(text, level=_LEVELS.get(at.record.level, at.record.level)))
    for at in run.events:
        text = f"{at.record.kind}: {at.record.message}"
        sheet.at(at.time, f"/events/{at.record.kind}", rr.TextLog(text, level="INFO"))


def _about(run: Run) -> str:
    """Return settings and outcome of the run as a table."""
    words = [(row.key, row.value.replace("|", "\\|").replace("\n", " ")) for row in run_rows(run)]
    return "\n".join(["| | |", "|---|---|", *(f"| {key} | {value} |" for key, value in words)])


_LEVELS = {"WARNING": "WARN", "FATAL": "CRITICAL"}
"""Rerun's names of the levels, where they differ from the log's."""


def lane_entity(path: str) -> str:
    return "/tree/" + "/".join(rr.escape_entity_path_part(part) for part in path.split("/") if part)


def _lanes(sheet: RerunWriter, run: Run) -> None:
    """Write each node's visits in the colour of their outcome; nothing between them."""
    lanes: dict[str, list[tuple[float, str]]] = {}
    for path, time, state in _changes(run):
        lane = lanes.setdefault(path, [])
        if lane and time <= lane[-1][0]:  # began again in the same tick
            lane.pop()
        lane.append((time, state))
    for path, lane in lanes.items():
        entity = lane_entity(path)
        sheet.always(entity, _STATE_STYLE)
        states = [state for _, state in lane]
        sheet.column(entity, [time for time, _ in lane], rr.StateChange.columns(state=states))


def _changes(run: Run) -> Iterator[tuple[str, float, str]]:
    """Yield (path, time, state), by time for each node.

    Where the log has no transitions, they come from the statuses alone.
    """
    if run.log.format > 1:
        for visit in run.visits:
            yield visit.path, visit.start, visit.outcome
            yield visit.path, max(visit.end, visit.start + run.info.tick), _IDLE
        return
    before: dict[str, str] = {}
    for tick in run.ticks:
        for node in tick.record.nodes:
            if node.status != before.get(node.path, "IDLE"):
                yield node.path, tick.time, node.status
            before[node.path] = node.status


def _signals(sheet: RerunWriter, run: Run) -> None:
    joints, wrenches, controls = run.joints, run.wrenches, run.controls
    arm = len(run.joint_names[0])
    for name, values in (
        ("position", joints.positions), ("velocity", joints.velocities), ("effort", joints.efforts)
    ):  # fmt: skip
        _series(sheet, f"/joints/{name}", joints.times, values[:, :arm], joints.names[:arm])
    if len(joints.names) > arm:
        opening = joints.positions[:, arm:].sum(axis=1, keepdims=True)
        _series(sheet, "/gripper/opening", joints.times, opening, ("opening (m)",))
        force = joints.efforts[:, arm : arm + 1]
        _series(sheet, "/gripper/force", joints.times, force, ("force per finger (N)",))
    _series(sheet, "/wrench/force", wrenches.times, wrenches.forces, _AXES)
    _series(sheet, "/wrench/torque", wrenches.times, wrenches.torques, _AXES)
    _series(
        sheet, "/control/error", controls.times, controls.errors, joints.names[: controls.errors.shape[1]]
    )


def _series(
    sheet: RerunWriter,
    entity: str,
    times: NDArray[np.float64],
    values: NDArray[np.float64],
    names: Sequence[str],
) -> None:
    """Write values (n, series) at times (n,)."""
    if not values.size:
        return
    colours = np.array([_COLOURS[k % len(_COLOURS)] for k in range(len(names))], dtype=np.uint32)
    sheet.always(entity, rr.SeriesLines(names=list(names), colors=colours))
    columns = rr.Scalars.columns(scalars=values.reshape(-1)).partition([values.shape[1]] * len(values))
    sheet.column(entity, times.tolist(), columns)


_EVENT_FILTER = ["$origin/**", "- /events/belief/**", "- /events/image/**"]
"""Filter of the event view. It hides events of which each image brings many; they are in the recording."""


def write_rerun(run: Run, path: Path) -> None:
    """Write the recording. Raises OSError when the disk refuses, PicktreeError where the log is damaged."""
    name = f"{run.info.mission}, {run.info.seed_text}"
    sheet = RerunWriter(path, name, blueprint(run))
    try:
        write_stage(sheet, run)
        write_signals(sheet, run)
    finally:
        sheet.close()


def blueprint(run: Run) -> rrb.Blueprint:
    """Return a blueprint: scene beside images and log lines, above the nodes' lanes and the signals."""
    contents = [f"+ {lane_entity(lane.path)}" for lane in lanes(run)]
    images = [
        rrb.Spatial2DView(origin=f"{camera_entity(camera)}/{kind}", name=f"{camera}, {kind}")
        for camera in run.log.cameras
        for kind in ("colour", "depth")
    ]
    signals = [
        rrb.TimeSeriesView(origin=origin, name=name)
        for origin, name in (
            ("/wrench/force", "Force (N)"),
            ("/wrench/torque", "Torque (Nm)"),
            ("/joints/position", "Joints (rad)"),
            ("/joints/velocity", "Velocity (rad/s)"),
            ("/control/error", "Tracking error (rad)"),
            ("/gripper/opening", "Gripper (m)"),
            ("/gripper/force", "Grip force (N)"),
        )
    ]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Spatial3DView(
                    origin="/world",
                    contents=["$origin/**", *(f"- {camera_entity(c)}/depth/**" for c in run.log.cameras)],
                    name="Belief, and truth in magenta",
                    eye_controls=rrb.EyeControls3D(
                        position=(1.6, -0.9, 1.0), look_target=(0.3, 0.0, 0.25), eye_up=(0.0, 0.0, 1.0)
                    ),
                ),
                rrb.Vertical(
                    rrb.Tabs(*images, rrb.TextDocumentView(origin="/about", name="Run")),
                    rrb.TextLogView(origin="/log", name="Failures and recoveries"),
                    rrb.TextLogView(origin="/events", contents=_EVENT_FILTER, name="Events"),
                ),
                column_shares=[5, 3],
            ),
            rrb.Horizontal(
                rrb.StateTimelineView(origin="/tree", contents=contents, name="Tree"),
                rrb.Tabs(*signals),
                column_shares=[1, 1],
            ),
            row_shares=[3, 2],
        ),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )
