"""Quantities: units are converted, anything else is refused with a sentence."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.files.quantities import parse_quantity, units_like


@pytest.mark.parametrize(
    ("value", "unit", "si"),
    [
        ("30 mm", "m", 0.03),
        ("30mm", "m", 0.03),
        (" -5 cm ", "m", -0.05),
        ("5 deg", "rad", math.radians(5)),
        ("90°", "rad", math.pi / 2),
        ("500 ms", "s", 0.5),
        ("25 us", "s", 2.5e-5),
        ("25 µs", "s", 2.5e-5),
        ("20 N", "N", 20.0),
        ("120 g", "kg", 0.12),
        ("1.5e-1 kg", "kg", 0.15),
        ("50 %", "", 0.5),
        ("0.25", "m", 0.25),
        (3, "m", 3.0),
        (0.5, "s", 0.5),
        ("100 mm/s", "m/s", 0.1),
        ("15 rad/s²", "rad/s2", 15.0),
        ("7 widgets", "widgets", 7.0),
    ],
)
def test_conversions(value: str | float, unit: str, si: float) -> None:
    assert parse_quantity(value, unit) == si


@pytest.mark.parametrize(
    ("value", "unit", "message"),
    [
        ("20 N", "m", "'20 N' is a force, not a length (as 30 mm)"),
        ("x", "m", "'x' is not a length (as 30 mm)"),
        ("", "s", "'' is not a time (as 500 ms)"),
        (True, "m", "true is not a length (as 30 mm)"),
        (math.nan, "m", "nan is not a finite number"),
        (-math.inf, "m", "-inf is not a finite number"),
        ("nan m", "m", "'nan m' is not a length (as 30 mm)"),
        ("1e999 m", "m", "the number is too large"),
        (10**400, "m", "the number is too large"),
        ("3 foo", "kg", "'3 foo': unknown unit 'foo' (kg, g)"),
        ("3 mm", "", "'3 mm' is a length, not a number without a unit (as 0.5)"),
        ("1 000 mm", "m", "'1 000 mm' is not a length (as 30 mm)"),
        ("3 mm", "widgets", "'3 mm' is a length, not a number in widgets"),
        ("٣ m", "m", "'٣ m' is not a length (as 30 mm)"),
        ("1" * 50 + "x", "Nm", "'1111111111111111111111111111111111111...': unknown unit 'x' (Nm, mNm)"),
    ],
)
def test_refused(value: str | float, unit: str, message: str) -> None:
    with pytest.raises(ValueError) as caught:
        parse_quantity(value, unit)
    assert str(caught.value) == message


@given(st.floats(-1e6, 1e6), st.sampled_from([("mm", "m", 1e3), ("ms", "s", 1e3), ("g", "kg", 1e3)]))
def test_a_unit_is_a_factor(number: float, unit: tuple[str, str, float]) -> None:
    written, si, factor = unit
    assert parse_quantity(f"{number!r} {written}", si) == pytest.approx(number / factor, rel=1e-15, abs=0)


@given(st.text(max_size=30), st.sampled_from(["m", "rad", "", "N", "widgets"]))
def test_any_text_is_a_finite_number_or_refused(text: str, unit: str) -> None:
    try:
        assert math.isfinite(parse_quantity(text, unit))
    except ValueError as error:
        assert str(error)


def test_units_that_may_be_written() -> None:
    assert units_like("m") == ("m", "cm", "mm", "um")
    assert units_like("widgets") == ("widgets",)
