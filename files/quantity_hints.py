"""Hints for quantities that are written in another way, as `0,5 sec` or `1_000`."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping

from .quantities import SPELLINGS, UNIT_TABLE, dimension, parse_quantity

_WORDS: Mapping[str, str] = {
    "metre": "m", "meter": "m", "centimetre": "cm", "centimeter": "cm", "millimetre": "mm",
    "millimeter": "mm", "micrometre": "um", "micrometer": "um", "micron": "um", "radian": "rad",
    "degree": "deg", "º": "deg", "˚": "deg", "second": "s", "sec": "s", "millisecond": "ms",
    "msec": "ms", "microsecond": "us", "usec": "us", "minute": "min", "hour": "h", "hr": "h",
    "kilogram": "kg", "kilo": "kg", "gram": "g", "gramme": "g", "newton": "N", "millinewton": "mN",
    "kilonewton": "kN", "newtonmetre": "Nm", "newtonmeter": "Nm", "hertz": "Hz", "percent": "%",
    "percentage": "%",
}  # fmt: skip
"""Units as people write them, singular and in small letters."""


_FACTORS: Mapping[str, tuple[float, str]] = {
    "in": (25.4, "mm"), "inch": (25.4, "mm"), "inches": (25.4, "mm"), '"': (25.4, "mm"), "ft": (0.3048, "m"),
    "lb": (453.59237, "g"), "lbs": (453.59237, "g"), "oz": (28.349523125, "g"), "kgf": (9.80665, "N"),
    "lbf": (4.4482216152605, "N"), "rpm": (6.0, "deg/s"), "rev": (360.0, "deg"),
}  # fmt: skip
"""Units that files may not use, with the equivalent in a permitted unit."""


_FRACTIONS: Mapping[str, str] = {"½": "0.5", "¼": "0.25", "¾": "0.75"}


_GROUPED = re.compile(
    r"[-+]?\d{1,3}(?:[ _'’,]\d{3})+(?:\.\d+)?|[-+]?\d{1,3}(?:\.\d{3})+,\d+|[-+]?\d[\d_]*(?:\.\d+)?", re.ASCII
)


_COMMA = re.compile(r"([-+]?\d+),(\d+)(?!\d)", re.ASCII)


_AMBIGUOUS = re.compile(r"\s*[-+]?\d{1,3},\d{3}(?![\d,.])", re.ASCII)
"""Thousands, or three decimals behind a comma."""


_LEADING = re.compile(r"(?:[~≈±<>=]|about|approx\.?|ca\.?)\s*(?=[-+.\d])", re.IGNORECASE)


_CLOCK = re.compile(r"(\d{1,2}):(\d\d)(?::(\d\d))?", re.ASCII)


_RATIO = re.compile(r"(\d+)\s*/\s*(\d+)(?=\s|$)", re.ASCII)


_SUM = re.compile(r"(?:[-+]?\d+(?:\.\d+)?\s*[a-zA-Z]+\s*){2,4}", re.ASCII)


def suggest_quantity(text: str, unit: str) -> str:
    """Return how a quantity is written that is written in another way; "" where none is recognised.

    >>> suggest_quantity("1_000", "s"), suggest_quantity("0,5 sec", "s"), suggest_quantity("２０ Newton", "N")
    ('1000', '0.5 s', '20 N')
    >>> suggest_quantity("2 in", "m"), suggest_quantity("1:30", "s"), suggest_quantity("1,500", "m")
    ('50.8 mm', '90 s', '')
    """
    if len(text) > 60 or _AMBIGUOUS.match(text):
        return ""
    plain = _plain(text)
    try:
        meant = _clock(plain, unit) or _sum(plain, unit) or _normalised_quantity(plain)
        parse_quantity(meant, unit)
    except ValueError:
        return ""
    return meant if meant != text.strip() else ""


def suggested(text: str, unit: str) -> str:
    """Return a hint with the quantity that is meant; "" where none is recognised.

    >>> suggested("0,5 sec", "s"), suggested("1,500 mm", "m"), suggested("soon", "s")
    ('write 0.5 s', "a decimal sign is '.', and thousands have no sign", '')
    """
    if _AMBIGUOUS.match(text):
        return "a decimal sign is '.', and thousands have no sign"
    meant = suggest_quantity(text, unit)
    return f"write {meant}" if meant else ""


def _plain(text: str) -> str:
    """Return a quantity with digits, signs and blanks of ASCII, without quotes and words before it."""
    text = "".join(_FRACTIONS.get(letter, letter) for letter in text.strip().strip("“”„‟‘’‚‛«»\"'"))
    text = "".join(str(unicodedata.digit(c)) if unicodedata.category(c) == "Nd" else c for c in text)
    text = "".join(
        " " if unicodedata.category(c) == "Zs" else c for c in text if unicodedata.category(c) != "Cf"
    )
    for letter in "−–﹣－":
        text = text.replace(letter, "-")
    return _LEADING.sub("", text.replace("．", ".").replace("，", ","), count=1).strip()


def _normalised_quantity(text: str) -> str:
    """Return number and unit in the spelling that files take. Raises ValueError for a text without a
    number."""
    ratio = _RATIO.match(text)
    if ratio is not None and int(ratio[2]):
        number, rest = f"{int(ratio[1]) / int(ratio[2]):.6g}", text[ratio.end() :]
    else:
        number, rest = _number(text)
    unit = _unit_meant(rest)
    if unit in _FACTORS:
        times, unit = _FACTORS[unit]
        number = f"{float(number) * times:.6g}"
    return f"{number} {unit}".strip()


def _number(text: str) -> tuple[str, str]:
    exact = re.match(r"[-+]?(?:\d+\.?\d*|\.\d+)[eE][-+]?\d+", text, re.ASCII)
    grouped, comma = _GROUPED.match(text), _COMMA.match(text)
    if exact is not None:
        return exact[0], text[exact.end() :]
    if grouped is not None and not (comma is not None and comma.end() > grouped.end()):
        number = re.sub(r"[ _'’]", "", grouped[0])
        decimal = number.replace(".", "").replace(",", ".") if re.search(r"\.\d{3}.*,", number) else number
        return decimal.replace(",", ""), text[grouped.end() :]
    if comma is not None:
        return f"{comma[1]}.{comma[2]}", text[comma.end() :]
    raise ValueError("there is no number")


def _unit_meant(text: str) -> str:
    """Return the unit meant by the text after a number; unknown texts are returned unchanged."""
    written = re.sub(r"\s+", " ", text).strip().rstrip(".").strip()
    if written in UNIT_TABLE or written in SPELLINGS or written in _FACTORS:
        return written
    over, _, under = re.sub(r"\s*(?:/|\bper\b|\bp\b)\s*", "/", written).partition("/")
    parts = [_unit_word(part) for part in (over, under) if part]
    joined = "/".join(parts).replace("^2", "2").replace("²", "2").replace("s s", "s2")
    if joined in UNIT_TABLE:
        return joined
    return joined.lower() if joined.lower() in _FACTORS else joined


def _unit_word(word: str) -> str:
    bare = re.sub(r"[\s*·⋅.-]", "", word)
    if bare in UNIT_TABLE:
        return bare
    low = bare.lower()
    named = _WORDS.get(low) or _WORDS.get(low.removesuffix("s")) or _WORDS.get(low.removesuffix("es"))
    mega = bare[:1] == "M" and low not in ("mm", "ms")
    alike = [name for name in UNIT_TABLE if name.lower() == low and not mega]
    return named or (alike[0] if len(alike) == 1 else bare)


def _clock(text: str, unit: str) -> str:
    """Return minutes and seconds, or hours, minutes and seconds, in seconds; "" for anything else."""
    found = _CLOCK.fullmatch(text)
    if found is None or dimension(unit) != "a time":
        return ""
    parts = [int(part) for part in found.groups() if part]
    return f"{sum(part * 60**n for n, part in enumerate(reversed(parts)))} s"


def _sum(text: str, unit: str) -> str:
    """Return the sum of several quantities, `1 min 30 s`, in the smallest of their units."""
    if not _SUM.fullmatch(text):
        return ""
    terms = re.findall(r"([-+]?\d+(?:\.\d+)?)\s*([a-zA-Z]+)", text)
    units = [_unit_word(word) for _, word in terms]
    known = [UNIT_TABLE[name] for name in units if name in UNIT_TABLE]
    if len(known) < len(units) or len({each.dimension for each in known}) > 1:
        return ""
    smallest = min(known, key=lambda each: each.to_si(1.0))
    total = sum(each.to_si(float(number)) for (number, _), each in zip(terms, known, strict=True))
    return f"{total * smallest.over / smallest.times:.6g} {units[known.index(smallest)]}"
