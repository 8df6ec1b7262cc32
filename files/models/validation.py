"""Checking a document against pydantic models, with sentences and places of our own.

Each `kind` of file reads its parts through one `DocumentChecker`, which gathers every fault before it
complains.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar, cast

import pydantic
from pydantic import AfterValidator, BaseModel, BeforeValidator, Strict, WithJsonSchema

from ..marks import MAX_FAULTS, SPOILT, Severity, too_many
from ..quantities import NotFinite, dimension, in_unit, parse_quantity
from ..value_wording import describe, listed, suggest_name, suggest_number
from ..yaml.document import Diagnostic, Document, FileError, Location
from .partial_models import FileModel, UnreadPart, partial_model
from .validation_messages import InvalidValue, follows, to_diagnostic

__all__ = [
    "Angle",
    "Angles",
    "DocumentChecker",
    "Duration",
    "FileModel",
    "Flag",
    "Force",
    "InvalidValue",
    "Length",
    "Mass",
    "Name",
    "Share",
    "Size",
    "Sizes",
    "UnreadPart",
    "Vector",
    "as_mapping",
    "describe",
    "quantity",
]  # fmt: skip

HEADER = ("picktree", "kind")
MAX_ENTRIES = 1000
"""Maximum number of entries of a section."""


@dataclass(frozen=True)
class Quantity(BeforeValidator):
    """Reads a number with a unit, and says so in a JSON Schema under `unit`."""

    unit: str = ""
    bounds: tuple[tuple[str, float], ...] = ()

    def __get_pydantic_json_schema__(self, _: object, __: object) -> dict[str, Any]:
        return {"type": ["string", "number"], "unit": self.unit, **dict(self.bounds)}


def quantity(
    unit: str, *, above: float | None = None, least: float | None = None, most: float | None = None
) -> Quantity:
    """A number with a unit: greater than `above`, not under `least`, not over `most` (SI)."""

    def read(value: object) -> float:
        if not isinstance(value, str | int | float):
            raise InvalidValue(
                f"{describe(value)} is not a number" + (f" in {unit}" if unit else ""), code="P109"
            )
        try:
            number = parse_quantity(value, unit)
        except NotFinite as error:
            raise InvalidValue(str(error), code="P120") from None
        except ValueError as error:
            meant = suggest_number(value)
            raise InvalidValue(
                f"{describe(value)} is not a number" if meant else str(error), meant, code="P109"
            ) from None
        written = value if isinstance(value, str) else f"{value} {unit}".strip()
        what = dimension(unit) or "it"
        if number < 0 and (above == 0 or least == 0):
            hint = f"{what} is {'positive' if above == 0 else '0 or more'} here"
            raise InvalidValue(f"{written} is negative", hint, code="P107")
        if number == 0 and above == 0:
            raise InvalidValue(f"{written} is not positive", code="P107")
        if above is not None and number <= above:
            raise InvalidValue(f"{written} is not more than {in_unit(above, unit, written)}", code="P107")
        if least is not None and number < least:
            raise InvalidValue(f"{written} is less than {in_unit(least, unit, written)}", code="P107")
        if most is not None and number > most:
            raise InvalidValue(f"{written} is more than {in_unit(most, unit, written)}", code="P107")
        return number

    given = {"exclusiveMinimum": above, "minimum": least, "maximum": most}
    bounds = tuple((key, bound) for key, bound in given.items() if bound is not None)
    return Quantity(read, float | str, unit, bounds)


def as_mapping(key: str, given: object) -> BeforeValidator:
    """A bare value stands for a mapping with one key; `given` is what may be written."""

    def wrap(value: object) -> object:
        if value is None or isinstance(value, dict | FileModel):
            return cast("object", value)
        return {key: value}

    return BeforeValidator(wrap, json_schema_input_type=given)


def _identifier(value: str) -> str:
    if re.fullmatch(r"[A-Za-z_]\w*", value, re.ASCII) is None:
        hint = "letters, digits and _, not beginning with a digit"
        raise InvalidValue(f"{describe(value)} is not a name", hint, code="P111")
    return value


_NAME_FORM = {"type": "string", "pattern": r"^[A-Za-z_][A-Za-z0-9_]*(?![\s\S])"}
Name = Annotated[str, AfterValidator(_identifier), WithJsonSchema(_NAME_FORM)]
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


class DocumentChecker:
    """Reads parts of one document and keeps what is wrong with them.

    What it reads is there as far as it could be read; whatever asks for more stands under `readable()`.
    """

    def __init__(self, document: Document) -> None:
        self.document = document
        self.faults: list[Diagnostic] = list(document.faults)
        self._spoilt = {fault.mark for fault in document.faults if fault.code in SPOILT}

    @property
    def full(self) -> bool:
        """Whether so much is wrong that nobody wants to know more."""
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
        """As `Document.fault`, and keep it."""
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

    def read(self, model: type[Model], loc: Location = (), *, ignore: Collection[str] = HEADER) -> Model:
        """The model of the mapping at `loc`, as far as it can be read; `ignore`: keys at the top."""
        value = self.document.get(loc)
        if not loc and isinstance(value, dict):
            left_out = frozenset(ignore)
            value = {k: v for k, v in value.items() if k not in left_out}
        try:
            return model.model_validate(value)
        except pydantic.ValidationError as error:
            details = [detail for detail in error.errors(include_url=False) if not follows(detail)]
            for detail in details[: MAX_FAULTS + 1]:
                self._add(to_diagnostic(self.document, model, loc, detail))
            places = [tuple(part for part in d["loc"] if part != "[key]") for d in details]
            return partial_model(model, value, places)

    def each(self, model: type[Model], section: str, *, most: int = MAX_ENTRIES) -> dict[str, Model]:
        """The models of a mapping's values by key, each as far as it can be read."""
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
                _identifier(name)
            except InvalidValue as wrong:
                self.fault((section, name), wrong.message, wrong.hint, code=wrong.code, key=True)
        return {name: self.read(model, (section, name)) for name in value if not self.full}

    def sequence(self, model: type[Model], section: str, *, most: int = MAX_ENTRIES) -> list[Model]:
        """The models of a list's entries, each as far as it can be read."""
        value = self.document.get((section,))
        if value is None:
            return []
        if not isinstance(value, list):
            self.fault((section,), f"a list is wanted, not {describe(value)}", code="P106")
            return []
        if self._too_many(section, len(value), most):
            return []
        return [self.read(model, (section, n)) for n in range(len(value)) if not self.full]

    def _too_many(self, section: str, number: int, most: int) -> bool:
        if number > most:
            message = f"at most {most} entries are wanted, not {number}"
            self.fault((section,), message, code="P110", key=True)
        return number > most

    def one_of(self, loc: Location, keys: Collection[str]) -> str | None:
        """Which of the keys the mapping at `loc` has; a fault unless it is exactly one."""
        value = self.document.get(loc)
        if not isinstance(value, dict):
            return None  # reported already
        given = [key for key in keys if value.get(key) is not None]
        if len(given) == 1:
            return given[0]
        if given:
            message = f"{listed(given, 'and')} exclude each other"
            self.fault(loc, message, "give one of them", code="P112", key=True)
        else:
            self.fault(loc, f"{listed(keys, 'or')} is missing", code="P105", key=True)
        return None

    def written(self, loc: Location, number: float, unit: str) -> str:
        """A quantity as the file gives it."""
        value = self.document.get(loc)
        return value if isinstance(value, str) else f"{number:g} {unit}".strip()

    def finish(self) -> None:
        """Raises FileError when anything was wrong."""
        if any(fault.severity == "error" for fault in self.faults):
            raise FileError(self.faults)
