"""Names of other files in a file: which values of a grammar are such names, and where a document has them.

A field that names a file is `Annotated[str, NamedFile("mesh")]`. What archives a run's files goes by these
marks, so a new field needs nothing else.
"""

from __future__ import annotations

import copy
import types
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, Union, cast, get_args, get_origin

from pydantic import BaseModel

from ..marks import Location
from .document import Document
from .file_models import ShortForm, declared_type

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


def file_names(model: type[BaseModel], data: object) -> Iterator[FileName]:
    """Yield the names of other files in a document's data, in whatever form they are written."""
    for pattern, role in _forms(model):
        for loc, value in _matching(pattern, data, ()):
            if isinstance(value, str):
                yield FileName(loc, role, value)


def located(document: Document, model: type[BaseModel], known: Collection[str] = ()) -> tuple[FileName, ...]:
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
    """Yield place and value of what stands where a pattern leads; `*` is each key or index."""
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
def _forms(model: type[BaseModel]) -> tuple[tuple[Location, FileRole], ...]:
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
    """Yield the members of an annotation, each with what `Annotated` says of it."""
    while get_origin(kind) is Annotated:
        kind, *more = get_args(kind)
        marks = (*marks, *more)
    if get_origin(kind) in (Union, types.UnionType):
        for part in get_args(kind):
            yield from _alternatives(part, marks)
    else:
        yield kind, marks


def _fields(kind: Any) -> Iterator[tuple[str, Any]]:
    """Yield keys and annotations of a model; nothing of another type."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        for name, field in kind.model_fields.items():
            yield field.alias or name, declared_type(field)


def _short_forms(kind: Any, marks: tuple[object, ...]) -> Iterator[Any]:
    """Yield the annotation of the key for which a bare value may stand."""
    keys = [mark.key for mark in marks if isinstance(mark, ShortForm)]
    yield from (inner for name, inner in _fields(kind) if name in keys)


def _entries(kind: Any) -> Iterator[Any]:
    """Yield the annotations of the values of a container, each once; nothing of another type."""
    if get_origin(kind) in (dict, list, tuple):
        parts = get_args(kind)[1:] if get_origin(kind) is dict else get_args(kind)
        yield from dict.fromkeys(part for part in parts if part is not Ellipsis)
