"""The grammar of faults files: one model for each kind of entry."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field, Strict, WithJsonSchema

from ..colours import ITEM_COLOURS
from ..files.checked import Duration, FileModel, Mass, Name, Wrong, describe, quantity
from ..files.nearest import nearest
from ..scene.description import Form
from ..scene.schema import UnknownFile


def _colour(name: str) -> str:
    if name not in ITEM_COLOURS:
        message = f"{describe(name)} is no colour that an item may have"
        raise Wrong(message, nearest(name, ITEM_COLOURS), code="P108")
    return name


def _pattern(text: str) -> str:
    if not text.strip("/"):
        raise Wrong("the node is empty", "its name, or a path as SortOne/Grasp", code="P606")
    return text


ItemColour = Annotated[str, AfterValidator(_colour), WithJsonSchema({"enum": list(ITEM_COLOURS)})]
NodePattern = Annotated[str, AfterValidator(_pattern), WithJsonSchema({"type": "string", "pattern": "[^/]"})]
Speed = Annotated[float, quantity("m/s", least=-10, most=10)]
Spin = Annotated[float, quantity("rad/s", least=-100, most=100)]


class WhenFile(FileModel):
    """When it happens: at a time, or when a node starts."""

    one_of: ClassVar[tuple[str, ...]] = ("at", "node")
    """Exactly one of these is given."""

    at: Duration | None = None
    """Simulated time since the run began."""
    node: NodePattern | None = None
    """The node that starts: its name, or a path as SortOne/Grasp; '*' and '?' stand for other letters."""
    start: Annotated[int, Strict(), Field(ge=1)] | None = None
    """At which of the node's starts, from 1; the first unless given. Only with `node`."""
    delay: Duration | None = None
    """How long after the node's start; at once unless given. Only with `node`."""


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


class FaultEntryFile(FileModel):
    """One thing that goes wrong: what, when, and to which item or where."""

    fault: Literal["remove", "friction", "bump", "obstacle"]
    """remove: the item is snatched away. friction: it is oiled or made heavier. bump: it gets a push.
    obstacle: something that the robot is not told of is put into its way."""
    when: WhenFile
    """When it happens."""
    target: TargetFile | None = None
    """To which item. Of all faults but obstacle, which need it."""
    friction: Annotated[float, quantity("", least=0, most=2)] | None = None
    """Its new coefficient of friction. Only of the fault friction, which needs it."""
    mass: Mass | None = None
    """Its new mass; unchanged unless given. Only of the fault friction."""
    velocity: tuple[Speed, Speed, Speed] | None = None
    """What it gets all at once, along x, y, z of the world. Only of the fault bump, which needs it."""
    spin: tuple[Spin, Spin, Spin] | None = None
    """What it gets all at once, about x, y, z of the world; none unless given. Only of the fault bump."""

    body: UnknownFile | None = None
    """What is put there, and where; it stands still. It waits until no item and no part of the robot is in
    its place. Only of the fault obstacle, which needs it."""
    name: Name | None = None
    """What the record calls it; `obstacle` unless given. Only of the fault obstacle."""
    stays: Duration | None = None
    """How long it stays before it is taken away; for good unless given. Only of the fault obstacle."""


NEEDS = {
    "remove": ("target",),
    "friction": ("target", "friction"),
    "bump": ("target", "velocity"),
    "obstacle": ("body",),
}
"""What must be given with a fault."""
MAY = {
    "remove": ("target",),
    "friction": ("target", "friction", "mass"),
    "bump": ("target", "velocity", "spin"),
    "obstacle": ("body", "name", "stays"),
}
"""What may be given with a fault."""


class FaultsRestFile(FileModel):
    """What stands in a faults file beside its list."""

    scene: str | None = None
    """A scene, shipped or a file beside this one: kinds, colours and numbers of items are held against it."""


class FaultsFile(FaultsRestFile):
    """What is to go wrong in a run. Only the simulation knows; the robot finds out."""

    faults: list[FaultEntryFile]
    """The faults; those that are due in the same tick happen in this order."""
