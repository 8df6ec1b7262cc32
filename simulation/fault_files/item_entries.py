"""Faults that happen to items, and obstacles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

from ...world.scene.description import Fixture, Form
from ...world.values import Vector3
from .device_entries import When


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
class Remove:
    """The item is snatched away, out of the robot's world."""

    name: ClassVar[str] = "remove"
    when: When
    target: FaultTarget


@dataclass(frozen=True, slots=True)
class Friction:
    """The item gets another friction, and mass (kg) where one is given."""

    name: ClassVar[str] = "friction"
    when: When
    target: FaultTarget
    friction: float
    mass: float | None = None


@dataclass(frozen=True, slots=True)
class Bump:
    """The item gets a velocity (m/s, world) and a spin (rad/s, world) all at once."""

    name: ClassVar[str] = "bump"
    when: When
    target: FaultTarget
    velocity: Vector3
    spin: Vector3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Slip:
    """The item that the fingers hold, or hold next, has another friction for `lasts` s, or for good; then its
    own again."""

    name: ClassVar[str] = "slip"
    when: When
    friction: float = 0.0
    lasts: float | None = None


@dataclass(frozen=True, slots=True)
class Heavier:
    """The item has another mass, kg, than the catalogue says."""

    name: ClassVar[str] = "heavier"
    when: When
    target: FaultTarget
    mass: float


@dataclass(frozen=True, slots=True)
class Larger:
    """The item is `factor` times as large, along each of its axes, as the catalogue says; its mass stays."""

    name: ClassVar[str] = "larger"
    when: When
    target: FaultTarget
    factor: float


@dataclass(frozen=True, slots=True)
class Appear:
    """A further item of the catalogue appears at `place` (x, y) in the world, m. It waits until nothing is
    there. `yaw`, rad, about the world's z."""

    name: ClassVar[str] = "appear"
    when: When
    kind: str
    colour: str
    place: tuple[float, float]
    yaw: float = 0.0


@dataclass(frozen=True, slots=True)
class Obstacle:
    """An obstacle that the robot does not know is put into its way. It waits until nothing is there, never
    moves, and is removed after `stays` s; None: never."""

    name: ClassVar[str] = "obstacle"
    when: When
    body: Fixture
    stays: float | None = None


ItemFault: TypeAlias = Remove | Friction | Bump | Heavier | Larger
"""Faults that change one named item for good."""
