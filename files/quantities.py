"""Numbers with units: "30 mm" where metres are wanted is 0.03. A bare number is in SI units."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Unit:
    """Unit of a dimension, with its value in the SI unit."""

    dimension: str
    times: float = 1.0
    over: float = 1.0
    """Kept as a quotient: 25 / 1e6 is exactly 2.5e-05, 25 * 1e-6 is not."""

    def to_si(self, number: float) -> float:
        return number * self.times / self.over


_DEGREE = math.pi / 180.0


UNIT_TABLE: Mapping[str, Unit] = {
    "m": Unit("a length"),
    "cm": Unit("a length", over=1e2),
    "mm": Unit("a length", over=1e3),
    "um": Unit("a length", over=1e6),
    "rad": Unit("an angle"),
    "mrad": Unit("an angle", over=1e3),
    "deg": Unit("an angle", times=_DEGREE),
    "s": Unit("a time"),
    "ms": Unit("a time", over=1e3),
    "us": Unit("a time", over=1e6),
    "min": Unit("a time", times=60.0),
    "h": Unit("a time", times=3600.0),
    "kg": Unit("a mass"),
    "g": Unit("a mass", over=1e3),
    "N": Unit("a force"),
    "mN": Unit("a force", over=1e3),
    "kN": Unit("a force", times=1e3),
    "Nm": Unit("a torque"),
    "mNm": Unit("a torque", over=1e3),
    "Ns": Unit("an impulse"),
    "m/s": Unit("a speed"),
    "cm/s": Unit("a speed", over=1e2),
    "mm/s": Unit("a speed", over=1e3),
    "rad/s": Unit("an angular speed"),
    "deg/s": Unit("an angular speed", times=_DEGREE),
    "m/s2": Unit("an acceleration"),
    "rad/s2": Unit("an angular acceleration"),
    "deg/s2": Unit("an angular acceleration", times=_DEGREE),
    "N/m": Unit("a stiffness"),
    "N/mm": Unit("a stiffness", times=1e3),
    "Nm/rad": Unit("an angular stiffness"),
    "Hz": Unit("a rate"),
    "kHz": Unit("a rate", times=1e3),
    "": Unit("a number without a unit"),
    "%": Unit("a number without a unit", over=1e2),
}


UNITS = tuple(unit for unit in UNIT_TABLE if unit)
"""All units that may be written."""


SPELLINGS: Mapping[str, str] = {
    "°": "deg",
    "µm": "um",
    "μm": "um",
    "µs": "us",
    "μs": "us",
    "m/s²": "m/s2",
    "rad/s²": "rad/s2",
}


_EXAMPLE = {
    "a length": "30 mm",
    "an angle": "5 deg",
    "a time": "500 ms",
    "a mass": "100 g",
    "a force": "20 N",
    "a speed": "100 mm/s",
    "a number without a unit": "0.5",
}


_QUANTITY = re.compile(r"\s*([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*", re.ASCII)


class NotFinite(ValueError):
    """A number that no quantity can have: infinite, too large, or not a number."""


def parse_quantity(value: str | int | float, unit: str) -> float:
    """Return the value in the SI unit `unit`. Raises ValueError with a sentence."""
    return _finite(value, unit) if not isinstance(value, str) else _with_unit(value, unit)


def in_unit(number: float, unit: str, like: str) -> str:
    """Return a number of the SI unit `unit` as text, in the unit of the quantity `like`.

    >>> in_unit(0.001, "m", "5 mm"), in_unit(0.001, "m", "0.5")
    ('1 mm', '0.001 m')
    """
    match = _QUANTITY.fullmatch(like)
    written = SPELLINGS.get(match[2], match[2]) if match else ""
    given, target = UNIT_TABLE.get(written), UNIT_TABLE.get(SPELLINGS.get(unit, unit))
    if not written or given is None or target is None or given.dimension != target.dimension:
        return f"{number:g} {unit}".strip()
    return f"{number * given.over / given.times:g} {match[2] if match else written}"


def units_like(unit: str) -> tuple[str, ...]:
    """Return the units that a file may use for `unit`, `unit` first."""
    wanted = UNIT_TABLE.get(unit)
    same = (name for name, u in UNIT_TABLE.items() if wanted and u.dimension == wanted.dimension and name)
    return (unit, *(name for name in same if name != unit))


def spellings(unit: str) -> tuple[str, ...]:
    """Return all spellings of the units that a file may use for `unit`.

    >>> spellings("rad")
    ('rad', 'mrad', 'deg', '°')
    """
    units = tuple(name for name in units_like(unit) if name)
    return (*units, *(alias for alias, name in SPELLINGS.items() if name in units))


def example(unit: str) -> str:
    """Return an example quantity with a usual unit for `unit`.

    >>> example("m"), example("Nm/rad"), example("")
    ('30 mm', '1.5 Nm/rad', '0.5')
    """
    known = UNIT_TABLE.get(SPELLINGS.get(unit, unit))
    return _EXAMPLE.get(known.dimension if known else "", f"1.5 {unit}")


def dimension(unit: str) -> str:
    """Return the dimension that a unit measures, as `a length`; empty for a bare number or an unknown
    unit."""
    known = UNIT_TABLE.get(SPELLINGS.get(unit, unit))
    return known.dimension if known is not None and unit not in ("", "%") else ""


def bare_number(text: str) -> float | None:
    """Return the number of a text without a unit; None for anything else."""
    match = _QUANTITY.fullmatch(text)
    return float(match[1]) if match is not None and not match[2] else None


def _finite(value: float, unit: str) -> float:
    if isinstance(value, bool):
        raise ValueError(f"{str(value).lower()} is not {_expected_quantity(unit)}")
    try:
        number = float(value)
    except OverflowError:
        raise NotFinite("the number is too large") from None
    if not math.isfinite(number):
        raise NotFinite(f"{number} is not a finite number")
    return number


def _with_unit(text: str, unit: str) -> float:
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise ValueError(f"{_short(text)} is not {_expected_quantity(unit)}")
    number, written = float(match[1]), SPELLINGS.get(match[2], match[2])
    target = UNIT_TABLE.get(SPELLINGS.get(unit, unit))
    if not math.isfinite(number):
        raise NotFinite("the number is too large")
    if written == "" or written == unit:
        return number
    given = UNIT_TABLE.get(written)
    if given is None:
        allowed = ", ".join(u for u in units_like(unit) if u)
        raise ValueError(f"{_short(text)}: unknown unit {written!r}" + (f" ({allowed})" if allowed else ""))
    if target is None or given.dimension != target.dimension:
        raise ValueError(f"{_short(text)} is {given.dimension}, not {_expected_quantity(unit)}")
    return given.to_si(number)


def _expected_quantity(unit: str) -> str:
    known = UNIT_TABLE.get(SPELLINGS.get(unit, unit))
    if known is None:
        return f"a number in {unit}"
    return f"{known.dimension} (as {example(unit)})"


def _short(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "...")
