"""Translation of pydantic's errors into faults with place and code."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, cast, get_args, get_origin

from pydantic import BaseModel

from ..marks import Diagnostic, Location
from ..value_wording import describe, suggest_boolean, suggest_name, suggest_number
from ..yaml.document import Document
from .partial_models import bare


class InvalidValue(ValueError):
    """Raised by validators: what is wrong, and what would be right."""

    def __init__(self, message: str, hint: str = "", *, code: str) -> None:
        super().__init__(message)
        self.message, self.hint, self.code = message, hint, code


def follows(detail: Any) -> bool:
    """A list that pydantic calls too short only because it left out its faulty entries."""
    context = cast("Mapping[str, object]", detail.get("ctx") or {})
    least, given = context.get("min_length"), detail.get("input")
    return (
        isinstance(least, int)
        and isinstance(given, list | dict)
        and len(cast("list[object]", given)) >= least
    )


def to_diagnostic(document: Document, model: type[BaseModel], base: Location, detail: Any) -> Diagnostic:
    """The fault of one of pydantic's errors; `base` is where the model's value stands."""
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
        case "extra_forbidden":
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
            return document.fault(loc, message, _meant(kind, given), code="P106", key=wrong_key)


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


def _meant(kind: str, given: object) -> str:
    if kind.startswith("bool"):
        return suggest_boolean(given)
    if kind.startswith(("int", "float")):
        return suggest_number(given)
    return "quote it" if kind == "string_type" and isinstance(given, int | float) else ""


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
    here = bare(model)
    for part in path:
        origin, parts = get_origin(here), get_args(here)
        if isinstance(here, type) and issubclass(here, BaseModel):
            fields = {f.alias or name: f for name, f in here.model_fields.items()}
            field = fields.get(str(part))
            here = bare(field.annotation) if field else None
        elif origin is dict:
            here = bare(parts[1])
        elif origin in (list, tuple) and parts:
            index = part if isinstance(part, int) and Ellipsis not in parts and part < len(parts) else 0
            here = bare(parts[index])
        else:
            return None
    return here


def _keys(annotation: object) -> list[str]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [field.alias or name for name, field in annotation.model_fields.items()]
    return [str(p) for p in get_args(annotation)] if get_origin(annotation) is Literal else []
