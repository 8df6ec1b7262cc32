"""What can be said of an expression without the values of its names."""

from __future__ import annotations

from dataclasses import dataclass

from ...files.expressions.expression import Expression, ExpressionError
from ...files.expressions.syntax_tree import (
    Attribute,
    Choice,
    Comparison,
    ListOf,
    Literally,
    Logic,
    Name,
    Not,
    Part,
    walk,
)
from ...files.expressions.syntax_tree import below as parts_of


@dataclass(frozen=True, slots=True)
class Shape:
    """`certain`: names that are read whatever the values are. `total`: it has a value as soon as its names
    have one, of whatever type. `constant`: whether it holds, where no name decides; None: cannot be said."""

    names: tuple[str, ...]
    certain: frozenset[str]
    attributes: bool
    total: bool
    constant: bool | None
    fails: bool
    """It has no value at all: `1 / 0`."""
    if_yes: bool | None
    """What it says of the fact `holding` where it holds; None: nothing."""
    if_no: bool | None
    """The same where it does not hold."""


def shape(expression: Expression) -> Shape:
    constant, fails = _constant(expression)
    names = dict.fromkeys(part.name for part in walk(expression.root) if isinstance(part, Name))
    return Shape(
        tuple(names),
        certain_names(expression.root),
        bool(expression.paths),
        is_total(expression.root),
        constant,
        fails,
        says_of_hand(expression.root, answer=True),
        says_of_hand(expression.root, answer=False),
    )


def certain_names(part: Part) -> frozenset[str]:
    """Names that are read whatever the values are: those behind a first `and` or `or` are not."""
    match part:
        case Name(name=name):
            return frozenset((name,))
        case Logic(parts=(first, *_)):
            return certain_names(first)
        case Choice(test=test, yes=yes, no=no):
            return certain_names(test) | (certain_names(yes) & certain_names(no))
        case Comparison(first=first, rest=(second, *_)):
            return certain_names(first) | certain_names(second.operand)
        case _:
            return frozenset[str]().union(*map(certain_names, parts_of(part)))


def is_total(part: Part) -> bool:
    """Whether nothing in it works on some types only."""
    match part:
        case Literally() | Name():
            return True
        case Comparison(rest=rest):
            return all(r.relation in ("==", "!=") for r in rest) and all(map(is_total, parts_of(part)))
        case Logic() | Not() | Choice() | ListOf():
            return all(map(is_total, parts_of(part)))
        case _:
            return False


def says_of_hand(part: Part, *, answer: bool) -> bool | None:
    """Whether something is held when that is the answer; None: it does not tell."""
    match part:
        case Name(name="holding"):
            return answer
        case Not(operand=operand):
            return says_of_hand(operand, answer=not answer)
        case Logic(symbol=symbol, parts=parts) if (symbol == "and") is answer:
            # All parts of an `and` that holds do, and no part of an `or` that does not.
            known = (says_of_hand(one, answer=answer) for one in parts)
            return next((said for said in known if said is not None), None)
        case _:
            return None


def _constant(expression: Expression) -> tuple[bool | None, bool]:
    if expression.names or any(isinstance(part, Attribute) for part in walk(expression.root)):
        return None, False
    try:
        return bool(expression.evaluate({})), False
    except ExpressionError:
        return None, True
