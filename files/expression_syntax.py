"""Expression syntax: tokens, syntax tree and parser, within bounds. Every error names its character:
`at`, from 0.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias, cast

from .quantities import units_like
from .value_wording import suggest_name

MAX_INTEGER: Final = 2**63 - 1
"""Largest whole number, as in a log's records."""
_SHOWN = 80
_WORDS = ("and", "or", "not", "in", "if", "else")


class ExpressionError(ValueError):
    """Error in an expression, with its character (from 0)."""

    def __init__(self, message: str, offset: int = 0) -> None:
        super().__init__(message)
        self.offset = offset

    def describe(self, text: str) -> str:
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


# Hints for characters that are no part of the language.
_SYMBOL_HINTS: Mapping[str, str] = {
    ":=": "an assignment is allowed only in a postcondition; compare with '=='",
    "=>": "write '>='",
    "=<": "write '<='",
    "=": "compare with '=='",
    ":": "':' has no meaning here; there are no slices and no mappings",
    "&&": "write 'and' for '&&'",
    "?": "write 'a if condition else b' for 'condition ? a : b'",
    "||": "write 'or' for '||'",
    "&": "write 'and' for '&'",
    "|": "write 'or' for '|'",
    "!": "write 'not' for '!'",
    "{": "names are written without braces in an expression",
    "}": "names are written without braces in an expression",
    ";": "write a single expression here, without ';'",
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
    """Return the tokens of the text; the last one has the kind end. Raises ExpressionError at an invalid
    character."""
    at = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            problem = next(
                (hint for strange, hint in _SYMBOL_HINTS.items() if text.startswith(strange, at)), ""
            )
            raise syntax_error(problem or f"the character {text[at]!r} has no meaning here", at)
        kind, found = str(match.lastgroup), match[0]
        if kind == "name" and found in _STRANGE_WORDS:
            raise syntax_error(_STRANGE_WORDS[found], at)
        if kind == "name" and found in _WORDS:
            kind = "word"
        if kind != "space":
            yield Token(cast("Kind", kind), found, at)
        at = match.end()
    yield Token("end", "", at)


def number_of(token: Token) -> int | float:
    """Return the value of a token of kind number. Raises ExpressionError when it is too large."""
    whole = token.text.isdigit()
    number = int(token.text) if whole and len(token.text) <= 20 else float(token.text)
    if abs(number) > MAX_INTEGER if whole else math.isinf(number):
        raise ExpressionError("the number is too large", token.at)
    return number


def text_of(token: Token) -> str:
    """Return the text between the quotes of a token of kind text. Raises ExpressionError."""

    def escaped(match: re.Match[str]) -> str:
        if match[1] not in _ESCAPES:
            problem = f"a backslash is followed by one of {' '.join(_ESCAPES)}"
            raise syntax_error(problem, token.at + 1 + match.start())
        return _ESCAPES[match[1]]

    return re.sub(r"\\(.)", escaped, token.text[1:-1], flags=re.DOTALL)


def short(text: str) -> str:
    """Return the text as error messages quote it: at most 20 characters."""
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
    """Return the direct parts of a part, in their order."""
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
    """Yield the part and all parts below it, parents first."""
    todo = [root]
    while todo:
        part = todo.pop()
        yield part
        todo += reversed(children(part))


MAX_LENGTH: Final = 1000
MAX_PARTS: Final = 250
MAX_DEPTH: Final = 40
FUNCTIONS: Final = ("len", "min", "max", "abs", "round")
CONSTANTS: Mapping[str, bool | None] = {
    "true": True, "false": False, "null": None, "True": True, "False": False, "None": None,
}  # fmt: skip
_RELATIONS = ("==", "!=", "<", "<=", ">", ">=", "in", "not")
_UNITS = frozenset(unit for like in ("m", "rad", "s", "kg", "N") for unit in units_like(like))


# How tightly operators bind.
_OR, _AND, _NOT, _RELATION, _SUM, _PRODUCT = 1, 2, 3, 4, 5, 6
_BINDING: Mapping[str, int] = {
    "or": _OR, "and": _AND, **dict.fromkeys(_RELATIONS, _RELATION),
    "+": _SUM, "-": _SUM, "*": _PRODUCT, "/": _PRODUCT, "//": _PRODUCT, "%": _PRODUCT,
}  # fmt: skip


def parse(text: str) -> Part:
    """Parse an expression. Raises ExpressionError with a sentence and the character."""
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the expression is longer than {MAX_LENGTH} characters")
    if not text.strip():
        raise ExpressionError("the expression is empty")
    root = _Parser(text).whole()
    _check_size(root)
    return root


class _Parser:
    """Precedence climbing: a method call for each level of nesting, not for each operator."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens = list(tokens(text))
        self._next = 0
        self._depth = 0

    @property
    def _token(self) -> Token:
        return self._tokens[self._next]

    def _is(self, *texts: str) -> bool:
        """Whether the next token is one of these operators or words."""
        return self._token.kind in ("symbol", "word") and self._token.text in texts

    def _take(self) -> Token:
        token = self._token
        self._next += 1
        return token

    def whole(self) -> Part:
        part = self._choice()
        token, before = self._token, self._tokens[self._next - 1]
        if token.kind == "end":
            return part
        if self._is(")", "]"):
            problem = f"{token.text!r} closes nothing"
        elif self._is(","):
            problem = "a list is written in [ ]"
        elif self._is("else"):
            problem = "'else' without 'if'"
        else:
            problem = self._missing_operator(before, token)
        raise syntax_error(problem, token.at)

    def _missing_operator(self, before: Token, token: Token) -> str:
        if token.text == "(":
            return f"{short(before.text)} is not a function"
        if before.kind == "number" and token.text in _UNITS:
            return f"numbers are written without units here, in SI; leave out {token.text!r}"
        return f"an operator is missing before {short(token.text)}"

    def _choice(self) -> Part:
        yes = self._operators(_OR)
        if not self._is("if"):
            return yes
        start = self._take()
        test = self._operators(_OR)
        if not self._is("else"):
            raise syntax_error("'if' without 'else': write 'a if c else b'", start.at)
        self._enter(self._take())
        no = self._choice()
        self._depth -= 1
        return Conditional(start.at, test, yes, no)

    def _operators(self, least: int) -> Part:
        """Parse a value and the operators after it that bind at least this tightly."""
        left = self._operand()
        while True:
            token = self._token
            binding = _BINDING.get(token.text, 0) if token.kind in ("symbol", "word") else 0
            if binding == 0 or binding < least:
                return left
            if binding in (_OR, _AND):
                left = self._logic(left, binding)
            elif binding == _RELATION:
                left = self._comparison(left)
            else:
                self._take()
                left = Arithmetic(token.at, cast("Symbol", token.text), left, self._operators(binding + 1))

    def _logic(self, left: Part, binding: int) -> Part:
        first, parts = self._token, [left]
        while self._is(first.text):
            self._take()
            parts.append(self._operators(binding + 1))
        return Logic(first.at, "and" if binding == _AND else "or", tuple(parts))

    def _comparison(self, first: Part) -> Part:
        at, rest = self._token.at, list[ComparisonLink]()
        while self._is(*_RELATIONS):
            token = self._take()
            relation = token.text
            if relation == "not":
                if not self._is("in"):
                    raise syntax_error("an operator is missing before 'not'", token.at)
                self._take()
                relation = "not in"
            rest.append(ComparisonLink(token.at, cast("Relation", relation), self._operators(_RELATION + 1)))
        return ComparisonChain(at, first, tuple(rest))

    def _operand(self) -> Part:
        token = self._token
        if self._is("not", "+", "-"):
            before = self._tokens[self._next - 1] if self._next else None
            tight = before is not None and before.text != "not" and _BINDING.get(before.text, 0) > _NOT
            if token.text == "not" and before is not None and tight:
                raise syntax_error(f"'not' after {before.text!r} is written in brackets", token.at)
            self._enter(self._take())
            operand = self._operators(_NOT) if token.text == "not" else self._operand()
            self._depth -= 1
            if token.text == "not":
                return Not(token.at, operand)
            return Sign(token.at, "-" if token.text == "-" else "+", operand)
        part = self._value()
        while self._is(".", "["):
            opened = self._take()
            part = self._attribute(part, opened) if opened.text == "." else self._element(part, opened)
        return part

    def _attribute(self, owner: Part, dot: Token) -> Part:
        name = self._token
        if name.kind not in ("name", "word"):
            raise syntax_error("the name of an attribute is missing after '.'", dot.at)
        if name.text.startswith("_"):
            raise ExpressionError(f"{name.text!r} is private", name.at)
        return Attribute(self._take().at, owner, name.text)

    def _element(self, owner: Part, opened: Token) -> Part:
        if self._is("]"):
            raise syntax_error("an index is missing between '[' and ']'; the first element is [0]", opened.at)
        self._enter(opened)
        index = self._choice()
        if self._is(","):
            raise syntax_error("[ ] takes one index", self._token.at)
        self._close(opened, "]")
        self._depth -= 1
        return Element(opened.at, owner, index)

    def _value(self) -> Part:
        token = self._token
        match token.kind:
            case "number":
                return LiteralValue(token.at, number_of(self._take()))
            case "text":
                return LiteralValue(token.at, text_of(self._take()))
            case "name":
                return self._name()
            case "symbol" if token.text in ("(", "["):
                self._enter(token)
                part = self._brackets()
                self._depth -= 1
                return part
            case _:
                raise self._no_value(token)

    def _no_value(self, token: Token) -> ExpressionError:
        before = self._tokens[self._next - 1] if self._next else None
        if before is not None and before.text == "%" and self._tokens[self._next - 2].kind == "number":
            share = number_of(self._tokens[self._next - 2]) / 100
            return syntax_error(f"'%' is the remainder of a division here; write {share:g}", before.at)
        if before is not None and before.text == token.text == "*":
            return syntax_error("powers are not supported; write 'x * x'", before.at)
        if before is None:
            return syntax_error(f"a value is missing before {short(token.text)}", token.at)
        if token.kind == "end" and before.text in ("(", "["):
            return syntax_error(f"{before.text!r} is not closed", before.at)
        if token.kind == "end":
            return syntax_error(f"a value is missing after {short(before.text)}", before.at)
        return syntax_error(f"a value is missing between {before.text!r} and {short(token.text)}", token.at)

    def _name(self) -> Part:
        token = self._take()
        if self._is("("):
            if token.text not in FUNCTIONS:
                hint = suggest_name(token.text, FUNCTIONS)
                raise ExpressionError(f"there is no function {short(token.text)}; {hint}", token.at)
            self._enter(token)
            call = Call(token.at, token.text, self._items(self._take(), ")"))
            self._depth -= 1
            return call
        if token.text in CONSTANTS:
            return LiteralValue(token.at, CONSTANTS[token.text])
        return Name(token.at, token.text)

    def _brackets(self) -> Part:
        opened = self._take()
        if opened.text == "[":
            return ListOf(opened.at, self._items(opened, "]"))
        if self._is(")"):
            raise syntax_error("a value is missing between '(' and ')'", self._token.at)
        part = self._choice()
        if self._is(","):
            # (a, b) is a list, as in Python.
            self._take()
            return ListOf(opened.at, (part, *self._items(opened, ")")))
        self._close(opened, ")")
        return part

    def _items(self, opened: Token, closing: str) -> tuple[Part, ...]:
        items: list[Part] = []
        while not self._is(closing):
            items.append(self._choice())
            if not self._is(","):
                break
            self._take()
        self._close(opened, closing)
        return tuple(items)

    def _close(self, opened: Token, closing: str) -> None:
        token = self._token
        if self._is(closing):
            self._take()
        elif token.kind == "end":
            raise syntax_error(f"{opened.text!r} is not closed", opened.at)
        elif self._is(")", "]"):
            raise syntax_error(f"{token.text!r} does not close {opened.text!r}", token.at)
        else:
            raise syntax_error(self._missing_operator(self._tokens[self._next - 1], token), token.at)

    def _enter(self, token: Token) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise ExpressionError(f"the expression is nested more than {MAX_DEPTH} deep", token.at)


def _check_size(root: Part) -> None:
    todo, count = [(root, 1)], 0
    while todo:
        part, depth = todo.pop()
        count += 1
        if count > MAX_PARTS:
            raise ExpressionError(f"the expression has more than {MAX_PARTS} parts", part.at)
        if depth > MAX_DEPTH:
            raise ExpressionError(f"the expression is nested more than {MAX_DEPTH} deep", part.at)
        todo += [(lower, depth + 1) for lower in children(part)]
