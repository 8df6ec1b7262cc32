"""Kinds of faults: each class is the grammar of its entries in fault files, and their value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Final, Literal, TypeAlias, TypeVar

from pydantic import AfterValidator, Field, Strict, WithJsonSchema

from picktree.files import describe, suggest_name
from picktree.files.yaml import file_models
from picktree.world import ITEM_COLOURS, Pose
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
LastingTime = Annotated[float, file_models.quantity("s", above=0)]
Count = Annotated[int, Strict(), Field(ge=1)]
Probability = Annotated[float, file_models.quantity("", above=0, most=1)]
Factor = Annotated[float, file_models.quantity("", above=0, most=100)]
Push = Annotated[float, file_models.quantity("N", least=-1000, most=1000)]
Twist = Annotated[float, file_models.quantity("Nm", least=-100, most=100)]
Speed = Annotated[float, file_models.quantity("m/s", least=-10, most=10)]
Spin = Annotated[float, file_models.quantity("rad/s", least=-100, most=100)]


FrictionCoefficient = Annotated[float, file_models.quantity("", least=0, most=2)]
_ZERO: Final = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class AtTime:
    """Occasions at the simulated time `time`, s; with `every`, repeated at that interval, s."""

    time: float
    every: float | None = None


@dataclass(frozen=True, slots=True)
class AtNode:
    """Occasion `delay` s after the node that fits `pattern` has started for the `start`-th time (from 1).
    With `each` at every start from that one on."""

    pattern: str
    start: int = 1
    delay: float = 0.0
    each: bool = False


When: TypeAlias = AtTime | AtNode


class WhenFile(file_models.FileModel):
    """Occasion of a fault: a time, or the start of a node; once, unless `each` or `every` repeats it."""

    one_of: ClassVar[tuple[str, ...]] = ("at", "node")
    """Exactly one of these is given."""

    at: file_models.Duration | None = None
    """Simulated time since the run began."""
    every: LastingTime | None = None
    """Interval at which the fault repeats. Only with `at`."""
    node: NodePattern | None = None
    """Starting node: its name, or a path such as SortOne/Grasp; '*' and '?' match other letters."""
    start: Count | None = None
    """Number of the start of the node, from 1. Default: the first. Only with `node`."""
    delay: file_models.Duration | None = None
    """Delay after the node's start. Default: none. Only with `node`."""
    each: file_models.Flag | None = None
    """true: at this start of the node and at each later one. Only with `node`."""

    def value(self) -> When:
        if self.node is None:
            return AtTime(self.at or 0.0, self.every)
        return AtNode(self.node, self.start or 1, self.delay or 0.0, bool(self.each))


@dataclass(frozen=True, slots=True)
class FaultTarget(file_models.FileValue):
    """Item that a fault affects: of the items that fit all keys, the nearest or the first spawned one."""

    index: Annotated[int, Strict(), Field(ge=0)] | None = None
    """Number of the item in the order of spawning, from 0."""
    kind: str | None = None
    """Kind of the item in the scene's catalogue."""
    form: Form | None = None
    """Form of the item."""
    colour: ItemColour | None = None
    """Colour of the item."""
    nearest_to: Literal["tool", "object"] | None = None
    """Reference for the nearest item: the TCP, or the believed place of the object at the node's port
    `object`."""


@dataclass(frozen=True, slots=True)
class Fault(file_models.FileValue):
    """One injected fault: kind, occasion, and the affected item, device or place."""

    fault: ClassVar[str]
    """Kind of the fault in files and records; docs/faults.md describes each kind."""
    when: Annotated[When, file_models.ReadAs(WhenFile, WhenFile.value)]
    """Occasion of the fault."""
    probability: Probability = field(default=1.0, kw_only=True)
    """Probability of the fault at each of its occasions. Drawn from the run's seed, from a separate
    stream."""
    off: file_models.Flag = field(default=False, kw_only=True)
    """true: the fault keeps its place in the file and never happens. The draws of the other faults, which
    depend on their places, do not change."""


KINDS: Final[dict[str, type[Fault]]] = {}
"""Kinds of faults by their names."""
FaultClass = TypeVar("FaultClass", bound=type[Fault])


def fault(name: str) -> Callable[[FaultClass], FaultClass]:
    """Return the decorator that registers a kind of fault."""

    def register(kind: FaultClass) -> FaultClass:
        kind.fault, KINDS[name] = name, kind
        return kind

    return register


