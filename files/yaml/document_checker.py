"""Check of a document against pydantic models: values, and faults with places and sentences of our own."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from contextlib import AbstractContextManager, suppress
from typing import Any, Literal, TypeVar, cast, get_args, get_origin

import pydantic

from picktree.files import (
    MAX_FAULTS,
    SPOILING_CODES,
    CheckedFile,
    Diagnostic,
    Location,
    Severity,
    describe,
    listed,
    suggest_boolean,
    suggest_name,
    suggest_number,
    too_many,
)

from .document import Document
from .file_models import (
    AnyModel,
    InvalidValue,
    Model,
    UnreadPart,
    bare,
    check_name,
    declared_type,
    is_model,
    keys_of,
    model_fields,
    partial_model,
    read_model,
)
from .syntax_faults import structure_hint

HEADER = ("picktree", "kind")
MAX_ENTRIES = 1000
"""Maximum number of entries of a section."""

T = TypeVar("T")


class DocumentChecker:
    """Checker of one document: reads its parts and collects their faults.

    Faulty parts are left out of the result. Checks that need complete parts belong under `readable()`.
    """

    def __init__(self, document: Document) -> None:
        self.document = document
        self.faults: list[Diagnostic] = list(document.faults)
        self._spoilt = {fault.mark for fault in document.faults if fault.code in SPOILING_CODES}

    @property
    def full(self) -> bool:
        """Whether the number of faults exceeds MAX_FAULTS."""
        return len(self.faults) > MAX_FAULTS

    def readable(self) -> AbstractContextManager[None]:
        """Return a context that ends silently where its code needs a part that could not be read."""
        return suppress(UnreadPart)

    def fault(
        self,
        loc: Location,
        message: str,
        hint: str = "",
        *,
        code: str,
        key: bool = False,
        character: int | None = None,
        severity: Severity = "error",
    ) -> None:
        """Record a fault, with the arguments of `Document.fault`."""
        made = self.document.fault(
            loc, message, hint, code=code, key=key, character=character, severity=severity
        )
        self._add(made)

    def _add(self, fault: Diagnostic) -> None:
        if fault.mark in self._spoilt or self.full:
            return
        self.faults.append(fault if len(self.faults) < MAX_FAULTS else too_many(fault.mark))

    def keys(self, known: Collection[str]) -> None:
        """Refuse unknown keys at the top of the file."""
        for name in self.document.data:
            if name not in known and name not in HEADER and not self.full:
                self.fault(
                    (name,), f"unknown key {describe(name)}", suggest_name(name, known), code="P104", key=True
                )

    def read(
        self,
        model: type[Model],
        loc: Location = (),
        *,
        ignore: Collection[str] | None = None,
        needed: Collection[str] = (),
    ) -> Model:
        """Return the model of the mapping at `loc`, as far as it can be read.

        `ignore`: keys that are left out, at the top the header unless given. `needed`: keys whose absence the
        caller reports.
        """
        value = self.document.get(loc)
        left_out = frozenset(() if loc else HEADER) if ignore is None else frozenset(ignore)
        if isinstance(value, dict):
            value = {k: v for k, v in value.items() if k not in left_out}
        try:
            return read_model(model, value)
        except pydantic.ValidationError as error:
            details = [detail for detail in error.errors(include_url=False) if not _follows(detail)]
            reported = [
                d for d in details if d["type"] != "missing" or d["loc"] not in {(k,) for k in needed}
            ]
            for detail in reported[: MAX_FAULTS + 1]:
                self._add(_to_diagnostic(self.document, model, loc, detail))
            places = [tuple(part for part in d["loc"] if part != "[key]") for d in details]
            return partial_model(model, value, places)

    def each(self, model: type[Model], section: str, *, most: int = MAX_ENTRIES) -> dict[str, Model]:
        """Return the models of a mapping's values by key, without unreadable parts."""
        value = self.document.get((section,))
        if value is None:
            return {}
        if not isinstance(value, dict):
            message = f"a mapping from names is wanted, not {describe(value)}"
            self.fault((section,), message, code="P106")
            return {}
        if self._too_many(section, len(value), most):
            return {}
        for name in value:
            try:
                check_name(name)
            except InvalidValue as wrong:
                self.fault((section, name), wrong.message, wrong.hint, code=wrong.code, key=True)
        return {name: self.read(model, (section, name)) for name in value if not self.full}

    def sequence(self, model: type[Model], section: str, *, most: int = MAX_ENTRIES) -> list[Model]:
        """Return the models of a list's entries, without unreadable parts."""
        return [self.read(model, loc) for loc in self.places(section, most=most) if not self.full]

    def places(self, section: str, *, most: int = MAX_ENTRIES) -> list[Location]:
        """Return the places of a list's entries."""
        value = self.document.get((section,))
        if value is None:
            return []
        if not isinstance(value, list):
            self.fault((section,), f"a list is wanted, not {describe(value)}", code="P106")
            return []
        if self._too_many(section, len(value), most):
            return []
        return [(section, n) for n in range(len(value))]

    def _too_many(self, section: str, number: int, most: int) -> bool:
        if number > most:
            message = f"at most {most} entries are wanted, not {number}"
            self.fault((section,), message, code="P110", key=True)
        return number > most

    def one_of(self, loc: Location, keys: Collection[str]) -> str | None:
        """Return the one key of `keys` that the mapping at `loc` has; record a fault unless it has exactly
        one."""
        value = self.document.get(loc)
        if not isinstance(value, dict):
            return None  # reported already
        given = [key for key in keys if value.get(key) is not None]
        if len(given) == 1:
            return given[0]
        if given:
            message = f"{listed(map(repr, given))} exclude each other"
            self.fault(loc, message, "give one of them", code="P112", key=True)
        else:
            self.fault(loc, f"{listed(map(repr, keys), last='or')} is missing", code="P105", key=True)
        return None

    def written(self, loc: Location, number: float, unit: str) -> str:
        """Return a quantity in the words of the file."""
        value = self.document.get(loc)
        return value if isinstance(value, str) else f"{number:g} {unit}".strip()

    def result(self, value: Callable[[], T]) -> CheckedFile[T]:
        """Return the result of the check; `value` is called when there are no errors."""
        failed = any(fault.severity == "error" for fault in self.faults)
        return CheckedFile(None if failed else value(), tuple(self.faults))


