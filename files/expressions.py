"""Expression language of all files: small and bounded, with no way into Python. An expression is
evaluated, and its type is inferred without values, so that errors show before anything runs.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, Literal, Never, TypeAlias, cast

from .expression_syntax import (
    FUNCTIONS,
    MAX_INTEGER,
    Arithmetic,
    Attribute,
    Call,
    ComparisonChain,
    ComparisonLink,
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
    parse,
    walk,
)
from .expression_syntax import children as parts_of
from .value_wording import suggest_name

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
        """Parse an expression. Raises ExpressionError (a ValueError) with a sentence and the offset."""
        return _parsed(text)

    def evaluate(self, names: Mapping[str, object], attributes: Attributes | None = None) -> object:
        """Return the value with these names. Raises ExpressionError; never runs anything but the
        operators."""
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
    """Return the value of the function. Raises ExpressionError in the words of the language."""
    try:
        return function(*given)
    except ZeroDivisionError:
        raise ExpressionError("division by zero", at) from None
    except OverflowError:
        raise ExpressionError("the number is too large", at) from None
    except _Unfit as error:
        raise ExpressionError(str(error), at) from None
    except TypeError:
        raise _misfit(what, [type_words(value) for value in given], at) from None


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
    """Return the values if they can be ordered: all numbers, or all texts. Raises TypeError."""
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
    """Return the sum of two numbers, or a text joined with a text or a number."""
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


Kind: TypeAlias = Literal[
    "any", "null", "bool", "int", "float", "number", "text", "word", "object", "place", "list", "mapping"
]
"""Kind of a value. `number`: whole or not. `text`: names no object. `word`: a text that may be an object's
id. `object`: an object's id. `place`: id of a bin or another support."""


@dataclass(frozen=True, slots=True)
class ValueType:
    """Type of a value. `element` is set for a list, `optional` when the value may be null."""

    kind: Kind
    element: ValueType | None = None
    optional: bool = False
    choices: tuple[str, ...] = ()
    """All texts that it can be; empty when they are unknown."""

    def words(self) -> str:
        """Return the type in words for a sentence: "a list, each a number"."""
        each = self.element.words() if self.element is not None else "a value"
        return f"a list, each {each}" if self.kind == "list" and each != "a value" else _WORDS[self.kind]


ANY: Final = ValueType("any")
NULL: Final = ValueType("null")
BOOL: Final = ValueType("bool")
INT: Final = ValueType("int")
FLOAT: Final = ValueType("float")
NUMBER: Final = ValueType("number")
TEXT: Final = ValueType("text")
WORD: Final = ValueType("word")
OBJECT: Final = ValueType("object")
PLACE: Final = ValueType("place")
_WORDS: Mapping[Kind, str] = {
    "any": "a value", "null": "null", "bool": "true/false", "int": "a whole number", "float": "a number",
    "number": "a number", "text": "a text", "word": "a text", "object": "an object's id",
    "place": "the name of a place", "list": "a list", "mapping": "a mapping",
}  # fmt: skip
_NUMBERS = ("int", "float", "number")
_TEXTS = ("text", "word", "object", "place")


def list_of(element: ValueType) -> ValueType:
    return ValueType("list", element)


def join(types: Iterable[ValueType]) -> ValueType:
    """Return the common type of values of these types."""
    found = tuple(dict.fromkeys(types))
    plain = tuple(dict.fromkeys(ValueType(t.kind, t.element) for t in found if t.kind != "null"))
    if not plain:
        return NULL if found else ANY
    joined = plain[0] if len(plain) == 1 else _joined(plain)
    optional = any(t.optional or t.kind == "null" for t in found)
    texts = [t.choices for t in found if t.kind in _TEXTS]
    choices = tuple(dict.fromkeys(c for each in texts for c in each)) if all(texts) else ()
    if len(choices) > _MAX_CHOICES:
        choices = ()
    return ANY if joined.kind == "any" else replace(joined, optional=optional, choices=choices)


_MAX_CHOICES = 50


def _joined(types: tuple[ValueType, ...]) -> ValueType:
    kinds = {t.kind for t in types}
    if kinds <= set(_NUMBERS):
        return NUMBER
    if kinds == {"list"}:
        return list_of(join(t.element or ANY for t in types))
    definite = [t for t in types if t.kind != "word"]
    # A word fits any kind of text.
    return definite[0] if len(definite) == 1 and definite[0].kind in _TEXTS else ANY


def type_of_value(value: object) -> ValueType:
    """Return the type of a plain value, as on the blackboard."""
    match value:
        case None:
            return NULL
        case bool():
            return BOOL
        case int():
            return INT
        case float():
            return FLOAT
        case str():
            return ValueType("word", choices=(value,))
        case list():
            return list_of(join(map(type_of_value, cast("list[object]", value))))
        case dict():
            return ValueType("mapping")
        case _:
            return ANY


