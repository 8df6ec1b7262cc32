"""Literals of ports as attribute texts, and back.

Numbers are in SI units and lists have `;` between their elements, as BehaviorTree.CPP reads them. Other
values follow `json:`, as there.
"""

from __future__ import annotations

import json
import math
import re
from typing import Final, cast

from picktree.files import Expression
from picktree.files.yaml import Value
from picktree.trees import PortDeclaration, PortType
from picktree.world import Plain

JSON: Final = "json:"
ANY_TYPE: Final = "BT::AnyTypeAllowed"
_TYPES: Final = {
    "string": "std::string", "int": "int", "float": "double", "bool": "bool", "object": "ObjectId",
    "expression": "std::string", "any": ANY_TYPE,
}  # fmt: skip
_NAMES: Final = {
    "std::string": "string", "int": "int", "double": "float", "bool": "bool", "ObjectId": "object",
    "BT::AnyTypeAllowed": "any", "AnyTypeAllowed": "any", "unsigned int": "int", "float": "float",
    "BT::SimpleString": "string", "long": "int", "unsigned": "int", "string": "string",
    "size_t": "int", "std::size_t": "int", "uint64_t": "int", "int64_t": "int", "uint32_t": "int",
    "int32_t": "int", "uint16_t": "int", "int16_t": "int", "uint8_t": "int", "int8_t": "int",
    "std::int64_t": "int", "std::uint64_t": "int", "std::int32_t": "int", "std::uint32_t": "int",
    "char const*": "string", "const char*": "string",
    "std::__cxx11::basic_string<char, std::char_traits<char>, std::allocator<char> >": "string",
}  # fmt: skip
_MIN_EXPONENT_NUMBER: Final = 1e15
"""Limit from which numbers are written with an exponent."""
_MAX_NUMBER_LENGTH: Final = 40
"""Limit of the length of a number, characters."""
_VECTOR = re.compile(
    r"(?:(?:std::shared_ptr<\s*)?(?:std::)?(?:vector|deque|list)|(?:BT::)?(?:SharedQueue|ProtectedQueue))"
    r"<\s*(?P<of>[\w: ]+?)\s*(?:,.*)?>+"
)
_BEHIND = re.compile(r"(?<=[\d.]) (ms)?$", re.ASCII)
_INTEGER = re.compile(r"-?(?:0|[1-9]\d{0,18})", re.ASCII)
_FLOAT = re.compile(r"-?(?:0|[1-9]\d*)(?:\.\d+)?(?:[eE][-+]?\d+)?", re.ASCII)
"""Numbers in the one form that BehaviorTree.CPP and people write; `007` and `0x10` are texts."""
_DECIMAL = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
_LARGEST_INTEGER: Final = 2**63 - 1
_TRUTH = {"true": True, "True": True, "TRUE": True, "1": True,
          "false": False, "False": False, "FALSE": False, "0": False}  # fmt: skip


def type_text(kind: PortType) -> str:
    """Return the type's C++ name."""
    return f"std::vector<{_TYPES[kind.name]}>" if kind.many else _TYPES[kind.name]


def type_name(text: str) -> str:
    """Return the type's name in a mission; `any` for an unknown one."""
    vector = _VECTOR.fullmatch(text.strip())
    if vector is not None:
        return f"list of {_NAMES.get(vector['of'], 'any')}"
    return _NAMES.get(text.strip(), "any")


def value_text(value: object, kind: PortType) -> str:
    """Return a converted literal as text."""
    if kind.many and isinstance(value, list):
        return _list_text(cast("list[Plain]", value), kind)
    if value is None:
        return f"{JSON}null"
    if isinstance(value, Expression):
        return value.text
    if kind.name == "any":
        return _any_text(cast("Plain", value))
    return _scalar_text(cast("str | int | float | bool", value))


def read_value(text: str, kind: PortType) -> Value:
    """Convert a text to a literal of a mission file; the mission's checker finds wrong types.

    Raises ValueError for invalid JSON after `json:`.
    """
    if kind.many:
        return _list(text, kind)
    if text == f"{JSON}null" and kind.optional:
        return None
    match kind.name:
        case "int" | "float":
            # As a sub-tree's port has it, where BehaviorTree.CPP must not take it for a number.
            return _number(_BEHIND.sub("", text).strip(), text)
        case "bool":
            return _TRUTH.get(text, text)
        case "any":
            return _json(text) if text.startswith(JSON) else _any_value(text)
        case _:
            return text


def default_text(port: PortDeclaration) -> str:
    """Return the port's default as text; empty when it has none, or an empty one."""
    if port.required or port.direction == "out" or port.default is None:
        return ""
    return value_text(port.default, port.type)


def is_pointer(text: str) -> bool:
    """Whether BehaviorTree.CPP reads the text as a key of the blackboard."""
    bare = text.strip(" ")
    return len(bare) >= 3 and bare.startswith("{") and bare.endswith("}")


def _any_value(text: str) -> str | int | float | bool:
    """Return the value of a text for a port of any type. A text that is not clearly another value stays a
    text."""
    bare = _BEHIND.sub("", text)
    if _INTEGER.fullmatch(bare):
        return int(bare) if abs(int(bare)) <= _LARGEST_INTEGER else text
    if _FLOAT.fullmatch(bare) and not bare.lstrip("-").isdigit() and math.isfinite(float(bare)):
        return float(bare)
    return {"true": True, "false": False}.get(text, text)


def _number(text: str, otherwise: str) -> str | int | float:
    """Return a decimal number, as BehaviorTree.CPP reads it for a typed port."""
    if not _DECIMAL.fullmatch(text) or len(text) > _MAX_NUMBER_LENGTH:
        return otherwise
    number = float(text)
    if re.fullmatch(r"[-+]?\d+", text, re.ASCII):
        return int(text)
    whole = number.is_integer() and abs(number) < _MIN_EXPONENT_NUMBER
    return int(number) if whole else number


def _scalar_text(value: str | int | float | bool) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case float() if value.is_integer() and abs(value) < _MIN_EXPONENT_NUMBER:
            return str(int(value))
        case float():
            return repr(value)
        case _:
            return str(value)


def _any_text(value: Plain) -> str:
    # Texts that would be read as another value, and values that are no scalars.
    plain = isinstance(value, str) and not value.startswith(JSON) and isinstance(_any_value(value), str)
    if plain or (isinstance(value, bool | int) and not isinstance(value, str)):
        return _scalar_text(cast("str | int | bool", value))
    return repr(value) if isinstance(value, float) else JSON + json.dumps(value, ensure_ascii=False)


def _list_text(values: list[Plain], kind: PortType) -> str:
    one = PortType(kind.name)
    texts = [value_text(value, one) for value in values]
    simple = all(text and ";" not in text and text == text.strip() for text in texts)
    joined = ";".join(texts)
    if texts and simple and not joined.startswith(JSON) and not is_pointer(joined):
        return joined
    return JSON + json.dumps(values, ensure_ascii=False)


def _list(text: str, kind: PortType) -> Value:
    if text.startswith(JSON):
        return _json(text)
    one = PortType(kind.name)
    return [read_value(part, one) for part in text.split(";")] if text else []


def _json(text: str) -> Value:
    try:
        return cast("Value", json.loads(text.removeprefix(JSON)))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"not valid JSON behind 'json:': {error}") from None
