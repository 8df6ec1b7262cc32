"""Protocol between picktree and the process that moves a robot, or one that recognises items in pictures.
This file needs numpy and nothing of picktree.

Transport: a stream socket, Unix or TCP. Every message is a frame: a header of 12 bytes, then its payload. All
numbers are little-endian and without padding. SI units, radians. Times are in µs of the robot's clock, u64. A
text has 64 bytes of UTF-8, filled with zeros. `f64[n]` has a value for each joint, from the base on.

    header      magic "PTRB", version u16, kind u16, length of the payload u32

picktree connects and sends HELLO; the robot answers WELCOME, or REFUSAL and closes. Then picktree sends a
message and waits for its answer:

    1 HELLO     wishes u32 (`Wish`), token text, speed f64 (share of the joints' speeds, above 0 and at most
                1: the robot stops when it is told more, until the client leaves)
    2 WELCOME   robot text, engine text, capabilities u32 (`Capability`), period u32 (of the robot's servo),
                silence u32 (time without a command after which the robot brakes), joints u8, cameras u8, 0
                u16, workspace f64[6] (smallest x, y, z, greatest x, y, z of the TCP in the world), force
                f64 (contact force at the wrist at which the robot stops), gripper f64[3] (greatest opening,
                m; greatest force of a finger, N; speed of a finger, m/s), speed f64 (the share in force);
                for each joint: name text, lower, upper, velocity, torque f64;
                for each camera: name text, segment text, width u32, height u32, fx, fy, cx, cy f64
    3 COMMAND   sequence u64, advance u32 (lockstep: time that passes with this command), mode u8 (`Mode`),
                previews u8 (0 or 4), grips u8 (1: the gripper command is new), 0 u8, gripper f64[3]
                (opening, m; greatest force of a finger, N; its greatest speed, m/s, 0: as fast as it can),
                position f64[n], velocity f64[n], torque f64[n], then for each preview: position f64[n]
    4 STATE     sequence u64, command u64 (sequence of the last command in force), time u64,
                stop u16 (`Stop`), busy u8 (1: the gripper still executes its command), 0 u8, flags u32 (0),
                gripper f64[3] (opening, m; its rate, m/s; drive force of a finger, N), wrench f64[6],
                stamps u64[3] (last new reading of joints, gripper, wrench),
                position f64[n], velocity f64[n], torque f64[n]
    5 CAPTURE   camera u8, 0 u8[7]
    6 PICTURE   camera u8, given u8 (0: the camera gave no picture), 0 u16, inline u32 (length of the
                data that follows; 0: the picture is in the shared segment), stamp u64, data
    7 STOP      reason u16. The robot brakes at once. The answer is STATE
    8 CLEAR     empty: the stop is acknowledged. The answer is STATE
    9 BYE       empty: the robot brakes and waits for another client
   10 REFUSAL   code u16 (`Refused`), then UTF-8 to the end
   14 OBSERVE   until u64: the answer is STATE once the robot's clock has come there, or at once when nobody
                moves the robot. It changes nothing

A client whose HELLO has the wish OBSERVE only reads: it sends OBSERVE, CAPTURE and BYE, and the robot refuses
anything else from it. A robot may serve it beside a client that moves the robot, at an address of its own.

A process that recognises items listens at an address of its own. A client whose HELLO has the wish
RECOGNITION gets RECOGNISER in place of WELCOME; then it sends LOOK and waits for FINDINGS:

   11 RECOGNISER  name text, model text, kinds u16, 0 u16; for each kind that it can name: text
   12 LOOK        camera text, stamp u64, width u32, height u32, fx, fy, cx, cy f64, pose f64[7] (believed
                  pose of the camera's optical frame in the world), then the picture's data
   13 FINDINGS    stamp u64 (of the picture), count u16, 0 u16; for each: kind text, colour text (empty:
                  unknown), confidence f64 (0 to 1), gives u8 (1: a mask, 2: a pose), 0 u8[3],
                  box u32[4] (first column, first row, columns, rows), pose f64[7] (item in the camera's
                  optical frame), deviation f64[2] (standard deviation of its position along each axis, m,
                  and of its turn, rad), then with a mask its bits: of the box, row by row, 8 to a byte, the
                  first pixel in the highest bit, the last byte filled with zeros

A pose is x, y, z and the unit quaternion x, y, z, w. The box of an item may be the whole picture when only a
pose is given.

The answer to COMMAND is STATE. With `Capability.LOCKSTEP` time passes only by `advance`. Later
versions may add a robot that sends STATE by itself; kinds from 32 on are reserved for real time, 64 for
recordings.

Position mode: `position` and `velocity` belong to the end of the period that the command begins. The
previews are the checked path 30, 60, 100 and 150 ms after the command. When no command comes the robot
follows them; after `silence` it brakes. Torque mode: the robot adds the torque that carries its own weight.
Mode HOLD: the robot brakes and holds.

Wrench: force and torque that the hand and its load exert on the wrist, in the axes of the flange (the child
link of the flange joint) about its origin. A load that hangs still adds a force along gravity. It is not
tared.

Picture data: colour u8[height][width][3], then depth f32[height][width], m along the optical axis, 0:
unknown. The pixel of column u and row v looks along ((u - cx)/fx, (v - cy)/fy, 1), x right and y down. In a
shared segment (POSIX shared memory) 64 bytes come before it: count u64, stamp u64, then zeros. The count is
odd while the robot writes.
"""

