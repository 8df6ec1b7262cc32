"""From the text of an expression to its parts. Bounded, and every complaint names its character."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal, NoReturn, TypeAlias, cast

from .expression_nodes import (
    Arithmetic,
    Attribute,
    Call,
    Choice,
    Comparison,
    ListOf,
    Literally,
    Logic,
    Name,
    Not,
    Part,
    Related,
    Relation,
    Sign,
    Symbol,
    below,
)
from .nearest import nearest
from .quantities import units_like

MAX_LENGTH: Final = 1000
MAX_PARTS: Final = 250
MAX_DEPTH: Final = 40
LARGEST: Final = 2**63 - 1
"""Of whole numbers: what a record holds."""
FUNCTIONS: Final = ("len", "min", "max", "abs", "round")
CONSTANTS: Mapping[str, bool | None] = {
    "true": True, "false": False, "null": None, "True": True, "False": False, "None": None,
}  # fmt: skip


class ExpressionError(ValueError):
    """What is wrong with an expression, and the character (from 0) where."""

    def __init__(self, message: str, offset: int = 0) -> None:
        super().__init__(message)
        self.offset = offset

    def told(self, text: str) -> str:
        """With the character, counted from 1, and the text of the expression or what stands around it."""
        if len(text) <= _SHOWN:
            return f"{self}, at character {self.offset + 1} of {text!r}"
        start = max(0, self.offset - _SHOWN // 4)
        return f"{self}, at character {self.offset + 1}: …{text[start : start + _SHOWN // 2]!r}…"


_SHOWN = 80


Kind: TypeAlias = Literal["number", "text", "name", "word", "symbol", "end"]


@dataclass(frozen=True, slots=True)
class _Token:
    kind: Kind
    text: str
    at: int


_TOKEN = re.compile(
    r"""(?P<space>\s+)
    |(?P<number>(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)
    |(?P<text>'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")
    |(?P<name>[A-Za-z_]\w*)
    |(?P<symbol>==|!=|<=|>=|//|[-+*/%<>()\[\],.])""",
    re.VERBOSE | re.ASCII | re.DOTALL,
)
_WORDS = ("and", "or", "not", "in", "if", "else")
_RELATIONS = ("==", "!=", "<", "<=", ">", ">=", "in", "not")
# The first that stands at a place where nothing of the language does.
_STRANGE: Mapping[str, str] = {
    ":=": "an assignment stands in a postcondition only; compare with '=='",
    "=>": "write '>='",
    "=<": "write '<='",
    "=": "compare with '=='",
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
_UNITS = frozenset(unit for like in ("m", "rad", "s", "kg", "N") for unit in units_like(like))

# How tightly operators bind.
_OR, _AND, _NOT, _RELATION, _SUM, _PRODUCT = 1, 2, 3, 4, 5, 6
_BINDING: Mapping[str, int] = {
    "or": _OR, "and": _AND, **dict.fromkeys(_RELATIONS, _RELATION),
    "+": _SUM, "-": _SUM, "*": _PRODUCT, "/": _PRODUCT, "//": _PRODUCT, "%": _PRODUCT,
}  # fmt: skip


def parse(text: str) -> Part:
    """Raises ExpressionError with a sentence and the character."""
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the expression is longer than {MAX_LENGTH} characters")
    if not text.strip():
        raise ExpressionError("the expression is empty")
    root = _Parser(text).whole()
    _check_size(root)
    return root


def _syntax(problem: str, at: int) -> ExpressionError:
    return ExpressionError(f"not an expression: {problem}", at)


def _tokens(text: str) -> Iterator[_Token]:
    at = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            _complain(text, at)
        kind, found = str(match.lastgroup), match[0]
        if kind == "name" and found in _STRANGE_WORDS:
            raise _syntax(_STRANGE_WORDS[found], at)
        if kind == "name" and found in _WORDS:
            kind = "word"
        if kind != "space":
            yield _Token(cast("Kind", kind), found, at)
        at = match.end()
    yield _Token("end", "", at)


def _complain(text: str, at: int) -> NoReturn:
    for strange, problem in _STRANGE.items():
        if text.startswith(strange, at):
            raise _syntax(problem, at)
    raise _syntax(f"the character {text[at]!r} has no meaning here", at)


class _Parser:
    """Precedence climbing: a method call for each level of nesting, not for each operator."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens = list(_tokens(text))
        self._next = 0
        self._depth = 0

    @property
    def _token(self) -> _Token:
        return self._tokens[self._next]

    def _is(self, *texts: str) -> bool:
        """Whether one of these operators or words stands next."""
        return self._token.kind in ("symbol", "word") and self._token.text in texts

    def _take(self) -> _Token:
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
            problem = "a list stands in [ ]"
        elif self._is("else"):
            problem = "'else' without 'if'"
        else:
            problem = self._missing_operator(before, token)
        raise _syntax(problem, token.at)

    def _missing_operator(self, before: _Token, token: _Token) -> str:
        if token.text == "[":
            return "indexing with [ ] is not part of the language"
        if token.text == "(":
            return f"{_short(before.text)} is not a function"
        if before.kind == "number" and token.text in _UNITS:
            return f"numbers stand without units here, in SI; leave out {token.text!r}"
        return f"an operator is missing before {_short(token.text)}"

    def _choice(self) -> Part:
        yes = self._operators(_OR)
        if not self._is("if"):
            return yes
        start = self._take()
        test = self._operators(_OR)
        if not self._is("else"):
            raise _syntax("'if' without 'else': write 'a if c else b'", start.at)
        self._enter(self._take())
        no = self._choice()
        self._depth -= 1
        return Choice(start.at, test, yes, no)

    def _operators(self, least: int) -> Part:
        """A value, with the operators after it that bind at least so tightly."""
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
        at, rest = self._token.at, list[Related]()
        while self._is(*_RELATIONS):
            token = self._take()
            relation = token.text
            if relation == "not":
                if not self._is("in"):
                    raise _syntax("an operator is missing before 'not'", token.at)
                self._take()
                relation = "not in"
            rest.append(Related(token.at, cast("Relation", relation), self._operators(_RELATION + 1)))
        return Comparison(at, first, tuple(rest))

    def _operand(self) -> Part:
        token = self._token
        if self._is("not", "+", "-"):
            before = self._tokens[self._next - 1] if self._next else None
            tight = before is not None and before.text != "not" and _BINDING.get(before.text, 0) > _NOT
            if token.text == "not" and before is not None and tight:
                raise _syntax(f"'not' after {before.text!r} stands in brackets", token.at)
            self._enter(self._take())
            operand = self._operators(_NOT) if token.text == "not" else self._operand()
            self._depth -= 1
            if token.text == "not":
                return Not(token.at, operand)
            return Sign(token.at, "-" if token.text == "-" else "+", operand)
        part = self._value()
        while self._is("."):
            dot, name = self._take(), self._token
            if name.kind not in ("name", "word"):
                raise _syntax("the name of an attribute is missing after '.'", dot.at)
            if name.text.startswith("_"):
                raise ExpressionError(f"{name.text!r} is private", name.at)
            part = Attribute(self._take().at, part, name.text)
        return part

    def _value(self) -> Part:
        token = self._token
        match token.kind:
            case "number":
                return Literally(token.at, _number(self._take()))
            case "text":
                return Literally(token.at, _unquoted(self._take()))
            case "name":
                return self._name()
            case "symbol" if token.text in ("(", "["):
                self._enter(token)
                part = self._brackets()
                self._depth -= 1
                return part
            case _:
                raise self._no_value(token)

    def _no_value(self, token: _Token) -> ExpressionError:
        before = self._tokens[self._next - 1] if self._next else None
        if before is not None and before.text == token.text == "*":
            return _syntax("there is no power; write 'x * x'", before.at)
        if before is None:
            return _syntax(f"a value is missing before {_short(token.text)}", token.at)
        if token.kind == "end" and before.text in ("(", "["):
            return _syntax(f"{before.text!r} is not closed", before.at)
        if token.kind == "end":
            return _syntax(f"a value is missing after {_short(before.text)}", before.at)
        return _syntax(f"a value is missing between {before.text!r} and {_short(token.text)}", token.at)

    def _name(self) -> Part:
        token = self._take()
        if self._is("("):
            if token.text not in FUNCTIONS:
                hint = nearest(token.text, FUNCTIONS)
                raise ExpressionError(f"there is no function {_short(token.text)}; {hint}", token.at)
            self._enter(token)
            call = Call(token.at, token.text, self._items(self._take(), ")"))
            self._depth -= 1
            return call
        if token.text in CONSTANTS:
            return Literally(token.at, CONSTANTS[token.text])
        return Name(token.at, token.text)

    def _brackets(self) -> Part:
        opened = self._take()
        if opened.text == "[":
            return ListOf(opened.at, self._items(opened, "]"))
        if self._is(")"):
            raise _syntax("a value is missing between '(' and ')'", self._token.at)
        part = self._choice()
        if self._is(","):
            # (a, b) is a list, as in Python.
            self._take()
            return ListOf(opened.at, (part, *self._items(opened, ")")))
        self._close(opened, ")")
        return part

    def _items(self, opened: _Token, closing: str) -> tuple[Part, ...]:
        items: list[Part] = []
        while not self._is(closing):
            items.append(self._choice())
            if not self._is(","):
                break
            self._take()
        self._close(opened, closing)
        return tuple(items)

    def _close(self, opened: _Token, closing: str) -> None:
        token = self._token
        if self._is(closing):
            self._take()
        elif token.kind == "end":
            raise _syntax(f"{opened.text!r} is not closed", opened.at)
        elif self._is(")", "]"):
            raise _syntax(f"{token.text!r} does not close {opened.text!r}", token.at)
        else:
            raise _syntax(self._missing_operator(self._tokens[self._next - 1], token), token.at)

    def _enter(self, token: _Token) -> None:
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
        todo += [(lower, depth + 1) for lower in below(part)]


def _number(token: _Token) -> int | float:
    whole = token.text.isdigit()
    number = int(token.text) if whole and len(token.text) <= 20 else float(token.text)
    if abs(number) > LARGEST if whole else math.isinf(number):
        raise ExpressionError("the number is too large", token.at)
    return number


def _unquoted(token: _Token) -> str:
    def escaped(match: re.Match[str]) -> str:
        if match[1] not in _ESCAPES:
            problem = f"after a backslash stands one of {' '.join(_ESCAPES)}"
            raise _syntax(problem, token.at + 1 + match.start())
        return _ESCAPES[match[1]]

    return re.sub(r"\\(.)", escaped, token.text[1:-1], flags=re.DOTALL)


def _short(text: str) -> str:
    return repr(text if len(text) <= 20 else text[:17] + "...")
