"""The expression language of all files: a small, bounded subset of Python's expressions, never `eval`.

Comparisons, arithmetic on numbers, `and`, `or`, `not`, `in`, `a if c else b`, lists, and the functions of
`FUNCTIONS`. Attributes are read only through the resolver that the caller hands in.
"""

from __future__ import annotations

import ast
import operator
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias, cast

from .nearest import nearest

Attributes: TypeAlias = Callable[[object, str], object]
"""Resolves `thing.name`; raises KeyError or ValueError when there is no such attribute."""

MAX_LENGTH = 1000
MAX_NODES = 250
MAX_DEPTH = 40
CONSTANTS: Mapping[str, bool | None] = {"true": True, "false": False, "null": None}


class ExpressionError(ValueError):
    """What is wrong with an expression, and the character (from 0) where."""

    def __init__(self, message: str, offset: int = 0) -> None:
        super().__init__(message)
        self.offset = offset


@dataclass(frozen=True, slots=True)
class Expression:
    """A parsed expression. `names` are the free names, `paths` the dotted ones (`item.colour`)."""

    text: str
    names: frozenset[str]
    paths: frozenset[str]
    _root: ast.expr

    @classmethod
    def parse(cls, text: str) -> Expression:
        """Raises ExpressionError (a ValueError) with a sentence and the offset."""
        root = _parse(text)
        names = {n.id for n in ast.walk(root) if isinstance(n, ast.Name)} - set(CONSTANTS)
        functions = {
            n.func.id for n in ast.walk(root) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)
        }
        paths = {path for n in ast.walk(root) if isinstance(n, ast.Attribute) and (path := _dotted(n))}
        return cls(text, frozenset(names - functions), frozenset(paths), root)

    def evaluate(self, names: Mapping[str, object], attributes: Attributes | None = None) -> object:
        """The value with these names. Raises ExpressionError; never runs anything but the operators."""
        return _Evaluation(self.text, names, attributes).value(self._root)

    def __str__(self) -> str:
        return self.text


def _length(items: object) -> int:
    if isinstance(items, str | list | tuple | dict | set | frozenset):
        return len(cast("list[object]", items))
    raise TypeError


FUNCTIONS: Mapping[str, Callable[..., object]] = {
    "len": _length,
    "min": min,
    "max": max,
    "abs": abs,
    "round": round,
}
_ARITHMETIC: Mapping[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.FloorDiv: lambda a, b: a // b,
    ast.Mod: lambda a, b: a % b,
}
_COMPARISONS: Mapping[type[ast.cmpop], Callable[[object, object], object]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: cast("Callable[[object, object], object]", operator.lt),
    ast.LtE: cast("Callable[[object, object], object]", operator.le),
    ast.Gt: cast("Callable[[object, object], object]", operator.gt),
    ast.GtE: cast("Callable[[object, object], object]", operator.ge),
    ast.In: lambda a, b: a in _container(b),
    ast.NotIn: lambda a, b: a not in _container(b),
}
_SYMBOLS: Mapping[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%",
    ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=",
    ast.In: "in", ast.NotIn: "not in", ast.UAdd: "+", ast.USub: "-",
}  # fmt: skip
_PLAIN = (
    ast.BoolOp, ast.IfExp, ast.List, ast.Tuple, ast.Name, ast.Attribute,
)  # fmt: skip


def _parse(text: str) -> ast.expr:
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the expression is longer than {MAX_LENGTH} characters")
    if not text.strip():
        raise ExpressionError("the expression is empty")
    one_line = re.sub(r"\s", " ", text)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            root = ast.parse(one_line.strip(), mode="eval").body
    except (SyntaxError, ValueError) as error:
        offset = (getattr(error, "offset", None) or 1) - 1
        raise ExpressionError(_syntax(one_line), _in_text(text, offset)) from None
    except (MemoryError, RecursionError):
        raise ExpressionError("the expression is nested too deeply") from None
    for count, (node, depth) in enumerate(_walk(root)):
        if count >= MAX_NODES:
            raise ExpressionError(f"the expression has more than {MAX_NODES} parts")
        if depth > MAX_DEPTH:
            raise ExpressionError(f"the expression is nested more than {MAX_DEPTH} deep")
        _check(node, _in_text(text, _characters(one_line.strip(), node)))
    return root


