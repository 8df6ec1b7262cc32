"""Expressions as BehaviorTree.CPP's scripts, and back: what stands in the text, and that nothing changes."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Literal, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.authoring.xml.scripts import (
    NotExpressible,
    ScriptError,
    assignments_script,
    expression_text,
    read_expression,
    read_parts,
    script,
)
from picktree.files import Expression
from picktree.files.expression_syntax import (
    Arithmetic,
    Attribute,
    Call,
    ComparisonChain,
    ComparisonLink,
    Conditional,
    ListOf,
    LiteralValue,
    Logic,
    Name,
    Not,
    Part,
    Relation,
    Sign,
    Symbol,
)
from picktree.trees.loading.port_reader import parse_assignments

RELATIONS: tuple[Relation, ...] = ("==", "!=", "<", "<=", ">", ">=")
AMONG: tuple[Relation, ...] = ("in", "not in")
SYMBOLS: tuple[Symbol, ...] = ("+", "-", "*", "/")
DIVISIONS: tuple[Symbol, ...] = ("//", "%")
LOGIC: tuple[Literal["and", "or"], ...] = ("and", "or")


def without_places(part: object) -> object:
    """Equal for what says the same; 1 and true and 1.0 are not the same."""
    if isinstance(part, tuple):
        return tuple(without_places(item) for item in cast("tuple[object, ...]", part))
    if not is_dataclass(part):
        return (type(part).__name__, part)
    kept = [f.name for f in fields(part) if f.name != "at"]
    return (type(part).__name__, *(without_places(getattr(part, name)) for name in kept))


SAID = [
    ("n > 3", "n > 3"),
    ("not done", "!done"),
    ("not (a and b)", "!(a && b)"),
    ("not a == b", "!(a == b)"),
    ("(not a) == b", "!a == b"),
    ("a and b and c", "a && b && c"),
    ("a or b and c", "a || (b && c)"),
    ("(a or b) and c", "(a || b) && c"),
    ("colour == 'red'", "colour == 'red'"),
    ("'box_' + n", "'box_' .. n"),
    ("'a' + b + 'c'", "('a' .. b) .. 'c'"),
    ("0 < n <= 3", "0 < n <= 3"),
    ("(a < b) == c", "(a < b) == c"),
    ("a - (b - c)", "a - (b - c)"),
    ("a - b - c", "a - b - c"),
    ("a + b * c", "a + b * c"),
    ("(a + b) * c", "(a + b) * c"),
    ("-a + 1", "(-a) + 1"),
    ("1.5e-7 * x", "1.5e-07 * x"),
    ("done == true", "done == true"),
    ("1 if a else 2", "a ? 1 : 2"),
    ("1 if a else 2 if b else 3", "a ? 1 : (b ? 2 : 3)"),
]


@pytest.mark.parametrize(("ours", "theirs"), SAID)
def test_what_both_can_say(ours: str, theirs: str) -> None:
    expression = Expression.parse(ours)
    assert script(expression) == theirs
    back = Expression.parse(expression_text(read_expression(theirs)))
    assert without_places(back.root) == without_places(expression.root)


UNSAID = {
    "items_left": "'items_left' is a fact of the world, not a key of the blackboard",
    "item.colour == 'red'": "attributes, lists, functions and other operators are not allowed",
    "len(items) > 0": "attributes, lists, functions and other operators are not allowed",
    "n // 2": "attributes, lists, functions and other operators are not allowed",
    "c in ['red']": "there is no 'in'",
    "x == null": "there is no null",
    "trueish": "'trueish' begins like a constant",
    "c == 'grün'": "a text with such characters",
    "c == 'it\\'s \"so\"'": "a text with such characters",
    'c == "operator\'s bin"': "a text with such characters",
    "n == 9007199254740993": "the number is too large",
    "+n": "attributes, lists, functions and other operators are not allowed",
}


@pytest.mark.parametrize("ours", UNSAID)
def test_what_only_we_can_say(ours: str) -> None:
    with pytest.raises(NotExpressible) as caught:
        script(Expression.parse(ours))
    assert str(caught.value) == UNSAID[ours]


THEIRS = {
    " battery>20&&!charging ": "battery > 20 and not charging",
    "'a' .. b .. 1": "'a' + b + 1",
    "a || b && c": "a or b and c",
    "a && b || c && d": "a and b or c and d",
    "!a && b": "not a and b",
    "-x * -y": "-x * -y",
    "0x1F == n": "31 == n",
    "(a)": "a",
    "a ? 'yes' : 'no'": "'yes' if a else 'no'",
}


@pytest.mark.parametrize("theirs", THEIRS)
def test_scripts_of_others_are_read_by_btcpp_s_own_grammar(theirs: str) -> None:
    assert expression_text(read_expression(theirs)) == THEIRS[theirs]


REFUSED = {
    "": "the script is empty",
    "a & b": "bitwise operators have no counterpart",
    "~a": "bitwise operators have no counterpart",
    "in > 3": "'in' cannot be the name of a key in an expression",
    "a := 3": "one expression without an assignment is wanted",
    "a; b": "one expression without an assignment is wanted",
    "a ==": "a value is missing",
    "(a": "')' is missing",
    "a b": "one expression without an assignment is wanted",
    "a.b": "'.' has no meaning in a script",
    "(" * 60 + "a" + ")" * 60: "the script is nested more than 40 deep",
    "a" * 5000: "the script is longer than 4000 characters",
    "3 = a": "only a key of the tree can be assigned to",
    "a = b = c": "only one key can be assigned to",
}


@pytest.mark.parametrize("theirs", REFUSED)
def test_scripts_that_have_no_counterpart(theirs: str) -> None:
    with pytest.raises(ScriptError) as caught:
        expression_text(read_expression(theirs))
    assert str(caught.value) == REFUSED[theirs]


def test_assignments() -> None:
    ours = parse_assignments("a := 1; b = a + 1; c := 'x;y'")
    theirs = assignments_script(ours)
    assert theirs == "a := 1; b = a + 1; c := 'x;y'"
    assert [s.text() for s in read_parts(theirs)] == ["a := 1", "b = a + 1", "c := 'x;y'"]
    assert [s.text() for s in read_parts("in := 4")] == ["in := 4"]
    assert [s.text() for s in read_parts("n += 1; m *= 2 + k")] == ["n = n + 1", "m = m * (2 + k)"]


PLACE = st.just(0)
names = st.builds(Name, PLACE, st.sampled_from(["a", "b", "count", "colour_2", "_x"]))
texts = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=5)
numbers = st.integers(0, 2**40) | st.floats(0, 1e30)
literals = st.builds(
    LiteralValue,
    PLACE,
    numbers | st.booleans() | texts.filter(lambda text: not ("'" in text and '"' in text)),
)


def parts_of(inner: st.SearchStrategy[Part]) -> st.SearchStrategy[Part]:
    """What scripts can say, too."""
    relations = st.sampled_from(RELATIONS)
    several = st.lists(inner, min_size=2, max_size=3).map(tuple)
    related = st.lists(st.builds(ComparisonLink, PLACE, relations, inner), min_size=1, max_size=2).map(tuple)
    return st.one_of(
        st.builds(Not, PLACE, inner),
        st.builds(Sign, PLACE, st.just("-"), inner),
        st.builds(Arithmetic, PLACE, st.sampled_from(SYMBOLS), inner, inner),
        st.builds(ComparisonChain, PLACE, inner, related),
        st.builds(Logic, PLACE, st.sampled_from(LOGIC), several),
        st.builds(Conditional, PLACE, inner, inner, inner),
    )


def ours_alone(inner: st.SearchStrategy[Part]) -> st.SearchStrategy[Part]:
    items = st.lists(inner, min_size=1, max_size=3).map(tuple)
    among = st.tuples(st.builds(ComparisonLink, PLACE, st.sampled_from(AMONG), inner))
    return st.one_of(
        parts_of(inner),
        st.builds(Attribute, PLACE, inner, st.just("colour")),
        st.builds(ListOf, PLACE, items),
        st.builds(Call, PLACE, st.just("max"), items),
        st.builds(ComparisonChain, PLACE, inner, among),
        st.builds(Sign, PLACE, st.just("+"), inner),
        st.builds(Arithmetic, PLACE, st.sampled_from(DIVISIONS), inner, inner),
    )


sayable = st.recursive(names | literals, parts_of, max_leaves=8)
everything = st.recursive(names | literals | st.just(LiteralValue(0, None)), ours_alone, max_leaves=8)


@given(everything)
def test_the_text_of_any_expression_parses_to_the_same(part: Part) -> None:
    assert without_places(Expression.parse(expression_text(part)).root) == without_places(part)


@given(sayable)
def test_a_script_reads_back_as_the_same_expression(part: Part) -> None:
    theirs = script(Expression("", frozenset(), frozenset(), part))
    back = Expression.parse(expression_text(read_expression(theirs)))
    assert without_places(back.root) == without_places(part)


@given(st.text("ab 01.'\"&|!<>=:?;+-*/()@~^xX", max_size=25))
def test_no_script_is_too_strange_to_be_refused(text: str) -> None:
    try:
        ours = expression_text(read_expression(text))
    except ScriptError as error:
        assert 0 <= error.offset <= max(len(text), 0)
    else:
        Expression.parse(ours)
