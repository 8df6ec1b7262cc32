"""Journal: entries that all rooms note for the log; `logs/` alone defines their storage."""

from __future__ import annotations

import types
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from functools import cache
from typing import (
    Annotated,
    Any,
    ClassVar,
    Final,
    Literal,
    Self,
    TypeAlias,
    Union,
    cast,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from .protocols import RgbdImage
from .values import Quaternion, Vector3

Plain: TypeAlias = "str | int | float | bool | None | list[Plain] | dict[str, Plain]"
EVENT_KINDS: Final[dict[str, type[JournalEvent]]] = {}
"""Declared kinds of event by name, in the order of their declarations."""


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(field,))
@dataclass(frozen=True)
class JournalEvent:
    """Event: a sentence for people, the node that noted it, and the fields of its kind.

    A kind is a class below this one: `class PutDownEvent(JournalEvent, kind="put_down")`. It becomes a frozen
    dataclass with its first event, because most processes note few of the kinds. Its fields are recorded by
    their names in the order of their declaration, which digests cover. A field whose default is None is not
    recorded while it is None. The classes have no slots: orjson writes those slowly.
    """

    NAME: ClassVar[str] = ""
    """Name of the kind; empty for events whose kind is not declared."""

    message: str
    node: str = ""
    """Path of the node that noted the event; empty when none did."""
    extra: Mapping[str, object] = field(default_factory=dict[str, object], kw_only=True)
    """Recorded values that the kind does not declare, by name: evidence, or fields of another version."""

    def __init_subclass__(cls, *, kind: str = "") -> None:
        """Register the class as the declaration of `kind`."""
        cls.NAME = kind
        if kind:
            EVENT_KINDS[kind] = cls

    def __new__(cls, *_values: object, **_named: object) -> Self:
        _complete(cls)
        return super().__new__(cls)

    @property
    def kind(self) -> str:
        """Name of the kind, such as `item_done`."""
        return self.NAME

    @property
    def data(self) -> dict[str, object]:
        """Recorded values by name, in the recorded order."""
        declared = ((each.name, getattr(self, each.name), each.default) for each in event_fields(type(self)))
        return {
            **{name: _plain(v) for name, v, default in declared if v is not None or default is not None},
            **self.extra,
        }

    @classmethod
    def from_data(cls, message: str, node: str, data: Mapping[str, object]) -> Self:
        """Return the event with these values. Raises ValueError when one is missing or has another type."""
        values, extra = dict[str, Any](), dict(data)
        for each in event_fields(cls):
            if each.name in data:
                values[each.name] = _converted(data[each.name], each.hint)
                if values[each.name] is not None or each.default is not None:
                    del extra[each.name]
            elif each.required:
                raise ValueError(f"{cls.NAME} has no {each.name}")
        return cls(message, node, extra=extra, **values)


def _complete(declared: type[JournalEvent]) -> None:
    """Make a kind, and kinds above it, the dataclass that it declares."""
    for kind in reversed(declared.__mro__[:-1]):
        if "__dataclass_fields__" not in vars(kind):
            dataclass(frozen=True, kw_only=True)(kind)


class OtherEvent(JournalEvent):
    """Event of a kind that is not declared, such as a plug-in's, or without a value that its kind needs."""

    name: str = field(kw_only=True)
    """Name of the kind."""

    @property
    def kind(self) -> str:
        return self.name

    @property
    def data(self) -> dict[str, object]:
        return dict(self.extra)


@dataclass(frozen=True, slots=True)
class RecordField:
    """Declaration of a recorded value: `width: Annotated[float, "opening after closing", "m"]`."""

    name: str
    hint: object
    """Type of the value."""
    meaning: str
    unit: str
    """Unit; empty for a value without one."""
    default: object
    """Value of an event that does not give it; MISSING: each event gives it."""

    @property
    def required(self) -> bool:
        """Whether each event gives the value."""
        return self.default is MISSING

    @property
    def text(self) -> str:
        """Meaning with the unit."""
        return f"{self.meaning}, {self.unit}" if self.unit else self.meaning


@cache
def event_fields(declared: type[JournalEvent]) -> tuple[RecordField, ...]:
    """Return the fields that a kind adds to those of every event, in the recorded order."""
    if any(isinstance(value, Field) for kind in declared.__mro__ for value in vars(kind).values()):
        _complete(declared)
    common = get_type_hints(JournalEvent)
    return tuple(each for each in record_fields(declared) if each.name not in common)


def record_fields(record: type) -> tuple[RecordField, ...]:
    """Return the fields of a record in the order of their declaration."""
    hints = get_type_hints(record, include_extras=True)
    if "__dataclass_fields__" in vars(record):
        defaults = {
            each.name: each.default if each.default_factory is MISSING else each.default_factory
            for each in fields(record)
        }
    else:
        defaults = {name: getattr(record, name, MISSING) for name in hints}
    return tuple(
        _record_field(name, hint, defaults[name]) for name, hint in hints.items() if name in defaults
    )