from __future__ import annotations

import hmac
import math
import os
import socket
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag
from ipaddress import ip_address
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

VERSION: Final = 2
"""Version of the protocol. Peers of different versions refuse each other. A new kind of message leaves it as
it is: who does not know the kind refuses it."""
MAGIC: Final = b"PTRB"
TEXT_LENGTH: Final = 64
"""Length of a text, bytes."""
MAX_JOINTS, MAX_CAMERAS = 16, 16
"""Greatest number of joints and of cameras."""
MAX_FINDINGS, MAX_KINDS = 1000, 1000
"""Greatest number of items in a picture, and of kinds that a recogniser names."""
MAX_PAYLOAD: Final = 32 << 20
"""Greatest length of a payload, bytes."""
PREVIEW_TIMES: Final = (0.03, 0.06, 0.10, 0.15)
"""Times of the previews after their command, s."""
SEGMENT_HEADER: Final = 64
"""Length of the header of a shared segment, bytes."""
TOKEN_VARIABLE: Final = "PICKTREE_ROBOT_TOKEN"
"""Environment variable with the token of a connection that is not on the loopback."""

_HEADER = struct.Struct("<4sHHI")
_HELLO = struct.Struct("<I64sd")
_WELCOME = struct.Struct("<64s64sIIIBBH6dd3dd")
_JOINT = struct.Struct("<64s4d")
_CAMERA = struct.Struct("<64s64sII4d")
_COMMAND = struct.Struct("<QIBBBB3d")
_STATE = struct.Struct("<QQQHBBI3d6d3Q")
_CAPTURE = struct.Struct("<B7x")
_OBSERVE = struct.Struct("<Q")
_PICTURE = struct.Struct("<BBHIQ")
_STOP = struct.Struct("<H")
_REFUSAL = struct.Struct("<H")
_RECOGNISER = struct.Struct("<64s64sHH")
_LOOK = struct.Struct("<64sQII4d7d")
_FINDINGS = struct.Struct("<QHH")
_FINDING = struct.Struct("<64s64sdB3x4I7d2d")
_MASK, _POSE = 1, 2

Numbers: TypeAlias = tuple[float, ...]


class ProtocolError(ValueError):
    """Message or connection that does not follow the protocol; the text is one sentence."""


class Kind(IntEnum):
    """Kinds of messages."""

    HELLO = 1
    WELCOME = 2
    COMMAND = 3
    STATE = 4
    CAPTURE = 5
    PICTURE = 6
    STOP = 7
    CLEAR = 8
    BYE = 9
    REFUSAL = 10
    RECOGNISER = 11
    LOOK = 12
    FINDINGS = 13
    OBSERVE = 14


class Wish(IntFlag):
    """Wishes of the client."""

    SHARED_MEMORY = 1
    """Pictures in shared memory: client and robot are on one machine."""
    RECOGNITION = 2
    """The client wants items recognised, not a robot moved."""
    OBSERVE = 4
    """The client only reads: it moves nothing."""


class Capability(IntFlag):
    """Capabilities of the robot."""

    POSITION = 1
    """It follows joint positions."""
    TORQUE = 2
    """It takes joint torques."""
    LOCKSTEP = 4
    """Its time passes only with commands."""
    WRENCH = 8
    """It has a force/torque sensor at the wrist."""


class Mode(IntEnum):
    """Modes of a command."""

    HOLD = 0
    POSITION = 1
    TORQUE = 2


