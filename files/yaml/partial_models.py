"""Models of files that are faulty in places: what could be read is there, the rest says so when touched.

Faults of form and faults of meaning come in one round: a scene with a bad mass still says which bins it has.
"""

from __future__ import annotations

import types
from collections.abc import Collection, Iterator, Sequence
from functools import cache
from typing import (
    Annotated,
    Any,
    Final,
    SupportsIndex,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
)

from pydantic import BaseModel, TypeAdapter
from pydantic.fields import FieldInfo

from ..marks import Location
from .field_types import UnreadPart


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


Model = TypeVar("Model", bound=BaseModel)


def partial_model(model: type[Model], value: object, faulty: Collection[Location]) -> Model:
    """The model of `value`, of which the parts in `faulty` (pydantic's places) could not be read."""
    found: dict[str, object] = {}
    for name, field in model.model_fields.items():
        key = field.alias or name
        below = _below(faulty, key)
        if not isinstance(value, dict):
            continue
        if key not in value:
            if not field.is_required():
                found[name] = field.get_default(call_default_factory=True)
        else:
            part = _part(_declared(field), cast("dict[str, object]", value)[key], below)
            if part is not _HOLE:
                found[name] = part
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
    if () in faulty:
        return _HOLE
    kind = bare(annotation)
    origin, parts = get_origin(kind), get_args(kind)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
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


def _declared(field: FieldInfo) -> object:
    """The field's annotation with its metadata, as it was written."""
    return Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation


@cache
def _adapter(annotation: Any) -> TypeAdapter[Any]:
    return TypeAdapter[Any](annotation)


def bare(annotation: object) -> object:
    """An annotation without `Annotated` and `| None`."""
    while True:
        origin, parts = get_origin(annotation), get_args(annotation)
        if origin is Annotated:
            annotation = parts[0]
        elif origin in (Union, types.UnionType):
            annotation = next(p for p in parts if p is not type(None))
        else:
            return annotation
