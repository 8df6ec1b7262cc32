"""Rerun scene: robot, fixtures, belief, ground truth, planned paths and cameras, under `/world`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...logs.binary_gltf import with_y_up
from ...logs.recording import foxglove_messages
from ...logs.recording.foxglove_messages import UNKNOWN_COLOUR
from ...logs.schema import topics
from ...logs.schema.records import BlockRecord, BodyRecord, PartRecord, Scene, Transform
from ...logs.triangle_meshes import part_mesh, shape_mesh
from ...world.colours import COLOURS, TRUTH_COLOUR, Rgb
from ...world.shapes import Box, ConvexMesh, Cylinder, Shape, Sphere
from ...world.values import Pose
from ..run import Run

TIMELINE = "sim_time"
"""Name of the timeline in simulated seconds."""


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
    fixed: Scene | None = next((at.record for at in run.log.beliefs()), None)
    if fixed is not None:
        _fixtures(sheet, fixed.fixed)
    _bodies(
        sheet,
        "belief",
        [(at.time, at.record.bodies) for at in run.log.beliefs()],
        rr.components.FillMode.Solid,
    )
    _bodies(
        sheet,
        "truth",
        [(at.time, at.record.bodies) for at in run.log.truths()],
        rr.components.FillMode.MajorWireframe,
    )
    _frames(sheet, run)
    _plans(sheet, run)
    for camera in run.log.cameras:
        _camera(sheet, run, camera)


def _robot(sheet: RerunWriter, run: Run) -> None:
    """Write the meshes once; they follow their links' frames."""
    for mesh in run.log.robot_model():
        model = f"/world/robot/{rr.escape_entity_path_part(mesh.link)}/model"
        sheet.always(model, rr.Asset3D(contents=with_y_up(mesh.glb), media_type="model/gltf-binary"))
        sheet.always(model, rr.Transform3D(quaternion=_Z_UP_FROM_Y_UP))


def _fixtures(sheet: RerunWriter, parts: Sequence[PartRecord]) -> None:
    by_owner: dict[str, list[PartRecord]] = {}
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
    scenes: Sequence[tuple[float, tuple[BodyRecord, ...]]],
    fill: rr.components.FillMode,
) -> None:
    """Write shapes when they appear or change, poses at each message, and the removal of bodies."""
    there: Mapping[str, tuple[Shape, str, tuple[BlockRecord, ...]]] = {}
    for time, bodies in scenes:
        present = {body.id: (body.shape, body.colour, body.blocks) for body in bodies}
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
    believed = _believed(run)
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


def _believed(run: Run) -> frozenset[str]:
    return frozenset(body.id for at in run.log.beliefs() for body in at.record.bodies)


def _frame_entity(t: Transform, links: set[str], believed: frozenset[str]) -> str | None:
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
    """Write colour and depth as they are in the log, on the plane of a pinhole camera."""
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
    body: BodyRecord, colour: tuple[int, int, int], fill: rr.components.FillMode
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


def _mesh_form(part: PartRecord) -> rr.AsComponents:
    mesh = part_mesh(part.shape, part.holes)
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
    labels = [label] if label else None
    match shape:
        case Box(size):
            return rr.Boxes3D(sizes=[size], colors=[colour], fill_mode=fill, labels=labels, show_labels=False)
        case Cylinder(radius, height):
            return rr.Cylinders3D(
                lengths=[height], radii=[radius], colors=[colour], fill_mode=fill, labels=labels,
                show_labels=False,
            )  # fmt: skip
        case Sphere(radius):
            return rr.Ellipsoids3D(
                radii=[radius], colors=[colour], fill_mode=fill, labels=labels, show_labels=False
            )
        case ConvexMesh():
            mesh = shape_mesh(shape)
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