def _syntax(text: str) -> str:
    bare = re.sub(r"'[^']*'|\"[^\"]*\"", "''", text)
    for pattern, hint in (
        (r"&&", "write 'and' for '&&'"),
        (r"\|\|", "write 'or' for '||'"),
        (r"!(?!=)", "write 'not' for '!'"),
        (r"(?<![=!<>])=(?!=)", "compare with '=='"),
        (r"[{}]", "names stand without braces in an expression"),
    ):
        if re.search(pattern, bare):
            return f"not an expression: {hint}"
    return "not an expression"


def _walk(root: ast.expr) -> Iterator[tuple[ast.expr, int]]:
    todo: list[tuple[ast.expr, int]] = [(root, 1)]
    while todo:
        node, depth = todo.pop()
        yield node, depth
        # A function's name is checked with its call; operators are no expressions.
        children: Iterable[ast.AST] = node.args if isinstance(node, ast.Call) else ast.iter_child_nodes(node)
        todo.extend((child, depth + 1) for child in children if isinstance(child, ast.expr))


def _check(node: ast.expr, offset: int) -> None:
    match node:
        case ast.Constant(value=value):
            # An Ellipsis, a bytes or a complex literal is a Constant as well.
            ok = value is None or type(value) in (bool, int, float, str)
            problem = "only numbers, texts, true, false and null are constants"
        case ast.UnaryOp(op=op):
            ok, problem = (
                isinstance(op, ast.Not | ast.USub | ast.UAdd),
                "this operator is not part of the language",
            )
        case ast.BinOp(op=op):
            ok = type(op) in _ARITHMETIC
            problem = f"this operator is not part of the language (arithmetic: {_symbols(_ARITHMETIC)})"
        case ast.Compare(ops=ops):
            ok = all(type(op) in _COMPARISONS for op in ops)
            problem = "'is' is not part of the language: compare with '=='"
        case ast.Call(func=func, keywords=keywords):
            name = func.id if isinstance(func, ast.Name) else ""
            ok = name in FUNCTIONS and not keywords
            problem = f"functions are {', '.join(FUNCTIONS)}, and take no named arguments"
        case _:
            ok = isinstance(node, _PLAIN)
            problem = f"{_words(node)} is not part of the language"
    if isinstance(node, ast.Attribute) and node.attr.startswith("_"):
        ok, problem = False, f"{node.attr!r} is private"
    if not ok:
        raise ExpressionError(problem, offset)


def _words(node: ast.expr) -> str:
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(node).__name__).lower()
    known = {
        "subscript": "indexing with [ ]",
        "joined str": "an f-string",
        "set": "a name in braces",
        "list comp": "a loop",
        "generator exp": "a loop",
        "set comp": "a loop",
        "dict comp": "a loop",
        "await": "'await'",
    }
    return known.get(words, f"a {words}")


def _symbols(operators: Iterable[type[ast.AST]]) -> str:
    return " ".join(_SYMBOLS[op] for op in operators)


def _characters(line: str, node: ast.expr) -> int:
    # ast counts UTF-8 bytes.
    return len(line.encode()[: node.col_offset].decode(errors="ignore"))


def _in_text(text: str, offset: int) -> int:
    return min(offset + len(text) - len(text.lstrip()), max(0, len(text) - 1))


def _dotted(node: ast.expr) -> str:
    match node:
        case ast.Name(id=name):
            return name
        case ast.Attribute(value=inner, attr=attr):
            stem = _dotted(inner)
            return f"{stem}.{attr}" if stem else ""
        case _:
            return ""