def _follows(detail: Any) -> bool:
    """Whether the fault only follows from others: pydantic calls a list too short without its faulty
    entries."""
    context = cast("Mapping[str, object]", detail.get("ctx") or {})
    least, given = context.get("min_length"), detail.get("input")
    return (
        isinstance(least, int)
        and isinstance(given, list | dict)
        and len(cast("list[object]", given)) >= least
    )


def _to_diagnostic(document: Document, model: type[AnyModel], base: Location, detail: Any) -> Diagnostic:
    """Return the fault of one of pydantic's errors; `base` is the location of the model's value."""
    path: Location = tuple(detail["loc"])
    wrong_key = bool(path) and path[-1] == "[key]"
    path = path[:-1] if wrong_key else path
    loc = (*base, *path)
    kind, given = str(detail["type"]), detail.get("input")
    context = cast("Mapping[str, object]", detail.get("ctx") or {})
    cause = context.get("error")
    if isinstance(cause, InvalidValue):
        return document.fault(loc, cause.message, cause.hint, code=cause.code, key=wrong_key)
    match kind:
        case "extra_forbidden" | "unexpected_keyword_argument":
            known = _keys(_annotation(model, path[:-1]))
            message = f"unknown key {describe(str(path[-1]))}"
            return document.fault(loc, message, suggest_name(str(path[-1]), known), code="P104", key=True)
        case "missing" if isinstance(path[-1], str):
            return document.fault(loc[:-1], f"{path[-1]!r} is missing", code="P105", key=True)
        case "missing" | "too_long" | "too_short":
            at = path[:-1] if kind == "missing" else path
            message = _length(model, at, document.get((*base, *at)), context)
            return document.fault((*base, *at), message, code="P110")
        case "literal_error":
            choices = [str(c) for c in get_args(_annotation(model, path))]
            hint = (
                suggest_name(str(given), choices)
                if isinstance(given, str)
                else f"one of {', '.join(choices)}"
            )
            return document.fault(loc, f"{describe(given)} is not known here", hint, code="P108")
        case _ if kind in _BOUNDS:
            key, words = _BOUNDS[kind]
            message = f"{words} {context.get(key)} is wanted, not {describe(given)}"
            return document.fault(loc, message, code="P107", key=wrong_key)
        case "finite_number" | "int_parsing_size":
            message = f"a number of sensible size is wanted, not {describe(given)}"
            return document.fault(loc, message, code="P120", key=wrong_key)
        case _:
            wanted = _WANTED.get(kind, kind.replace("_", " "))
            message = f"{wanted} is wanted, not {describe(given)}"
            return document.fault(loc, message, _suggestion(kind, given), code="P106", key=wrong_key)


_WANTED = {
    "string_type": "a text",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "dataclass_type": "a mapping",
}
_BOUNDS = {
    "greater_than": ("gt", "more than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


def _suggestion(kind: str, given: object) -> str:
    if kind.startswith("bool"):
        return suggest_boolean(given)
    if kind.startswith(("int", "float")):
        return suggest_number(given)
    if kind in ("list_type", "tuple_type"):
        return _listed_hint(given)
    if kind in ("dict_type", "model_type", "dataclass_type"):
        if isinstance(given, list):
            return "its keys are written without a '-'"
        return structure_hint(given) if isinstance(given, str) else ""
    return "quote it" if kind == "string_type" and isinstance(given, int | float) else ""


def _listed_hint(given: object) -> str:
    """Return a hint on the form of a list for a value that lacks brackets or dashes."""
    if isinstance(given, dict):
        return "each entry of a list begins with '- '"
    if isinstance(given, str) and len(given) <= 60:
        hint = structure_hint(given)
        return hint or f"write [{', '.join(re.split(r'[,;] *| +', given.strip()))}]"
    return f"write [{describe(given)}]" if isinstance(given, int | float) else ""


def _length(model: type[AnyModel], path: Location, value: object, context: Mapping[str, object]) -> str:
    parts = get_args(_annotation(model, path))
    given = len(cast("list[object]", value)) if isinstance(value, list) else 0
    if parts and Ellipsis not in parts and get_origin(_annotation(model, path)) is tuple:
        return f"{len(parts)} values are wanted, not {given}"
    if "min_length" in context:
        return f"at least {context['min_length']} is wanted, not {given}"
    return f"at most {context.get('max_length')} are wanted, not {given}"


def _annotation(model: object, path: Location) -> object:
    """Return the declared type of the value at `path` below a model."""
    here = bare(model)
    for part in path:
        origin, parts = get_origin(here), get_args(here)
        if is_model(here):
            fields = {f.alias or name: f for name, f in model_fields(here).items()}
            field = fields.get(str(part))
            here = bare(declared_type(field)) if field else None
        elif origin is dict:
            here = bare(parts[1])
        elif origin in (list, tuple) and parts:
            index = part if isinstance(part, int) and Ellipsis not in parts and part < len(parts) else 0
            here = bare(parts[index])
        else:
            return None
    return here


def _keys(annotation: object) -> list[str]:
    if is_model(annotation):
        return keys_of(annotation)
    return [str(p) for p in get_args(annotation)] if get_origin(annotation) is Literal else []
