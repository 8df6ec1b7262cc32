"""Entries of fault files: their schema with the keys that each kind takes, and the values made of
entries that passed the checks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import AfterValidator, Field, Strict, WithJsonSchema

from picktree.files import describe, suggest_name
from picktree.files.yaml import file_models
from picktree.world import ITEM_COLOURS, Pose, Vector3
from picktree.world.scene import Fixture, Form, UnknownFile, hidden_body


def _colour(name: str) -> str:
    if name not in ITEM_COLOURS:
        message = f"{describe(name)} is no colour that an item may have"
        raise file_models.InvalidValue(message, suggest_name(name, ITEM_COLOURS), code="P108")
    return name


def _pattern(text: str) -> str:
    if not text.strip("/"):
        raise file_models.InvalidValue(
            "the node is empty", "its name, or a path as SortOne/Grasp", code="P606"
        )
    return text


ItemColour = Annotated[str, AfterValidator(_colour), WithJsonSchema({"enum": list(ITEM_COLOURS)})]
NodePattern = Annotated[str, AfterValidator(_pattern), WithJsonSchema({"type": "string", "pattern": "[^/]"})]
Lasting = Annotated[float, file_models.quantity("s", above=0)]
Count = Annotated[int, Strict(), Field(ge=1)]
Probability = Annotated[float, file_models.quantity("", above=0, most=1)]
Factor = Annotated[float, file_models.quantity("", above=0, most=100)]
Push = Annotated[float, file_models.quantity("N", least=-1000, most=1000)]
Twist = Annotated[float, file_models.quantity("Nm", least=-100, most=100)]
Speed = Annotated[float, file_models.quantity("m/s", least=-10, most=10)]
Spin = Annotated[float, file_models.quantity("rad/s", least=-100, most=100)]


class WhenFile(file_models.FileModel):
    """When it happens: at a time, or when a node starts; once unless `each` or `every` says otherwise."""

    one_of: ClassVar[tuple[str, ...]] = ("at", "node")
    """Exactly one of these is given."""

    at: file_models.Duration | None = None
    """Simulated time since the run began."""
    every: Lasting | None = None
    """Interval at which it repeats. Only with `at`."""
    node: NodePattern | None = None
    """The node that starts: its name, or a path as SortOne/Grasp; '*' and '?' stand for other letters."""
    start: Count | None = None
    """At which of the node's starts, from 1; the first unless given. Only with `node`."""
    delay: file_models.Duration | None = None
    """How long after the node's start; at once unless given. Only with `node`."""
    each: file_models.Flag | None = None
    """true: at each of the node's starts, from that one on. Only with `node`."""


class TargetFile(file_models.FileModel):
    """Which item is meant: of those that fit all that is given the nearest, or the first that was spawned."""

    index: Annotated[int, Strict(), Field(ge=0)] | None = None
    """Its number in the order of spawning, from 0."""
    kind: str | None = None
    """Its kind, by the scene's catalogue."""
    form: Form | None = None
    """Its form."""
    colour: ItemColour | None = None
    """Its colour."""
    nearest_to: Literal["tool", "object"] | None = None
    """The nearest to the TCP, or to where the belief has what the node's port `object` names."""


FaultName: TypeAlias = Literal[
    "remove", "friction", "bump", "obstacle", "slip", "appear", "heavier", "larger", "gripper_jam",
    "gripper_weak", "camera_drop", "camera_shift", "camera_noise", "camera_mislabel", "wrench_bias",
    "wrench_dead", "joint_weak", "stall", "no_plan", "hang", "raise", "kill",
]  # fmt: skip


