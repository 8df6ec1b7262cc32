"""Types of expressions: what cannot have a value is refused before it is asked, and only that."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from picktree.files import (
    ANY,
    BOOL,
    FLOAT,
    INT,
    OBJECT,
    PLACE,
    TEXT,
    WORD,
    Expression,
    UnknownName,
    ValueType,
    check_types,
    join,
    list_of,
    type_of_value,
)
from picktree.files.expression_syntax import ExpressionError
from picktree.files.expressions import NULL, NUMBER

NAMES = {
    "n": INT, "x": FLOAT, "flag": BOOL, "colour": TEXT, "word": WORD, "item": OBJECT, "bin": PLACE,
    "numbers": list_of(INT), "items": list_of(OBJECT), "lists": list_of(list_of(INT)), "what": ANY,
    "shade": ValueType("text", choices=("red", "green")), "none": NULL, "map": ValueType("mapping"),
}  # fmt: skip
ATTRIBUTES = {
    "colour": TEXT,
    "confidence": FLOAT,
    "id": OBJECT,
    "destination": ValueType("place", optional=True),
}
VALUES: dict[str, object] = {
    "n": 4, "x": 0.5, "flag": True, "colour": "red", "word": "item_1", "item": "item_1", "bin": "red_bin",
    "numbers": [1, 2], "items": ["item_1", "item_2"], "lists": [[1], [2, 3]], "what": 3,
    "shade": "red", "none": None, "map": {"a": 1},
}  # fmt: skip


def attribute(owner: object, name: str) -> object:
    if not isinstance(owner, str):
        raise ValueError("only an object has attributes")
    return {"colour": "red", "confidence": 0.5, "id": owner, "destination": "red_bin"}[name]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1", INT), ("1.5", FLOAT), ("true", BOOL), ("null", NULL),
        ("'red'", ValueType("word", choices=("red",))),
        ("n + 1", INT), ("n / 2", FLOAT), ("n + x", FLOAT), ("what + 1", NUMBER), ("n // 2 % 3", INT),
        ("colour + 1", WORD), ("n + 'a' + what", WORD), ("bin + word", WORD), ("what + what", ANY),
        ("-n", INT), ("-what", NUMBER), ("not items", BOOL), ("n < x <= 3", BOOL), ("n and x", NUMBER),
        ("flag and items", ANY), ("flag or not flag", BOOL), ("item or word", OBJECT),
        ("colour or word", TEXT), ("n if flag else null", ValueType("int", optional=True)),
        ("[]", list_of(ANY)), ("[1, 2.5]", list_of(NUMBER)), ("[n, 'a']", list_of(ANY)),
        ("item.colour", TEXT), ("word.confidence", FLOAT), ("what.id.colour", TEXT),
        ("len(items)", INT), ("len(colour)", INT), ("len(map)", INT), ("min(1, x)", NUMBER),
        ("max(numbers)", INT), ("max('a', colour)", TEXT), ("abs(x)", FLOAT), ("round(x)", INT),
        ("round(x, 2)", NUMBER), ("item in items", BOOL), ("'r' in colour", BOOL), ("'a' in map", BOOL),
        ("item.destination == null", BOOL), ("flag == 1", BOOL), ("none == 3", BOOL),
        ("item == 'red_1'", BOOL), ("shade == 'red' or 'e' in shade", BOOL), ("items == []", BOOL),
        ("shade in 'red, green'", BOOL), ("items[0]", OBJECT), ("items[-1].colour", TEXT),
        ("lists[n][0]", INT), ("what[n + 1]", ANY), ("[1, 'a'][1]", ANY), ("[n, x][n]", NUMBER),
        ("what.colour.colour", None),
    ],
)  # fmt: skip
def test_types(text: str, expected: ValueType | None) -> None:
    expression = Expression.parse(text)
    if expected is None:
        with pytest.raises(ExpressionError):
            check_types(expression, NAMES, ATTRIBUTES)
    else:
        assert check_types(expression, NAMES, ATTRIBUTES) == expected


@pytest.mark.parametrize(
    ("text", "message", "offset"),
    [
        ("flag and itme == 'a'", "unknown name 'itme'; did you mean 'item'?", 9),
        ("n.colour == 'red'", "only an object has attributes, so a whole number has no 'colour'", 2),
        ("item.colour.id", "only an object has attributes, so a text has no 'id'", 12),
        ("item.destination.colour",
         "only an object has attributes, so the name of a place has no 'colour'", 17),
        ("items.colour", "only an object has attributes, so a list, each an object's id has no 'colour'", 6),
        ("item.color == 'red'", "an object has no attribute 'color'; did you mean 'colour'?", 5),
        ("n - colour", "'-' does not work on a whole number and a text", 2),
        ("colour + flag", "'+' does not work on a text and true/false: it joins a text with a text or a "
         "number", 7),
        ("-colour", "'-' does not work on a text", 0),
        ("items * 3", "'*' does not work on a list and a whole number", 6),
        ("n > colour", "'>' does not work on a whole number and a text", 2),
        ("items > items", "'>' does not work on a list and a list", 6),
        ("n == 'four'", "a whole number and a text are never equal", 2),
        ("flag == 'true'", "true/false and a text are never equal", 5),
        ("n in x", "'in' does not work on a whole number and a number", 2),
        ("n in items", "a whole number is never in a list, each an object's id", 2),
        ("map in map", "'in' does not work on a mapping and a mapping", 4),
        ("len(n)", "'len' does not work on a whole number", 0),
        ("len()", "'len' does not work on nothing", 0),
        ("min(n)", "'min' does not work on a whole number", 0),
        ("max(lists)", "'max' does not work on a list", 0),
        ("max([])", "an empty list has no smallest and no largest element", 0),
        ("abs(colour)", "'abs' does not work on a text", 0),
        ("round(x, 0.5)", "'round' takes a whole number of digits", 0),
        ("flag and shade == 'rde'", "this is never 'rde'; did you mean 'red'?", 18),
        ("shade in ['red', 'gren']", "this is never 'gren'; did you mean 'green'?", 17),
        ("colour[0]", "only a list has elements, and this is a text", 6),
        ("flag and items[n / 2]", "an index is a whole number, not a number", 17),
        ("items['first']", "an index is a whole number, not a text", 6),
        ("['a', 'b'][2]", "a list of 2 has no element [2]; [0] is the first, [1] the last", 10),
        ("[n][-2]", "a list of 1 has no element [-2]; [0] is the only one", 3),
        ("(shade if flag else 'blue') == 'yellow'", "this is never 'yellow'; known: red, green, blue", 31),
    ],
)  # fmt: skip
def test_what_cannot_have_a_value(text: str, message: str, offset: int) -> None:
    with pytest.raises(ExpressionError) as caught:
        check_types(Expression.parse(text), NAMES, ATTRIBUTES)
    assert (str(caught.value), caught.value.offset) == (message, offset)
    assert isinstance(caught.value, UnknownName) is text.startswith("flag and itme")


PIECES = [
    *NAMES, "1", "2.5", "'a'", "(", ")", "[", "]", " and ", " or ", "not ", "==", "<", " in ", "+", "-",
    "*", "/", ".colour", ".destination", ",", "len(", "max(", "abs(", "round(", " if ", " else ", "null",
    "[0]", "[-1]", "[n]",
]  # fmt: skip
UNFORESEEN = ("division by zero", "too large", "empty list", "digits", "an index is", "has no element")


@settings(max_examples=150)
@given(st.lists(st.sampled_from(PIECES), min_size=1, max_size=9).map("".join))
def test_what_passes_has_a_value(text: str) -> None:
    try:
        expression = Expression.parse(text)
        found = check_types(expression, {**NAMES, "what": INT}, ATTRIBUTES)
    except ExpressionError:
        return
    try:
        value = expression.evaluate(VALUES, attribute)
    except ExpressionError as error:
        assert any(words in str(error) for words in UNFORESEEN), str(error)
        return
    assert fits(value, found), (value, found)


def fits(value: object, expected: ValueType) -> bool:
    if expected.choices and value not in (*expected.choices, None):
        return False
    kind = type_of_value(value).kind
    if expected.kind == "any" or (value is None and expected.optional):
        return True
    if expected.kind == "number":
        return kind in ("int", "float")
    if expected.kind in ("text", "object", "place"):
        return kind == "word"
    return kind == expected.kind


@pytest.mark.parametrize(
    ("types", "expected"),
    [
        ([], ANY), ([INT], INT), ([INT, INT], INT), ([INT, FLOAT], NUMBER), ([INT, TEXT], ANY),
        ([NULL], NULL), ([NULL, INT], ValueType("int", optional=True)), ([ANY, INT], ANY),
        ([WORD, OBJECT], OBJECT), ([WORD, TEXT, OBJECT], ANY), ([WORD, INT], ANY),
        ([list_of(INT), list_of(FLOAT)], list_of(NUMBER)), ([list_of(INT), INT], ANY),
    ],
)  # fmt: skip
def test_the_type_of_one_of_several(types: list[ValueType], expected: ValueType) -> None:
    assert join(types) == expected
