"""Foxglove messages: encoding of picktree's values and images, and decoding back into them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.KeyValuePair_pb2 import KeyValuePair
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.ModelPrimitive_pb2 import ModelPrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose as PoseMessage
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3 as VectorMessage
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from picktree.files import PicktreeError
from picktree.logs import binary_gltf, encode, log_records, triangle_meshes
from picktree.world import COLOURS, Box, ConvexMesh, Cylinder, Intrinsics, Pose, Rgb, Shape, Sphere, Vector3

_PNG_SETTINGS = (
    *(cv2.IMWRITE_PNG_COMPRESSION, 0),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP),
)
_JPEG_SETTINGS = (
    cv2.IMWRITE_JPEG_QUALITY,
    92,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
)


def encode_colour(image: NDArray[np.uint8]) -> bytes:
    """Encode RGB (h, w, 3) as JPEG."""
    return _encoded(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), _JPEG_SETTINGS)


def encode_depth(depth: NDArray[np.float32]) -> bytes:
    """Encode depth (h, w) in m as 16-bit PNG in mm; 0 where unknown."""
    millimetres = np.clip(np.nan_to_num(depth) * 1000.0 + 0.5, 0, 65535)
    return _encoded(".png", millimetres.astype(np.uint16), _PNG_SETTINGS)


def decode_colour(data: bytes) -> NDArray[np.uint8]:
    """Decode RGB (h, w, 3). Raises ValueError for data that is no image."""
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError("not an image")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB).astype(np.uint8)


def decode_depth(data: bytes) -> NDArray[np.float32]:
    """Decode depth (h, w) in m, 0 where unknown. Raises ValueError for data that is no image."""
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim != 2:
        raise ValueError("not a depth image")
    return image.astype(np.float32) / np.float32(1000.0)


def write_picture(path: str, image: NDArray[np.uint8]) -> None:
    """Write RGB (h, w, 3) into a file in the format of its suffix. Raises OSError when that fails."""
    Path(path).write_bytes(_encoded(Path(path).suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), ()))


def require_picture_name(path: Path) -> None:
    """Raise PicktreeError when the suffix of the path is not that of a picture format."""
    if not cv2.haveImageWriter(path.name):
        raise PicktreeError(f"{path}: the picture cannot be written: name it {path.stem}.png")


def _encoded(ending: str, image: NDArray[np.uint16] | cv2.typing.MatLike, settings: tuple[int, ...]) -> bytes:
    done, data = cv2.imencode(ending, image, settings)
    if not done:
        raise ValueError("the image cannot be encoded")
    return data.tobytes()


WORLD = "world"
UNKNOWN_COLOUR: Rgb = (0.6, 0.6, 0.65)
_BODY_KEY = "picktree.body"
_PART_KEY = "picktree.part"
"""Keys of an entity's metadata with the whole record, which primitives cannot hold."""
_MAX_KEPT_RECORDS = 512
"""Number of decoded bodies and parts that are kept: most of a scene is as in the scene before."""