class FaultEntryFile(file_models.FileModel):
    """One thing that goes wrong: what, when, and to which item, device or place."""

    fault: FaultName
    """Kind of the fault; docs/faults.md says what each kind does."""
    when: WhenFile
    """When it happens."""
    probability: Probability | None = None
    """Probability that it happens, at each of its occasions; 1 unless given. Drawn from the run's seed, from
    a stream of its own."""
    lasts: Lasting | None = None
    """How long it is so; for good unless given."""
    target: TargetFile | None = None
    """The item that it happens to. Only of faults that happen to one item."""
    friction: Annotated[float, file_models.quantity("", least=0, most=2)] | None = None
    """Its new coefficient of friction: of the fault friction, which needs it, and of slip, 0 unless given."""
    mass: file_models.Mass | None = None
    """Its new mass: of the fault heavier, which needs it, and of friction, unchanged unless given."""
    velocity: tuple[Speed, Speed, Speed] | None = None
    """Velocity that it gets at once, along x, y, z of the world. Only of the fault bump, which needs it."""
    spin: tuple[Spin, Spin, Spin] | None = None
    """Angular velocity that it gets at once, about x, y, z of the world; none unless given. Only of the fault
    bump."""
    factor: Factor | None = None
    """Factor: of the fault larger on its size, of camera_noise on the noise. Both need it."""
    kind: str | None = None
    """Its kind, by the scene's catalogue. Only of the fault appear, which needs it."""
    colour: ItemColour | None = None
    """Colour of the item that appears, or the colour that camera_mislabel shows as another. Both need it."""
    place: tuple[file_models.Length, file_models.Length] | None = None
    """Position of its centre, x and y in the world. It waits until nothing is there. Only of the fault
    appear, which needs it."""
    yaw: file_models.Angle | None = None
    """Rotation about the world's z; 0 unless given. Only of the fault appear."""
    share: file_models.Share | None = None
    """Share that is left: of the force with gripper_weak, of the torque with joint_weak. Both need it."""
    joint: str | None = None
    """The joint of the arm, by its name. Only of the fault joint_weak, which needs it."""
    force: tuple[Push, Push, Push] | None = None
    """Bias of the sensor's force, along its own axes. Only of the fault wrench_bias, which needs it."""
    torque: tuple[Twist, Twist, Twist] | None = None
    """Bias of the sensor's torque, about its own axes; 0 unless given. Only of the fault wrench_bias."""
    camera: str | None = None
    """The camera; all of them unless given. Only of faults of cameras."""
    images: Count | None = None
    """Number of images that do not come, unless `lasts` is over before. Only of the fault camera_drop."""
    shift: file_models.Vector | None = None
    """Translation: right, down, forward in its former view. Only of the fault camera_shift, which needs
    it."""
    turn: file_models.Angles | None = None
    """Rotation about the same axes, one after the other; 0 unless given. Only of camera_shift."""
    shown_as: ItemColour | None = None
    """Colour that is shown instead of `colour`. Only of the fault camera_mislabel, which needs it."""
    swapped: file_models.Flag | None = None
    """true: `colour` is shown instead of `shown_as`, too. Only of the fault camera_mislabel."""
    requests: Count | None = None
    """Number of planning requests that fail, unless `lasts` is over before. Only of the fault no_plan."""

    body: UnknownFile | None = None
    """The body and its pose; it never moves. It waits until no item and no part of the robot is in its place.
    Only of the fault obstacle, which needs it."""
    name: file_models.Name | None = None
    """Its name in the record; `obstacle` unless given. Only of the fault obstacle."""
    stays: file_models.Duration | None = None
    """How long it stays before it is taken away; for good unless given. Only of the fault obstacle."""


REQUIRED_KEYS: Mapping[str, tuple[str, ...]] = {
    "remove": ("target",),
    "friction": ("target", "friction"),
    "bump": ("target", "velocity"),
    "obstacle": ("body",),
    "slip": (),
    "appear": ("kind", "colour", "place"),
    "heavier": ("target", "mass"),
    "larger": ("target", "factor"),
    "gripper_jam": (),
    "gripper_weak": ("share",),
    "camera_drop": (),
    "camera_shift": ("shift",),
    "camera_noise": ("factor",),
    "camera_mislabel": ("colour", "shown_as"),
    "wrench_bias": ("force",),
    "wrench_dead": (),
    "joint_weak": ("joint", "share"),
    "stall": (),
    "no_plan": (),
    "hang": (),
    "raise": (),
    "kill": (),
}
"""Required keys of each kind of fault, besides `fault` and `when`."""
_OPTIONAL_KEYS: Mapping[str, tuple[str, ...]] = {
    "friction": ("mass",),
    "bump": ("spin",),
    "obstacle": ("name", "stays"),
    "slip": ("friction", "lasts"),
    "appear": ("yaw",),
    "gripper_jam": ("lasts",),
    "gripper_weak": ("lasts",),
    "camera_drop": ("camera", "lasts", "images"),
    "camera_shift": ("turn", "camera", "lasts"),
    "camera_noise": ("camera", "lasts"),
    "camera_mislabel": ("swapped", "camera", "lasts"),
    "wrench_bias": ("torque", "lasts"),
    "wrench_dead": ("lasts",),
    "joint_weak": ("lasts",),
    "stall": ("lasts",),
    "no_plan": ("lasts", "requests"),
}
ALLOWED_KEYS: Mapping[str, tuple[str, ...]] = {
    name: (*needed, *_OPTIONAL_KEYS.get(name, ())) for name, needed in REQUIRED_KEYS.items()
}
"""Allowed keys of each kind of fault, the required ones included."""
OWN_KEYS = tuple(dict.fromkeys(key for keys in ALLOWED_KEYS.values() for key in keys))
"""Keys that some faults take and others do not."""


