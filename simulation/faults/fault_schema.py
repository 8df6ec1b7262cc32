"""Schema of fault files: one model for entries of all kinds, and the keys that each kind takes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import AfterValidator, Field, Strict, WithJsonSchema

from ...files.value_wording import describe, suggest_name
from ...files.yaml.file_models import (
    Angle,
    Angles,
    Duration,
    FileModel,
    Flag,
    InvalidValue,
    Length,
    Mass,
    Name,
    Share,
    Vector,
    quantity,
)
from ...files.yaml.named_files import NamedFile
from ...world.colours import ITEM_COLOURS
from ...world.scene.body_schema import UnknownFile
from ...world.scene.description import Form


def _colour(name: str) -> str:
    if name not in ITEM_COLOURS:
        message = f"{describe(name)} is no colour that an item may have"
        raise InvalidValue(message, suggest_name(name, ITEM_COLOURS), code="P108")
    return name


def _pattern(text: str) -> str:
    if not text.strip("/"):
        raise InvalidValue("the node is empty", "its name, or a path as SortOne/Grasp", code="P606")
    return text


ItemColour = Annotated[str, AfterValidator(_colour), WithJsonSchema({"enum": list(ITEM_COLOURS)})]
NodePattern = Annotated[str, AfterValidator(_pattern), WithJsonSchema({"type": "string", "pattern": "[^/]"})]
Lasting = Annotated[float, quantity("s", above=0)]
Count = Annotated[int, Strict(), Field(ge=1)]
Probability = Annotated[float, quantity("", above=0, most=1)]
Factor = Annotated[float, quantity("", above=0, most=100)]
Push = Annotated[float, quantity("N", least=-1000, most=1000)]
Twist = Annotated[float, quantity("Nm", least=-100, most=100)]
Speed = Annotated[float, quantity("m/s", least=-10, most=10)]
Spin = Annotated[float, quantity("rad/s", least=-100, most=100)]


class WhenFile(FileModel):
    """When it happens: at a time, or when a node starts; once unless `each` or `every` says otherwise."""

    one_of: ClassVar[tuple[str, ...]] = ("at", "node")
    """Exactly one of these is given."""

    at: Duration | None = None
    """Simulated time since the run began."""
    every: Lasting | None = None
    """Interval at which it repeats. Only with `at`."""
    node: NodePattern | None = None
    """The node that starts: its name, or a path as SortOne/Grasp; '*' and '?' stand for other letters."""
    start: Count | None = None
    """At which of the node's starts, from 1; the first unless given. Only with `node`."""
    delay: Duration | None = None
    """How long after the node's start; at once unless given. Only with `node`."""
    each: Flag | None = None
    """true: at each of the node's starts, from that one on. Only with `node`."""


class TargetFile(FileModel):
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


class FaultEntryFile(FileModel):
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
    friction: Annotated[float, quantity("", least=0, most=2)] | None = None
    """Its new coefficient of friction: of the fault friction, which needs it, and of slip, 0 unless given."""
    mass: Mass | None = None
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
    place: tuple[Length, Length] | None = None
    """Position of its centre, x and y in the world. It waits until nothing is there. Only of the fault
    appear, which needs it."""
    yaw: Angle | None = None
    """Rotation about the world's z; 0 unless given. Only of the fault appear."""
    share: Share | None = None
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
    shift: Vector | None = None
    """Translation: right, down, forward in its former view. Only of the fault camera_shift, which needs
    it."""
    turn: Angles | None = None
    """Rotation about the same axes, one after the other; 0 unless given. Only of camera_shift."""
    shown_as: ItemColour | None = None
    """Colour that is shown instead of `colour`. Only of the fault camera_mislabel, which needs it."""
    swapped: Flag | None = None
    """true: `colour` is shown instead of `shown_as`, too. Only of the fault camera_mislabel."""
    requests: Count | None = None
    """Number of planning requests that fail, unless `lasts` is over before. Only of the fault no_plan."""

    body: UnknownFile | None = None
    """The body and its pose; it never moves. It waits until no item and no part of the robot is in its place.
    Only of the fault obstacle, which needs it."""
    name: Name | None = None
    """Its name in the record; `obstacle` unless given. Only of the fault obstacle."""
    stays: Duration | None = None
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


class ExpectFile(FileModel):
    """Expected outcome, for the evaluation of a campaign. Neither the robot nor the simulation reads it."""

    causes: list[str]
    """Causes that name the failure correctly, or families of them as grasp.*; none where it should do no
    harm."""
    roots: list[str] = Field(default_factory=list[str])
    """Root causes by which an explanation names it correctly, or families of them as item.*."""
    lost: Annotated[int, Strict(), Field(ge=0)] = 0
    """How many items can physically not be sorted any more."""


class FaultsRestFile(FileModel):
    """Keys of a fault file besides its list."""

    scene: Annotated[str, NamedFile("scene")] | None = None
    """A scene, shipped or a file next to this one. Kinds, colours and numbers of items, cameras and joints
    are checked against it."""
    expect: ExpectFile | None = None
    """Expected outcome of a run with these faults, for its evaluation."""


class FaultsFile(FaultsRestFile):
    """Faults of a run. Only the simulation knows them; the robot has to find out."""

    faults: list[FaultEntryFile]
    """The faults; those that are due in the same tick happen in this order."""
