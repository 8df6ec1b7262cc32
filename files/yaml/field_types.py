"""Field types of file schemas: the base of all models, names, and numbers with units and bounds."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, cast

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Strict, WithJsonSchema

from ..quantities import NotFinite, dimension, in_unit, parse_quantity
from ..value_wording import describe, suggest_number


class InvalidValue(ValueError):
    """Raised by validators: what is wrong, and what would be right."""

    def __init__(self, message: str, hint: str = "", *, code: str) -> None:
        super().__init__(message)
        self.message, self.hint, self.code = message, hint, code


class UnreadPart(Exception):
    """A part of a file that could not be read was touched; the fault is reported already."""


class FileModel(BaseModel):
    """Base of all models of files: frozen, and refuses keys that it does not know."""

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
Force = Annotated[float, quantity("N", above=0)]
Share = Annotated[float, quantity("", least=0, most=1)]
Vector = tuple[Length, Length, Length]
Angles = tuple[Angle, Angle, Angle]
Sizes = tuple[Size, Size, Size]