class Stop(IntEnum):
    """Reasons for which the robot has stopped by itself. It stays stopped until CLEAR."""

    NONE = 0
    SILENCE = 1
    """No command came for longer than `Welcome.silence`."""
    SPEED = 2
    """A joint was faster than its limit."""
    POSITION = 3
    """A joint was beyond its limit."""
    WORKSPACE = 4
    """The TCP left the workspace."""
    FORCE = 5
    """The contact force at the wrist exceeded its limit."""
    JUMP = 6
    """A commanded position was too far from the one before."""
    REQUESTED = 7
    """The client asked for it."""
    OPERATOR = 8
    """A person or a safety device stopped the robot."""
    FAULT = 9
    """A device of the robot is faulty."""
    TRACKING = 10
    """The arm does not follow its set-point: something blocks it."""


class Refused(IntEnum):
    """Reasons for which a client is refused."""

    VERSION = 1
    TOKEN = 2
    BUSY = 3
    MESSAGE = 4


@dataclass(frozen=True, slots=True)
class Hello:
    """First message of the client."""

    wishes: Wish = Wish.SHARED_MEMORY
    token: str = ""
    speed: float = 1.0
    """Share of the joints' speeds that the robot allows this client."""


@dataclass(frozen=True, slots=True)
class Joint:
    """Joint of the arm and its limits as the robot enforces them, rad, rad/s, Nm."""

    name: str
    lower: float
    upper: float
    velocity: float
    torque: float


@dataclass(frozen=True, slots=True)
class CameraInfo:
    """Camera of the robot's cell."""

    name: str
    segment: str
    """Name of its shared segment; empty: its pictures are inline."""
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @property
    def picture_size(self) -> int:
        """Length of a picture's data, bytes."""
        return self.width * self.height * 7


@dataclass(frozen=True, slots=True)
class Welcome:
    """Answer to `Hello`: what the robot is and can do."""

    robot: str
    engine: str
    capabilities: Capability
    period: float
    """Period of the robot's servo, s."""
    silence: float
    """Time without a command after which the robot brakes, s."""
    workspace: Numbers
    """Smallest x, y, z and greatest x, y, z of the TCP, m."""
    force: float
    """Contact force at the wrist at which the robot stops, N."""
    gripper: Numbers
    """Greatest opening, m, greatest force, N, and speed of a finger, m/s."""
    joints: tuple[Joint, ...]
    cameras: tuple[CameraInfo, ...] = ()
    speed: float = 1.0
    """Share of the joints' speeds that is in force."""


@dataclass(frozen=True, slots=True)
class GripCommand:
    """Opening, m, greatest force of each finger, N, greatest speed of each finger, m/s; 0: as fast as it
    can."""

    width: float
    force: float
    speed: float = 0.0


@dataclass(frozen=True, slots=True)
class Command:
    """Command for one control period."""

    sequence: int
    mode: Mode
    position: Numbers
    velocity: Numbers
    torque: Numbers
    advance: float = 0.0
    """Time that passes with it in lockstep, s."""
    ahead: tuple[Numbers, ...] = ()
    """Checked path ahead, at `PREVIEW_TIMES`; empty: none."""
    grip: GripCommand | None = None
    """New command of the gripper; None: the one before stays in force."""


@dataclass(frozen=True, slots=True)
class State:
    """State of the robot."""

    sequence: int
    command: int
    time: float
    """Time of the robot's clock, s."""
    position: Numbers
    velocity: Numbers
    torque: Numbers
    gripper: Numbers
    """Opening, m, its rate, m/s, and drive force of each finger, N."""
    wrench: Numbers
    """Force, N, and torque, Nm, in the axes of the flange."""
    stamps: Numbers
    """Times of the last new reading of joints, gripper and wrench, s."""
    busy: bool = False
    """Whether the gripper still executes its command."""
    stop: Stop = Stop.NONE


@dataclass(frozen=True, slots=True)
class Capture:
    """Request for a picture of a camera, by its number in `Welcome.cameras`."""

    camera: int


@dataclass(frozen=True, slots=True)
class Observe:
    """Request for the state at a time of the robot's clock, s; it changes nothing."""

    until: float


@dataclass(frozen=True, slots=True)
class Picture:
    """Answer to `Capture`."""

    camera: int
    given: bool
    stamp: float
    data: bytes = b""
    """Colour and depth; empty: they are in the shared segment."""


@dataclass(frozen=True, slots=True)
class StopRequest:
    """Request to brake at once."""

    reason: Stop = Stop.REQUESTED


@dataclass(frozen=True, slots=True)
class Clear:
    """Acknowledgement of a stop."""


