"""Rerun recording of a run: scene, signals, and a blueprint that arranges them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from picktree.analysis import Run
from picktree.logs import Stamped, binary_gltf, log_records, node_visits, topics, triangle_meshes
from picktree.logs.recording import UNKNOWN_COLOUR, foxglove_messages
from picktree.world import (
    COLOURS,
    TRUTH_COLOUR,
    Box,
    ConvexMesh,
    Cylinder,
    Pose,
    Rgb,
    Shape,
    Sphere,
    TreeNode,
)

from .run_tables import run_rows

TIMELINE = "sim_time"
"""Name of the timeline in simulated seconds."""
MAX_LEAF_LANES = 12
"""Maximum number of lanes of leaves in the blueprint."""
MAX_INNER_LANES = 5
"""Maximum number of lanes of nodes with children, besides the root."""
_MAX_WAITING_CALLS = 200
"""Number of calls after which their data are written to the file."""


class RerunWriter:
    """Rerun recording that is written to the file as it grows. Methods raise OSError when the disk refuses.

    The library encodes it in memory: its own writer logs an error of the disk, and does not return it.
    """

    def __init__(self, path: Path, name: str, blueprint: rrb.Blueprint) -> None:
        self._file = path.open("wb")
        self._recording = rr.RecordingStream("picktree", recording_id=name, send_properties=False)
        self._recording.set_log_time_enabled(False)
        self._recording.set_log_tick_enabled(False)
        self._stream = self._recording.binary_stream()
        self._waiting = 0
        """Number of calls whose data are not in the file."""
        rr.send_blueprint(blueprint, recording=self._recording)
        self._recording.send_recording_name(name)

    def always(self, entity: str, *what: rr.AsComponents) -> None:
        for one in what:
            self._recording.log(entity, one, static=True)
        self._write_some()

    def at(self, time: float, entity: str, what: rr.AsComponents) -> None:
        self._recording.set_time(TIMELINE, duration=time)
        self._recording.log(entity, what)
        self._write_some()

    def column(self, entity: str, times: Sequence[float], columns: Iterable[rr.ComponentColumn]) -> None:
        if times:
            self._recording.send_columns(
                entity, indexes=[rr.TimeColumn(TIMELINE, duration=times)], columns=columns
            )
            self._write_some()

    def close(self) -> None:
        try:
            self._write()
        finally:
            self._recording.disconnect()
            self._file.close()

    def _write_some(self) -> None:
        self._waiting += 1
        if self._waiting >= _MAX_WAITING_CALLS:
            self._write()

    def _write(self) -> None:
        self._waiting = 0
        self._file.write(self._stream.read() or b"")


_Z_UP_FROM_Y_UP = rr.Quaternion(xyzw=(math.sin(math.pi / 4), 0.0, 0.0, math.cos(math.pi / 4)))
"""Rotation from glTF, which has Y up, to the links' frames, which have Z up."""
_MAX_POSES_IN_MEMORY = 10_000
"""Maximum number of poses of a frame in memory: a run may last for hours."""
_PLAN_COLOUR, _FAILED_PLAN_COLOUR = (40, 200, 120), (230, 60, 60)


