"""Syntax tree of expressions. `at` is the character (from 0) to which an error refers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

Symbol: TypeAlias = Literal["+", "-", "*", "/", "//", "%"]
Relation: TypeAlias = Literal["==", "!=", "<", "<=", ">", ">=", "in", "not in"]


@dataclass(frozen=True, slots=True)
class LiteralValue:
    """A number, a text, true, false or null."""

    at: int
    value: str | int | float | bool | None


@dataclass(frozen=True, slots=True)
class Name:
    at: int
    name: str


@dataclass(frozen=True, slots=True)
class Attribute:
    """`owner.name`"""

    at: int
    owner: Part
    name: str


@dataclass(frozen=True, slots=True)
class Not:
    at: int
    operand: Part


@dataclass(frozen=True, slots=True)
class Sign:
    at: int
    symbol: Literal["+", "-"]
    operand: Part


@dataclass(frozen=True, slots=True)
class Arithmetic:
    at: int
    symbol: Symbol
    left: Part
    right: Part


@dataclass(frozen=True, slots=True)
class ComparisonChain:
    """`first < second <= third`: every relation holds between its neighbours."""

    at: int
    first: Part
    rest: tuple[ComparisonLink, ...]


@dataclass(frozen=True, slots=True)
class ComparisonLink:
    at: int
    relation: Relation
    operand: Part


@dataclass(frozen=True, slots=True)
class Logic:
    """`a and b and c`: the first that decides, else the last."""

    at: int
    symbol: Literal["and", "or"]
    parts: tuple[Part, ...]


@dataclass(frozen=True, slots=True)
class Conditional:
    """`yes if test else no`"""

    at: int
    test: Part
    yes: Part
    no: Part


@dataclass(frozen=True, slots=True)
class ListOf:
    at: int
    items: tuple[Part, ...]


@dataclass(frozen=True, slots=True)
class Call:
    at: int
    function: str
    arguments: tuple[Part, ...]


Part: TypeAlias = (
    LiteralValue
    | Name
    | Attribute
    | Not
    | Sign
    | Arithmetic
    | ComparisonChain
    | Logic
    | Conditional
    | ListOf
    | Call
)


def children(part: Part) -> tuple[Part, ...]:
    """The parts that a part is made of, in their order."""
    match part:
        case LiteralValue() | Name():
            return ()
        case Attribute(owner=owner):
            return (owner,)
        case Not(operand=operand) | Sign(operand=operand):
            return (operand,)
        case Arithmetic(left=left, right=right):
            return (left, right)
        case ComparisonChain(first=first, rest=rest):
            return (first, *(related.operand for related in rest))
        case Logic(parts=parts) | ListOf(items=parts) | Call(arguments=parts):
            return parts
        case Conditional(test=test, yes=yes, no=no):
            return (yes, test, no)


def walk(root: Part) -> Iterator[Part]:
    """The part and all below it, parents first."""
    todo = [root]
    while todo:
        part = todo.pop()
        yield part
        todo += reversed(children(part))
