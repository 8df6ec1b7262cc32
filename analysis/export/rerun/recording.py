"""A run as a recording for Rerun, with a blueprint that arranges it."""

from __future__ import annotations

from pathlib import Path

import rerun.blueprint as rrb

from ...run import Run
from ..layout.lanes import lanes
from .course import lane_entity, write_course
from .sheet import TIMELINE, Sheet
from .stage import camera_entity, write_stage

_EVENTS = ["$origin/**", "- /events/belief/**", "- /events/image/**"]
"""Without those of which each image brings many; they are in the recording."""


def write_rerun(run: Run, path: Path) -> None:
    """Raises OSError when the disk refuses, PicktreeError where the log is damaged."""
    name = f"{run.info.mission}, seed {run.info.seed}"
    sheet = Sheet(path, name, blueprint(run))
    try:
        write_stage(sheet, run)
        write_course(sheet, run)
    finally:
        sheet.close()


def blueprint(run: Run) -> rrb.Blueprint:
    """The scene beside the images and what is said, above the nodes' lanes and the signals."""
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
                    rrb.TextLogView(origin="/events", contents=_EVENTS, name="Events"),
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
