"""Comparisons at inputs of any type: what a call gives can never equal what it is compared with."""

from __future__ import annotations

import pytest

from .test_wiring import faults

MISSION = """
    trees:
      Main:
        ports: {p: {type: any, default: 3}, t: string}
        Sequence:
          - Script: {code: "k := 2.5; m := 1; m := 'a'"}
          - CALL
      Outer: {ports: {v: any}, Check: {slot: "{v}"}}
      Check:
        ports: {slot: {type: any, default: null}, other: {type: any, default: null}}
        Condition: {if: TEST}
    """


def found(call: str, test: str) -> list[str]:
    return faults(MISSION.replace("CALL", call).replace("TEST", test))


@pytest.mark.parametrize(
    ("call", "test", "said"),
    [
        ("Check: {slot: '3'}", "slot == 3", "a text and a whole number are never equal "
         "('slot' is a text, line 8)"),
        ("Check: {slot: 3}", "not '3' == slot", "a text and a whole number are never equal "
         "('slot' is a whole number, line 8)"),
        ("Check: {slot: '{k}'}", "slot == 'a'", "a number and a text are never equal "
         "('slot' is a number, Main/Sequence/Script writes it, line 7)"),
        ("Check: {slot: '{t}'}", "slot == 3", "a text and a whole number are never equal "
         "('slot' is a text, the tree's input 't', line 5)"),
        ("Check: {slot: '{= 1 + 2}'}", "slot == 'a' or other == 1",
         "a whole number and a text are never equal "
         "('slot' is a whole number, line 8)"),
        ("Outer: {v: true}", "not (slot == 'a')", "true/false and a text are never equal "
         "('slot' is true/false, line 8)"),
    ],
)  # fmt: skip
def test_a_comparison_that_fails_with_what_a_call_gives(call: str, test: str, said: str) -> None:
    (fault,) = found(call, test)
    place, message = fault.split(": port 'if': ")
    assert (place[:8], message) == ("P226 12:", said)


@pytest.mark.parametrize(
    ("call", "test"),
    [
        ("Check: {slot: '3'}", "slot == '3'"),
        ("Check: {slot: 3}", "slot == 2.5 or slot == true"),
        ("Check: {slot: null}", "slot == 'a'"),
        ("Check: {}", "slot == 'a'"),
        ("Check: {slot: '{m}'}", "slot == 'a'"),  # with either type
        ("Check: {slot: '{p}'}", "slot == 'a'"),  # a parameter, which may be set
        ("Check: {slot: 3, other: 1}", "other == 1 or slot == 'a'"),  # not evaluated
        ("Check: {slot: 3, other: 1}", "(slot == 'a' if other == 2 else true)"),
    ],
)
def test_a_comparison_that_may_be_made(call: str, test: str) -> None:
    assert found(call, test) == []
