"""The type of an expression, found without its values: what would fail when it is asked fails here."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias, cast

from ..value_wording import suggest_name
from .expression import Expression, beyond
from .syntax_tree import (
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
    Sign,
)
from .syntax_tree import children as parts_of

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
    """All texts that it can be; empty when nobody knows."""

    def words(self) -> str:
        """As it reads in a sentence: "a list, each a number"."""
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
    """The type of a value that has one of these types."""
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
    # A word may be whatever kind of text the others are.
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
    """The expression's type. Raises ExpressionError for what cannot have a value with such names.

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
                return _sum(part.at, left, right) if symbol == "+" else _numbers(part.at, symbol, left, right)
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
    kinds = " and ".join(_WORDS[t.kind] for t in given) or "nothing"
    return ExpressionError(f"{what!r} does not work on {kinds}", at)


def _sum(at: int, left: ValueType, right: ValueType) -> ValueType:
    """The type of a sum, or of a text that is joined with a text or a number."""
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
    """Return the number that stands there, with its sign; None for anything else."""
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
        case "in" | "not in":
            _check_container(related, left, right)
        case _:
            if not _ordered((left, right)):
                raise _unfit(relation, (left, right), related.at)


def _check_choice(part: Part, other: ValueType) -> None:
    """A literal text, or each in a list, against all that the other side can be."""
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


def _ordered(types: Iterable[ValueType]) -> bool:
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
        case "min" | "max" if len(given) > 1 and _ordered(given):
            return join(given)
        case "min" | "max" if len(given) == 1 and first and first.kind in ("any", "list"):
            return _of_list(part, first)
        case _:
            raise _unfit(name, given, part.at)


def _of_list(part: Call, given: ValueType) -> ValueType:
    element = given.element or ANY
    if not _ordered((element,)):
        raise _unfit(part.function, (given,), part.at)
    if isinstance(part.arguments[0], ListOf) and not part.arguments[0].items:
        raise ExpressionError("an empty list has no smallest and no largest element", part.at)
    return element
