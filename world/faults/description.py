"""What a faults file says, as values: what is to go wrong, when, and to which item."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from ..scene.description import Fixture, Form
from ..values import Vector3


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


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Something that the robot is not told of is put into its way, as soon as nothing is there; it stands
    still, and is taken away again after so many seconds, or never."""

    when: When
    body: Fixture
    stays: float | None = None


FaultSpec: TypeAlias = Remove | Friction | Bump | Obstacle


@dataclass(frozen=True, slots=True)
class FaultFile:
    """A fault file, read: its faults in the order of the file."""

    faults: tuple[FaultSpec, ...]
    source: str = ""
    text: str = ""
    """The file as it was read, for the log."""
