"""The expression language of all files: small and bounded, with no way into Python.

Comparisons, arithmetic on numbers, `and`, `or`, `not`, `in`, `a if c else b`, lists and their elements, and
the functions of `FUNCTIONS`. Attributes are read only through the resolver that the caller hands in.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Never, TypeAlias, cast

from ..value_wording import suggest_name
from .parser import FUNCTIONS, parse
from .syntax_tree import (
    MAX_INTEGER,
    Arithmetic,
    Attribute,
    Call,
    ComparisonChain,
    Conditional,
    Element,
    ExpressionError,
    ListOf,
    LiteralValue,
    Logic,
    Name,
    Not,
    Part,
    Relation,
    Sign,
    Symbol,
    walk,
)

__all__ = ["FUNCTIONS", "Attributes", "Expression", "ExpressionError"]

MAX_DIGITS = 15
"""Maximum number of digits that `round` takes."""
MAX_TEXT_LENGTH = 4000
"""Maximum length of a text that `+` joins, characters."""
_MIN_EXPONENT_NUMBER = 1e15

Attributes: TypeAlias = Callable[[object, str], object]
"""Resolves `thing.name`; raises KeyError or ValueError when there is no such attribute."""


@dataclass(frozen=True, slots=True)
class Expression:
    """A parsed expression. `names` are the free names, `paths` the dotted ones (`items[…].colour`)."""

    text: str
    names: frozenset[str]
    paths: frozenset[str]
    root: Part

    @classmethod
    def parse(cls, text: str) -> Expression:
        """Raises ExpressionError (a ValueError) with a sentence and the offset."""
        return _parsed(text)

    def evaluate(self, names: Mapping[str, object], attributes: Attributes | None = None) -> object:
        """The value with these names. Raises ExpressionError; never runs anything but the operators."""
        return _Evaluation(names, attributes).value(self.root)

    def __str__(self) -> str:
        return self.text


@lru_cache(maxsize=2000)
def _parsed(text: str) -> Expression:
    # A mission asks the same few questions in many places.
    root = parse(text)
    parts = tuple(walk(root))
    names = frozenset(part.name for part in parts if isinstance(part, Name))
    paths = frozenset(_dotted(part) for part in parts if isinstance(part, Attribute))
    return Expression(text, names, paths, root)


def _dotted(part: Part) -> str:
    match part:
        case Name(name=name):
            return name
        case Attribute(owner=owner, name=name):
            return f"{_dotted(owner)}.{name}"
        case Element(owner=owner):
            return f"{_dotted(owner)}[…]"
        case _:
            return "(…)"


class _Evaluation:
    def __init__(self, names: Mapping[str, object], attributes: Attributes | None) -> None:
        self._names, self._attributes = names, attributes

    def value(self, part: Part) -> object:
        match part:
            case LiteralValue(value=value):
                return value
            case Name():
                return self._name(part)
            case Attribute():
                return self._attribute(part)
            case Element():
                owner, index = self.value(part.owner), self.value(part.index)
                return _apply(part.at, "[ ]", element, owner, index)
            case Logic(symbol=symbol, parts=parts):
                stop = symbol == "or"
                found: object = not stop
                for lower in parts:
                    found = self.value(lower)
                    if bool(found) is stop:
                        break
                return found
            case Not(operand=operand):
                return not self.value(operand)
            case Sign(symbol=symbol):
                operand = self.value(part.operand)
                return _apply(part.at, symbol, _SIGNS[symbol], operand)
            case Arithmetic(symbol=symbol):
                left, right = self.value(part.left), self.value(part.right)
                return _apply(part.at, symbol, _ARITHMETIC[symbol], left, right)
            case ComparisonChain():
                return self._comparison(part)
            case Conditional():
                return self.value(part.yes if self.value(part.test) else part.no)
            case ListOf(items=items):
                return [self.value(item) for item in items]
            case Call(function=function):
                arguments = [self.value(argument) for argument in part.arguments]
                return _apply(part.at, function, _FUNCTIONS[function], *arguments)

    def _name(self, part: Name) -> object:
        if part.name in self._names:
            return self._names[part.name]
        hint = suggest_name(part.name, self._names)
        raise ExpressionError(f"unknown name {part.name!r}; {hint}".rstrip("; "), part.at)

    def _attribute(self, part: Attribute) -> object:
        owner = self.value(part.owner)
        if self._attributes is None:
            raise ExpressionError(f"nothing here has attributes, so not {part.name!r} either", part.at)
        try:
            return self._attributes(owner, part.name)
        except (KeyError, ValueError, AttributeError) as error:
            text = str(error.args[0]) if error.args else ""
            raise ExpressionError(text if " " in text else f"no attribute {part.name!r}", part.at) from None

    def _comparison(self, part: ComparisonChain) -> bool:
        left = self.value(part.first)
        for related in part.rest:
            right = self.value(related.operand)
            if not _apply(related.at, related.relation, _RELATIONS[related.relation], left, right):
                return False
            left = right
        return True


def _apply(at: int, what: str, function: Callable[..., object], *given: object) -> object:
    """The function's value. Raises ExpressionError in the words of the language."""
    try:
        return function(*given)
    except ZeroDivisionError:
        raise ExpressionError("division by zero", at) from None
    except OverflowError:
        raise ExpressionError("the number is too large", at) from None
    except _Unfit as error:
        raise ExpressionError(str(error), at) from None
    except TypeError:
        kinds = " and ".join(type_words(value) for value in given) or "nothing"
        raise ExpressionError(f"{what!r} does not work on {kinds}", at) from None


class _Unfit(Exception):
    """A value of the right type with which nothing can be done."""