@dataclass(frozen=True, slots=True)
class Bye:
    """End of the connection."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Reason for which the peer ends the connection."""

    code: Refused
    text: str


@dataclass(frozen=True, slots=True)
class RecogniserInfo:
    """Answer to a `Hello` with the wish for recognition."""

    name: str
    model: str
    kinds: tuple[str, ...]
    """Kinds of items that it can name."""


@dataclass(frozen=True, slots=True)
class Look:
    """Picture in which items are to be recognised."""

    camera: CameraInfo
    """Camera without a segment: the picture is inline."""
    stamp: float
    pose: Numbers
    """Believed pose of the camera's optical frame in the world: x, y, z, m, and x, y, z, w."""
    data: bytes
    """Colour and depth, see `split_picture`."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Item in a picture."""

    kind: str
    box: tuple[int, int, int, int]
    """First column, first row, columns and rows of the pixels around it."""
    colour: str = ""
    """Name of its colour; empty: unknown."""
    confidence: float = 1.0
    """Confidence, 0 … 1."""
    mask: bytes = b""
    """Pixels of the box that show it, see `pack_mask`; empty: unknown."""
    pose: Numbers = ()
    """Its pose in the camera's optical frame: x, y, z, m, and x, y, z, w; empty: unknown."""
    deviation: tuple[float, float] = (0.0, 0.0)
    """Standard deviation of the pose: of the position along each axis, m, and of the turn, rad."""


@dataclass(frozen=True, slots=True)
class Findings:
    """Answer to `Look`."""

    stamp: float
    """Time of the picture, s."""
    items: tuple[Finding, ...] = ()


Message: TypeAlias = (
    Hello
    | Welcome
    | Command
    | State
    | Capture
    | Observe
    | Picture
    | StopRequest
    | Clear
    | Bye
    | Refusal
    | RecogniserInfo
    | Look
    | Findings
)


def encode(message: Message) -> bytes:
    """Return a message as a frame. Raises ProtocolError for values that a frame cannot hold."""
    try:
        kind, payload = _encoded(message)
    except struct.error as error:
        raise ProtocolError(f"a {type(message).__name__} does not fit its frame: {error}") from None
    return _HEADER.pack(MAGIC, VERSION, kind, len(payload)) + payload


def _encoded(message: Message) -> tuple[Kind, bytes]:
    match message:
        case Hello(wishes, token, speed):
            return Kind.HELLO, _HELLO.pack(wishes, _to_text(token), speed)
        case Welcome():
            return Kind.WELCOME, _encoded_welcome(message)
        case Command():
            return Kind.COMMAND, _encoded_command(message)
        case State():
            return Kind.STATE, _encoded_state(message)
        case Capture(camera):
            return Kind.CAPTURE, _CAPTURE.pack(camera)
        case Observe(until):
            return Kind.OBSERVE, _OBSERVE.pack(_to_micro(until))
        case Picture(camera, given, stamp, data):
            return Kind.PICTURE, _PICTURE.pack(camera, given, 0, len(data), _to_micro(stamp)) + data
        case StopRequest(reason):
            return Kind.STOP, _STOP.pack(reason)
        case Clear():
            return Kind.CLEAR, b""
        case Bye():
            return Kind.BYE, b""
        case Refusal(code, text):
            return Kind.REFUSAL, _REFUSAL.pack(code) + text.encode()
        case RecogniserInfo(name, model, kinds):
            head = _RECOGNISER.pack(_to_text(name), _to_text(model), len(kinds), 0)
            texts = (_to_text(each).ljust(TEXT_LENGTH, b"\0") for each in kinds)
            return Kind.RECOGNISER, head + b"".join(texts)
        case Look(camera, stamp, pose, data):
            lens = camera.fx, camera.fy, camera.cx, camera.cy
            size = camera.width, camera.height
            return Kind.LOOK, _LOOK.pack(_to_text(camera.name), _to_micro(stamp), *size, *lens, *pose) + data
        case Findings():
            return Kind.FINDINGS, _encoded_findings(message)


def _encoded_welcome(m: Welcome) -> bytes:
    parts = [
        _WELCOME.pack(
            _to_text(m.robot),
            _to_text(m.engine),
            m.capabilities,
            _to_micro(m.period),
            _to_micro(m.silence),
            len(m.joints),
            len(m.cameras),
            0,
            *m.workspace,
            m.force,
            *m.gripper,
            m.speed,
        )
    ]
    parts += [_JOINT.pack(_to_text(j.name), j.lower, j.upper, j.velocity, j.torque) for j in m.joints]
    for c in m.cameras:
        texts = _to_text(c.name), _to_text(c.segment)
        parts.append(_CAMERA.pack(*texts, c.width, c.height, c.fx, c.fy, c.cx, c.cy))
    return b"".join(parts)


