"""Syntax tree of expressions. `at` is the character (from 0) to which an error refers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal, NoReturn, TypeAlias, cast

MAX_INTEGER: Final = 2**63 - 1
"""Largest whole number, as in a log's records."""
_SHOWN = 80
_WORDS = ("and", "or", "not", "in", "if", "else")


class ExpressionError(ValueError):
    """Error in an expression, with its character (from 0)."""

    def __init__(self, message: str, offset: int = 0) -> None:
        super().__init__(message)
        self.offset = offset

    def told(self, text: str) -> str:
        """Return the message with the character, counted from 1, and the text of the expression around it."""
        if len(text) <= _SHOWN:
            return f"{self}, at character {self.offset + 1} of {text!r}"
        start = max(0, self.offset - _SHOWN // 4)
        return f"{self}, at character {self.offset + 1}: …{text[start : start + _SHOWN // 2]!r}…"


Kind: TypeAlias = Literal["number", "text", "name", "word", "symbol", "end"]


@dataclass(frozen=True, slots=True)
class Token:
    kind: Kind
    text: str
    at: int


_TOKEN = re.compile(
    r"""(?P<space>\s+)
    |(?P<number>(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)
    |(?P<text>'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")
    |(?P<name>@?[A-Za-z_]\w*)
    |(?P<symbol>==|!=|<=|>=|//|[-+*/%<>()\[\],.])""",
    re.VERBOSE | re.ASCII | re.DOTALL,
)
# The first that stands at a place where nothing of the language does.
_STRANGE: Mapping[str, str] = {
    ":=": "an assignment stands in a postcondition only; compare with '=='",
    "=>": "write '>='",
    "=<": "write '<='",
    "=": "compare with '=='",
    ":": "':' has no meaning here; there are no slices and no mappings",
    "&&": "write 'and' for '&&'",
    "||": "write 'or' for '||'",
    "&": "write 'and' for '&'",
    "|": "write 'or' for '|'",
    "!": "write 'not' for '!'",
    "{": "names stand without braces in an expression",
    "}": "names stand without braces in an expression",
    ";": "one expression stands here, without ';'",
    "'": "the text is not closed by another '",
    '"': 'the text is not closed by another "',
    "\u2018": "write straight quotes: '",
    "\u2019": "write straight quotes: '",
    "\u201c": "write straight quotes: '",
    "\u201d": "write straight quotes: '",
    "\u2260": "write '!='",
    "\u2264": "write '<='",
    "\u2265": "write '>='",
}
_STRANGE_WORDS: Mapping[str, str] = {
    "is": "compare with '=='",
    "lambda": "a lambda is not part of the language",
    "for": "a loop is not part of the language",
    **{word: f"write '{word.lower()}'" for word in ("AND", "OR", "NOT", "IN", "And", "Or", "Not")},
}
_ESCAPES: Mapping[str, str] = {"n": "\n", "t": "\t", "\\": "\\", "'": "'", '"': '"'}


def syntax_error(problem: str, at: int) -> ExpressionError:
    """Return an error for a text that is no expression at all."""
    return ExpressionError(f"not an expression: {problem}", at)


def tokens(text: str) -> Iterator[Token]:
    """Ends with a token of kind end. Raises ExpressionError at what has no meaning."""
    at = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            _complain(text, at)
        kind, found = str(match.lastgroup), match[0]
        if kind == "name" and found in _STRANGE_WORDS:
            raise syntax_error(_STRANGE_WORDS[found], at)
        if kind == "name" and found in _WORDS:
            kind = "word"
        if kind != "space":
            yield Token(cast("Kind", kind), found, at)
        at = match.end()
    yield Token("end", "", at)


def _complain(text: str, at: int) -> NoReturn:
    for strange, problem in _STRANGE.items():
        if text.startswith(strange, at):
            raise syntax_error(problem, at)
    raise syntax_error(f"the character {text[at]!r} has no meaning here", at)


def number_of(token: Token) -> int | float:
    """The value of a token of kind number. Raises ExpressionError when it is too large."""
    whole = token.text.isdigit()
    number = int(token.text) if whole and len(token.text) <= 20 else float(token.text)
    if abs(number) > MAX_INTEGER if whole else math.isinf(number):
        raise ExpressionError("the number is too large", token.at)
    return number


def text_of(token: Token) -> str:
    """Return the text between the quotes of a token of kind text. Raises ExpressionError."""

    def escaped(match: re.Match[str]) -> str:
        if match[1] not in _ESCAPES:
            problem = f"after a backslash stands one of {' '.join(_ESCAPES)}"
            raise syntax_error(problem, token.at + 1 + match.start())
        return _ESCAPES[match[1]]

    return re.sub(r"\\(.)", escaped, token.text[1:-1], flags=re.DOTALL)


def short(text: str) -> str:
    """As it stands in a complaint."""
    return repr(text if len(text) <= 20 else text[:17] + "...")


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
class Element:
    """`owner[index]`; `at` is the bracket."""

    at: int
    owner: Part
    index: Part


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
    | Element
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
        case Element(owner=owner, index=index):
            return (owner, index)
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