def _record_field(name: str, hint: Any, default: object) -> RecordField:
    words = hint.__metadata__ if get_origin(hint) is Annotated else ()
    meaning, unit = (*words, "", "")[:2]
    return RecordField(name, hint.__origin__ if words else hint, meaning, unit, default)


def _plain(value: object) -> object:
    return [_plain(each) for each in cast("tuple[object, ...]", value)] if isinstance(value, tuple) else value


def _converted(value: object, hint: object) -> object:
    """Return a recorded value as a field's type has it. Raises ValueError when it does not fit."""
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        if value is None or len(get_args(hint)) > 2:
            return value
        return _converted(value, next(arm for arm in get_args(hint) if arm is not types.NoneType))
    if origin is tuple and isinstance(value, list | tuple):
        inner = get_args(hint)[0]
        return tuple(_converted(each, inner) for each in cast("list[object]", value))
    if origin is Literal:
        if value not in get_args(hint):
            raise ValueError(f"{value!r} is not one of {get_args(hint)}")
        return value
    wanted = {float: (int, float), tuple: (list, tuple)}.get(cast("type", origin or hint), origin or hint)
    if not isinstance(value, cast("type", wanted)) or (isinstance(value, bool) and hint is not bool):
        raise ValueError(f"{value!r} is no {hint}")
    return value


@dataclass(frozen=True)
class Plan:
    """Planning request and its answer.

    Older logs lack the fields with a default. The class has no slots: orjson writes those slowly.
    """

    request: Annotated[str, "request to the planner"]
    planner: Annotated[str, "planner that answered"]
    checks: Annotated[int, "number of checked configurations"]
    thinking: Annotated[float, "simulated time charged for the checks", "s"]
    outcome: Annotated[str, "`found`, or the cause of the failure"]
    message: Annotated[str, "answer as a sentence"]
    duration: Annotated[float, "duration of the timed trajectory; 0 without one", "s"]
    path: Annotated[tuple[tuple[float, ...], ...], "waypoints in joint space", "rad"] = ()
    tool_path: Annotated[
        tuple[tuple[float, float, float], ...], "positions of the TCP along the path in the world", "m"
    ] = ()
    start: Annotated[tuple[float, ...], "configuration at the start, also of a failure", "rad"] = ()
    version: Annotated[int, "version of the belief that the plan is based on"] = 0
    length: Annotated[float, "length of the path in joint space", "rad"] = 0.0
    way: Annotated[float, "length of the TCP's path", "m"] = 0.0
    singular: Annotated[
        float, "minimum singular value of the TCP's Jacobian along the path; 0 without a path"
    ] = 0.0


@dataclass(frozen=True)
class StageCount:
    """Number of candidates that reached a stage of a search."""

    name: str
    count: int


@dataclass(frozen=True)
class Candidate:
    """Candidate grasps, or grasps with a place, that dropped out alike; or the accepted one.

    Older logs lack the fields with a default. The class has no slots: orjson writes those slowly.
    """

    name: Annotated[str, "name of the grasp"]
    position: Annotated[Vector3, "position of the TCP in the world when the fingers closed", "m"]
    orientation: Annotated[Quaternion, "orientation of the TCP at closing in the world, quaternion xyzw"]
    score: Annotated[float, "rank, lowest first: seconds with bonuses and penalties", "s"]
    verdict: Annotated[str, "`accepted`, or the reason of the refusal"]
    place: Annotated[str, "first place to which the grasp would have led; empty when none was tried"] = ""
    stage: Annotated[
        str, "stage that the candidate did not pass; for the accepted candidate its last stage"
    ] = ""
    by: Annotated[str, "obstacle: an id of the scene or a part of the robot; empty without one"] = ""
    gap: Annotated[float, "distance to the obstacle, negative for a penetration; 0 when unknown", "m"] = 0.0
    count: Annotated[int, "number of this grasp's places that were rejected for the same reason"] = 1


@dataclass(frozen=True)
class Candidates:
    """Candidate search: number of grasps that reached each stage, and the result of each one."""

    purpose: str
    object: str
    stages: tuple[StageCount, ...]
    tried: tuple[Candidate, ...]
    into: str = ""
    """Bin to which the object was to go."""


@dataclass(frozen=True, slots=True)
class ImageEntry:
    """A camera image, with the results of perception in one line each."""

    image: RgbdImage
    findings: tuple[str, ...] = ()


Entry: TypeAlias = Plan | Candidates | ImageEntry | JournalEvent


class Journal:
    """Entries in the order in which they came; the session takes them away after each tick."""

    def __init__(self) -> None:
        self._entries: list[Entry] = []
        self.items_done = 0
        """Number of items that were placed, in the belief; part of the state."""

    def note(self, entry: Entry) -> None:
        self._entries.append(entry)
        if isinstance(entry, JournalEvent) and entry.kind == "item_done":
            self.items_done += 1

    def take(self) -> tuple[Entry, ...]:
        entries = tuple(self._entries)
        self._entries.clear()
        return entries