class ExpectFile(file_models.FileModel):
    """Expected outcome, for the evaluation of a campaign. Neither the robot nor the simulation reads it."""

    causes: list[str]
    """Causes that name the failure correctly, or families of them as grasp.*; none where it should do no
    harm."""
    roots: list[str] = Field(default_factory=list[str])
    """Root causes by which an explanation names it correctly, or families of them as item.*."""
    lost: Annotated[int, Strict(), Field(ge=0)] = 0
    """How many items can physically not be sorted any more."""


class FaultsRestFile(file_models.FileModel):
    """Keys of a fault file besides its list."""

    scene: Annotated[str, file_models.NamedFile("scene")] | None = None
    """A scene, shipped or a file next to this one. Kinds, colours and numbers of items, cameras and joints
    are checked against it."""
    expect: ExpectFile | None = None
    """Expected outcome of a run with these faults, for its evaluation."""


class FaultsFile(FaultsRestFile):
    """Faults of a run. Only the simulation knows them; the robot has to find out."""

    faults: list[FaultEntryFile]
    """The faults; those that are due in the same tick happen in this order."""


@dataclass(frozen=True, slots=True)
class AtTime:
    """Occasions at the simulated time `time`, s; with `every`, repeated at that interval, s."""

    time: float
    every: float | None = None
    probability: float = 1.0
    """Probability that the fault happens at one of its occasions, drawn from a stream of its own."""


@dataclass(frozen=True, slots=True)
class AtNode:
    """Occasion `delay` s after the node that fits `pattern` has started for the `start`-th time (from 1).
    With `each` at every start from that one on."""

    pattern: str
    start: int = 1
    delay: float = 0.0
    each: bool = False
    probability: float = 1.0
    """Probability that the fault happens at one of its occasions, drawn from a stream of its own."""


When: TypeAlias = AtTime | AtNode


@dataclass(frozen=True, slots=True)
class _Fault:
    """Fault with its occasions. `name` is the word of fault files and records; a renamed class keeps it."""

    name: ClassVar[str]
    when: When


@dataclass(frozen=True, slots=True)
class Hang(_Fault):
    """The running skill yields for ever: it never ends until it is halted."""

    name = "hang"


@dataclass(frozen=True, slots=True)
class Raise(_Fault):
    """The code of the running skill raises an exception."""

    name = "raise"


@dataclass(frozen=True, slots=True)
class Kill(_Fault):
    """The process is killed (SIGKILL)."""

    name = "kill"


ProgramFault: TypeAlias = Hang | Raise | Kill


@dataclass(frozen=True, slots=True)
class GripperJam(_Fault):
    """The fingers stay in place, ignore commands, and keep pressing on the item that they hold."""

    name = "gripper_jam"
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class GripperWeak(_Fault):
    """The fingers press with a share of the commanded force."""

    name = "gripper_weak"
    share: float
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class JointWeak(_Fault):
    """The joint's torque is at most a share of what it could give."""

    name = "joint_weak"
    joint: str
    share: float
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class Stall(_Fault):
    """The arm ignores commands: its drives hold it in place."""

    name = "stall"
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class WrenchBias(_Fault):
    """The wrist's sensor has a bias: force, N, and torque, Nm, in its own axes."""

    name = "wrench_bias"
    force: Vector3
    torque: Vector3 = (0.0, 0.0, 0.0)
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class WrenchDead(_Fault):
    """The wrist's sensor is silent: its reading and its time stamp do not change."""

    name = "wrench_dead"
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class CameraDrop(_Fault):
    """A camera (None: any) gives no image, for a time or for a number of images."""

    name = "camera_drop"
    camera: str | None = None
    lasts: float | None = None
    images: int | None = None