def _encoded_command(m: Command) -> bytes:
    grip = m.grip or GripCommand(0.0, 0.0)
    n = len(m.position)
    if {len(m.velocity), len(m.torque), *map(len, m.ahead)} != {n}:
        raise ProtocolError(f"a command for {n} joints has lists of other lengths")
    head = _COMMAND.pack(
        m.sequence,
        _to_micro(m.advance),
        m.mode,
        len(m.ahead),
        m.grip is not None,
        0,
        grip.width,
        grip.force,
        grip.speed,
    )
    numbers = [*m.position, *m.velocity, *m.torque]
    for each in m.ahead:
        numbers += each
    return head + struct.pack(f"<{len(numbers)}d", *numbers)


def _encoded_state(m: State) -> bytes:
    head = _STATE.pack(
        m.sequence,
        m.command,
        _to_micro(m.time),
        m.stop,
        m.busy,
        0,
        0,
        *m.gripper,
        *m.wrench,
        *map(_to_micro, m.stamps),
    )
    numbers = [*m.position, *m.velocity, *m.torque]
    return head + struct.pack(f"<{len(numbers)}d", *numbers)


def _encoded_findings(m: Findings) -> bytes:
    parts = [_FINDINGS.pack(_to_micro(m.stamp), len(m.items), 0)]
    for each in m.items:
        gives = (_MASK if each.mask else 0) | (_POSE if each.pose else 0)
        pose = each.pose or (0.0,) * 7
        texts = _to_text(each.kind), _to_text(each.colour)
        if each.mask and len(each.mask) != _mask_size(each.box):
            raise ProtocolError(f"the mask of a {each.kind} has {len(each.mask)} bytes")
        parts.append(_FINDING.pack(*texts, each.confidence, gives, *each.box, *pose, *each.deviation))
        parts.append(each.mask)
    return b"".join(parts)


def decode_header(data: bytes) -> tuple[int, int]:
    """Return kind and payload length of a header.

    Raises ProtocolError for other data, another version and an excessive length.
    """
    if len(data) != _HEADER.size:
        raise ProtocolError(f"a header has {_HEADER.size} bytes, not {len(data)}")
    magic, version, kind, length = _HEADER.unpack(data)
    if magic != MAGIC:
        raise ProtocolError(f"the peer does not speak this protocol: its frame begins with {magic!r}")
    if version != VERSION:
        raise ProtocolError(f"the peer speaks version {version} of the protocol, this side version {VERSION}")
    if length > MAX_PAYLOAD:
        raise ProtocolError(f"a payload of {length} bytes is longer than {MAX_PAYLOAD}")
    return kind, length


def decode(kind: int, payload: bytes) -> Message:
    """Return the message of a frame. Raises ProtocolError, with the reason, for another payload."""
    try:
        return _decoded(Kind(kind), payload)
    except ProtocolError:
        raise
    except (struct.error, ValueError) as error:  # UnicodeDecodeError and unknown members are ValueErrors
        name = Kind(kind).name if kind in Kind.__members__.values() else f"kind {kind}"
        raise ProtocolError(f"a message {name} of {len(payload)} bytes is malformed: {error}") from None


def _decoded(kind: Kind, data: bytes) -> Message:
    match kind:
        case Kind.HELLO:
            wishes, token, speed = _HELLO.unpack(data)
            if not 0.0 < speed <= 1.0:
                raise ProtocolError(f"a HELLO has the speed {speed:g}; it is above 0 and at most 1")
            return Hello(Wish(wishes), _from_text(token), speed)
        case Kind.WELCOME:
            return _decoded_welcome(data)
        case Kind.COMMAND:
            return _decoded_command(data)
        case Kind.STATE:
            return _decoded_state(data)
        case Kind.CAPTURE:
            return Capture(*_CAPTURE.unpack(data))
        case Kind.OBSERVE:
            return Observe(_OBSERVE.unpack(data)[0] / 1e6)
        case Kind.PICTURE:
            camera, given, _, length, stamp = _PICTURE.unpack(data[: _PICTURE.size])
            if len(data) != _PICTURE.size + length:
                raise ProtocolError(f"a picture of {length} bytes comes with {len(data) - _PICTURE.size}")
            return Picture(camera, bool(given), stamp / 1e6, data[_PICTURE.size :])
        case Kind.STOP:
            return StopRequest(Stop(*_STOP.unpack(data)))
        case Kind.CLEAR | Kind.BYE:
            if data:
                raise ProtocolError(f"a message {kind.name} has no payload, but {len(data)} bytes came")
            return Clear() if kind is Kind.CLEAR else Bye()
        case Kind.REFUSAL:
            (code,) = _REFUSAL.unpack(data[: _REFUSAL.size])
            return Refusal(Refused(code), data[_REFUSAL.size :].decode())
        case Kind.RECOGNISER:
            return _decoded_recogniser(data)
        case Kind.LOOK:
            return _decoded_look(data)
        case Kind.FINDINGS:
            return _decoded_findings(data)