def stamp(time: int) -> Timestamp:
    """Return simulated ns as a message's timestamp."""
    return Timestamp(seconds=time // 1_000_000_000, nanos=time % 1_000_000_000)


class TransformMessages:
    """Encoder of `/tf`. Most of the message is the same from tick to tick, so only differences are set."""

    def __init__(self) -> None:
        self._message = FrameTransforms()
        self._frames: list[str] = []
        self._poses: list[Pose] = []
        self._stamps: list[Timestamp] = []
        self._parts: list[tuple[VectorMessage, Quaternion]] = []

    def encode(self, time: int, frames_in_world: Mapping[str, Pose]) -> bytes:
        frames, poses = list(frames_in_world), list(frames_in_world.values())
        if frames != self._frames:
            self._start(frames, poses)
        seconds, nanos = divmod(time, 1_000_000_000)
        for slot in self._stamps:
            slot.seconds = seconds
            slot.nanos = nanos
        for k, (pose, before) in enumerate(zip(poses, self._poses, strict=True)):
            if pose is not before:
                self._set(k, pose)
        self._poses = poses
        return self._message.SerializeToString(deterministic=True)

    def _start(self, frames: list[str], poses: list[Pose]) -> None:
        self._frames, self._poses = frames, poses
        self._message = FrameTransforms()
        slots = [self._message.transforms.add(parent_frame_id=WORLD, child_frame_id=f) for f in frames]
        self._stamps = [slot.timestamp for slot in slots]
        self._parts = [(slot.translation, slot.rotation) for slot in slots]
        for k, pose in enumerate(poses):
            self._set(k, pose)

    def _set(self, k: int, pose: Pose) -> None:
        translation, rotation = self._parts[k]
        translation.x, translation.y, translation.z = pose.position
        rotation.x, rotation.y, rotation.z, rotation.w = pose.orientation


def read_transforms(data: bytes) -> tuple[log_records.Transform, ...]:
    message = FrameTransforms.FromString(data)
    return tuple(
        log_records.Transform(
            t.parent_frame_id,
            t.child_frame_id,
            Pose(
                (t.translation.x, t.translation.y, t.translation.z),
                (t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w),
            ),
        )
        for t in message.transforms
    )


def read_rows(data: bytes) -> list[tuple[str, tuple[float, ...]]]:
    """Decode transforms as each frame's name with position and quaternion, several times as fast."""
    return [
        (t.child_frame_id, (p.x, p.y, p.z, q.x, q.y, q.z, q.w))
        for t in FrameTransforms.FromString(data).transforms
        for p, q in ((t.translation, t.rotation),)
    ]


class JointMessages:
    """Encoder of `/joint_states`. The names stay the same from tick to tick, so only numbers are set."""

    def __init__(self) -> None:
        self._message = JointStates()
        self._names: tuple[str, ...] = ()
        self._joints: list[JointState] = []

    def encode(self, time: int, joints: log_records.Joints) -> bytes:
        message = self._message
        if joints.names != self._names:
            self._names = joints.names
            self._message = message = JointStates()
            self._joints = [message.joints.add(name=name) for name in joints.names]
        stamp = message.timestamp
        stamp.seconds, stamp.nanos = divmod(time, 1_000_000_000)
        for slot, position, velocity, effort in zip(
            self._joints, joints.position, joints.velocity, joints.effort, strict=True
        ):
            slot.position, slot.velocity, slot.effort = position, velocity, effort
        return message.SerializeToString(deterministic=True)


def read_joints(data: bytes) -> log_records.Joints:
    joints = JointStates.FromString(data).joints
    return log_records.Joints(
        tuple(j.name for j in joints),
        tuple(j.position for j in joints),
        tuple(j.velocity for j in joints),
        tuple(j.effort for j in joints),
    )


def encode_log(time: int, line: log_records.LogLine) -> bytes:
    """Encode a log line. Raises ValueError for a level that does not exist."""
    message = Log(timestamp=stamp(time), message=line.message, name=line.name)
    message.level = Log.Level.Value(line.level)
    return message.SerializeToString(deterministic=True)


def read_log(data: bytes) -> log_records.LogLine:
    message = Log.FromString(data)
    return log_records.LogLine(Log.Level.Name(message.level), message.message, message.name)


def encode_image(time: int, frame: str, form: str, data: bytes) -> bytes:
    message = CompressedImage(timestamp=stamp(time), frame_id=frame, data=data, format=form)
    return message.SerializeToString(deterministic=True)


def read_image(data: bytes) -> bytes:
    """Return the image file inside the message."""
    return CompressedImage.FromString(data).data


def encode_calibration(time: int, frame: str, i: Intrinsics) -> bytes:
    message = CameraCalibration(
        timestamp=stamp(time),
        frame_id=frame,
        width=i.width,
        height=i.height,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=[i.fx, 0.0, i.cx, 0.0, i.fy, i.cy, 0.0, 0.0, 1.0],
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[i.fx, 0.0, i.cx, 0.0, 0.0, i.fy, i.cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )
    return message.SerializeToString(deterministic=True)


def read_calibration(data: bytes) -> Intrinsics:
    message = CameraCalibration.FromString(data)
    k = message.K
    return Intrinsics(message.width, message.height, k[0], k[4], k[2], k[5])


def encode_robot(time: int, meshes: Iterable[log_records.LinkMesh]) -> bytes:
    """Encode each link's model, locked to the link's frame."""
    update = SceneUpdate()
    for mesh in meshes:
        entity = _entity(update, time, f"robot/{mesh.link}", mesh.link, locked=True)
        entity.models.append(
            ModelPrimitive(
                pose=_pose(Pose()),
                scale=VectorMessage(x=1.0, y=1.0, z=1.0),
                color=Color(r=1.0, g=1.0, b=1.0, a=1.0),
                media_type="model/gltf-binary",
                data=mesh.glb,
            )
        )
    return update.SerializeToString(deterministic=True)


def read_robot(data: bytes) -> tuple[log_records.LinkMesh, ...]:
    update = SceneUpdate.FromString(data)
    return tuple(log_records.LinkMesh(e.frame_id, e.models[0].data) for e in update.entities if e.models)


class SceneMessages:
    """Encoder of a scene's topic. Each message holds the full scene and deletes what an earlier one showed.

    When `locked`, a body's id names its frame, so that it moves with `/tf`; otherwise it has its pose in the
    world. Most of a scene is the same from message to message, so only differences are encoded again.
    """

    def __init__(self, *, locked: bool) -> None:
        self._locked = locked
        self._fixed: tuple[log_records.PartRecord, ...] = ()
        self._fixtures: list[SceneEntity] = []
        self._bodies: dict[str, tuple[log_records.BodyRecord, SceneEntity]] = {}

    def encode(self, time: int, scene: log_records.Scene) -> bytes:
        at = stamp(time)
        update = SceneUpdate()
        update.deletions.add(timestamp=at, type=SceneEntityDeletion.Type.ALL)
        if scene.fixed is not self._fixed:
            self._fixed, self._fixtures = scene.fixed, _fixtures(scene.fixed)
        known, self._bodies = self._bodies, {}
        for body in scene.bodies:
            before = known.get(body.id)
            same = before is not None and before[0] == body
            self._bodies[body.id] = before if before is not None and same else (body, self._body(body))
        update.entities.extend(self._fixtures)
        update.entities.extend(entity for _, entity in self._bodies.values())
        for entity in update.entities:
            entity.timestamp.CopyFrom(at)
        return update.SerializeToString(deterministic=True)

    def _body(self, body: log_records.BodyRecord) -> SceneEntity:
        locked = self._locked
        entity = SceneEntity(frame_id=body.id if locked else WORLD, id=body.id, frame_locked=True)
        colour = COLOURS.get(body.colour, UNKNOWN_COLOUR)
        alpha = 0.45 if body.role == "obstacle" else 1.0
        frame = Pose() if locked else body.pose
        for shape, pose in binary_gltf.parts_of(body):
            _add_shape(entity, shape, frame @ pose, colour, alpha)
        for key, value in (
            ("kind", body.kind),
            ("colour", body.colour),
            ("place", body.place),
            ("confidence", f"{body.confidence:.2f}"),
        ):
            entity.metadata.append(KeyValuePair(key=key, value=value))
        entity.metadata.append(KeyValuePair(key=_BODY_KEY, value=encode(body).decode()))
        return entity


def _fixtures(parts: Iterable[log_records.PartRecord]) -> list[SceneEntity]:
    entities: dict[str, SceneEntity] = {}
    for part in parts:
        owner = part.id.split("/")[0]
        entity = entities.setdefault(owner, SceneEntity(frame_id=WORLD, id=owner, frame_locked=True))
        colour = COLOURS.get(part.colour, UNKNOWN_COLOUR)
        if part.holes:
            _add_mesh(
                entity,
                triangle_meshes.part_mesh(part.shape, part.holes),
                _pose(part.pose),
                _paint(colour, 1.0),
            )
        else:
            _add_shape(entity, part.shape, part.pose, colour, 1.0)
        entity.metadata.append(KeyValuePair(key=_PART_KEY, value=encode(part).decode()))
    return list(entities.values())


def read_scene(data: bytes) -> log_records.Scene:
    """Decode a scene of picktree; empty for another program's scene. Raises ValueError when a field is
    missing."""
    bodies: list[log_records.BodyRecord] = []
    fixed: list[log_records.PartRecord] = []
    for entity in SceneUpdate.FromString(data).entities:
        for pair in entity.metadata:
            if pair.key == _PART_KEY:
                fixed.append(_part_of(pair.value))
            elif pair.key == _BODY_KEY:
                bodies.append(_body_of(pair.value))
    return log_records.Scene(tuple(bodies), tuple(fixed))


@lru_cache(_MAX_KEPT_RECORDS)
def _part_of(text: str) -> log_records.PartRecord:
    return log_records.decode(log_records.PartRecord, text.encode())


@lru_cache(_MAX_KEPT_RECORDS)
def _body_of(text: str) -> log_records.BodyRecord:
    return log_records.decode(
        log_records.ThingRecord if '"tag":' in text else log_records.BodyRecord, text.encode()
    )


def _entity(update: SceneUpdate, time: int, name: str, frame: str, *, locked: bool) -> SceneEntity:
    return update.entities.add(timestamp=stamp(time), frame_id=frame, id=name, frame_locked=locked)


def _add_shape(entity: SceneEntity, shape: Shape, pose: Pose, colour: Rgb, alpha: float) -> None:
    where = _pose(pose)
    paint = _paint(colour, alpha)
    match shape:
        case Box(size):
            entity.cubes.append(CubePrimitive(pose=where, size=_vector(size), color=paint))
        case Cylinder(radius, height):
            size = _vector((2 * radius, 2 * radius, height))
            entity.cylinders.append(
                CylinderPrimitive(pose=where, size=size, bottom_scale=1.0, top_scale=1.0, color=paint)
            )
        case Sphere(radius):
            size = _vector((2 * radius, 2 * radius, 2 * radius))
            entity.spheres.append(SpherePrimitive(pose=where, size=size, color=paint))
        case ConvexMesh():
            _add_mesh(entity, triangle_meshes.shape_mesh(shape), where, paint)


def _paint(colour: Rgb, alpha: float) -> Color:
    return Color(r=colour[0], g=colour[1], b=colour[2], a=alpha)


def _add_mesh(entity: SceneEntity, mesh: triangle_meshes.Mesh, where: PoseMessage, paint: Color) -> None:
    entity.triangles.append(
        TriangleListPrimitive(
            pose=where,
            points=[Point3(x=x, y=y, z=z) for x, y, z in mesh.vertices.tolist()],
            color=paint,
            indices=mesh.faces.ravel().tolist(),
        )
    )


def _pose(pose: Pose) -> PoseMessage:
    x, y, z, w = pose.orientation
    return PoseMessage(position=_vector(pose.position), orientation=Quaternion(x=x, y=y, z=z, w=w))


def _vector(vector: Vector3) -> VectorMessage:
    return VectorMessage(x=vector[0], y=vector[1], z=vector[2])


def with_stamp(data: bytes, time: int) -> bytes:
    """Return a SceneUpdate with all its timestamps set to `time`, simulated ns."""
    update = SceneUpdate.FromString(data)
    at = stamp(time)
    for dated in (*update.deletions, *update.entities):
        dated.timestamp.CopyFrom(at)
    return update.SerializeToString(deterministic=True)
