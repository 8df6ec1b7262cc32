"""Scripts of BehaviorTree.CPP: expressions as scripts, where they can express them, and scripts as
expressions.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal, NoReturn, TypeAlias, cast

from picktree.files import Expression, expression_syntax
from picktree.trees import references
from picktree.world import world_facts

# Precedence of each kind of part, as in the parser of expressions.
_CHOICE, _OR, _AND, _NOT, _RELATION, _SUM, _PRODUCT, _SIGN, _VALUE = range(9)


def expression_text(part: expression_syntax.Part) -> str:
    """Return a text that parses to the same parts."""
    match part:
        case expression_syntax.LiteralValue(value=value):
            return literal_text(value)
        case expression_syntax.Name(name=name):
            return name
        case expression_syntax.Attribute(owner=owner, name=name):
            number = isinstance(owner, expression_syntax.LiteralValue) and type(owner.value) in (int, float)
            return f"({expression_text(owner)}).{name}" if number else f"{_within(owner, _VALUE)}.{name}"
        case expression_syntax.Element(owner=owner, index=index):
            return f"{_within(owner, _VALUE)}[{expression_text(index)}]"
        case expression_syntax.Not(operand=operand):
            return f"not {_within(operand, _NOT)}"
        case expression_syntax.Sign(symbol=symbol, operand=operand):
            return f"{symbol}{_within(operand, _SIGN)}"
        case expression_syntax.Arithmetic(symbol=symbol, left=left, right=right):
            binding = _binding(part)
            return f"{_within(left, binding)} {symbol} {_within(right, binding + 1)}"
        case expression_syntax.ComparisonChain(first=first, rest=rest):
            words = [_within(first, _SUM)]
            for related in rest:
                words += [related.relation, _within(related.operand, _SUM)]
            return " ".join(words)
        case expression_syntax.Logic(symbol=symbol, parts=parts):
            return f" {symbol} ".join(_within(lower, _binding(part) + 1) for lower in parts)
        case expression_syntax.Conditional(test=test, yes=yes, no=no):
            return f"{_within(yes, _OR)} if {_within(test, _OR)} else {_within(no, _CHOICE)}"
        case expression_syntax.ListOf(items=items):
            return f"[{', '.join(map(expression_text, items))}]"
        case expression_syntax.Call(function=function, arguments=arguments):
            return f"{function}({', '.join(map(expression_text, arguments))})"


def literal_text(value: str | int | float | bool | None) -> str:
    """Return a constant in the syntax of expressions."""
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case int() | float():
            return repr(value)
        case str():
            escaped = value.replace("\\", "\\\\").replace("\n", "\\n").replace("\t", "\\t")
            quote = '"' if "'" in escaped and '"' not in escaped else "'"
            return quote + escaped.replace(quote, f"\\{quote}") + quote


def _within(part: expression_syntax.Part, least: int) -> str:
    text = expression_text(part)
    return text if _binding(part) >= least else f"({text})"


def _binding(part: expression_syntax.Part) -> int:
    match part:
        case expression_syntax.Conditional():
            return _CHOICE
        case expression_syntax.Logic(symbol=symbol):
            return _OR if symbol == "or" else _AND
        case expression_syntax.Not():
            return _NOT
        case expression_syntax.ComparisonChain():
            return _RELATION
        case expression_syntax.Arithmetic(symbol=symbol):
            return _SUM if symbol in ("+", "-") else _PRODUCT
        case expression_syntax.Sign():
            return _SIGN
        case _:
            return _VALUE


LARGEST_INTEGER = 2**53
"""Largest whole number that scripts compute with: BehaviorTree.CPP throws where a double is not exact."""
_SCRIPT_LOGIC = {"and": "&&", "or": "||"}


class NotExpressible(Exception):
    """Expression that BehaviorTree.CPP's scripts cannot express; the text gives the reason."""


def script(expression: Expression) -> str:
    """Return the expression as a script. Raises NotExpressible."""
    return _text(expression.root)


def assignments_script(assignments: Iterable[references.Assignment]) -> str:
    """Return assignments as `a := 1; b = a + 1`. Raises NotExpressible."""
    parts: list[str] = []
    for assignment in assignments:
        _check_name(assignment.key)
        operator = ":=" if assignment.new else "="
        parts.append(f"{assignment.key} {operator} {script(assignment.value)}")
    return "; ".join(parts)


def constant_script(key: str, value: object) -> str:
    """Return `key := value` for a scalar. Raises NotExpressible."""
    _check_name(key)
    if not isinstance(value, str | int | float | bool):
        raise NotExpressible("there are no lists and mappings")
    return f"{key} := {_literal(value)}"