@dataclass(frozen=True, slots=True)
class CameraShift(_Fault):
    """A camera's true optical frame is moved, given in the frame as it was: x right, y down, z forward."""

    name = "camera_shift"
    moved: Pose
    camera: str | None = None
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class CameraNoise(_Fault):
    """The noise of a camera's depth and colour is `factor` times as large."""

    name = "camera_noise"
    factor: float
    camera: str | None = None
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class CameraMislabel(_Fault):
    """A camera shows one colour of items as another; `swapped`: and the other as the one."""

    name = "camera_mislabel"
    colour: str
    shown_as: str
    swapped: bool = False
    camera: str | None = None
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class NoPlan(_Fault):
    """The planner finds no path, for a time or for a number of requests."""

    name = "no_plan"
    lasts: float | None = None
    requests: int | None = None


def counted(fault: object) -> bool:
    """Return whether the fault can end after a number of images or requests."""
    return isinstance(fault, CameraDrop | NoPlan)


CameraFault: TypeAlias = CameraDrop | CameraShift | CameraNoise | CameraMislabel
LastingFault: TypeAlias = (
    GripperJam | GripperWeak | JointWeak | Stall | WrenchBias | WrenchDead | CameraFault | NoPlan
)
"""Faults that last: each begins and ends, unless it is for good."""


@dataclass(frozen=True, slots=True)
class FaultTarget:
    """Target of a fault: a true item. Among the items that fit all given criteria it is the nearest to
    `nearest_to`, else the first.

    `tool` is the TCP; `object` is the believed place of the object that the node's port `object` names.
    """

    index: int | None = None
    """Number in the order of spawning, from 0."""
    kind: str | None = None
    form: Form | None = None
    colour: str | None = None
    nearest_to: Literal["tool", "object"] | None = None


@dataclass(frozen=True, slots=True)
class Remove(_Fault):
    """The item is snatched away, out of the robot's world."""

    name = "remove"
    target: FaultTarget


@dataclass(frozen=True, slots=True)
class Friction(_Fault):
    """The item gets another friction, and mass (kg) where one is given."""

    name = "friction"
    target: FaultTarget
    friction: float
    mass: float | None = None


@dataclass(frozen=True, slots=True)
class Bump(_Fault):
    """The item gets a velocity (m/s, world) and a spin (rad/s, world) all at once."""

    name = "bump"
    target: FaultTarget
    velocity: Vector3
    spin: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Slip(_Fault):
    """The item that the fingers hold, or hold next, has another friction for `lasts` s, or for good; then its
    own again."""

    name = "slip"
    friction: float = 0.0
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class Heavier(_Fault):
    """The item has another mass, kg, than the catalogue says."""

    name = "heavier"
    target: FaultTarget
    mass: float


@dataclass(frozen=True, slots=True)
class Larger(_Fault):
    """The item is `factor` times as large, along each of its axes, as the catalogue says; its mass stays."""

    name = "larger"
    target: FaultTarget
    factor: float


@dataclass(frozen=True, slots=True)
class Appear(_Fault):
    """A further item of the catalogue appears at `place` (x, y) in the world, m. It waits until nothing is
    there. `yaw`, rad, about the world's z."""

    name = "appear"
    kind: str
    colour: str
    place: tuple[float, float]
    yaw: float = 0.0


@dataclass(frozen=True, slots=True)
class Obstacle(_Fault):
    """An obstacle that the robot does not know is put into its way. It waits until nothing is there, never
    moves, and is removed after `stays` s; None: never."""

    name = "obstacle"
    body: Fixture
    stays: float | None = None


ItemFault: TypeAlias = Remove | Friction | Bump | Heavier | Larger
"""Faults that change one named item for good."""
FaultSpec: TypeAlias = ItemFault | Slip | Appear | Obstacle | LastingFault | ProgramFault
"""One injected fault."""


@dataclass(frozen=True, slots=True)
class FaultExpectation:
    """Expected outcome of a run with these faults, for its evaluation. Neither robot nor simulation reads
    it."""

    causes: tuple[str, ...] = ()
    """Causes, or patterns of causes, that name the failure correctly; empty: the fault should do no harm."""
    lost: int = 0
    """Number of items that physically cannot be sorted any more."""
    roots: tuple[str, ...] = ()
    """Root causes, or patterns of them, by which an explanation names it correctly."""