def comparable(a: ValueType, b: ValueType) -> bool:
    """Whether a value of one type can ever equal one of the other."""
    if a.kind in ("any", "null") or b.kind in ("any", "null"):
        return True
    return any(a.kind in family and b.kind in family for family in _FAMILIES)


_FAMILIES = ((*_NUMBERS, "bool"), _TEXTS, ("list",), ("mapping",))


def check_types(
    expression: Expression, names: Mapping[str, ValueType], attributes: Mapping[str, ValueType]
) -> ValueType:
    """Return the type of the expression. Raises ExpressionError when it cannot have a value with these names.

    `attributes` are those of an object. A name that is not in `names` is unknown.
    """
    return _Typing(names, attributes).of(expression.root)


def unlike_sides(
    expression: Expression, names: Mapping[str, ValueType], attributes: Mapping[str, ValueType]
) -> ExpressionError | None:
    """Return why an `==` or `!=` fails with such names, whatever the values are; None where none does."""
    typing = _Typing(names, attributes)
    for first, link in _always_compared(expression.root):
        try:
            left, right = typing.of(first), typing.of(link.operand)
        except ExpressionError:
            continue
        if not comparable(left, right):
            return _never_equal(link.at, left, right)
    return None


def _always_compared(part: Part) -> Iterator[tuple[Part, ComparisonLink]]:
    match part:
        case Logic(parts=(first, *_)):
            yield from _always_compared(first)
        case Conditional(test=test):
            yield from _always_compared(test)
        case ComparisonChain(first=first, rest=(link, *_)):
            if link.relation in ("==", "!="):
                yield first, link
            yield from (found for side in (first, link.operand) for found in _always_compared(side))
        case _:
            yield from (found for below in parts_of(part) for found in _always_compared(below))


def _never_equal(at: int, left: ValueType, right: ValueType) -> ExpressionError:
    return ExpressionError(f"{_WORDS[left.kind]} and {_WORDS[right.kind]} are never equal", at)


class _Typing:
    def __init__(self, names: Mapping[str, ValueType], attributes: Mapping[str, ValueType]) -> None:
        self._names, self._attributes = names, attributes

    def of(self, part: Part) -> ValueType:
        match part:
            case LiteralValue(value=value):
                return type_of_value(value)
            case Name():
                return self._name(part)
            case Attribute():
                return self._attribute(part)
            case Element():
                return _element(part, self.of(part.owner), self.of(part.index))
            case Not(operand=operand):
                self.of(operand)
                return BOOL
            case Sign(symbol=symbol):
                return _numbers(part.at, symbol, self.of(part.operand))
            case Arithmetic(symbol=symbol):
                left, right = self.of(part.left), self.of(part.right)
                return (
                    _type_of_sum(part.at, left, right)
                    if symbol == "+"
                    else _numbers(part.at, symbol, left, right)
                )
            case ComparisonChain():
                return self._comparison(part)
            case Logic(parts=parts):
                return join([self.of(lower) for lower in parts])
            case Conditional():
                self.of(part.test)
                return join((self.of(part.yes), self.of(part.no)))
            case ListOf(items=items):
                return list_of(join([self.of(item) for item in items]))
            case Call():
                return _call(part, [self.of(argument) for argument in part.arguments])

    def _name(self, part: Name) -> ValueType:
        if part.name in self._names:
            return self._names[part.name]
        hint = suggest_name(part.name, self._names)
        raise UnknownName(f"unknown name {part.name!r}; {hint}".rstrip("; "), part.at)

    def _attribute(self, part: Attribute) -> ValueType:
        owner = self.of(part.owner)
        literal = isinstance(part.owner, LiteralValue)
        if literal or owner.kind not in ("any", "word", "object"):
            message = f"only an object has attributes, so {owner.words()} has no {part.name!r}"
            raise ExpressionError(message, part.at)
        if part.name not in self._attributes:
            hint = suggest_name(part.name, self._attributes)
            raise ExpressionError(f"an object has no attribute {part.name!r}; {hint}", part.at)
        return self._attributes[part.name]

    def _comparison(self, part: ComparisonChain) -> ValueType:
        before, left = part.first, self.of(part.first)
        for related in part.rest:
            right = self.of(related.operand)
            _related(related, left, right)
            if related.relation in ("==", "!="):
                _check_choice(before, right)
                _check_choice(related.operand, left)
            elif isinstance(related.operand, ListOf):
                _check_choice(related.operand, left)
            before, left = related.operand, right
        return BOOL


class UnknownName(ExpressionError):
    """A name that nothing gives a value."""


def _unfit(what: str, given: Iterable[ValueType], at: int) -> ExpressionError:
    return _misfit(what, [_WORDS[t.kind] for t in given], at)


def _misfit(what: str, kinds: list[str], at: int) -> ExpressionError:
    """Return the error of an operator or function on values of these kinds, in words."""
    message = f"{what!r} does not work on {' and '.join(kinds) or 'nothing'}"
    if what == "+" and "a text" in kinds:
        message += ": it joins a text with a text or a number"
    return ExpressionError(message, at)


