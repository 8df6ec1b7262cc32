"""Checking a document against pydantic models, with sentences and places of our own.

Each `kind` of file reads its parts through one `Checker`, which gathers every fault before it complains.
"""

from __future__ import annotations

import re
import types
from collections.abc import Collection, Mapping
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin

import pydantic
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Strict

from .document import Document, Fault, FileError, Location
from .nearest import nearest
from .quantities import dimension, parse_quantity

HEADER = ("picktree", "kind")


class FileModel(BaseModel):
    """Base of all models of files: frozen, and refuses keys that it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class Wrong(ValueError):
    """Raised by validators: what is wrong, and what would be right."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


def quantity(
    unit: str, *, above: float | None = None, least: float | None = None, most: float | None = None
) -> BeforeValidator:
    """A number with a unit: greater than `above`, not under `least`, not over `most` (SI)."""

    def read(value: object) -> float:
        if not isinstance(value, str | int | float):
            raise Wrong(f"{describe(value)} is not a number" + (f" in {unit}" if unit else ""))
        try:
            number = parse_quantity(value, unit)
        except ValueError as error:
            raise Wrong(str(error)) from None
        written = value if isinstance(value, str) else f"{value} {unit}".strip()
        what = dimension(unit) or "it"
        if number < 0 and (above == 0 or least == 0):
            raise Wrong(
                f"{written} is negative", f"{what} is {'positive' if above == 0 else '0 or more'} here"
            )
        if number == 0 and above == 0:
            raise Wrong(f"{written} is not positive")
        if above is not None and number <= above:
            raise Wrong(f"{written} is not more than {_amount(above, unit)}")
        if least is not None and number < least:
            raise Wrong(f"{written} is less than {_amount(least, unit)}")
        if most is not None and number > most:
            raise Wrong(f"{written} is more than {_amount(most, unit)}")
        return number

    return BeforeValidator(read, json_schema_input_type=float | str)


def _amount(number: float, unit: str) -> str:
    return f"{number:g} {unit}".strip()


def _identifier(value: str) -> str:
    if re.fullmatch(r"[A-Za-z_]\w*", value, re.ASCII) is None:
        raise Wrong(f"{value!r} is not a name", "letters, digits and _, not beginning with a digit")
    return value


Name = Annotated[str, AfterValidator(_identifier)]
Flag = Annotated[bool, Strict()]
Length = Annotated[float, quantity("m")]
Size = Annotated[float, quantity("m", above=0, most=100)]
Angle = Annotated[float, quantity("rad")]
Duration = Annotated[float, quantity("s", least=0)]
Mass = Annotated[float, quantity("kg", above=0)]
Force = Annotated[float, quantity("N", above=0)]
Share = Annotated[float, quantity("", least=0, most=1)]
Vector = tuple[Length, Length, Length]
Angles = tuple[Angle, Angle, Angle]
Sizes = tuple[Size, Size, Size]

Model = TypeVar("Model", bound=BaseModel)


class Checker:
    """Reads parts of one document and keeps what is wrong with them."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.faults: list[Fault] = []

    def fault(self, loc: Location, message: str, hint: str = "", *, key: bool = False) -> None:
        self.faults.append(self.document.fault(loc, message, hint, key=key))

    def keys(self, known: Collection[str]) -> None:
        """Refuse unknown keys at the top of the file."""
        for name in self.document.data:
            if name not in known and name not in HEADER:
                self.fault((name,), f"unknown key {name!r}", nearest(name, known), key=True)

    def read(
        self, model: type[Model], loc: Location = (), *, ignore: Collection[str] = HEADER
    ) -> Model | None:
        """The model of the mapping at `loc`, None when it has faults; `ignore` leaves out keys at the top."""
        value = self.document.get(loc)
        if not loc and isinstance(value, dict):
            value = {k: v for k, v in value.items() if k not in ignore}
        try:
            return model.model_validate(value)
        except pydantic.ValidationError as error:
            details = [detail for detail in error.errors() if not _follows(detail)]
            self.faults += [_fault(self.document, model, loc, detail) for detail in details]
            return None

    def each(self, model: type[Model], section: str) -> dict[str, Model | None]:
        """The models of a mapping's values by key; None where a value is faulty."""
        value = self.document.get((section,))
        if value is None:
            return {}
        if not isinstance(value, dict):
            self.fault((section,), f"a mapping from names is wanted, not {describe(value)}")
            return {}
        for name in value:
            try:
                _identifier(name)
            except Wrong as wrong:
                self.fault((section, name), wrong.message, wrong.hint, key=True)
        return {name: self.read(model, (section, name)) for name in value}

    def sequence(self, model: type[Model], section: str) -> list[Model | None]:
        """The models of a list's entries, None where one is faulty."""
        value = self.document.get((section,))
        if value is None:
            return []
        if not isinstance(value, list):
            self.fault((section,), f"a list is wanted, not {describe(value)}")
            return []
        return [self.read(model, (section, n)) for n in range(len(value))]

    def one_of(self, loc: Location, keys: Collection[str]) -> str | None:
        """Which of the keys the mapping at `loc` has; a fault unless it is exactly one."""
        value = self.document.get(loc)
        given = [k for k in keys if isinstance(value, dict) and value.get(k) is not None]
        if len(given) == 1:
            return given[0]
        message = f"only one of {', '.join(given)} may be given"
        if not given:
            message = f"one of {', '.join(keys)} is missing"
        self.fault(loc, message, key=True)
        return None

    def finish(self) -> None:
        """Raises FileError when anything was wrong."""
        if self.faults:
            raise FileError(self.faults)