def _decoded_welcome(data: bytes) -> Welcome:
    head = _WELCOME.unpack(data[: _WELCOME.size])
    robot, engine, capabilities, period, silence, joints, cameras, _, *numbers = head
    if not 1 <= joints <= MAX_JOINTS or cameras > MAX_CAMERAS:
        raise ProtocolError(f"a robot has 1 to {MAX_JOINTS} joints and at most {MAX_CAMERAS} cameras")
    at = _WELCOME.size
    expected = at + joints * _JOINT.size + cameras * _CAMERA.size
    if len(data) != expected:
        raise ProtocolError(f"a WELCOME with {joints} joints and {cameras} cameras has {expected} bytes")
    found_joints: list[Joint] = []
    found_cameras: list[CameraInfo] = []
    for _ in range(joints):
        name, *limits = _JOINT.unpack_from(data, at)
        found_joints.append(Joint(_from_text(name), *_finite(limits)))
        at += _JOINT.size
    for _ in range(cameras):
        name, segment, width, height, *lens = _CAMERA.unpack_from(data, at)
        camera = CameraInfo(_from_text(name), _from_text(segment), width, height, *_finite(lens))
        if not 0 < camera.picture_size <= MAX_PAYLOAD - _PICTURE.size:
            raise ProtocolError(f"the camera {camera.name!r} has pictures of {width} × {height} pixels")
        found_cameras.append(camera)
        at += _CAMERA.size
    numbers = _finite(numbers)
    return Welcome(
        _from_text(robot),
        _from_text(engine),
        Capability(capabilities),
        period / 1e6,
        silence / 1e6,
        numbers[:6],
        numbers[6],
        numbers[7:10],
        tuple(found_joints),
        tuple(found_cameras),
        numbers[10],
    )


def _decoded_command(data: bytes) -> Command:
    sequence, advance, mode, previews, grips, _, *grip = _COMMAND.unpack(data[: _COMMAND.size])
    if previews not in (0, len(PREVIEW_TIMES)):
        raise ProtocolError(f"a command has 0 or {len(PREVIEW_TIMES)} previews, not {previews}")
    lists = _lists(data[_COMMAND.size :], 3 + previews)
    return Command(
        sequence,
        Mode(mode),
        lists[0],
        lists[1],
        lists[2],
        advance / 1e6,
        tuple(lists[3:]),
        GripCommand(*_finite(grip)) if grips else None,
    )


def _decoded_state(data: bytes) -> State:
    sequence, command, time, stop, busy, _, _, *rest = _STATE.unpack(data[: _STATE.size])
    position, velocity, torque = _lists(data[_STATE.size :], 3)
    numbers = _finite(rest[:9])
    return State(
        sequence,
        command,
        time / 1e6,
        position,
        velocity,
        torque,
        numbers[:3],
        numbers[3:9],
        tuple(stamp / 1e6 for stamp in rest[9:]),
        bool(busy),
        Stop(stop),
    )


def _decoded_recogniser(data: bytes) -> RecogniserInfo:
    name, model, count, _ = _RECOGNISER.unpack(data[: _RECOGNISER.size])
    rest = data[_RECOGNISER.size :]
    if count > MAX_KINDS or len(rest) != count * TEXT_LENGTH:
        raise ProtocolError(f"a recogniser of {count} kinds comes with {len(rest)} bytes")
    kinds = (_from_text(rest[at : at + TEXT_LENGTH]) for at in range(0, len(rest), TEXT_LENGTH))
    return RecogniserInfo(_from_text(name), _from_text(model), tuple(kinds))


