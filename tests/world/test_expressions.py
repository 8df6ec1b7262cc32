"""The expression language: what it knows, what it refuses, and that it is bounded."""

from __future__ import annotations

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from picktree.world.files.expressions import Expression, ExpressionError

NAMES = {"x": 4, "colour": "red", "items": ["a", "b"], "flag": True, "none": None}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("colour == 'red'", True),
        ("x > 3 and not flag", False),
        ("x > 3 or y", True),
        ("1 < x <= 4", True),
        ("'a' in items and 'z' not in items", True),
        ("colour in ['red', \"green\"]", True),
        ("(x + 2) * 3 - 7 // 2 % 2", 17),
        ("-x / 8", -0.5),
        ("len(items) + max(1, 2) - min(items_left)", None),
        ("true and flag and not false", True),
        ("none == null", True),
        ("'small' if x < 5 else 'large'", "small"),
        ("[x, 1]", [4, 1]),
        ("abs(-2) + round(2.4)", 4),
        ("x\n>\t3", True),
        ("x != 4.0", False),
    ],
)
def test_values(text: str, value: object) -> None:
    assert Expression.parse(text).evaluate({**NAMES, "items_left": [3, 9]}) == (1 if value is None else value)


def test_names_and_paths() -> None:
    expression = Expression.parse("item.pose.x > limit and len(items) and not true")
    assert expression.names == {"item", "limit", "items"}
    assert expression.paths == {"item.pose", "item.pose.x"}
    assert str(expression) == "item.pose.x > limit and len(items) and not true"


def test_attributes_go_through_the_resolver_only() -> None:
    def resolve(owner: object, name: str) -> object:
        return {"colour": "blue"}[name]

    assert Expression.parse("item.colour == 'blue'").evaluate({"item": "item_1"}, resolve) is True
    with pytest.raises(ExpressionError) as caught:
        Expression.parse("item.mass > 3").evaluate({"item": "item_1"}, resolve)
    assert (str(caught.value), caught.value.offset) == ("no attribute 'mass'", 0)
    with pytest.raises(ExpressionError, match="nothing here has attributes, so not 'upper' either"):
        Expression.parse("colour.upper").evaluate(NAMES)


@pytest.mark.parametrize(
    ("text", "message", "offset"),
    [
        ("", "the expression is empty", 0),
        ("a = 1", "not an expression: compare with '=='", 2),
        ("a && b", "not an expression: write 'and' for '&&'", 3),
        ("a || b", "not an expression: write 'or' for '||'", 3),
        ("!a", "not an expression: write 'not' for '!'", 0),
        ("1 + {item} == 1", "a name in braces is not part of the language", 4),
        ("len(x", "not an expression", 3),
        ("x.__class__", "'__class__' is private", 0),
        ("(1).real.imag", None, 0),
        ("a + f(x)", "functions are len, min, max, abs, round, and take no named arguments", 4),
        ("x.f()", "functions are len, min, max, abs, round, and take no named arguments", 0),
        ("max(1, key=2)", "functions are len, min, max, abs, round, and take no named arguments", 0),
        ("[i for i in x]", "a loop is not part of the language", 0),
        ("x[0]", "indexing with [ ] is not part of the language", 0),
        ("f'{x}'", "an f-string is not part of the language", 0),
        ("lambda: 1", "a lambda is not part of the language", 0),
        ("(y := 1)", "a named expr is not part of the language", 1),
        ("len(*x)", "a starred is not part of the language", 4),
        ("2 ** 9", "this operator is not part of the language (arithmetic: + - * / // %)", 0),
        ("~x", "this operator is not part of the language", 0),
        ("a is b", "'is' is not part of the language: compare with '=='", 0),
        ("b'x'", "only numbers, texts, true, false and null are constants", 0),
        ("1j", "only numbers, texts, true, false and null are constants", 0),
        ("é + ...", "only numbers, texts, true, false and null are constants", 4),
        ("\x00", "not an expression", 0),
        ("x" * 1001, "the expression is longer than 1000 characters", 0),
        ("not " * 45 + "x", "the expression is nested more than 40 deep", None),
        ("-" * 999 + "1", None, None),
        ("(" * 500 + ")" * 500, "not an expression", None),
        ("+".join("1" * 300), "the expression is nested more than 40 deep", None),
        ("[" + ",".join("1" * 300) + "]", "the expression has more than 250 parts", None),
    ],
)
def test_refused(text: str, message: str | None, offset: int | None) -> None:
    if message is None:
        with pytest.raises(ExpressionError):
            Expression.parse(text).evaluate({})
        return
    with pytest.raises(ExpressionError) as caught:
        Expression.parse(text)
    assert str(caught.value) == message
    assert offset is None or caught.value.offset == offset


@pytest.mark.parametrize(
    ("text", "message", "offset"),
    [
        ("y > 1", "unknown name 'y'; known: x, colour, items, flag, none", 0),
        ("x > colour", "'>' does not work on a number and a text", 0),
        ("x + flag", "'+' does not work on a number and true/false", 0),
        ("'a' * 1000000000", "'*' does not work on a text and a number", 0),
        ("flag and x / 0", "division by zero", 9),
        ("-colour", "'-' does not work on a text", 0),
        ("3 in x", "'in' does not work on a number and a number", 0),
        ("x in colour", "'in' does not work on a number and a text", 0),
        ("len(x)", "'len' does not work on a number", 0),
        ("min()", "'min' does not work on nothing", 0),
        ("1 + max(items, x)", "'max' does not work on a list and a number", 4),
        ("colr == 'red'", "unknown name 'colr'; did you mean 'colour'?", 0),
        ("1e308 * 1e308 // 1", None, 0),
    ],
)
def test_failing_values(text: str, message: str | None, offset: int) -> None:
    if message is None:
        Expression.parse(text).evaluate(NAMES)
        return
    with pytest.raises(ExpressionError) as caught:
        Expression.parse(text).evaluate(NAMES)
    assert (str(caught.value), caught.value.offset) == (message, offset)


PIECES = ["x", "colour", "1", "'a'", "(", ")", "[", "]", " and ", " or ", "not ", "==", "<", " in ", "+", "-"]
PIECES += ["*", "/", "%", ".", ",", "len(", "max(", "if ", " else ", "é", "0.5", "{", "\\", "lambda "]


@settings(max_examples=400, deadline=500)
@given(st.one_of(st.lists(st.sampled_from(PIECES), max_size=40).map("".join), st.text(max_size=60)))
def test_any_text_has_a_value_or_an_expression_error(text: str) -> None:
    try:
        Expression.parse(text).evaluate(NAMES)
    except ExpressionError as error:
        assert 0 <= error.offset <= max(0, len(text))
        assert str(error)


def test_the_dearest_expression_is_cheap() -> None:
    text = "*".join(["9" * 20] * 30)
    begun = time.process_time()
    Expression.parse(text).evaluate({})
    assert time.process_time() - begun < 0.1