def _literal(value: str | int | float | bool | None) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case int():
            if abs(value) > LARGEST_INTEGER:
                raise NotExpressible("the number is too large")
            return str(value)
        case float():
            return repr(value)
        case str():
            # From 4.9 on double quotes are none.
            if "'" in value or not value.isascii() or not value.isprintable():
                raise NotExpressible("a text with such characters")
            return f"'{value}'"
        case None:
            raise NotExpressible("there is no null")


def _text(part: expression_syntax.Part) -> str:
    match part:
        case expression_syntax.LiteralValue(value=value):
            return _literal(value)
        case expression_syntax.Name(name=name):
            _check_name(name)
            return name
        case expression_syntax.Not(operand=operand):
            return f"!{_operand(operand)}"
        case expression_syntax.Sign(symbol="-", operand=operand):
            return f"-{_operand(operand)}"
        case expression_syntax.Arithmetic(symbol="+", left=left, right=right) if _is_text(part):
            return f"{_operand(left)} .. {_operand(right)}"
        case expression_syntax.Arithmetic(symbol="+" | "-" | "*" | "/" as symbol, left=left, right=right):
            return _arithmetic(symbol, left, right)
        case expression_syntax.ComparisonChain(first=first, rest=rest):
            words = [_compared(first)]
            for related in rest:
                if related.relation in ("in", "not in"):
                    raise NotExpressible(f"there is no {related.relation!r}")
                words += [related.relation, _compared(related.operand)]
            return " ".join(words)
        case expression_syntax.Logic(symbol=symbol, parts=parts):
            return f" {_SCRIPT_LOGIC[symbol]} ".join(_in_logic(lower) for lower in parts)
        case expression_syntax.Conditional(test=test, yes=yes, no=no):
            return f"{_in_logic(test)} ? {_in_logic(yes)} : {_in_logic(no)}"
        case _:
            raise NotExpressible("attributes, lists, functions and other operators are not allowed")


def _is_text(part: expression_syntax.Part) -> bool:
    """Whether a sum certainly is a text: texts are joined, which `+` does not do with a number."""
    match part:
        case expression_syntax.LiteralValue(value=value):
            return isinstance(value, str)
        case expression_syntax.Arithmetic(symbol="+", left=left, right=right):
            return _is_text(left) or _is_text(right)
        case _:
            return False


def _check_name(name: str) -> None:
    if name in world_facts.FACTS:
        raise NotExpressible(f"{name!r} is a fact of the world, not a key of the blackboard")
    if name.startswith(("true", "false")):
        raise NotExpressible(f"{name!r} begins like a constant")


def _operand(part: expression_syntax.Part, *plain: type[expression_syntax.Part]) -> str:
    """Return an operand in brackets, unless it is a constant, a name or one of the `plain` parts."""
    bare = isinstance(part, (expression_syntax.LiteralValue, expression_syntax.Name, *plain))
    return _text(part) if bare else f"({_text(part)})"


def _arithmetic(symbol: str, left: expression_syntax.Part, right: expression_syntax.Part) -> str:
    """Return a sum or product. A chain of one kind is evaluated in order, and products before sums."""
    additive = symbol in ("+", "-")
    first = isinstance(left, expression_syntax.Arithmetic) and (additive or left.symbol in ("*", "/"))
    second = additive and isinstance(right, expression_syntax.Arithmetic) and right.symbol in ("*", "/")
    texts = [_text(part) if bare else _operand(part) for part, bare in ((left, first), (right, second))]
    return f" {symbol} ".join(texts)


def _compared(part: expression_syntax.Part) -> str:
    return _operand(part, expression_syntax.Arithmetic, expression_syntax.Not, expression_syntax.Sign)


def _in_logic(part: expression_syntax.Part) -> str:
    return _text(part) if isinstance(part, expression_syntax.ComparisonChain) else _compared(part)


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
_EXPRESSION_LOGIC: dict[str, Literal["and", "or"]] = {"&&": "and", "||": "or"}


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
    value: expression_syntax.Part

    def constant(self) -> str | int | float | bool | None:
        """Literal, or `"{key}"` for a copy, that is written in any case; else None."""
        if not self.new:
            return None
        match self.value:
            case expression_syntax.Name(name=name):
                return f"{{{name}}}"
            case expression_syntax.LiteralValue(value=str() as text) if "{" in text:
                return None
            case expression_syntax.LiteralValue(value=value):
                return value
            case expression_syntax.Sign(
                symbol="-", operand=expression_syntax.LiteralValue(value=int() | float() as number)
            ) if number is not True:
                return -number
            case _:
                return None

    def text(self) -> str:
        """Return the statement in the syntax of a postcondition."""
        operator = ":=" if self.new else "="
        return f"{self.key} {operator} {expression_text(self.value)}"


def read_expression(script: str, enums: Mapping[str, int] | None = None) -> expression_syntax.Part:
    """Return the script's single expression. Raises ScriptError."""
    statements = _Parser(script, enums or {}).statements()
    if len(statements) != 1 or statements[0].key:
        raise ScriptError("one expression without an assignment is wanted", 0)
    return statements[0].value


