"""Models of files: their base and field types, models of which parts could not be read, and which of
their values name other files.
"""

from __future__ import annotations

import copy
import re
import types
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Final,
    Literal,
    SupportsIndex,
    TypeAlias,
    TypeGuard,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    Strict,
    TypeAdapter,
    WithJsonSchema,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, core_schema

from picktree.files import Location, describe, quantities, suggest_number, suggested

from .document import Document


class InvalidValue(ValueError):
    """Raised by validators: what is wrong, and what would be right."""

    def __init__(self, message: str, hint: str = "", *, code: str) -> None:
        super().__init__(message)
        self.message, self.hint, self.code = message, hint, code


class UnreadPart(Exception):
    """A part of a file that could not be read was touched; the fault is reported already."""


class FileValue:
    """Base of frozen dataclasses that are both the grammar of a mapping in a file and its value.

    Subclasses have slots: an attribute whose part of the file could not be read raises UnreadPart.
    """

    __slots__ = ()
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> object:
            if name in getattr(type(self), "__dataclass_fields__", ()):
                raise UnreadPart(name)
            raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}")


class FileModel(BaseModel):
    """Base of the grammar of mappings whose values have another form: frozen, without unknown keys."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        populate_by_name=True,
        defer_build=True,  # few commands read every kind of file
    )

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> object:
            if name in type(self).model_fields:
                raise UnreadPart(name)
            return super().__getattr__(name)


@dataclass(frozen=True)
class Quantity(BeforeValidator):
    """Reads a number with a unit, and declares it in a JSON Schema under `unit`."""

    unit: str = ""
    bounds: tuple[tuple[str, float], ...] = ()

    def __get_pydantic_json_schema__(self, _: object, __: object) -> dict[str, Any]:
        return {"type": ["string", "number"], "unit": self.unit, **dict(self.bounds)}


def quantity(
    unit: str, *, above: float | None = None, least: float | None = None, most: float | None = None
) -> Quantity:
    """Return the type of a number with a unit: greater than `above`, not under `least`, not over `most`
    (SI)."""

    def read(value: object) -> float:
        if not isinstance(value, str | int | float):
            raise InvalidValue(
                f"{describe(value)} is not a number" + (f" in {unit}" if unit else ""), code="P109"
            )
        try:
            number = quantities.parse_quantity(value, unit)
        except quantities.NotFinite as error:
            raise InvalidValue(str(error), code="P120") from None
        except ValueError as error:
            meant = suggest_number(value)
            message = f"{describe(value)} is not a number" if meant else str(error)
            meant = meant or (suggested(value, unit) if isinstance(value, str) else "")
            raise InvalidValue(message, meant, code="P109") from None
        written = value if isinstance(value, str) else f"{value} {unit}".strip()
        what = quantities.dimension(unit) or "it"
        if number < 0 and (above == 0 or least == 0):
            hint = f"{what} is {'positive' if above == 0 else '0 or more'} here"
            raise InvalidValue(f"{written} is negative", hint, code="P107")
        if number == 0 and above == 0:
            raise InvalidValue(f"{written} is not positive", code="P107")
        if above is not None and number <= above:
            raise InvalidValue(
                f"{written} is not more than {quantities.in_unit(above, unit, written)}", code="P107"
            )
        if least is not None and number < least:
            raise InvalidValue(
                f"{written} is less than {quantities.in_unit(least, unit, written)}", code="P107"
            )
        if most is not None and number > most:
            meant = _smaller_unit(value, unit, above, least, most)
            raise InvalidValue(
                f"{written} is more than {quantities.in_unit(most, unit, written)}", meant, code="P107"
            )
        return number

    given = {"exclusiveMinimum": above, "minimum": least, "maximum": most}
    bounds = tuple((key, bound) for key, bound in given.items() if bound is not None)
    return Quantity(read, float | str, unit, bounds)


_SMALLER_UNITS: Final = {"rad": "deg", "kg": "g", "m": "mm", "s": "ms"}


def _smaller_unit(
    value: str | int | float, unit: str, above: float | None, least: float | None, most: float
) -> str:
    """Return the hint that a bare number was meant in a smaller unit, where it is within the bounds so."""
    smaller = _SMALLER_UNITS.get(unit)
    if isinstance(value, str) or smaller is None:
        return ""
    meant = f"{value} {smaller}"
    number = quantities.parse_quantity(meant, unit)
    fits = number <= most and (above is None or number > above) and (least is None or number >= least)
    return f"write {meant}" if fits else ""


@dataclass(frozen=True, slots=True)
class ReadAs:
    """Mark of a value that a file gives in another form: `value` converts what was read as `form`."""

    form: Any
    value: Callable[[Any], object]

    def __get_pydantic_core_schema__(self, _: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.value, handler.generate_schema(self.form))


@dataclass(frozen=True)
class ShortForm(BeforeValidator):
    """Reads a bare value as a mapping with one key."""

    key: str = ""


def as_mapping(key: str, given: object) -> ShortForm:
    """Return the short form of a mapping with one key: its bare value. `given` is the type of bare values."""

    def wrap(value: object) -> object:
        if value is None or isinstance(value, dict | FileModel):
            return cast("object", value)
        return {key: value}

    return ShortForm(wrap, given, key)


def check_name(value: str) -> str:
    """Return a valid name. Raises InvalidValue."""
    if re.fullmatch(r"[A-Za-z_]\w*", value, re.ASCII) is None:
        hint = "letters, digits and _, not beginning with a digit"
        raise InvalidValue(f"{describe(value)} is not a name", hint, code="P111")
    return value


_NAME_FORM = {"type": "string", "pattern": r"^[A-Za-z_][A-Za-z0-9_]*(?![\s\S])"}
Name = Annotated[str, AfterValidator(check_name), WithJsonSchema(_NAME_FORM)]
Flag = Annotated[bool, Strict()]
Length = Annotated[float, quantity("m")]
Size = Annotated[float, quantity("m", above=0, most=100)]
Angle = Annotated[float, quantity("rad")]
Duration = Annotated[float, quantity("s", least=0)]
Mass = Annotated[float, quantity("kg", above=0)]
ItemMass = Annotated[float, quantity("kg", above=0, most=20)]
"""Mass of an item for an arm on a table."""
Force = Annotated[float, quantity("N", above=0)]
Share = Annotated[float, quantity("", least=0, most=1)]
Vector = tuple[Length, Length, Length]
Angles = tuple[Angle, Angle, Angle]
Sizes = tuple[Size, Size, Size]


class _Hole:
    """Stands where an entry of a list or mapping could not be read."""


_HOLE: Final = _Hole()


class PartialMap(dict[str, Any]):
    """A mapping with holes: all its keys are known, not all its values."""

    def __getitem__(self, key: str) -> object:
        return _whole(super().__getitem__(key))

    def get(self, key: str, default: object = None) -> object:
        return _whole(super().get(key, default))

    def items(self) -> Any:
        _all_whole(super().values())
        return super().items()

    def values(self) -> Any:
        _all_whole(super().values())
        return super().values()


class PartialList(tuple[Any, ...]):
    """A list with holes: its length is known, not all its entries."""

    __slots__ = ()

    def __getitem__(self, index: SupportsIndex | slice) -> Any:
        return _whole(super().__getitem__(index))

    def __iter__(self) -> Iterator[Any]:
        return (_whole(value) for value in super().__iter__())


def _whole(value: Any) -> Any:
    if value is _HOLE:
        raise UnreadPart
    return value


def _all_whole(values: Collection[object]) -> None:
    for value in values:
        _whole(value)


AnyModel: TypeAlias = BaseModel | FileValue
Model = TypeVar("Model", bound=AnyModel)


def is_model(kind: object) -> TypeGuard[type[AnyModel]]:
    return isinstance(kind, type) and issubclass(kind, (BaseModel, FileValue))


@cache
def model_fields(model: type[AnyModel]) -> Mapping[str, FieldInfo]:
    """Return the fields of a model by attribute; `alias` is the key in files where it differs."""
    if issubclass(model, BaseModel):
        return model.model_fields
    hints = get_type_hints(model, include_extras=True)
    return {
        each.name: FieldInfo.from_annotation(hints[each.name])
        if each.default is each.default_factory  # both are MISSING
        else FieldInfo.from_annotated_attribute(
            hints[each.name],
            Field(default_factory=each.default_factory) if each.default is MISSING else each.default,
        )
        for each in cast("Iterable[Any]", fields(cast("Any", model)))
    }


def keys_of(model: type[AnyModel]) -> list[str]:
    """Return the keys of a model in files."""
    return [field.alias or name for name, field in model_fields(model).items()]


def read_model(model: type[Model], value: object) -> Model:
    """Return the model of a file's data. Raises pydantic's ValidationError."""
    return _adapter(model).validate_python(value)


def partial_model(model: type[Model], value: object, faulty: Collection[Location]) -> Model:
    """Return the model of `value` without the parts in `faulty` (pydantic's places)."""
    found: dict[str, object] = {}
    for name, field in model_fields(model).items():
        key = field.alias or name
        below = _below(faulty, key)
        if not isinstance(value, dict):
            continue
        if key not in value:
            if not field.is_required():
                found[name] = field.get_default(call_default_factory=True)
        else:
            part = _part(declared_type(field), cast("dict[str, object]", value)[key], below)
            if part is not _HOLE:
                found[name] = part
    if issubclass(model, FileValue):
        empty = object.__new__(model)
        for name, part in found.items():
            object.__setattr__(empty, name, part)
        return cast("Model", empty)
    made = model.model_construct(None, **found)
    for name in model.model_fields.keys() - found.keys():
        if name in vars(made):  # model_construct fills in the default of what is faulty
            object.__delattr__(made, name)
    return made


def _below(faulty: Collection[Location], key: str | int) -> list[Location]:
    return [loc[1:] for loc in faulty if loc[:1] == (key,)]


def _part(annotation: object, value: object, faulty: Sequence[Location]) -> object:
    """Validate a value against an annotation; return _HOLE when no part of it could be read."""
    if not faulty:
        return _adapter(annotation).validate_python(value)
    if () in faulty or _converted(annotation):
        return _HOLE
    kind = bare(annotation)
    origin, parts = get_origin(kind), get_args(kind)
    if is_model(kind):
        return partial_model(kind, cast("object", value), faulty) if isinstance(value, dict) else _HOLE
    if origin is dict and isinstance(value, dict):
        given = cast("dict[str, object]", value)
        return PartialMap({key: _part(parts[1], item, _below(faulty, key)) for key, item in given.items()})
    if origin in (list, tuple) and isinstance(value, list):
        entries = cast("list[object]", value)
        kinds = [parts[0]] * len(entries) if origin is list or Ellipsis in parts else list(parts)
        if len(kinds) == len(entries):
            each = (
                _part(k, item, _below(faulty, n))
                for n, (k, item) in enumerate(zip(kinds, entries, strict=True))
            )
            return PartialList(each)
    return _HOLE


def declared_type(field: FieldInfo) -> object:
    """Return a field's annotation with its metadata."""
    return Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation


@cache
def _adapter(annotation: Any) -> TypeAdapter[Any]:
    return TypeAdapter[Any](annotation)


def _converted(annotation: object) -> bool:
    return any(isinstance(mark, ReadAs) for _, marks in _alternatives(annotation) for mark in marks)


def bare(annotation: object) -> object:
    """Return an annotation without `Annotated` and `| None`, in the form of files."""
    while True:
        origin, parts = get_origin(annotation), get_args(annotation)
        if origin is Annotated:
            annotation = next((mark.form for mark in parts if isinstance(mark, ReadAs)), parts[0])
        elif origin in (Union, types.UnionType):
            annotation = next(p for p in parts if p is not type(None))
        else:
            return annotation


FileRole: TypeAlias = Literal["mesh", "mesh folder", "robot", "scene", "urdf"]


@dataclass(frozen=True, slots=True)
class NamedFile:
    """Mark of a text that names another file, of that role."""

    role: FileRole


@dataclass(frozen=True, slots=True)
class FileName:
    """A name of another file in a document."""

    loc: Location
    role: FileRole
    text: str


def file_names(model: type[AnyModel], data: object) -> Iterator[FileName]:
    """Yield the names of other files in a document's data, in any of their forms."""
    for pattern, role in _forms(model):
        for loc, value in _matching(pattern, data, ()):
            if isinstance(value, str):
                yield FileName(loc, role, value)


def located(document: Document, model: type[AnyModel], known: Collection[str] = ()) -> tuple[FileName, ...]:
    """Return the names of other files in a document, each as its path. `known`: names that are no files."""
    return tuple(
        replace(name, text=str(path_of(document, name.loc, name.text)))
        for name in file_names(model, document.data)
        if name.text not in known
    )


def path_of(document: Document, loc: Location, text: str) -> Path:
    """Return the path of a file that is named at `loc`, in the document or a layer of it."""
    return Path(document.mark(loc).file).parent / text


def renamed(data: Mapping[str, Any], names: Mapping[Location, str]) -> dict[str, Any]:
    """Return a copy of a document's data that has other texts at these places."""
    made = copy.deepcopy(dict(data))
    for loc, text in names.items():
        parent: Any = made
        for part in loc[:-1]:
            parent = parent[part]
        parent[loc[-1]] = text
    return made


def _matching(pattern: Location, value: object, loc: Location) -> Iterator[tuple[Location, object]]:
    """Yield location and value of each match of a pattern; `*` matches every key or index."""
    if not pattern:
        yield loc, value
        return
    part, *rest = pattern
    if isinstance(value, dict):
        given = cast("dict[str, object]", value)
        found: Iterable[tuple[str | int, object]] = (
            given.items() if part == "*" else [(part, given.get(str(part)))]
        )
    elif isinstance(value, list) and part == "*":
        found = enumerate(cast("list[object]", value))
    else:
        found = ()
    for key, inner in found:
        yield from _matching(tuple(rest), inner, (*loc, key))


@cache
def _forms(model: type[AnyModel]) -> tuple[tuple[Location, FileRole], ...]:
    """Return pattern and role of each place at which a grammar lets a document name a file."""
    return tuple(dict.fromkeys(_marked(model, (), ())))


def _marked(kind: Any, loc: Location, above: tuple[object, ...]) -> Iterator[tuple[Location, FileRole]]:
    for one, marks in _alternatives(kind):
        for mark in marks:
            if one is str and isinstance(mark, NamedFile):
                yield loc, mark.role
        for inner in _short_forms(one, marks):
            yield from _marked(inner, loc, above)
        for key, inner in () if one in above else _fields(one):
            yield from _marked(inner, (*loc, key), (*above, one))
        for inner in _entries(one):
            yield from _marked(inner, (*loc, "*"), above)


def _alternatives(kind: Any, marks: tuple[object, ...] = ()) -> Iterator[tuple[Any, tuple[object, ...]]]:
    """Yield the members of an annotation, each with its metadata in `Annotated`."""
    while get_origin(kind) is Annotated:
        kind, *more = get_args(kind)
        kind = next((mark.form for mark in more if isinstance(mark, ReadAs)), kind)
        marks = (*marks, *more)
    if get_origin(kind) in (Union, types.UnionType):
        for part in get_args(kind):
            yield from _alternatives(part, marks)
    else:
        yield kind, marks


def _fields(kind: Any) -> Iterator[tuple[str, Any]]:
    """Yield keys and annotations of a model; nothing of another type."""
    if is_model(kind):
        for name, field in model_fields(kind).items():
            yield field.alias or name, declared_type(field)


def _short_forms(kind: Any, marks: tuple[object, ...]) -> Iterator[Any]:
    """Yield the annotation of each key whose bare value is a short form of the mapping."""
    keys = [mark.key for mark in marks if isinstance(mark, ShortForm)]
    yield from (inner for name, inner in _fields(kind) if name in keys)


def _entries(kind: Any) -> Iterator[Any]:
    """Yield the annotations of the values of a container, each once; nothing of another type."""
    if get_origin(kind) in (dict, list, tuple):
        parts = get_args(kind)[1:] if get_origin(kind) is dict else get_args(kind)
        yield from dict.fromkeys(part for part in parts if part is not Ellipsis)