@dataclass(frozen=True, slots=True)
class FaultFile:
    """A fault file, read: its faults in the order of the file."""

    faults: tuple[FaultSpec, ...]
    source: str = ""
    text: str = ""
    """Text of the file as read, for the log."""
    expect: FaultExpectation | None = None


_ZERO_VECTOR = (0.0, 0.0, 0.0)


def fault_of_entry(entry: FaultEntryFile) -> FaultSpec:
    """Return the fault of a checked entry, which has all that its kind needs."""
    return _MAKERS[entry.fault](entry, _when(entry))


def _when(entry: FaultEntryFile) -> When:
    when = entry.when
    probability = 1.0 if entry.probability is None else entry.probability
    if when.node is None:
        return AtTime(when.at or 0.0, when.every, probability)
    return AtNode(when.node, when.start or 1, when.delay or 0.0, bool(when.each), probability)


def _target(entry: FaultEntryFile) -> FaultTarget:
    chosen = entry.target or TargetFile()
    return FaultTarget(chosen.index, chosen.kind, chosen.form, chosen.colour, chosen.nearest_to)


def _obstacle(entry: FaultEntryFile, when: When) -> Obstacle:
    assert entry.body is not None
    return Obstacle(when, hidden_body(entry.name or "obstacle", entry.body), entry.stays)


def _appear(entry: FaultEntryFile, when: When) -> Appear:
    assert entry.kind is not None
    assert entry.colour is not None
    return Appear(when, entry.kind, entry.colour, entry.place or (0.0, 0.0), entry.yaw or 0.0)


def _bump(entry: FaultEntryFile, when: When) -> Bump:
    return Bump(when, _target(entry), entry.velocity or _ZERO_VECTOR, entry.spin or _ZERO_VECTOR)


def _shift(entry: FaultEntryFile, when: When) -> CameraShift:
    moved = Pose.from_rpy(entry.shift or _ZERO_VECTOR, entry.turn or _ZERO_VECTOR)
    return CameraShift(when, moved, entry.camera, entry.lasts)


def _mislabel(entry: FaultEntryFile, when: When) -> CameraMislabel:
    return CameraMislabel(
        when, entry.colour or "", entry.shown_as or "", bool(entry.swapped), entry.camera, entry.lasts
    )


_MAKERS: Mapping[str, Callable[[FaultEntryFile, When], FaultSpec]] = {
    "remove": lambda entry, when: Remove(when, _target(entry)),
    "friction": lambda entry, when: Friction(when, _target(entry), entry.friction or 0.0, entry.mass),
    "bump": _bump,
    "obstacle": _obstacle,
    "slip": lambda entry, when: Slip(when, entry.friction or 0.0, entry.lasts),
    "appear": _appear,
    "heavier": lambda entry, when: Heavier(when, _target(entry), entry.mass or 0.0),
    "larger": lambda entry, when: Larger(when, _target(entry), entry.factor or 1.0),
    "gripper_jam": lambda entry, when: GripperJam(when, entry.lasts),
    "gripper_weak": lambda entry, when: GripperWeak(when, entry.share or 0.0, entry.lasts),
    "camera_drop": lambda entry, when: CameraDrop(when, entry.camera, entry.lasts, entry.images),
    "camera_shift": _shift,
    "camera_noise": lambda entry, when: CameraNoise(when, entry.factor or 1.0, entry.camera, entry.lasts),
    "camera_mislabel": _mislabel,
    "wrench_bias": lambda entry, when: WrenchBias(
        when, entry.force or _ZERO_VECTOR, entry.torque or _ZERO_VECTOR, entry.lasts
    ),
    "wrench_dead": lambda entry, when: WrenchDead(when, entry.lasts),
    "joint_weak": lambda entry, when: JointWeak(when, entry.joint or "", entry.share or 0.0, entry.lasts),
    "stall": lambda entry, when: Stall(when, entry.lasts),
    "no_plan": lambda entry, when: NoPlan(when, entry.lasts, entry.requests),
    "hang": lambda _, when: Hang(when),
    "raise": lambda _, when: Raise(when),
    "kill": lambda _, when: Kill(when),
}