def _type_of_sum(at: int, left: ValueType, right: ValueType) -> ValueType:
    """Return the type of a sum, or of a text joined with a text or a number."""
    if any(t.kind in ("text", "word") for t in (left, right)):
        if any(t.kind not in ("any", *_TEXTS, *_NUMBERS) for t in (left, right)):
            raise _unfit("+", (left, right), at)
        return WORD
    found = _numbers(at, "+", left, right)
    # Beside a number the other one is taken for a number, too: counters would be unknown otherwise.
    return ANY if left.kind == right.kind == "any" else found


def _numbers(at: int, symbol: str, *given: ValueType) -> ValueType:
    if any(t.kind not in ("any", *_NUMBERS) for t in given):
        raise _unfit(symbol, given, at)
    if symbol == "/" or any(t.kind == "float" for t in given):
        return FLOAT
    return INT if all(t.kind == "int" for t in given) else NUMBER


def _element(part: Element, owner: ValueType, index: ValueType) -> ValueType:
    if owner.kind not in ("any", "list"):
        raise ExpressionError(f"only a list has elements, and this is {_WORDS[owner.kind]}", part.at)
    if index.kind not in ("any", "int", "number"):
        raise ExpressionError(f"an index is a whole number, not {_WORDS[index.kind]}", part.index.at)
    place = _whole_number(part.index)
    if isinstance(part.owner, ListOf) and place is not None:
        count = len(part.owner.items)
        if not -count <= place < count:
            raise ExpressionError(beyond(place, count), part.at)
    return owner.element or ANY


def _whole_number(part: Part) -> int | None:
    """Return the whole number that this part writes, with its sign; None for any other part."""
    if isinstance(part, Sign):
        number = _whole_number(part.operand)
        return -number if number is not None and part.symbol == "-" else number
    return part.value if isinstance(part, LiteralValue) and type(part.value) is int else None


def _related(related: ComparisonLink, left: ValueType, right: ValueType) -> None:
    relation = related.relation
    match relation:
        case "==" | "!=":
            if not comparable(left, right):
                raise _never_equal(related.at, left, right)
            number = _whole_number(related.operand)
            if left.kind == "bool" and number not in (None, 0, 1):
                raise ExpressionError(f"{_WORDS['bool']} and {number} are never equal", related.at)
        case "in" | "not in":
            _check_container(related, left, right)
        case _:
            if not _may_be_ordered((left, right)):
                raise _unfit(relation, (left, right), related.at)


def _check_choice(part: Part, other: ValueType) -> None:
    """Check a literal text, or each text of a list, against all possible values of the other side."""
    if isinstance(part, ListOf):
        for item in part.items:
            _check_choice(item, other)
    elif isinstance(part, LiteralValue) and isinstance(part.value, str) and other.choices:
        if part.value in other.choices:
            return
        hint = suggest_name(part.value, other.choices)
        raise ExpressionError(f"this is never {part.value!r}; {hint}", part.at)


def _check_container(related: ComparisonLink, item: ValueType, container: ValueType) -> None:
    if container.kind == "any":
        return
    if container.kind in ("mapping", *_TEXTS) and item.kind in ("any", *_TEXTS):
        return
    if container.kind != "list":
        raise _unfit(related.relation, (item, container), related.at)
    element = container.element or ANY
    if not comparable(item, element):
        message = f"{_WORDS[item.kind]} is never in a list, each {element.words()}"
        raise ExpressionError(message, related.at)


def _may_be_ordered(types: Iterable[ValueType]) -> bool:
    known = [t.kind for t in types if t.kind != "any"]
    return all(kind in _NUMBERS for kind in known) or all(kind in _TEXTS for kind in known)


def _call(part: Call, given: list[ValueType]) -> ValueType:
    name, first = part.function, given[0] if given else None
    match name:
        case "len" if len(given) == 1 and first and first.kind in ("any", "list", "mapping", *_TEXTS):
            return INT
        case "abs" if len(given) == 1 and first and first.kind in ("any", *_NUMBERS):
            return first if first.kind != "any" else NUMBER
        case "round" if len(given) == 1 and first and first.kind in ("any", *_NUMBERS):
            return INT
        case "round" if len(given) == 2 and all(t.kind in ("any", *_NUMBERS) for t in given):
            if given[1].kind == "float":
                raise ExpressionError("'round' takes a whole number of digits", part.at)
            return NUMBER
        case "min" | "max" if len(given) > 1 and _may_be_ordered(given):
            return join(given)
        case "min" | "max" if len(given) == 1 and first and first.kind in ("any", "list"):
            return _of_list(part, first)
        case _:
            raise _unfit(name, given, part.at)


def _of_list(part: Call, given: ValueType) -> ValueType:
    element = given.element or ANY
    if not _may_be_ordered((element,)):
        raise _unfit(part.function, (given,), part.at)
    if isinstance(part.arguments[0], ListOf) and not part.arguments[0].items:
        raise ExpressionError("an empty list has no smallest and no largest element", part.at)
    return element