def describe(value: object) -> str:
    """A value as a fault names it: `'yes'`, `3`, `a list`, `nothing`."""
    match value:
        case None:
            return "nothing"
        case bool():
            return str(value).lower()
        case int() | float():
            return f"{value}"
        case str():
            return repr(value if len(value) <= 40 else value[:37] + "...")
        case list() | tuple():
            return "a list"
        case _:
            return "a mapping"


def _follows(detail: Any) -> bool:
    """A list that pydantic calls too short only because it left out its faulty entries."""
    context = cast("Mapping[str, object]", detail.get("ctx") or {})
    least, given = context.get("min_length"), detail.get("input")
    return (
        isinstance(least, int)
        and isinstance(given, list | dict)
        and len(cast("list[object]", given)) >= least
    )


def _fault(document: Document, model: type[BaseModel], base: Location, detail: Any) -> Fault:
    path: Location = tuple(detail["loc"])
    wrong_key = bool(path) and path[-1] == "[key]"
    path = path[:-1] if wrong_key else path
    loc = (*base, *path)
    kind, given = str(detail["type"]), detail.get("input")
    context = cast("Mapping[str, object]", detail.get("ctx") or {})
    cause = context.get("error")
    if isinstance(cause, Wrong):
        return document.fault(loc, cause.message, cause.hint, key=wrong_key)
    match kind:
        case "extra_forbidden":
            known = _keys(_annotation(model, path[:-1]))
            name = str(path[-1])
            return document.fault(loc, f"unknown key {name!r}", nearest(name, known), key=True)
        case "missing" if isinstance(path[-1], str):
            return document.fault(loc[:-1], f"{path[-1]!r} is missing", key=True)
        case "missing" | "too_long" | "too_short":
            at = path[:-1] if kind == "missing" else path
            return document.fault((*base, *at), _length(model, at, document.get((*base, *at)), context))
        case "literal_error":
            choices = [str(c) for c in get_args(_annotation(model, path))]
            return document.fault(loc, f"{describe(given)} is not known here", nearest(str(given), choices))
        case _:
            message = f"{_wanted(kind, context)} is wanted, not {describe(given)}"
            return document.fault(loc, message, key=wrong_key)


_WANTED = {
    "string_type": "a text",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_parsing_size": "a whole number of sensible size",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "dataclass_type": "a mapping",
    "finite_number": "a finite number",
}
_BOUNDS = {
    "greater_than": ("gt", "more than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


def _wanted(kind: str, context: Mapping[str, object]) -> str:
    if kind in _BOUNDS:
        key, words = _BOUNDS[kind]
        return f"{words} {context.get(key)}"
    return _WANTED.get(kind, kind.replace("_", " "))


def _length(model: type[BaseModel], path: Location, value: object, context: Mapping[str, object]) -> str:
    parts = get_args(_annotation(model, path))
    given = len(cast("list[object]", value)) if isinstance(value, list) else 0
    if parts and Ellipsis not in parts and get_origin(_annotation(model, path)) is tuple:
        return f"{len(parts)} values are wanted, not {given}"
    if "min_length" in context:
        return f"at least {context['min_length']} is wanted, not {given}"
    return f"at most {context.get('max_length')} are wanted, not {given}"


def _annotation(model: object, path: Location) -> object:
    """The declared type of the value at `path` below a model."""
    here = _bare(model)
    for part in path:
        origin, parts = get_origin(here), get_args(here)
        if isinstance(here, type) and issubclass(here, BaseModel):
            fields = {f.alias or name: f for name, f in here.model_fields.items()}
            field = fields.get(str(part))
            here = _bare(field.annotation) if field else None
        elif origin is dict:
            here = _bare(parts[1])
        elif origin in (list, tuple) and parts:
            index = part if isinstance(part, int) and Ellipsis not in parts and part < len(parts) else 0
            here = _bare(parts[index])
        else:
            return None
    return here


def _bare(annotation: object) -> object:
    """Without `Annotated` and `| None`."""
    while True:
        origin, parts = get_origin(annotation), get_args(annotation)
        if origin is Annotated:
            annotation = parts[0]
        elif origin in (Union, types.UnionType):
            annotation = next(p for p in parts if p is not type(None))
        else:
            return annotation


def _keys(annotation: object) -> list[str]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [field.alias or name for name, field in annotation.model_fields.items()]
    return [str(p) for p in get_args(annotation)] if get_origin(annotation) is Literal else []
