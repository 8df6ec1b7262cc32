"""From the parts of an expression back to its text, with no more brackets than it needs."""

from __future__ import annotations

from ....files.expressions.syntax_tree import (
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
    Sign,
)

# How tightly each kind of part binds, as the parser of expressions has it.
_CHOICE, _OR, _AND, _NOT, _RELATION, _SUM, _PRODUCT, _SIGN, _VALUE = range(9)


def expression_text(part: Part) -> str:
    """A text that parses to the same parts."""
    match part:
        case Literally(value=value):
            return literal_text(value)
        case Name(name=name):
            return name
        case Attribute(owner=owner, name=name):
            number = isinstance(owner, Literally) and type(owner.value) in (int, float)
            return f"({expression_text(owner)}).{name}" if number else f"{_within(owner, _VALUE)}.{name}"
        case Not(operand=operand):
            return f"not {_within(operand, _NOT)}"
        case Sign(symbol=symbol, operand=operand):
            return f"{symbol}{_within(operand, _SIGN)}"
        case Arithmetic(symbol=symbol, left=left, right=right):
            binding = _binding(part)
            return f"{_within(left, binding)} {symbol} {_within(right, binding + 1)}"
        case Comparison(first=first, rest=rest):
            words = [_within(first, _SUM)]
            for related in rest:
                words += [related.relation, _within(related.operand, _SUM)]
            return " ".join(words)
        case Logic(symbol=symbol, parts=parts):
            return f" {symbol} ".join(_within(lower, _binding(part) + 1) for lower in parts)
        case Choice(test=test, yes=yes, no=no):
            return f"{_within(yes, _OR)} if {_within(test, _OR)} else {_within(no, _CHOICE)}"
        case ListOf(items=items):
            return f"[{', '.join(map(expression_text, items))}]"
        case Call(function=function, arguments=arguments):
            return f"{function}({', '.join(map(expression_text, arguments))})"


def literal_text(value: str | int | float | bool | None) -> str:
    """A constant as an expression writes it."""
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
        case Choice():
            return _CHOICE
        case Logic(symbol=symbol):
            return _OR if symbol == "or" else _AND
        case Not():
            return _NOT
        case Comparison():
            return _RELATION
        case Arithmetic(symbol=symbol):
            return _SUM if symbol in ("+", "-") else _PRODUCT
        case Sign():
            return _SIGN
        case _:
            return _VALUE
