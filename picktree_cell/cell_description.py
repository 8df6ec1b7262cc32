"""Cell file as values: one JSON object with robot, fixtures, items, cameras and places.

`picktree cell SCENE --seed N` writes it; any other program may.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias, cast

VERSION: Final = 1
Numbers: TypeAlias = tuple[float, ...]


class CellError(ValueError):
    """File or setting that the cell cannot use; the text is one sentence."""


GIVES: Final = ("pose", "mask", "box")
"""What findings have: mask and pose, a mask alone, or a box alone."""
NO_GL: Final = (
    "--camera gl: the graphics library {!r} of MUJOCO_GL does not work here ({}); install libegl1, or "
    "libosmesa6 for MUJOCO_GL=osmesa, or use --camera rays"
)
"""Sentence on a graphics library that does not work, for its name and error."""


@dataclass(frozen=True, slots=True)
class Place:
    """Position, m, and unit quaternion x, y, z, w."""

    at: Numbers
    xyzw: Numbers

    @property
    def wxyz(self) -> Numbers:
        """The quaternion in MuJoCo's order."""
        return (self.xyzw[3], *self.xyzw[:3])


@dataclass(frozen=True, slots=True)
class Solid:
    """Convex body: box (half sizes), cylinder (radius, half height), sphere (radius) or mesh (its
    corners)."""

    form: str
    size: Numbers = ()
    vertices: Numbers = ()


@dataclass(frozen=True, slots=True)
class FixtureEntry:
    """A body that never moves."""

    id: str
    solid: Solid
    place: Place
    colour: Numbers


@dataclass(frozen=True, slots=True)
class ItemEntry:
    """A body that is moved."""

    id: str
    form: str
    parts: tuple[Solid, ...]
    place: Place
    colour: Numbers
    mass: float
    friction: float
    kind: str
    """Kind by which a recogniser names it; empty: it is not named."""
    colour_name: str
    destination: str
    """Place, or fixture with places, where it belongs; empty: nowhere."""


@dataclass(frozen=True, slots=True)
class PlaceEntry:
    """Box in which items may come to lie: the inside of a bin, or a hole."""

    id: str
    frame: Place
    low: Numbers
    high: Numbers
    fixture: str
    """Fixture that has the hole; empty: it is the inside of a bin."""


@dataclass(frozen=True, slots=True)
class CameraEntry:
    """Camera: optical frame in the world, or in the TCP's frame on the hand."""

    name: str
    on_hand: bool
    size: tuple[int, int]
    fov: float
    """Vertical field of view, rad."""
    near: float
    far: float
    depth_noise: float
    edge_dropout: float
    frame: Place


@dataclass(frozen=True, slots=True)
class JointEntry:
    """Joint of the arm and its limits."""

    name: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    torque: float


@dataclass(frozen=True, slots=True)
class GripperEntry:
    """Parallel gripper: the positions of its joints over the opening."""

    joints: tuple[str, ...]
    links: tuple[str, ...]
    sliders: bool
    """Whether each joint is driven; else the first one, and the others follow."""
    widths: Numbers
    positions: tuple[Numbers, ...]
    max_width: float
    max_force: float
    speed: float
    friction: float