@dataclass(frozen=True, slots=True)
class Lasting(Fault):
    """Fault that begins and ends, unless it is for good."""

    lasts: LastingTime | None = field(default=None, kw_only=True)
    """Duration of the fault. Default: permanent."""


@dataclass(frozen=True, slots=True)
class ItemFault(Fault):
    """Fault that changes one item for good."""

    target: FaultTarget
    """The affected item."""


@dataclass(frozen=True, slots=True)
class CameraFault(Lasting):
    """Fault of cameras."""

    camera: str | None = field(default=None, kw_only=True)
    """The camera. Default: all cameras."""


@fault("remove")
@dataclass(frozen=True, slots=True)
class Remove(ItemFault):
    """The item is removed from the scene."""


@fault("friction")
@dataclass(frozen=True, slots=True)
class Friction(ItemFault):
    """The item gets another friction and, if given, another mass."""

    friction: FrictionCoefficient
    """New coefficient of friction of the item."""
    mass: file_models.Mass | None = None
    """New mass of the item. Default: unchanged."""


@fault("bump")
@dataclass(frozen=True, slots=True)
class Bump(ItemFault):
    """The item suddenly gets a velocity and an angular velocity."""

    velocity: tuple[Speed, Speed, Speed]
    """New velocity of the item along x, y, z of the world."""
    spin: tuple[Spin, Spin, Spin] = _ZERO
    """New angular velocity of the item about x, y, z of the world."""


@fault("obstacle")
@dataclass(frozen=True, slots=True)
class Obstacle(Fault):
    """An unknown obstacle appears in the path of the robot, and never moves."""

    body: UnknownFile
    """The body and its pose. It waits until no item and no part of the robot is in its place."""
    name: file_models.Name = "obstacle"
    """Name of the obstacle in the record."""
    stays: file_models.Duration | None = None
    """Time after which the obstacle is removed. Default: it stays."""

    @property
    def fixture(self) -> Fixture:
        return hidden_body(self.name, self.body)


@fault("slip")
@dataclass(frozen=True, slots=True)
class Slip(Lasting):
    """The item that the fingers hold, or hold next, has another friction for a time or permanently."""

    friction: FrictionCoefficient = 0.0
    """Coefficient of friction during the fault; the item has its own again afterwards."""


@fault("appear")
@dataclass(frozen=True, slots=True)
class Appear(Fault):
    """A further item of the catalogue appears."""

    kind: str
    """Kind of the item in the scene's catalogue."""
    colour: ItemColour
    """Colour of the item."""
    place: tuple[file_models.Length, file_models.Length]
    """Position of its centre, x and y in the world. It waits until nothing is there."""
    yaw: file_models.Angle = 0.0
    """Rotation about the world's z."""


@fault("heavier")
@dataclass(frozen=True, slots=True)
class Heavier(ItemFault):
    """The item has another mass than the catalogue says."""

    mass: file_models.Mass
    """New mass of the item."""


@fault("larger")
@dataclass(frozen=True, slots=True)
class Larger(ItemFault):
    """The item is larger along each of its axes than the catalogue says; its mass stays."""

    factor: Factor
    """Factor on its size."""


@fault("gripper_jam")
@dataclass(frozen=True, slots=True)
class GripperJam(Lasting):
    """The fingers stay in place, ignore commands, and keep pressing on the item that they hold."""


@fault("gripper_weak")
@dataclass(frozen=True, slots=True)
class GripperWeak(Lasting):
    """The fingers press with a share of the commanded force."""

    share: file_models.Share
    """Share of the force that is left."""


@fault("camera_drop")
@dataclass(frozen=True, slots=True)
class CameraDrop(CameraFault):
    """A camera gives no image, for a time or for a number of images."""

    images: Count | None = None
    """Number of missing images, unless `lasts` is over before."""


@fault("camera_shift")
@dataclass(frozen=True, slots=True)
class CameraShift(CameraFault):
    """A camera is moved."""

    shift: file_models.Vector
    """Translation: right, down, forward in its former view."""
    turn: file_models.Angles = _ZERO
    """Rotation about the same axes, one after the other."""

    @property
    def moved(self) -> Pose:
        """True optical frame in the former optical frame: x right, y down, z forward."""
        return Pose.from_rpy(self.shift, self.turn)