def read_parts(script: str, enums: Mapping[str, int] | None = None) -> tuple[Statement, ...]:
    """Return assignments and bare values of a script. Raises ScriptError."""
    return _Parser(script, enums or {}).statements()


def names_in(script: str) -> tuple[str, ...]:
    """Return the names in a script; empty for an unreadable one."""
    try:
        return tuple(token.text for token in _tokens(script) if token.kind == "name")
    except ScriptError:
        return ()


def with_names(script: str, names: Mapping[str, str]) -> str:
    """Return the script with other names; an unreadable one is not changed."""
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
        left = expression_syntax.Name(target.at, self._take().text) if assigned else self._choice()
        if not self._is(*_ASSIGNMENTS):
            return Statement("", False, left)
        operator = self._take()
        if not isinstance(left, expression_syntax.Name):
            raise ScriptError("only a key of the tree can be assigned to", target.at)
        value = self._choice()
        if self._is(*_ASSIGNMENTS):
            self._unexpected("only one key can be assigned to")
        if operator.text in (":=", "="):
            return Statement(left.name, operator.text == ":=", value)
        symbol = cast("Literal['+', '-', '*', '/']", operator.text[0])
        return Statement(left.name, False, expression_syntax.Arithmetic(operator.at, symbol, left, value))

    def _choice(self) -> expression_syntax.Part:
        test = self._logic()
        if not self._is("?"):
            return test
        at = self._take().at
        yes = self._nested()
        self._expect(":")
        return expression_syntax.Conditional(at, test, yes, self._nested())

    def _nested(self) -> expression_syntax.Part:
        self._deeper()
        part = self._choice()
        self._depth -= 1
        return part

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > MAX_SCRIPT_DEPTH:
            raise ScriptError(f"the script is nested more than {MAX_SCRIPT_DEPTH} deep", self._token.at)

    def _logic(self) -> expression_syntax.Part:
        """Parse `||`, and `&&`, which binds more tightly since BehaviorTree.CPP 4.9."""
        return self._joined("||", lambda: self._joined("&&", self._comparison))

    def _joined(self, symbol: str, operand: Callable[[], expression_syntax.Part]) -> expression_syntax.Part:
        first, rest = operand(), list[expression_syntax.Part]()
        at = self._token.at
        while self._is(symbol):
            self._take()
            rest.append(operand())
        return expression_syntax.Logic(at, _EXPRESSION_LOGIC[symbol], (first, *rest)) if rest else first

    def _comparison(self) -> expression_syntax.Part:
        first, rest = self._sum(), list[expression_syntax.ComparisonLink]()
        at = self._token.at
        while self._is("==", "!=", "<", "<=", ">", ">="):
            token = self._take()
            relation = cast("expression_syntax.Relation", token.text)
            rest.append(expression_syntax.ComparisonLink(token.at, relation, self._sum()))
        if self._is(*_NO_COUNTERPART):
            self._unexpected("")
        return expression_syntax.ComparisonChain(at, first, tuple(rest)) if rest else first

    def _sum(self) -> expression_syntax.Part:
        left = self._product()
        while self._is("+", "-", ".."):
            token = self._take()
            symbol = "-" if token.text == "-" else "+"
            left = expression_syntax.Arithmetic(token.at, symbol, left, self._product())
        return left

    def _product(self) -> expression_syntax.Part:
        left = self._prefixed()
        while self._is("*", "/"):
            token = self._take()
            symbol = "*" if token.text == "*" else "/"
            left = expression_syntax.Arithmetic(token.at, symbol, left, self._prefixed())
        return left

    def _prefixed(self) -> expression_syntax.Part:
        if self._is("-", "!"):
            token = self._take()
            self._deeper()
            operand = self._prefixed()
            self._depth -= 1
            if token.text == "-":
                return expression_syntax.Sign(token.at, "-", operand)
            return expression_syntax.Not(token.at, operand)
        return self._value()

    def _value(self) -> expression_syntax.Part:
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
                return expression_syntax.LiteralValue(token.at, int(token.text, 16))
            case "number":
                whole = token.text.isdigit() and len(token.text) < 20
                number = int(token.text) if whole else float(token.text)
                return expression_syntax.LiteralValue(token.at, number)
            case "text":
                return expression_syntax.LiteralValue(token.at, token.text[1:-1])
            case _:
                return self._name(token)

    def _name(self, token: _Token) -> expression_syntax.Part:
        if token.text in ("true", "false"):
            return expression_syntax.LiteralValue(token.at, token.text == "true")
        if token.text in self._enums:
            return expression_syntax.LiteralValue(token.at, self._enums[token.text])
        if token.text in OUR_WORDS:
            raise ScriptError(f"{token.text!r} cannot be the name of a key in an expression", token.at)
        return expression_syntax.Name(token.at, token.text)