def element(items: object, index: object) -> object:
    """Return an element of a list by its index: 0 is the first, -1 the last."""
    if not isinstance(items, list | tuple):
        raise _Unfit(f"only a list has elements, and this is {type_words(items)}")
    if not isinstance(index, int) or isinstance(index, bool):
        shown = index if isinstance(index, float) else type_words(index)
        raise _Unfit(f"an index is a whole number, not {shown}")
    values = cast("list[object]", items)
    if not -len(values) <= index < len(values):
        raise _Unfit(beyond(index, len(values)))
    return values[index]


def beyond(index: int, count: int) -> str:
    """Return the message for an index that a list of that many elements does not have."""
    if count == 0:
        return f"an empty list has no element [{index}]"
    last = "[0] is the only one" if count == 1 else f"[0] is the first, [{count - 1}] the last"
    return f"a list of {count} has no element [{index}]; {last}"


def _number(value: object) -> int | float:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value
    raise TypeError


def _bounded(number: int | float) -> int | float:
    if (abs(number) > MAX_INTEGER) if isinstance(number, int) else not math.isfinite(number):
        raise OverflowError
    return number


def _on_numbers(function: Callable[[float, float], float]) -> Callable[[object, object], object]:
    return lambda a, b: _bounded(function(_number(a), _number(b)))


def _ordered(function: Callable[[object, object], object]) -> Callable[[object, object], object]:
    def compare(a: object, b: object) -> object:
        return function(*_alike((a, b)))

    return compare


def _alike(values: Iterable[object]) -> list[Never]:
    """The values, which have an order among them: all numbers, or all texts. Raises TypeError."""
    given = list(values)
    if not all(isinstance(value, str) for value in given):
        for value in given:
            _number(value)
    return cast("list[Never]", given)


def _equal(a: object, b: object) -> bool:
    """Whether two values are equal. A text and a number never are, which is an error."""
    plain = isinstance(a, str | int | float) and isinstance(b, str | int | float)
    if plain and isinstance(a, str) is not isinstance(b, str):
        raise _Unfit(f"{type_words(a)} and {type_words(b)} are never equal")
    return a == b


def _contains(item: object, container: object) -> bool:
    if isinstance(container, str) and not isinstance(item, str):
        raise TypeError
    if isinstance(container, str | list | tuple | dict):
        return item in cast("list[object]", container)
    raise TypeError


def _length(items: object) -> int:
    if isinstance(items, str | list | tuple | dict):
        return len(cast("list[object]", items))
    raise TypeError


def _of_several(function: Callable[[Iterable[Never]], object]) -> Callable[..., object]:
    def choose(*given: object) -> object:
        values = given[0] if len(given) == 1 else given
        if not given or not isinstance(values, list | tuple):
            raise TypeError
        if not values:
            raise _Unfit("an empty list has no smallest and no largest element")
        return function(_alike(cast("list[object]", values)))

    return choose


def _absolute(value: object) -> object:
    return abs(_number(value))


def _rounded(value: object, digits: object = None) -> object:
    number = _number(value)
    if digits is None:
        return _bounded(round(number))
    if not isinstance(digits, int) or isinstance(digits, bool):
        raise TypeError
    if abs(digits) > MAX_DIGITS:
        raise _Unfit(f"'round' takes at most {MAX_DIGITS} digits")
    return _bounded(round(number, digits))


def _sum(a: object, b: object) -> object:
    """The sum of two numbers; a text is joined with a text or a number."""
    if not isinstance(a, str) and not isinstance(b, str):
        return _bounded(_number(a) + _number(b))
    joined = _as_text(a) + _as_text(b)
    if len(joined) > MAX_TEXT_LENGTH:
        raise _Unfit(f"the text is longer than {MAX_TEXT_LENGTH} characters")
    return joined


def _as_text(value: object) -> str:
    if isinstance(value, str):
        return value
    number = _number(value)
    whole = isinstance(number, float) and number.is_integer() and abs(number) < _MIN_EXPONENT_NUMBER
    return str(int(number)) if whole else repr(number)


_SIGNS: Mapping[str, Callable[[object], object]] = {"-": lambda a: -_number(a), "+": _number}
_ARITHMETIC: Mapping[Symbol, Callable[[object, object], object]] = {
    "+": _sum,
    "-": _on_numbers(lambda a, b: a - b),
    "*": _on_numbers(lambda a, b: a * b),
    "/": _on_numbers(lambda a, b: a / b),
    "//": _on_numbers(lambda a, b: a // b),
    "%": _on_numbers(lambda a, b: a % b),
}
_RELATIONS: Mapping[Relation, Callable[[object, object], object]] = {
    "==": _equal,
    "!=": lambda a, b: not _equal(a, b),
    "<": _ordered(cast("Callable[[object, object], object]", operator.lt)),
    "<=": _ordered(cast("Callable[[object, object], object]", operator.le)),
    ">": _ordered(cast("Callable[[object, object], object]", operator.gt)),
    ">=": _ordered(cast("Callable[[object, object], object]", operator.ge)),
    "in": _contains,
    "not in": lambda a, b: not _contains(a, b),
}
_FUNCTIONS: Mapping[str, Callable[..., object]] = {
    "len": _length,
    "min": _of_several(cast("Callable[[Iterable[Never]], object]", min)),
    "max": _of_several(cast("Callable[[Iterable[Never]], object]", max)),
    "abs": _absolute,
    "round": _rounded,
}


def type_words(value: object) -> str:
    """Return the type of a value, in the words of the language."""
    match value:
        case None:
            return "null"
        case bool():
            return "true/false"
        case int() | float():
            return "a number"
        case str():
            return "a text"
        case list() | tuple():
            return "a list"
        case _:
            return "a mapping"