def _container(value: object) -> Iterable[object]:
    if isinstance(value, str | list | tuple | dict | set | frozenset):
        return cast("Iterable[object]", value)
    raise TypeError


def _number(value: object) -> int | float:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value
    raise TypeError


class _Evaluation:
    def __init__(self, text: str, names: Mapping[str, object], attributes: Attributes | None) -> None:
        self._text, self._names, self._attributes = text, names, attributes

    def value(self, node: ast.expr) -> object:
        match node:
            case ast.Constant(value=constant):
                return constant
            case ast.Name(id=name):
                return self._name(node, name)
            case ast.Attribute(value=owner, attr=attr):
                return self._attribute(node, self.value(owner), attr)
            case ast.BoolOp(op=op, values=values):
                stop = isinstance(op, ast.Or)
                found: object = not stop
                for part in values:
                    found = self.value(part)
                    if bool(found) is stop:
                        break
                return found
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return not self.value(operand)
            case ast.UnaryOp(op=op, operand=operand):
                operand_value = self.value(operand)
                sign = -1 if isinstance(op, ast.USub) else 1
                return self._guard(node, type(op), (operand_value,), lambda: sign * _number(operand_value))
            case ast.BinOp(left=left, op=op, right=right):
                a, b = self.value(left), self.value(right)
                return self._guard(
                    node, type(op), (a, b), lambda: _ARITHMETIC[type(op)](_number(a), _number(b))
                )
            case ast.Compare():
                return self._compare(node)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return self.value(body if self.value(test) else orelse)
            case ast.List(elts=elements) | ast.Tuple(elts=elements):
                return [self.value(element) for element in elements]
            case ast.Call(func=ast.Name(id=name), args=args):
                given = [self.value(arg) for arg in args]
                return self._guard(node, name, given, lambda: FUNCTIONS[name](*given))
            case _:
                raise self._error(node, f"{_words(node)} is not part of the language")

    def _name(self, node: ast.expr, name: str) -> object:
        if name in self._names:
            return self._names[name]
        if name in CONSTANTS:
            return CONSTANTS[name]
        raise self._error(node, f"unknown name {name!r}; {nearest(name, self._names)}".rstrip("; "))

    def _attribute(self, node: ast.expr, owner: object, attr: str) -> object:
        if self._attributes is None:
            raise self._error(node, f"nothing here has attributes, so not {attr!r} either")
        try:
            return self._attributes(owner, attr)
        except (KeyError, ValueError, AttributeError) as error:
            text = str(error.args[0]) if error.args else ""
            raise self._error(node, text if " " in text else f"no attribute {attr!r}") from None

    def _compare(self, node: ast.Compare) -> object:
        left = self.value(node.left)
        for op, comparator in zip(node.ops, node.comparators, strict=True):
            right = self.value(comparator)
            a, b, kind = left, right, type(op)
            if not self._guard(node, kind, (a, b), lambda a=a, b=b, kind=kind: _COMPARISONS[kind](a, b)):
                return False
            left = right
        return True

    def _guard(
        self, node: ast.expr, what: type[ast.AST] | str, given: Iterable[object], apply: Callable[[], object]
    ) -> object:
        name = what if isinstance(what, str) else _SYMBOLS[what]
        try:
            return apply()
        except ZeroDivisionError:
            raise self._error(node, "division by zero") from None
        except (TypeError, ValueError, OverflowError):
            kinds = " and ".join(_type_name(value) for value in given) or "nothing"
            raise self._error(node, f"{name!r} does not work on {kinds}") from None

    def _error(self, node: ast.expr, message: str) -> ExpressionError:
        line = re.sub(r"\s", " ", self._text).strip()
        return ExpressionError(message, _in_text(self._text, _characters(line, node)))


def _type_name(value: object) -> str:
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
            return f"a {type(value).__name__}"
