"""Topics of a log: name, encoding and schema of each; the digest over the simulated ones."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache
from typing import Literal

import orjson
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor import Descriptor, FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass

from picktree.world import Candidates, Plan, Tree

from . import log_records
from .event_records import event_schema
from .json_schema import schema


@dataclass(frozen=True, slots=True)
class Topic:
    """Topic: its name in the log and the schema of its messages.

    `simulated` topics make up the digest; the others hold wall times or decoration.
    """

    name: str
    schema: str
    encoding: Literal["json", "protobuf"]
    simulated: bool = True

    @property
    def schema_encoding(self) -> str:
        return "jsonschema" if self.encoding == "json" else "protobuf"

    def schema_data(self) -> bytes:
        # plug-ins declare kinds of event after the first run of a process
        return orjson.dumps(event_schema()) if self == EVENTS else _schema_data(self.schema)


TREE = Topic("/bt/tree", "picktree.Tree", "json")
TICK = Topic("/bt/tick", "picktree.Tick", "json")


# It repeats what the ticks say, so that a reader may begin there.
NODES = Topic("/bt/nodes", "picktree.Nodes", "json", simulated=False)
TIMING = Topic("/timing", "picktree.Timing", "json", simulated=False)
JOINTS = Topic("/joint_states", "foxglove.JointStates", "protobuf")
TF = Topic("/tf", "foxglove.FrameTransforms", "protobuf")


# The meshes carry the version of the library that wrote them.
ROBOT = Topic("/scene/robot", "foxglove.SceneUpdate", "protobuf", simulated=False)
OBJECTS = Topic("/scene/objects", "foxglove.SceneUpdate", "protobuf")
TRUTH = Topic("/truth/objects", "foxglove.SceneUpdate", "protobuf")


# Needed to resume from the simulation's state; no event of a run is recorded here alone.
STATE = Topic("/truth/state", "picktree.TrueState", "json", simulated=False)
WRENCH = Topic("/wrench", "picktree.Wrench", "json")
CONTROL = Topic("/control", "picktree.Control", "json")
PLAN = Topic("/plan", "picktree.Plan", "json")
CANDIDATES = Topic("/candidates", "picktree.Candidates", "json")
LOG = Topic("/log", "foxglove.Log", "protobuf")
EVENTS = Topic("/events", "picktree.Event", "json")
FIXED = (
    TREE, NODES, TICK, TIMING, JOINTS, TF, ROBOT, OBJECTS, TRUTH, WRENCH, CONTROL, PLAN, CANDIDATES, LOG,
    EVENTS,
)  # fmt: skip
_SIMULATED = frozenset(topic.name for topic in FIXED if topic.simulated)
_CAMERAS = "/camera/"


def is_simulated(name: str) -> bool:
    """Whether the messages of the topic of this name make up the digest."""
    return name in _SIMULATED or name.startswith(_CAMERAS)


def colour_topic(camera: str) -> Topic:
    return Topic(f"/camera/{camera}/colour", "foxglove.CompressedImage", "protobuf")


def depth_topic(camera: str) -> Topic:
    """Return the topic of depth images: 16-bit PNG in mm, 0 where unknown."""
    return Topic(f"/camera/{camera}/depth", "foxglove.CompressedImage", "protobuf")


def calibration_topic(camera: str) -> Topic:
    return Topic(f"/camera/{camera}/calibration", "foxglove.CameraCalibration", "protobuf")


_JSON: dict[str, type] = {
    "picktree.Tree": Tree,
    "picktree.Nodes": log_records.NodesMessage,
    "picktree.Tick": log_records.TickMessage,
    "picktree.Timing": log_records.Timing,
    "picktree.Wrench": log_records.WrenchReading,
    "picktree.Control": log_records.Control,
    "picktree.Plan": Plan,
    "picktree.Candidates": Candidates,
    "picktree.TrueState": log_records.TrueState,
}
_PROTOBUF: dict[str, Descriptor] = {
    message.DESCRIPTOR.full_name: message.DESCRIPTOR
    for message in (CameraCalibration, CompressedImage, FrameTransforms, JointStates, Log, SceneUpdate)
}


def message_class(schema: str) -> type[Message] | None:
    """Return the class that reads messages of a protobuf schema; None for JSON."""
    return GetMessageClass(_PROTOBUF[schema]) if schema in _PROTOBUF else None


@cache
def _schema_data(name: str) -> bytes:
    if name in _JSON:
        return orjson.dumps(schema(_JSON[name]))
    found: dict[str, FileDescriptor] = {}
    _collect(_PROTOBUF[name].file, found)
    files = FileDescriptorSet()
    for file in found.values():
        file.CopyToProto(files.file.add())
    return files.SerializeToString(deterministic=True)


def _collect(file: FileDescriptor, found: dict[str, FileDescriptor]) -> None:
    """Collect the file after everything that it imports."""
    for imported in file.dependencies:
        _collect(imported, found)
    found.setdefault(file.name, file)


class Digest:
    """SHA-256 chain over (topic, time, payload). The link is its complete state."""

    def __init__(self, link: bytes = bytes(32)) -> None:
        self._link = link

    def add(self, topic: str, time: int, payload: bytes) -> None:
        """Add a message; `time` in simulated ns."""
        content = b"".join((self._link, _name_field(topic), time.to_bytes(8, "little"), payload))
        self._link = hashlib.sha256(content).digest()

    @property
    def hex(self) -> str:
        return self._link.hex()


@cache
def _name_field(topic: str) -> bytes:
    name = topic.encode()
    return len(name).to_bytes(2, "little") + name
