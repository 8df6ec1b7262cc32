"""Numbers with units: "30 mm" where metres are wanted is 0.03. A bare number is in SI units."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class _Unit:
    dimension: str
    times: float = 1.0
    over: float = 1.0
    """Kept as a quotient: 25 / 1e6 is exactly 2.5e-05, 25 * 1e-6 is not."""

    def to_si(self, number: float) -> float:
        return number * self.times / self.over


_DEGREE = math.pi / 180.0
_UNITS: Mapping[str, _Unit] = {
    "m": _Unit("a length"),
    "cm": _Unit("a length", over=1e2),
    "mm": _Unit("a length", over=1e3),
    "um": _Unit("a length", over=1e6),
    "rad": _Unit("an angle"),
    "mrad": _Unit("an angle", over=1e3),
    "deg": _Unit("an angle", times=_DEGREE),
    "s": _Unit("a time"),
    "ms": _Unit("a time", over=1e3),
    "us": _Unit("a time", over=1e6),
    "min": _Unit("a time", times=60.0),
    "h": _Unit("a time", times=3600.0),
    "kg": _Unit("a mass"),
    "g": _Unit("a mass", over=1e3),
    "N": _Unit("a force"),
    "mN": _Unit("a force", over=1e3),
    "kN": _Unit("a force", times=1e3),
    "Nm": _Unit("a torque"),
    "mNm": _Unit("a torque", over=1e3),
    "Ns": _Unit("an impulse"),
    "m/s": _Unit("a speed"),
    "cm/s": _Unit("a speed", over=1e2),
    "mm/s": _Unit("a speed", over=1e3),
    "rad/s": _Unit("an angular speed"),
    "deg/s": _Unit("an angular speed", times=_DEGREE),
    "m/s2": _Unit("an acceleration"),
    "rad/s2": _Unit("an angular acceleration"),
    "deg/s2": _Unit("an angular acceleration", times=_DEGREE),
    "N/m": _Unit("a stiffness"),
    "N/mm": _Unit("a stiffness", times=1e3),
    "Nm/rad": _Unit("an angular stiffness"),
    "Hz": _Unit("a rate"),
    "kHz": _Unit("a rate", times=1e3),
    "": _Unit("a number without a unit"),
    "%": _Unit("a number without a unit", over=1e2),
}
UNITS = tuple(unit for unit in _UNITS if unit)
"""All units that may be written."""
_ALIASES = {"°": "deg", "µm": "um", "μm": "um", "µs": "us", "μs": "us", "m/s²": "m/s2", "rad/s²": "rad/s2"}
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
    """The value in the SI unit that `unit` names. Raises ValueError with a sentence."""
    return _finite(value, unit) if not isinstance(value, str) else _with_unit(value, unit)


def in_unit(number: float, unit: str, like: str) -> str:
    """A number of the SI unit `unit` as people read it, in the unit that the quantity `like` was written in.

    >>> in_unit(0.001, "m", "5 mm"), in_unit(0.001, "m", "0.5")
    ('1 mm', '0.001 m')
    """
    match = _QUANTITY.fullmatch(like)
    written = _ALIASES.get(match[2], match[2]) if match else ""
    given, target = _UNITS.get(written), _UNITS.get(_ALIASES.get(unit, unit))
    if not written or given is None or target is None or given.dimension != target.dimension:
        return f"{number:g} {unit}".strip()
    return f"{number * given.over / given.times:g} {match[2] if match else written}"


def units_like(unit: str) -> tuple[str, ...]:
    """The units that may be written where `unit` is wanted, `unit` first."""
    wanted = _UNITS.get(unit)
    same = (name for name, u in _UNITS.items() if wanted and u.dimension == wanted.dimension and name)
    return (unit, *(name for name in same if name != unit))


def spellings(unit: str) -> tuple[str, ...]:
    """All that may be written behind a number where `unit` is wanted, other spellings included.

    >>> spellings("rad")
    ('rad', 'mrad', 'deg', '°')
    """
    units = tuple(name for name in units_like(unit) if name)
    return (*units, *(alias for alias, name in _ALIASES.items() if name in units))


def example(unit: str) -> str:
    """An amount as people write it where `unit` is wanted.

    >>> example("m"), example("Nm/rad"), example("")
    ('30 mm', '1.5 Nm/rad', '0.5')
    """
    known = _UNITS.get(_ALIASES.get(unit, unit))
    return _EXAMPLE.get(known.dimension if known else "", f"1.5 {unit}")


def dimension(unit: str) -> str:
    """Return the dimension that a unit measures, as `a length`; empty for a bare number or an unknown
    unit."""
    known = _UNITS.get(_ALIASES.get(unit, unit))
    return known.dimension if known is not None and unit not in ("", "%") else ""


def _finite(value: float, unit: str) -> float:
    if isinstance(value, bool):
        raise ValueError(f"{str(value).lower()} is not {_wanted(unit)}")
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
        raise ValueError(f"{_short(text)} is not {_wanted(unit)}")
    number, written = float(match[1]), _ALIASES.get(match[2], match[2])
    target = _UNITS.get(_ALIASES.get(unit, unit))
    if not math.isfinite(number):
        raise NotFinite("the number is too large")
    if written == "" or written == unit:
        return number
    given = _UNITS.get(written)
    if given is None:
        allowed = ", ".join(u for u in units_like(unit) if u)
        raise ValueError(f"{_short(text)}: unknown unit {written!r}" + (f" ({allowed})" if allowed else ""))
    if target is None or given.dimension != target.dimension:
        raise ValueError(f"{_short(text)} is {given.dimension}, not {_wanted(unit)}")
    return given.to_si(number)


def _wanted(unit: str) -> str:
    known = _UNITS.get(_ALIASES.get(unit, unit))
    if known is None:
        return f"a number in {unit}"
    return f"{known.dimension} (as {example(unit)})"


def _short(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "...")
