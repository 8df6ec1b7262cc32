"""Export of expressions to BehaviorTree.CPP's scripts, where scripts can express them.

The script grammar (4.7 and later) differs from common ones. `&&` and `||` bind equally tightly. Arithmetic
and `!` cannot be combined without brackets. A name that begins with `true` is read as the constant. Texts
have no escapes and only ASCII characters. So the output has more brackets than necessary.
"""

from __future__ import annotations

from collections.abc import Iterable

from ...files.expressions.expression import Expression
from ...files.expressions.syntax_tree import (
    Arithmetic,
    Attribute,
    Call,
    ComparisonChain,
    Conditional,
    Element,
    ListOf,
    LiteralValue,
    Logic,
    Name,
    Not,
    Part,
    Sign,
)
from ...trees.references import Assignment
from ...world.belief.facts import FACTS

# Precedence of each kind of part, as in the parser of expressions.
_CHOICE, _OR, _AND, _NOT, _RELATION, _SUM, _PRODUCT, _SIGN, _VALUE = range(9)


def expression_text(part: Part) -> str:
    """Return a text that parses to the same parts."""
    match part:
        case LiteralValue(value=value):
            return literal_text(value)
        case Name(name=name):
            return name
        case Attribute(owner=owner, name=name):
            number = isinstance(owner, LiteralValue) and type(owner.value) in (int, float)
            return f"({expression_text(owner)}).{name}" if number else f"{_within(owner, _VALUE)}.{name}"
        case Element(owner=owner, index=index):
            return f"{_within(owner, _VALUE)}[{expression_text(index)}]"
        case Not(operand=operand):
            return f"not {_within(operand, _NOT)}"
        case Sign(symbol=symbol, operand=operand):
            return f"{symbol}{_within(operand, _SIGN)}"
        case Arithmetic(symbol=symbol, left=left, right=right):
            binding = _binding(part)
            return f"{_within(left, binding)} {symbol} {_within(right, binding + 1)}"
        case ComparisonChain(first=first, rest=rest):
            words = [_within(first, _SUM)]
            for related in rest:
                words += [related.relation, _within(related.operand, _SUM)]
            return " ".join(words)
        case Logic(symbol=symbol, parts=parts):
            return f" {symbol} ".join(_within(lower, _binding(part) + 1) for lower in parts)
        case Conditional(test=test, yes=yes, no=no):
            return f"{_within(yes, _OR)} if {_within(test, _OR)} else {_within(no, _CHOICE)}"
        case ListOf(items=items):
            return f"[{', '.join(map(expression_text, items))}]"
        case Call(function=function, arguments=arguments):
            return f"{function}({', '.join(map(expression_text, arguments))})"


def literal_text(value: str | int | float | bool | None) -> str:
    """Return a constant as an expression writes it."""
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


def _within(part: Part, least: int) -> str:
    text = expression_text(part)
    return text if _binding(part) >= least else f"({text})"


def _binding(part: Part) -> int:
    match part:
        case Conditional():
            return _CHOICE
        case Logic(symbol=symbol):
            return _OR if symbol == "or" else _AND
        case Not():
            return _NOT
        case ComparisonChain():
            return _RELATION
        case Arithmetic(symbol=symbol):
            return _SUM if symbol in ("+", "-") else _PRODUCT
        case Sign():
            return _SIGN
        case _:
            return _VALUE


LARGEST_INTEGER = 2**53
"""Largest whole number that scripts compute with: BehaviorTree.CPP throws where a double is not exact."""
_LOGIC = {"and": "&&", "or": "||"}


class NotExpressible(Exception):
    """Expression that BehaviorTree.CPP's scripts cannot express; the text gives the reason."""


def script(expression: Expression) -> str:
    """Return the expression as a script. Raises NotExpressible."""
    return _text(expression.root)


def assignments_script(assignments: Iterable[Assignment]) -> str:
    """Return assignments as `a := 1; b = a + 1`. Raises NotExpressible."""
    return "; ".join(_assignment(assignment) for assignment in assignments)


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


def _assignment(assignment: Assignment) -> str:
    _check_name(assignment.key)
    return f"{assignment.key} {':=' if assignment.new else '='} {script(assignment.value)}"


def _text(part: Part) -> str:
    match part:
        case LiteralValue(value=value):
            return _literal(value)
        case Name(name=name):
            _check_name(name)
            return name
        case Not(operand=operand):
            return f"!{_atom(operand)}"
        case Sign(symbol="-", operand=operand):
            return f"-{_atom(operand)}"
        case Arithmetic(symbol="+", left=left, right=right) if _is_text(part):
            return f"{_atom(left)} .. {_atom(right)}"
        case Arithmetic(symbol="+" | "-" | "*" | "/" as symbol, left=left, right=right):
            return f"{_left_operand(symbol, left)} {symbol} {_operand(symbol, right)}"
        case ComparisonChain(first=first, rest=rest):
            words = [_compared(first)]
            for related in rest:
                if related.relation in ("in", "not in"):
                    raise NotExpressible(f"there is no {related.relation!r}")
                words += [related.relation, _compared(related.operand)]
            return " ".join(words)
        case Logic(symbol=symbol, parts=parts):
            return f" {_LOGIC[symbol]} ".join(_in_logic(lower) for lower in parts)
        case Conditional(test=test, yes=yes, no=no):
            return f"{_in_logic(test)} ? {_in_logic(yes)} : {_in_logic(no)}"
        case _:
            raise NotExpressible("there are no attributes, lists, functions and other operators")


def _is_text(part: Part) -> bool:
    """Whether a sum certainly is a text: then it is joined, which `+` does not do with a number."""
    match part:
        case LiteralValue(value=value):
            return isinstance(value, str)
        case Arithmetic(symbol="+", left=left, right=right):
            return _is_text(left) or _is_text(right)
        case _:
            return False


def _check_name(name: str) -> None:
    if name in FACTS:
        raise NotExpressible(f"{name!r} is a fact of the world, not a key of the blackboard")
    if name.startswith(("true", "false")):
        raise NotExpressible(f"{name!r} begins like a constant")


def _bracketed(part: Part) -> str:
    return f"({_text(part)})"


def _atom(part: Part) -> str:
    return _text(part) if isinstance(part, LiteralValue | Name) else _bracketed(part)


def _operand(symbol: str, part: Part) -> str:
    """Return a right operand, in brackets if it could be read as part of the operator's chain."""
    tighter = symbol in ("+", "-") and isinstance(part, Arithmetic) and part.symbol in ("*", "/")
    return _text(part) if tighter else _atom(part)


def _left_operand(symbol: str, part: Part) -> str:
    """Return a left operand; operators of the same kind are evaluated in order, without brackets."""
    same = isinstance(part, Arithmetic) and (symbol in ("+", "-") or part.symbol in ("*", "/"))
    return _text(part) if same else _atom(part)


def _compared(part: Part) -> str:
    return _text(part) if isinstance(part, Arithmetic | Not | Sign) else _atom(part)


def _in_logic(part: Part) -> str:
    return _text(part) if isinstance(part, ComparisonChain | Arithmetic | Not | Sign) else _atom(part)
