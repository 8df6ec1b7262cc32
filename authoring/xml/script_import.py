"""Import of BehaviorTree.CPP's scripts as expressions, with the precedence of its grammar."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal, NoReturn, TypeAlias, cast

from ...files.expressions.syntax_tree import (
    Arithmetic,
    ComparisonChain,
    ComparisonLink,
    Conditional,
    LiteralValue,
    Logic,
    Name,
    Not,
    Part,
    Relation,
    Sign,
)
from .script_export import expression_text

MAX_SCRIPT_LENGTH: Final = 4000
MAX_SCRIPT_DEPTH: Final = 40
_TOKEN = re.compile(
    r"""(?P<space>\s+)
    |(?P<hex>0[xX][0-9a-fA-F]+\b)
    |(?P<number>\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w.]))
    |(?P<text>'[^']*'|"[^"]*")
    |(?P<name>@?[A-Za-z_]\w*)
    |(?P<symbol>:=|[-+*/]=|==|!=|<=|>=|&&|\|\||\.\.|[-+*/<>()!?:=;&|^~])""",
    re.VERBOSE | re.ASCII,
)
_NO_COUNTERPART = {
    "&": "bitwise operators", "|": "bitwise operators", "^": "bitwise operators", "~": "bitwise operators",
}  # fmt: skip
OUR_WORDS = ("and", "or", "not", "in", "if", "else", "null", "is", "for", "lambda", "True", "False", "None")
_ASSIGNMENTS = (":=", "=", "+=", "-=", "*=", "/=")
_LOGIC: dict[str, Literal["and", "or"]] = {"&&": "and", "||": "or"}


class ScriptError(ValueError):
    """Error in a script, or a part that expressions lack, with the index of the character."""

    def __init__(self, message: str, offset: int) -> None:
        super().__init__(message)
        self.offset = offset


Kind: TypeAlias = Literal["hex", "number", "text", "name", "symbol", "end"]


@dataclass(frozen=True, slots=True)
class _Token:
    kind: Kind
    text: str
    at: int


@dataclass(frozen=True, slots=True)
class Statement:
    """Statement `key := value`, `key = value` (not `new`), or a bare value (no key)."""

    key: str
    new: bool
    value: Part

    def constant(self) -> str | int | float | bool | None:
        """Literal, or `"{key}"` for a copy, that is written in any case; else None."""
        if not self.new:
            return None
        match self.value:
            case Name(name=name):
                return f"{{{name}}}"
            case LiteralValue(value=str() as text) if "{" in text:
                return None
            case LiteralValue(value=value):
                return value
            case Sign(symbol="-", operand=LiteralValue(value=int() | float() as number)) if (
                number is not True
            ):
                return -number
            case _:
                return None

    def text(self) -> str:
        """Return the statement as a postcondition writes it."""
        operator = ":=" if self.new else "="
        return f"{self.key} {operator} {expression_text(self.value)}"


def read_expression(script: str, enums: Mapping[str, int] | None = None) -> Part:
    """Return the script's single expression. Raises ScriptError."""
    statements = _Parser(script, enums or {}).statements()
    if len(statements) != 1 or statements[0].key:
        raise ScriptError("one expression without an assignment is wanted", 0)
    return statements[0].value


def read_parts(script: str, enums: Mapping[str, int] | None = None) -> tuple[Statement, ...]:
    """Return assignments and bare values of a script. Raises ScriptError."""
    return _Parser(script, enums or {}).statements()


def names_in(script: str) -> tuple[str, ...]:
    """Return the names in a script; none when it cannot be read."""
    try:
        return tuple(token.text for token in _tokens(script) if token.kind == "name")
    except ScriptError:
        return ()


def with_names(script: str, names: Mapping[str, str]) -> str:
    """Return the script with other names; one that cannot be read is left as it is."""
    try:
        tokens = [token for token in _tokens(script) if token.kind == "name"]
    except ScriptError:
        return script
    for token in reversed(tokens):
        root = "@" if token.text.startswith("@") else ""
        name = token.text[len(root) :]
        script = f"{script[: token.at]}{root}{names.get(name, name)}{script[token.at + len(token.text) :]}"
    return script


def _tokens(script: str) -> Iterator[_Token]:
    at = 0
    while at < len(script):
        match = _TOKEN.match(script, at)
        if match is None:
            raise ScriptError(f"{script[at]!r} has no meaning in a script", at)
        if match.lastgroup != "space":
            yield _Token(cast("Kind", match.lastgroup), match[0], at)
        at = match.end()
    yield _Token("end", "", at)


