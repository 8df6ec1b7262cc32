"""The grammar of scene files: one model for each kind of entry."""

from __future__ import annotations

import math
from typing import Annotated, cast

from pydantic import AfterValidator, BeforeValidator, Field, Strict

from ..colours import ITEM_COLOURS, PLAIN_COLOURS
from ..files.checked import (
    Angle,
    Angles,
    FileModel,
    Flag,
    Force,
    Length,
    Mass,
    Share,
    Size,
    Sizes,
    Vector,
    Wrong,
    quantity,
)
from ..files.nearest import nearest
from ..files.wording import describe
from .description import Limits, SensorNoise, Thinking

SECTIONS = ("fixtures", "cameras", "catalogue", "spawn", "destinations")
"""The parts of a scene file that are read entry by entry; the rest is `RestFile`."""


def _item_colour(name: str) -> str:
    if name not in ITEM_COLOURS:
        raise Wrong(
            f"{describe(name)} is no colour that an item may have", nearest(name, ITEM_COLOURS), code="P108"
        )
    return name


def _plain_colour(name: str) -> str:
    if name in ITEM_COLOURS:
        plain = ", ".join(PLAIN_COLOURS)
        message = f"{name} is a colour of items: a camera tells items from fixtures by it"
        raise Wrong(message, f"one of {plain}", code="P108")
    if name not in PLAIN_COLOURS:
        raise Wrong(f"unknown colour {describe(name)}", nearest(name, PLAIN_COLOURS), code="P108")
    return name


def _as_mapping(key: str) -> BeforeValidator:
    """A bare value stands for a mapping with one key."""

    def wrap(value: object) -> object:
        if value is None or isinstance(value, dict | FileModel):
            return cast("object", value)
        return {key: value}

    return BeforeValidator(wrap)


ItemColour = Annotated[str, AfterValidator(_item_colour)]
PlainColour = Annotated[str, AfterValidator(_plain_colour)]
ItemSize = Annotated[float, quantity("m", least=0.001, most=1.0)]
ItemSizes = tuple[ItemSize, ItemSize, ItemSize]
Noise = Annotated[float, quantity("m", least=0, most=0.1)]
FieldOfView = Annotated[float, quantity("rad", above=0, most=math.radians(150))]
Distance = Annotated[float, quantity("m", above=0)]
Pixels = Annotated[int, Strict(), Field(ge=16, le=2048)]
Count = Annotated[int, Strict(), Field(ge=1, le=200)]
Corner = tuple[Length, Length]
Cost = Annotated[float, quantity("s", least=0, most=10)]


class CylinderFile(FileModel):
    radius: ItemSize
    height: ItemSize


class SphereFile(FileModel):
    radius: ItemSize


class MeshFile(FileModel):
    file: str
    scale: Annotated[float, quantity("", above=0)] = 1.0


class FixtureFile(FileModel):
    box: Sizes | None = None
    bin: Sizes | None = None
    at: Vector
    rpy: Angles | None = None
    yaw: Angle | None = None
    wall: Size | None = None
    colour: PlainColour = "grey"


class OffsetFile(FileModel):
    offset: Vector = (0.0, 0.0, 0.0)
    rpy: Angles = (0.0, 0.0, 0.0)


class CameraFile(FileModel):
    at: Vector
    look_at: Vector
    up: Vector | None = None
    size: tuple[Pixels, Pixels] = (320, 240)
    fov: FieldOfView = math.radians(60)
    depth_noise: Noise = 0.002
    edge_dropout: Share = 0.5
    near: Distance = 0.05
    far: Distance = 3.0
    error: Annotated[OffsetFile, _as_mapping("offset")] = OffsetFile()


class CatalogueFile(FileModel):
    box: ItemSizes | None = None
    cylinder: CylinderFile | None = None
    sphere: SphereFile | None = None
    plate: ItemSizes | None = None
    mesh: Annotated[MeshFile | None, _as_mapping("file")] = None
    mass: Mass
    friction: Annotated[float, quantity("", least=0, most=2)]
    force_limit: Force | None = None


class AreaFile(FileModel):
    min: Corner
    max: Corner


class SpawnFile(FileModel):
    of: Annotated[dict[str, Count], Field(min_length=1)]
    colours: Annotated[tuple[ItemColour, ...], Field(min_length=1)]
    area: AreaFile
    gap: Annotated[float, quantity("m", least=0, most=1)] = 0.025
    lying: Share = 0.0
    tumbled: Flag = False


class DestinationFile(FileModel):
    where: str
    to: str


class WorkspaceFile(FileModel):
    min: Vector = Limits().workspace.min
    max: Vector = Limits().workspace.max


class LimitsFile(FileModel):
    force: Force = Limits().force
    workspace: WorkspaceFile = WorkspaceFile()


class ThinkingFile(FileModel):
    collision_check: Cost = Thinking().collision_check
    image: Cost = Thinking().image


class SensorsFile(FileModel):
    encoder: Annotated[float, quantity("rad", least=0, most=0.1)] = SensorNoise().encoder
    width: Annotated[float, quantity("m", least=0, most=0.1)] = SensorNoise().width
    force: Annotated[float, quantity("N", least=0, most=100)] = SensorNoise().force
    torque: Annotated[float, quantity("Nm", least=0, most=100)] = SensorNoise().torque


class RestFile(FileModel):
    """What stands in a scene file beside its sections."""

    base: str | None = None
    robot: str
    limits: LimitsFile = LimitsFile()
    thinking: ThinkingFile = ThinkingFile()
    sensors: SensorsFile = SensorsFile()
    checkpoint_every: Count = 4
    goal: str | None = None