def write_stage(sheet: RerunWriter, run: Run) -> None:
    sheet.always("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    _robot(sheet, run)
    fixed: log_records.Scene | None = next((at.record for at in run.log.beliefs()), None)
    if fixed is not None:
        _fixtures(sheet, fixed.fixed)
    _bodies(sheet, "belief", run.log.beliefs(), rr.components.FillMode.Solid)
    _bodies(sheet, "truth", run.log.truths(), rr.components.FillMode.MajorWireframe)
    _frames(sheet, run)
    _plans(sheet, run)
    for camera in run.log.cameras:
        _camera(sheet, run, camera)


def _robot(sheet: RerunWriter, run: Run) -> None:
    """Write the meshes once; they follow their links' frames."""
    for mesh in run.log.robot_model():
        model = f"/world/robot/{rr.escape_entity_path_part(mesh.link)}/model"
        sheet.always(
            model, rr.Asset3D(contents=binary_gltf.with_y_up(mesh.glb), media_type="model/gltf-binary")
        )
        sheet.always(model, rr.Transform3D(quaternion=_Z_UP_FROM_Y_UP))


def _fixtures(sheet: RerunWriter, parts: Sequence[log_records.PartRecord]) -> None:
    by_owner: dict[str, list[log_records.PartRecord]] = {}
    for part in parts:
        by_owner.setdefault(part.id.split("/")[0], []).append(part)
    for owner, pieces in by_owner.items():
        for k, piece in enumerate(pieces):
            entity = f"/world/fixtures/{rr.escape_entity_path_part(owner)}/{k}"
            form = _mesh_form(piece) if piece.holes else _form(piece.shape, _rgb(piece.colour))
            sheet.always(entity, _placed(piece.pose), form)


def _bodies(
    sheet: RerunWriter,
    source: str,
    scenes: Iterable[Stamped[log_records.Scene]],
    fill: rr.components.FillMode,
) -> None:
    """Write shapes when they appear or change, poses at each message, and the removal of bodies."""
    there: Mapping[str, tuple[Shape, str, tuple[log_records.BlockRecord, ...]]] = {}
    for at in scenes:
        time, bodies = at.time, at.record.bodies
        present = {str(body.id): (body.shape, body.colour, body.blocks) for body in bodies}
        for gone in there.keys() - present.keys():
            sheet.at(time, _entity(source, gone), rr.Clear(recursive=True))
        for body in bodies:
            entity = _entity(source, body.id)
            sheet.at(time, entity, _placed(body.pose))
            if there.get(body.id) != present[body.id]:
                colour = _bytes(TRUTH_COLOUR) if source == "truth" else _rgb(body.colour)
                sheet.at(time, entity, _body_form(body, colour, fill))
        there = present


def _frames(sheet: RerunWriter, run: Run) -> None:
    """Write poses at each tick: links, cameras, and the believed objects between two beliefs."""
    links = {mesh.link for mesh in run.log.robot_model()}
    believed = frozenset(body.id for at in run.log.beliefs() for body in at.record.bodies)
    tracks: dict[str, list[tuple[float, Pose]]] = {}
    for at in run.log.transforms():
        for t in at.record:
            entity = _frame_entity(t, links, believed)
            if entity is None:
                continue
            track = tracks.setdefault(entity, [])
            track.append((at.time, t.pose))
            if len(track) == _MAX_POSES_IN_MEMORY:
                _move(sheet, entity, tracks.pop(entity))
    for entity, track in tracks.items():
        _move(sheet, entity, track)


def _move(sheet: RerunWriter, entity: str, track: Sequence[tuple[float, Pose]]) -> None:
    columns = rr.Transform3D.columns(
        translation=np.array([pose.position for _, pose in track]),
        quaternion=np.array([pose.orientation for _, pose in track]),
    )
    sheet.column(entity, [time for time, _ in track], columns)


def _frame_entity(t: log_records.Transform, links: set[str], believed: frozenset[str]) -> str | None:
    """Return the entity of a frame; None for frames without anything to draw."""
    if t.child in links:
        return f"/world/robot/{rr.escape_entity_path_part(t.child)}"
    if t.child in believed:
        return _entity("belief", t.child)
    return camera_entity(t.child.removeprefix("camera/")) if t.child.startswith("camera/") else None


def _plans(sheet: RerunWriter, run: Run) -> None:
    """Write the TCP path of the last plan; nothing where no plan was found."""
    for at in run.plans:
        way = [at.record.tool_path] if len(at.record.tool_path) > 1 else []
        colour = _PLAN_COLOUR if at.record.outcome == "found" else _FAILED_PLAN_COLOUR
        sheet.at(at.time, "/world/plan", rr.LineStrips3D(way, colors=[colour] * len(way), radii=0.003))


def _camera(sheet: RerunWriter, run: Run, camera: str) -> None:
    """Write the log's colour and depth images on the plane of a pinhole camera."""
    entity = camera_entity(camera)
    for message in run.log.messages([topics.calibration_topic(camera).name]):
        i = foxglove_messages.read_calibration(message.data)
        pinhole = rr.Pinhole(
            focal_length=(i.fx, i.fy),
            principal_point=(i.cx, i.cy),
            width=i.width,
            height=i.height,
            image_plane_distance=0.15,
        )
        sheet.at(message.time / 1e9, entity, pinhole)
    for message in run.log.messages([topics.colour_topic(camera).name]):
        image = rr.EncodedImage(contents=foxglove_messages.read_image(message.data), media_type="image/jpeg")
        sheet.at(message.time / 1e9, f"{entity}/colour", image)
    for message in run.log.messages([topics.depth_topic(camera).name]):
        depth = rr.EncodedDepthImage(
            foxglove_messages.read_image(message.data), media_type="image/png", meter=1000.0
        )
        sheet.at(message.time / 1e9, f"{entity}/depth", depth)


def _entity(source: str, name: str) -> str:
    return f"/world/{source}/{rr.escape_entity_path_part(name)}"


def camera_entity(camera: str) -> str:
    """Return the entity above a camera's colour and depth images."""
    return f"/world/camera/{rr.escape_entity_path_part(camera)}"


def _placed(pose: Pose) -> rr.Transform3D:
    return rr.Transform3D(translation=pose.position, quaternion=rr.Quaternion(xyzw=pose.orientation))


def _body_form(
    body: log_records.BodyRecord, colour: tuple[int, int, int], fill: rr.components.FillMode
) -> rr.AsComponents:
    if not body.blocks:
        return _form(body.shape, colour, fill, body.id)
    return rr.Boxes3D(
        centers=[block.at for block in body.blocks],
        sizes=[block.size for block in body.blocks],
        colors=[colour],
        fill_mode=fill,
        labels=[body.id],
        show_labels=False,
    )


def _mesh_form(part: log_records.PartRecord) -> rr.AsComponents:
    mesh = triangle_meshes.part_mesh(part.shape, part.holes)
    return rr.Mesh3D(
        vertex_positions=mesh.vertices,
        vertex_normals=mesh.normals.reshape(-1, 3),
        triangle_indices=mesh.faces,
        albedo_factor=_rgb(part.colour),
    )


def _form(
    shape: Shape,
    colour: tuple[int, int, int],
    fill: rr.components.FillMode = rr.components.FillMode.Solid,
    label: str = "",
) -> rr.AsComponents:
    style: Any = {
        "colors": [colour], "fill_mode": fill, "labels": [label] if label else None, "show_labels": False
    }  # fmt: skip
    match shape:
        case Box(size):
            return rr.Boxes3D(sizes=[size], **style)
        case Cylinder(radius, height):
            return rr.Cylinders3D(lengths=[height], radii=[radius], **style)
        case Sphere(radius):
            return rr.Ellipsoids3D(radii=[radius], **style)
        case ConvexMesh():
            mesh = triangle_meshes.shape_mesh(shape)
            if fill is not rr.components.FillMode.Solid:
                edges = [mesh.vertices[[*face, face[0]]] for face in mesh.faces]
                return rr.LineStrips3D(edges, colors=[colour] * len(edges))
            return rr.Mesh3D(
                vertex_positions=mesh.vertices, triangle_indices=mesh.faces, albedo_factor=colour
            )


def _rgb(colour: str) -> tuple[int, int, int]:
    return _bytes(COLOURS.get(colour, UNKNOWN_COLOUR))


def _bytes(colour: Rgb) -> tuple[int, int, int]:
    red, green, blue = colour
    return round(red * 255), round(green * 255), round(blue * 255)


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


def steps_entity(path: str) -> str:
    """Return the entity of the steps of a skill's node."""
    return f"{lane_entity(path)}/steps"


def _lanes(sheet: RerunWriter, run: Run) -> None:
    """Write each node's visits in the colour of their outcome, and below them the steps of skills.

    Nothing is between two visits or steps.
    """
    visits = ((lane_entity(visit.path), visit.start, visit.end, visit.outcome) for visit in run.visits)
    for entity, lane in _lane_changes(visits, run.info.tick).items():
        sheet.always(entity, _STATE_STYLE)
        _write_lane(sheet, entity, lane)
    by_start = sorted(run.steps, key=lambda step: step.start)
    steps = ((steps_entity(step.node), step.start, step.end, step.name) for step in by_start)
    for entity, lane in _lane_changes(steps, run.info.tick).items():
        _write_lane(sheet, entity, lane)


def _lane_changes(
    spans: Iterable[tuple[str, float, float, str]], tick: float
) -> Mapping[str, Sequence[tuple[float, str]]]:
    """Return (time, state) by entity from spans of (entity, start, end, state), by time for each entity."""
    lanes: dict[str, list[tuple[float, str]]] = {}
    for entity, start, end, state in spans:
        lane = lanes.setdefault(entity, [])
        if lane and start <= lane[-1][0]:  # began again in the same tick
            lane.pop()
        lane += [(start, state), (max(end, start + tick), _IDLE)]
    return lanes


def _write_lane(sheet: RerunWriter, entity: str, lane: Sequence[tuple[float, str]]) -> None:
    states = [state for _, state in lane]
    sheet.column(entity, [time for time, _ in lane], rr.StateChange.columns(state=states))


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
    skills = {step.node for step in run.steps}
    contents = [
        f"+ {entity}"
        for path in shown_nodes(run)
        for entity in (lane_entity(path), *((steps_entity(path),) if path in skills else ()))
    ]
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


def shown_nodes(run: Run) -> Sequence[str]:
    """Return paths of the root, the busiest leaves (failed ones first) and the busiest sub-trees, in order.

    Of nodes that wrap each other and are always busy together, one has a lane: the outermost, or the leaf.
    """
    nodes: dict[str, TreeNode] = {}
    for tree in run.trees:
        for node in tree.record.nodes:
            nodes.setdefault(node.path, node)
    if not nodes:
        return ()
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
    return [path for path in nodes if path in chosen]