class _Parser:
    def __init__(self, script: str, enums: Mapping[str, int]) -> None:
        self._enums = enums
        if len(script) > MAX_SCRIPT_LENGTH:
            raise ScriptError(f"the script is longer than {MAX_SCRIPT_LENGTH} characters", 0)
        self._tokens = list(_tokens(script))
        self._next = 0
        self._depth = 0

    def statements(self) -> tuple[Statement, ...]:
        found: list[Statement] = []
        while not self._ended():
            found.append(self._statement())
            while self._is(";"):
                self._take()
        if not found:
            raise ScriptError("the script is empty", 0)
        return tuple(found)

    @property
    def _token(self) -> _Token:
        return self._tokens[self._next]

    def _ended(self) -> bool:
        return self._token.kind == "end"

    def _is(self, *symbols: str) -> bool:
        return self._token.kind == "symbol" and self._token.text in symbols

    def _take(self) -> _Token:
        token = self._token
        self._next += 1
        return token

    def _expect(self, symbol: str) -> None:
        if not self._is(symbol):
            self._unexpected(f"{symbol!r} is missing")
        self._take()

    def _unexpected(self, otherwise: str) -> NoReturn:
        token = self._token
        if token.kind == "symbol" and token.text in _NO_COUNTERPART:
            raise ScriptError(f"{_NO_COUNTERPART[token.text]} have no counterpart", token.at)
        raise ScriptError(otherwise, token.at)

    def _statement(self) -> Statement:
        target = self._token
        assigned = target.kind == "name" and self._tokens[self._next + 1].text in (":=", "=")
        # Scripts may write to any word, though expressions cannot name each.
        left = Name(target.at, self._take().text) if assigned else self._choice()
        if not self._is(*_ASSIGNMENTS):
            return Statement("", False, left)
        operator = self._take()
        if not isinstance(left, Name):
            raise ScriptError("only a key of the tree can be assigned to", target.at)
        value = self._choice()
        if self._is(*_ASSIGNMENTS):
            self._unexpected("only one key can be assigned to")
        if operator.text in (":=", "="):
            return Statement(left.name, operator.text == ":=", value)
        symbol = cast("Literal['+', '-', '*', '/']", operator.text[0])
        return Statement(left.name, False, Arithmetic(operator.at, symbol, left, value))

    def _choice(self) -> Part:
        test = self._logic()
        if not self._is("?"):
            return test
        at = self._take().at
        yes = self._nested()
        self._expect(":")
        return Conditional(at, test, yes, self._nested())

    def _nested(self) -> Part:
        self._deeper()
        part = self._choice()
        self._depth -= 1
        return part

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > MAX_SCRIPT_DEPTH:
            raise ScriptError(f"the script is nested more than {MAX_SCRIPT_DEPTH} deep", self._token.at)

    def _logic(self) -> Part:
        """Parse `||`, and `&&`, which binds more tightly since BehaviorTree.CPP 4.9."""
        return self._joined("||", lambda: self._joined("&&", self._comparison))

    def _joined(self, symbol: str, operand: Callable[[], Part]) -> Part:
        first, rest = operand(), list[Part]()
        at = self._token.at
        while self._is(symbol):
            self._take()
            rest.append(operand())
        return Logic(at, _LOGIC[symbol], (first, *rest)) if rest else first

    def _comparison(self) -> Part:
        first, rest = self._sum(), list[ComparisonLink]()
        at = self._token.at
        while self._is("==", "!=", "<", "<=", ">", ">="):
            token = self._take()
            rest.append(ComparisonLink(token.at, cast("Relation", token.text), self._sum()))
        if self._is(*_NO_COUNTERPART):
            self._unexpected("")
        return ComparisonChain(at, first, tuple(rest)) if rest else first

    def _sum(self) -> Part:
        left = self._product()
        while self._is("+", "-", ".."):
            token = self._take()
            left = Arithmetic(token.at, "-" if token.text == "-" else "+", left, self._product())
        return left

    def _product(self) -> Part:
        left = self._prefixed()
        while self._is("*", "/"):
            token = self._take()
            left = Arithmetic(token.at, "*" if token.text == "*" else "/", left, self._prefixed())
        return left

    def _prefixed(self) -> Part:
        if self._is("-", "!"):
            token = self._take()
            self._deeper()
            operand = self._prefixed()
            self._depth -= 1
            return Sign(token.at, "-", operand) if token.text == "-" else Not(token.at, operand)
        return self._value()

    def _value(self) -> Part:
        token = self._token
        if self._is("("):
            self._take()
            part = self._nested()
            self._expect(")")
            return part
        if token.kind in ("end", "symbol"):
            self._unexpected("a value is missing")
        self._take()
        match token.kind:
            case "hex":
                return LiteralValue(token.at, int(token.text, 16))
            case "number":
                whole = token.text.isdigit() and len(token.text) < 20
                return LiteralValue(token.at, int(token.text) if whole else float(token.text))
            case "text":
                return LiteralValue(token.at, token.text[1:-1])
            case _:
                return self._name(token)

    def _name(self, token: _Token) -> Part:
        if token.text in ("true", "false"):
            return LiteralValue(token.at, token.text == "true")
        if token.text in self._enums:
            return LiteralValue(token.at, self._enums[token.text])
        if token.text in OUR_WORDS:
            raise ScriptError(f"{token.text!r} cannot be the name of a key in an expression", token.at)
        return Name(token.at, token.text)
