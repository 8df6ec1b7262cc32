"""Fault files: what is to go wrong, when, and to which item. Only the simulation and its analyst know."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import AfterValidator, Field, Strict

from ..colours import ITEM_COLOURS
from ..files.checked import Checker, Duration, FileModel, Mass, Wrong, quantity
from ..files.document import Document, Location, load_document, nearest, parse_document
from ..scene.description import Form
from ..values import Vector3

FAULTS = ("remove", "friction", "bump")


@dataclass(frozen=True, slots=True)
class AtTime:
    """At this simulated time, s."""

    time: float


@dataclass(frozen=True, slots=True)
class AtNode:
    """`delay` s after the node that fits `pattern` has started for the `start`-th time (from 1)."""

    pattern: str
    start: int = 1
    delay: float = 0.0


When: TypeAlias = AtTime | AtNode


@dataclass(frozen=True, slots=True)
class Target:
    """A true item: among those that fit all that is given, the nearest to `nearest_to`, else the first.

    `tool` is the TCP; `object` the place where the belief has what the node's port `object` names.
    """

    index: int | None = None
    """Number in the order of spawning, from 0."""
    kind: str | None = None
    form: Form | None = None
    colour: str | None = None
    nearest_to: Literal["tool", "object"] | None = None


@dataclass(frozen=True, slots=True)
class Remove:
    """The item is snatched away, out of the robot's world."""

    when: When
    target: Target


@dataclass(frozen=True, slots=True)
class Friction:
    """The item gets another friction, and mass (kg) where one is given."""

    when: When
    target: Target
    friction: float
    mass: float | None = None


@dataclass(frozen=True, slots=True)
class Bump:
    """The item gets a velocity (m/s, world) and a spin (rad/s, world) all at once."""

    when: When
    target: Target
    velocity: Vector3
    spin: Vector3 = (0.0, 0.0, 0.0)


FaultSpec: TypeAlias = Remove | Friction | Bump


@dataclass(frozen=True, slots=True)
class FaultFile:
    """A fault file, read: its faults in the order of the file."""

    faults: tuple[FaultSpec, ...]
    source: str = ""
    text: str = ""
    """The file as it was read, for the log."""


def _colour(name: str) -> str:
    if name not in ITEM_COLOURS:
        raise Wrong(f"{name!r} is no colour that an item may have", nearest(name, ITEM_COLOURS))
    return name


def _pattern(text: str) -> str:
    if not text.strip("/"):
        raise Wrong("the node is empty", "its name, or a path as SortOne/Grasp")
    return text


Speed = Annotated[float, quantity("m/s", least=-10, most=10)]
Spin = Annotated[float, quantity("rad/s", least=-100, most=100)]


class _When(FileModel):
    at: Duration | None = None
    node: Annotated[str, AfterValidator(_pattern)] | None = None
    start: Annotated[int, Strict(), Field(ge=1)] | None = None
    delay: Duration | None = None


class _Target(FileModel):
    index: Annotated[int, Strict(), Field(ge=0)] | None = None
    kind: str | None = None
    form: Form | None = None
    colour: Annotated[str, AfterValidator(_colour)] | None = None
    nearest_to: Literal["tool", "object"] | None = None


class _Fault(FileModel):
    fault: Literal["remove", "friction", "bump"]
    when: _When
    target: _Target
    friction: Annotated[float, quantity("", least=0, most=2)] | None = None
    mass: Mass | None = None
    velocity: tuple[Speed, Speed, Speed] | None = None
    spin: tuple[Spin, Spin, Spin] | None = None


_NEEDS = {"remove": (), "friction": ("friction",), "bump": ("velocity",)}
_MAY = {"remove": (), "friction": ("friction", "mass"), "bump": ("velocity", "spin")}


def load_faults(path: Path) -> FaultFile:
    """Raises FileError with all faults of the file."""
    return _read(load_document(path, "faults"))


def parse_faults(text: str, path: Path) -> FaultFile:
    """As `load_faults`, of a text as a log keeps it."""
    return _read(parse_document(text, path, "faults"))


def _read(document: Document) -> FaultFile:
    check = Checker(document)
    check.keys(("faults",))
    if "faults" not in document.data:
        check.fault((), "'faults' is missing", "a list of what is to go wrong")
    entries = check.sequence(_Fault, "faults")
    specs = [_spec(check, n, entry) for n, entry in enumerate(entries) if entry is not None]
    check.finish()
    return FaultFile(tuple(s for s in specs if s is not None), str(document.path), document.text)


def _spec(check: Checker, n: int, entry: _Fault) -> FaultSpec | None:
    loc: Location = ("faults", n)
    before = len(check.faults)
    when = _when(check, (*loc, "when"), entry.when)
    for name in ("friction", "mass", "velocity", "spin"):
        given = getattr(entry, name) is not None
        if given and name not in _MAY[entry.fault]:
            check.fault((*loc, name), f"{entry.fault!r} takes no {name!r}", key=True)
        if not given and name in _NEEDS[entry.fault]:
            check.fault(loc, f"{entry.fault!r} needs {name!r}")
    chosen = entry.target
    if chosen == _Target():
        check.fault((*loc, "target"), "no item is named", "index, kind, form, colour or nearest_to")
    if chosen.nearest_to == "object" and isinstance(when, AtTime):
        check.fault((*loc, "target", "nearest_to"), "'object' needs a node in 'when', whose port it is")
    target = Target(chosen.index, chosen.kind, chosen.form, chosen.colour, chosen.nearest_to)
    if when is None or len(check.faults) > before:
        return None
    match entry.fault:
        case "remove":
            return Remove(when, target)
        case "friction":
            return Friction(when, target, entry.friction or 0.0, entry.mass)
        case "bump":
            return Bump(when, target, entry.velocity or (0.0, 0.0, 0.0), entry.spin or (0.0, 0.0, 0.0))


def _when(check: Checker, loc: Location, when: _When) -> When | None:
    which = check.one_of(loc, ("at", "node"))
    if which == "at":
        for name in ("start", "delay"):
            if getattr(when, name) is not None:
                check.fault((*loc, name), f"{name!r} belongs to 'node'", key=True)
    if which is None:
        return None
    if when.node is not None:
        return AtNode(when.node, when.start or 1, when.delay or 0.0)
    return AtTime(when.at or 0.0)