def _decoded_look(data: bytes) -> Look:
    name, stamp, width, height, *numbers = _LOOK.unpack(data[: _LOOK.size])
    lens = _finite(numbers)
    camera = CameraInfo(_from_text(name), "", width, height, *lens[:4])
    picture = data[_LOOK.size :]
    if len(picture) != camera.picture_size or not picture:
        raise ProtocolError(f"a picture of {width} × {height} pixels comes with {len(picture)} bytes")
    return Look(camera, stamp / 1e6, _pose(lens[4:]), picture)


def _decoded_findings(data: bytes) -> Findings:
    stamp, count, _ = _FINDINGS.unpack(data[: _FINDINGS.size])
    if count > MAX_FINDINGS:
        raise ProtocolError(f"a picture has at most {MAX_FINDINGS} findings, not {count}")
    at, items = _FINDINGS.size, list[Finding]()
    for _ in range(count):
        kind, colour, confidence, gives, *numbers = _FINDING.unpack_from(data, at)
        at += _FINDING.size
        name = _from_text(kind)
        box = tuple(numbers[:4])
        values = _finite([confidence, *numbers[4:]])
        if not 0.0 <= values[0] <= 1.0:
            raise ProtocolError(f"a {name} has the confidence {values[0]:g}; it is 0 to 1")
        if min(values[8:]) < 0.0:
            raise ProtocolError(f"a {name} has a negative deviation")
        size = _mask_size(box) if gives & _MASK else 0
        mask = data[at : at + size]
        if len(mask) != size:
            raise ProtocolError(f"the mask of a {name} has {len(mask)} bytes, not {size}")
        at += size
        pose = _pose(values[1:8]) if gives & _POSE else ()
        items.append(Finding(name, box, _from_text(colour), values[0], mask, pose, (values[8], values[9])))
    if at != len(data):
        raise ProtocolError(f"{count} findings are followed by {len(data) - at} bytes")
    return Findings(stamp / 1e6, tuple(items))