@fault("camera_noise")
@dataclass(frozen=True, slots=True)
class CameraNoise(CameraFault):
    """A camera's depth and colour are noisier."""

    factor: Factor
    """Factor on the noise."""


@fault("camera_mislabel")
@dataclass(frozen=True, slots=True)
class CameraMislabel(CameraFault):
    """A camera shows one colour of items as another."""

    colour: ItemColour
    """Colour that is shown as another."""
    shown_as: ItemColour
    """Colour that is shown instead of `colour`."""
    swapped: file_models.Flag = False
    """true: `colour` is shown instead of `shown_as`, too."""


@fault("wrench_bias")
@dataclass(frozen=True, slots=True)
class WrenchBias(Lasting):
    """The wrist's sensor has a bias."""

    force: tuple[Push, Push, Push]
    """Bias of the force, along the sensor's own axes."""
    torque: tuple[Twist, Twist, Twist] = _ZERO
    """Bias of the torque, about the sensor's own axes."""


@fault("wrench_dead")
@dataclass(frozen=True, slots=True)
class WrenchDead(Lasting):
    """The wrist's sensor is silent: its reading and its time stamp do not change."""


@fault("joint_weak")
@dataclass(frozen=True, slots=True)
class JointWeak(Lasting):
    """The joint's torque is at most a share of what it could give."""

    joint: str
    """The joint of the arm, by its name."""
    share: file_models.Share
    """Share of the torque that is left."""


@fault("stall")
@dataclass(frozen=True, slots=True)
class Stall(Lasting):
    """The arm ignores commands: its drives hold it in place."""


@fault("no_plan")
@dataclass(frozen=True, slots=True)
class NoPlan(Lasting):
    """The planner finds no path, for a time or for a number of requests."""

    requests: Count | None = None
    """Number of planning requests that fail, unless `lasts` is over before."""


@fault("hang")
@dataclass(frozen=True, slots=True)
class Hang(Fault):
    """The running skill yields for ever: it never ends until it is halted."""


@fault("raise")
@dataclass(frozen=True, slots=True)
class Raise(Fault):
    """The code of the running skill raises an exception."""


@fault("kill")
@dataclass(frozen=True, slots=True)
class Kill(Fault):
    """The process is killed (SIGKILL)."""


def counted(fault: object) -> bool:
    """Return whether the fault can end after a number of images or requests."""
    return isinstance(fault, CameraDrop | NoPlan)


ItemFaults: TypeAlias = Remove | Friction | Bump | Heavier | Larger
CameraFaults: TypeAlias = CameraDrop | CameraShift | CameraNoise | CameraMislabel
LastingFault: TypeAlias = (
    GripperJam | GripperWeak | JointWeak | Stall | WrenchBias | WrenchDead | CameraFaults | NoPlan
)
"""Faults of devices that last: each begins and ends, unless it is for good."""
FaultSpec: TypeAlias = ItemFaults | Slip | Appear | Obstacle | LastingFault | Hang | Raise | Kill
"""One injected fault."""


@dataclass(frozen=True, slots=True)
class FaultExpectation(file_models.FileValue):
    """Expected outcome, for the evaluation of a campaign. Neither the robot nor the simulation reads it."""

    causes: tuple[str, ...]
    """Causes that name the failure correctly, or families such as grasp.*; empty for a fault without harm."""
    lost: Annotated[int, Strict(), Field(ge=0)] = 0
    """Number of items that can physically not be sorted any more."""
    roots: tuple[str, ...] = ()
    """Root causes that are correct in an explanation of the run, or families such as item.*."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultsSettings(file_models.FileValue):
    """Keys of a fault file besides its list."""

    scene: Annotated[str, file_models.NamedFile("scene")] | None = None
    """A scene, shipped or a file next to this one. Kinds, colours and numbers of items, cameras and joints
    are checked against it."""
    expect: FaultExpectation | None = None
    """Expected outcome of a run with these faults, for its evaluation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultsFile(FaultsSettings):
    """Faults of a run. Only the simulation knows them; the robot has to detect them."""

    faults: list[FaultSpec]
    """The faults; those that are due in the same tick happen in this order."""


@dataclass(frozen=True, slots=True)
class FaultFile:
    """A fault file, read: its faults in the order of the file."""

    faults: tuple[FaultSpec, ...]
    source: str = ""
    text: str = ""
    """Text of the file as read, for the log."""
    expect: FaultExpectation | None = None
