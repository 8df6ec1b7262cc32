"""The expression language: what it knows, what it refuses, and that it is bounded."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from picktree.files import Expression
from picktree.files.expression_syntax import ExpressionError

from ..effort import counted

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
        ("'box_' + 2 + '/' + 0.5 + 'm'", "box_2/0.5m"),
        ("'n' + 4 / 2", "n2"),
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
        ("x == 4 == true", False),
        ("010 + .5 + 1.", 11.5),
        ("'it\\'s' == \"it's\"", True),
        ("x in (1, 4)", True),
        ("not x == 3", True),
        ("not not flag", True),
        ("1 if flag else 2 if x else 3", 1),
        ("- -x", 4),
        ("2 - 1 - 1", 0),
        ("flag == True", True),
        ("round(2.55, 1) < 2.6", True),
        ("min(['b', 'a'])", "a"),
        ("items_left[0] + items_left[-1]", 12),
        ("[[1, 2], [3]][0][len(items_left) - 1]", 2),
        ("-items_left[0] + 1", -2),
        ("(items_left if flag else [7])[0]", 3),
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
    assert (str(caught.value), caught.value.offset) == ("no attribute 'mass'", 5)
    with pytest.raises(ExpressionError, match="nothing here has attributes, so not 'upper' either"):
        Expression.parse("colour.upper").evaluate(NAMES)


@pytest.mark.parametrize(
    ("text", "message", "offset"),
    [
        ("", "the expression is empty", 0),
        ("a = 1", "not an expression: compare with '=='", 2),
        ("a === 1", "not an expression: compare with '=='", 4),
        ("a && b", "not an expression: write 'and' for '&&'", 2),
        ("a || b", "not an expression: write 'or' for '||'", 2),
        ("a AND b", "not an expression: write 'and'", 2),
        ("!a", "not an expression: write 'not' for '!'", 0),
        ("a => 1", "not an expression: write '>='", 2),
        ("a ≤ 1", "not an expression: write '<='", 2),
        ("colour == ‘red’", "not an expression: write straight quotes: '", 10),
        ("colour == 'red", "not an expression: the text is not closed by another '", 10),
        ("colour == 'a\\qb'", "not an expression: a backslash is followed by one of n t \\ ' \"", 12),
        ("1 + {item} == 1", "not an expression: names are written without braces in an expression", 4),
        ("a; b", "not an expression: write a single expression here, without ';'", 1),
        ("sorted ==", "not an expression: a value is missing after '=='", 7),
        ("* 3", "not an expression: a value is missing before '*'", 0),
        ("a and and b", "not an expression: a value is missing between 'and' and 'and'", 6),
        ("a b", "not an expression: an operator is missing before 'b'", 2),
        ("1 + not b", "not an expression: 'not' after '+' is written in brackets", 4),
        (
            "width < 5 mm",
            "not an expression: numbers are written without units here, in SI; leave out 'mm'",
            10,
        ),
        ("len(x", "not an expression: '(' is not closed", 3),
        ("[1, (2]", "not an expression: ']' does not close '('", 6),
        ("a)", "not an expression: ')' closes nothing", 1),
        ("()", "not an expression: a value is missing between '(' and ')'", 1),
        ("a, b", "not an expression: a list is written in [ ]", 1),
        ("1 if a", "not an expression: 'if' without 'else': write 'a if c else b'", 2),
        ("1 else 2", "not an expression: 'else' without 'if'", 2),
        ("x.", "not an expression: the name of an attribute is missing after '.'", 1),
        ("x.__class__", "'__class__' is private", 2),
        ("(1).real.imag", None, 0),
        ("a + f(x)", "there is no function 'f'; known: len, min, max, abs, round", 4),
        ("a + lem(x)", "there is no function 'lem'; did you mean 'len'?", 4),
        ("x.f()", "not an expression: 'f' is not a function", 3),
        ("[i for i in x]", "not an expression: a loop is not part of the language", 3),
        ("x[]", "not an expression: an index is missing between '[' and ']'; the first element is [0]", 1),
        ("x[0, 1]", "not an expression: [ ] takes one index", 3),
        ("x[0", "not an expression: '[' is not closed", 1),
        ("x[0:1]", "not an expression: ':' has no meaning here; there are no slices and no mappings", 3),
        ("f'{x}'", "not an expression: an operator is missing before \"'{x}'\"", 1),
        ("lambda: 1", "not an expression: a lambda is not part of the language", 0),
        ("len(*x)", "not an expression: a value is missing between '(' and '*'", 4),
        ("5 %", "not an expression: '%' is the remainder of a division here; write 0.05", 2),
        ("2 ** 9", "not an expression: powers are not supported; write 'x * x'", 2),
        ("~x", "not an expression: the character '~' has no meaning here", 0),
        ("1 + ...", "not an expression: a value is missing between '+' and '.'", 4),
        ("\x00", "not an expression: the character '\\x00' has no meaning here", 0),
        ("x == 9223372036854775808", "the number is too large", 5),
        ("x" * 1001, "the expression is longer than 1000 characters", 0),
        ("not " * 45 + "x", "the expression is nested more than 40 deep", 160),
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
        ("x > colour", "'>' does not work on a number and a text", 2),
        ("none < 3", "'<' does not work on null and a number", 5),
        ("'a' * 1000000000", "'*' does not work on a text and a number", 4),
        ("flag and x / 0", "division by zero", 11),
        ("-colour", "'-' does not work on a text", 0),
        ("3 in x", "'in' does not work on a number and a number", 2),
        ("x not in colour", "'not in' does not work on a number and a text", 2),
        ("len(x)", "'len' does not work on a number", 0),
        ("min()", "'min' does not work on nothing", 0),
        ("1 + max(items, x)", "'max' does not work on a list and a number", 4),
        ("1 + max([])", "an empty list has no smallest and no largest element", 4),
        ("abs(true)", "'abs' does not work on true/false", 0),
        ("round(x, 1.5)", "'round' does not work on a number and a number", 0),
        ("round(x, -1000000000)", "'round' takes at most 15 digits", 0),
        ("9000000000000000000 * 9000000000000000000", "the number is too large", 20),
        ("4[0]", "only a list has elements, and this is a number", 1),
        ("items[2]", "a list of 2 has no element [2]; [0] is the first, [1] the last", 5),
        ("items['a']", "an index is a whole number, not a text", 5),
        ("items[0.5]", "an index is a whole number, not 0.5", 5),
        ("[][0]", "an empty list has no element [0]", 2),
        ("colr == 'red'", "unknown name 'colr'; did you mean 'colour'?", 0),
    ],
)
def test_failing_values(text: str, message: str, offset: int) -> None:
    with pytest.raises(ExpressionError) as caught:
        Expression.parse(text).evaluate(NAMES)
    assert (str(caught.value), caught.value.offset) == (message, offset)


PIECES = [
    "x", "colour", "1", "'a'", "(", ")", "[", "]", " and ", " or ", "not ", "==", "<", " in ", "+", "-",
    "*", "/", "%", ".", ",", "len(", "max(", "if ", " else ", "é", "0.5", "{", "\\", "lambda ",
    "round(", "abs(", "min(", "9" * 19, "1e300", "-15", '"', "items", "none",
    "flag", "[]", ";", ":=", "[0]", "[-1]",
]  # fmt: skip


@settings(max_examples=100)
@given(st.one_of(st.lists(st.sampled_from(PIECES), max_size=40).map("".join), st.text(max_size=60)))
def test_any_text_has_a_value_or_an_expression_error(text: str) -> None:
    try:
        Expression.parse(text).evaluate(NAMES)
    except ExpressionError as error:
        assert 0 <= error.offset <= max(0, len(text))
        assert str(error)


def test_the_dearest_expression_is_cheap() -> None:
    text = "[" + ",".join(["max(1,2)"] * 80) + "]"
    _, calls = counted(lambda: Expression.parse(text).evaluate({}))
    assert calls < 40_000