def _mask_size(box: Sequence[int]) -> int:
    return -(-box[2] * box[3] // 8)


def _pose(numbers: Numbers) -> Numbers:
    if abs(math.hypot(*numbers[3:]) - 1.0) > 1e-3:
        raise ProtocolError("a pose has no unit quaternion")
    return numbers


def _lists(data: bytes, count: int) -> list[Numbers]:
    """Return `count` lists of equal length. Raises ProtocolError unless the data holds 1 … MAX_JOINTS
    joints."""
    n, rest = divmod(len(data), 8 * count)
    if rest or not 1 <= n <= MAX_JOINTS:
        raise ProtocolError(f"{len(data)} bytes are no {count} lists of 1 to {MAX_JOINTS} numbers")
    numbers = _finite(struct.unpack(f"<{n * count}d", data))
    return [numbers[k * n : (k + 1) * n] for k in range(count)]


def _finite(numbers: Sequence[float]) -> Numbers:
    if not all(map(math.isfinite, numbers)):
        raise ProtocolError("a number is not finite")
    return tuple(numbers)


def _to_micro(seconds: float) -> int:
    return round(seconds * 1e6)


def _to_text(text: str) -> bytes:
    data = text.encode()
    if len(data) > TEXT_LENGTH or "\0" in text:
        raise ProtocolError(f"the text {text[:80]!r} has more than {TEXT_LENGTH} bytes, or a zero")
    return data


def _from_text(data: bytes) -> str:
    return data.rstrip(b"\0").decode()


@dataclass(frozen=True, slots=True)
class Address:
    """Address of a robot: a Unix socket, or host and port."""

    path: str = ""
    host: str = ""
    port: int = 0

    def __str__(self) -> str:
        return self.path or f"{self.host}:{self.port}"

    @classmethod
    def parse(cls, text: str) -> Address:
        """Parse `/run/robot.sock`, `unix:robot.sock` or `127.0.0.1:5577`. Raises ProtocolError for other
        text."""
        if text.startswith("unix:") or "/" in text:
            path = text.removeprefix("unix:")
            if not path or len(os.fsencode(path)) > 100:
                raise ProtocolError(f"{text!r}: the path of a Unix socket has 1 to 100 bytes")
            return cls(path=path)
        host, colon, port = text.rpartition(":")
        host = host.removeprefix("[").removesuffix("]")
        if not colon or not host or not port.isascii() or not port.isdigit() or int(port) > 65535:
            raise ProtocolError(
                f"{text!r} is no address: write a path, as /tmp/robot.sock, or 127.0.0.1:5577"
            )
        return cls(host=host, port=int(port))

    @property
    def loopback(self) -> bool:
        """Whether only this machine reaches the address."""
        if self.path or self.host == "localhost":
            return True
        try:
            return ip_address(self.host).is_loopback
        except ValueError:
            return False

    def require_token(self, token: str) -> None:
        """Raise ProtocolError for an address beyond the loopback without a token."""
        if not self.loopback and not token:
            raise ProtocolError(
                f"{self} is not on this machine's loopback; both sides need the same token in "
                f"{TOKEN_VARIABLE}"
            )

    def connect(self, timeout: float) -> socket.socket:
        """Connect to a listening robot. Raises OSError."""
        if not self.path:
            connection = socket.create_connection((self.host, self.port), timeout)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return connection
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.settimeout(timeout)
        try:
            connection.connect(self.path)
        except OSError:
            connection.close()
            raise
        return connection

    def listen(self) -> socket.socket:
        """Listen for a client. A Unix socket is for its owner alone. Raises OSError."""
        if not self.path:
            family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
            return socket.create_server((self.host, self.port), family=family, backlog=1)
        server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            _remove_stale(self.path)
            before = os.umask(0o077)
            try:
                server.bind(self.path)
            finally:
                os.umask(before)
            server.listen(1)
        except OSError:
            server.close()
            raise
        return server


def _remove_stale(path: str) -> None:
    """Remove a socket on which nobody listens. Raises OSError for one in use, or another file."""
    if not os.path.exists(path):
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as trial:
        try:
            trial.connect(path)
        except ConnectionRefusedError:
            os.unlink(path)
            return
    raise OSError(f"another process listens at {path}")


def same_token(one: str, other: str) -> bool:
    """Return whether two tokens are equal; the time it takes tells nothing about them."""
    return hmac.compare_digest(one.encode(), other.encode())


@dataclass(eq=False)
class Channel:
    """Connection over which messages go in both directions."""

    connection: socket.socket
    _buffer: bytearray = field(default_factory=bytearray)

    def send(self, message: Message) -> None:
        """Send a message. Raises ProtocolError when the connection is gone or the peer takes nothing."""
        try:
            self.connection.sendall(encode(message))
        except TimeoutError:
            raise ProtocolError("the peer takes no data") from None
        except OSError as error:
            raise ProtocolError(f"the connection is gone: {error.strerror or error}") from None

    def receive(self) -> Message:
        """Wait for the next message. Raises ProtocolError for silence, an end and malformed data."""
        kind, length = decode_header(self._take(_HEADER.size))
        return decode(kind, self._take(length))

    def close(self) -> None:
        self.connection.close()

    def _take(self, count: int) -> bytes:
        buffer = self._buffer
        while len(buffer) < count:
            try:
                data = self.connection.recv(max(4096, count - len(buffer)))
            except TimeoutError:
                raise ProtocolError("the peer does not answer") from None
            except OSError as error:
                raise ProtocolError(f"the connection is gone: {error.strerror or error}") from None
            if not data:
                raise ProtocolError("the peer has closed the connection")
            buffer += data
        taken = bytes(buffer[:count])
        del buffer[:count]
        return taken


def split_picture(
    data: bytes | memoryview, width: int, height: int
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return copies of colour (h, w, 3) and depth (h, w) of a picture's data."""
    colours = width * height * 3
    colour = np.frombuffer(data, np.uint8, colours).reshape(height, width, 3).copy()
    raw = np.frombuffer(data, np.uint8, width * height * 4, colours)
    return colour, raw.copy().view("<f4").reshape(height, width).astype(np.float32)


def join_picture(colour: NDArray[np.uint8], depth: NDArray[np.float32]) -> bytes:
    """Return colour (h, w, 3) and depth (h, w) as a picture's data."""
    return np.ascontiguousarray(colour).tobytes() + np.ascontiguousarray(depth, "<f4").tobytes()


def pack_mask(mask: NDArray[np.bool_]) -> bytes:
    """Return the pixels (rows, columns) of a box that show an item, as `Finding.mask`."""
    return np.packbits(mask.ravel()).tobytes()


def unpack_mask(finding: Finding) -> NDArray[np.bool_]:
    """Return the pixels (rows, columns) of a finding's box that show it; all of them without a mask."""
    _, _, columns, rows = finding.box
    if not finding.mask:
        return np.ones((rows, columns), bool)
    bits = np.unpackbits(np.frombuffer(finding.mask, np.uint8), count=rows * columns)
    return bits.reshape(rows, columns).astype(bool)