@dataclass(frozen=True, slots=True)
class RobotEntry:
    """Robot: URDF, meshes by the names that the URDF uses, joints and gripper."""

    name: str
    urdf: str
    meshes: Mapping[str, bytes]
    base: Place
    joints: tuple[JointEntry, ...]
    home: Numbers
    flange_joint: str
    tcp_link: str
    tcp: Place
    excluded: tuple[tuple[str, str], ...]
    gripper: GripperEntry


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell file, read."""

    scene: str
    robot: RobotEntry
    workspace: Numbers
    force: float
    floor: float
    fixtures: tuple[FixtureEntry, ...]
    items: tuple[ItemEntry, ...]
    places: tuple[PlaceEntry, ...]
    cameras: tuple[CameraEntry, ...]


def read_cell(path: Path) -> Cell:
    """Read a cell file. Raises CellError with file, key and problem."""
    try:
        data = json.loads(path.read_bytes())
    except OSError as error:
        raise CellError(f"{path}: the file cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise CellError(f"{path}: this is no JSON: {error}") from None
    return parse_cell(data, str(path))


def parse_cell(data: Any, source: str = "cell") -> Cell:
    """Return the cell of plain values. Raises CellError with the key and the problem."""
    top = _Reader(data, source)
    version = top.integer("picktree_cell")
    if version != VERSION:
        raise CellError(f"{source}: the file has version {version}, this program reads version {VERSION}")
    return Cell(
        top.text("scene"),
        _robot(top.inner("robot")),
        top.numbers("workspace", 6),
        top.number("force", above=0.0),
        top.number("floor"),
        tuple(
            FixtureEntry(e.text("id"), _solid(e), _place(e), e.numbers("colour", 3))
            for e in top.each("fixtures")
        ),
        tuple(_item(e) for e in top.each("items")),
        tuple(
            PlaceEntry(
                e.text("id"), _place(e), e.numbers("low", 3), e.numbers("high", 3), e.text("fixture", "")
            )
            for e in top.each("places")
        ),
        tuple(_camera(e) for e in top.each("cameras")),
    )


def _robot(e: _Reader) -> RobotEntry:
    joints = tuple(
        JointEntry(
            j.text("name"),
            j.number("lower"),
            j.number("upper"),
            j.number("velocity", above=0.0),
            j.number("acceleration", above=0.0),
            j.number("torque", above=0.0),
        )
        for j in e.each("joints")
    )
    tcp = e.inner("tcp")
    return RobotEntry(
        e.text("name"),
        e.text("urdf"),
        e.files("meshes"),
        _place(e.inner("base")),
        joints,
        e.numbers("home", len(joints)),
        e.text("flange_joint"),
        tcp.text("link"),
        _place(tcp),
        tuple((pair[0], pair[1]) for pair in e.lists("excluded", str) if len(pair) == 2),
        _gripper(e.inner("gripper")),
    )


def _gripper(e: _Reader) -> GripperEntry:
    joints = e.texts("joints")
    widths = e.numbers("widths")
    positions = tuple(tuple(map(float, row)) for row in e.lists("positions", float))
    if not 2 <= len(widths) == len(positions) or any(len(row) != len(joints) for row in positions):
        raise CellError(
            f"{e.where}: 'positions' has a row for each of 'widths', with a number for each joint"
        )
    return GripperEntry(
        joints,
        e.texts("links"),
        e.flag("sliders"),
        widths,
        positions,
        e.number("max_width", above=0.0),
        e.number("max_force", above=0.0),
        e.number("speed", above=0.0),
        e.number("friction", above=0.0),
    )


def _item(e: _Reader) -> ItemEntry:
    parts = tuple(_solid(part) for part in e.each("parts"))
    if not parts:
        raise CellError(f"{e.where}: an item has at least one of 'parts'")
    return ItemEntry(
        e.text("id"),
        e.text("form", ""),
        parts,
        _place(e),
        e.numbers("colour", 3),
        e.number("mass", above=0.0),
        e.number("friction", above=0.0),
        e.text("kind", ""),
        e.text("colour_name", ""),
        e.text("destination", "") if e.data.get("destination") is not None else "",
    )


def _camera(e: _Reader) -> CameraEntry:
    width, height = e.numbers("size", 2)
    if not (16 <= width <= 2048 and 16 <= height <= 2048):
        raise CellError(
            f"{e.where}: 'size' is {width:g} × {height:g}; a picture has 16 to 2048 pixels a side"
        )
    return CameraEntry(
        e.text("name"),
        e.text("on") == "hand",
        (int(width), int(height)),
        e.number("fov", above=0.0),
        e.number("near", above=0.0),
        e.number("far", above=0.0),
        e.number("depth_noise"),
        e.number("edge_dropout"),
        _place(e),
    )


def _solid(e: _Reader) -> Solid:
    form = e.text("shape")
    match form:
        case "box":
            return Solid(form, tuple(size / 2 for size in e.numbers("size", 3)))
        case "cylinder":
            return Solid(form, (e.number("radius", above=0.0), e.number("height", above=0.0) / 2))
        case "sphere":
            return Solid(form, (e.number("radius", above=0.0),))
        case "mesh":
            rows = [tuple(map(float, row)) for row in e.lists("vertices", float)]
            if len(rows) < 4 or any(len(row) != 3 for row in rows):
                raise CellError(f"{e.where}: 'vertices' has at least four rows of x, y, z")
            return Solid(form, vertices=tuple(c for row in rows for c in row))
        case _:
            raise CellError(f"{e.where}: 'shape' is {form!r}; it is box, cylinder, sphere or mesh")


def _place(e: _Reader) -> Place:
    at, turn = e.numbers("at", 3), e.numbers("xyzw", 4)
    if abs(math.hypot(*turn) - 1.0) > 1e-3:
        raise CellError(f"{e.where}: 'xyzw' is no unit quaternion")
    return Place(at, turn)


class _Reader:
    """Reader of one JSON object; its methods raise CellError with the way to the key."""

    def __init__(self, data: Any, where: str) -> None:
        if not isinstance(data, dict):
            raise CellError(f"{where}: an object is expected, not {type(data).__name__}")
        self.data: dict[str, Any] = data
        self.where = where

    def _value(self, key: str) -> Any:
        if key not in self.data:
            raise CellError(f"{self.where}: the key {key!r} is missing")
        return self.data[key]

    def text(self, key: str, default: str | None = None) -> str:
        value = self._value(key) if default is None else self.data.get(key, default)
        if not isinstance(value, str):
            raise CellError(f"{self.where}: {key!r} is a text")
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        value = self._list(key)
        if not all(isinstance(each, str) for each in value):
            raise CellError(f"{self.where}: {key!r} is a list of texts")
        return tuple(value)

    def flag(self, key: str) -> bool:
        value = self._value(key)
        if not isinstance(value, bool):
            raise CellError(f"{self.where}: {key!r} is true or false")
        return value

    def integer(self, key: str) -> int:
        value = self._value(key)
        if not isinstance(value, int):
            raise CellError(f"{self.where}: {key!r} is a whole number")
        return value

    def number(self, key: str, above: float = -math.inf) -> float:
        value = self._value(key)
        if not _is_number(value) or not value > above:
            more = f" above {above:g}" if above > -math.inf else ""
            raise CellError(f"{self.where}: {key!r} is a number{more}")
        return float(value)

    def numbers(self, key: str, count: int | None = None) -> Numbers:
        value = self._list(key)
        if not all(map(_is_number, value)) or (count is not None and len(value) != count):
            raise CellError(
                f"{self.where}: {key!r} is a list of {'' if count is None else f'{count} '}numbers"
            )
        return tuple(map(float, value))

    def lists(self, key: str, kind: type) -> list[list[Any]]:
        value = self._list(key)
        for row in value:
            if not _is_row(row, kind):
                raise CellError(
                    f"{self.where}: {key!r} is a list of lists of {'texts' if kind is str else 'numbers'}"
                )
        return value

    def inner(self, key: str) -> _Reader:
        return _Reader(self._value(key), f"{self.where}: {key}")

    def each(self, key: str) -> list[_Reader]:
        return [_Reader(value, f"{self.where}: {key}[{n}]") for n, value in enumerate(self._list(key))]

    def files(self, key: str) -> dict[str, bytes]:
        try:
            return {
                str(name): base64.b64decode(text, validate=True)
                for name, text in self.inner(key).data.items()
            }
        except (TypeError, binascii.Error):
            raise CellError(f"{self.where}: {key!r} has files in base64") from None

    def _list(self, key: str) -> list[Any]:
        value = self._value(key)
        if not isinstance(value, list):
            raise CellError(f"{self.where}: {key!r} is a list")
        return cast("list[Any]", value)


def _is_row(value: Any, kind: type) -> bool:
    if not isinstance(value, list):
        return False
    return all(
        isinstance(each, str) if kind is str else _is_number(each) for each in cast("list[Any]", value)
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
