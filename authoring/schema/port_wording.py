"""Declarations in words, for editors and the reference: accepted values and defaults of ports."""

from __future__ import annotations

import re
from collections.abc import Mapping

from ...files.quantities import example
from ...files.value_wording import listed
from ...trees.declaration import NodeDeclaration
from ...trees.port_types import Name
from ...trees.ports import PortDeclaration, Required
from ...world.belief.facts import FACTS

_TYPE_WORDS: dict[Name, str] = {
    "string": "text", "int": "whole number", "float": "number", "bool": "true or false",
    "object": "id of an object", "expression": "expression", "any": "any value",
}  # fmt: skip
_LIST_TYPE_WORDS: dict[Name, str] = {
    "string": "list of texts", "int": "list of whole numbers", "float": "list of numbers",
    "bool": "list of true or false", "object": "list of ids of objects", "expression": "list of expressions",
    "any": "list",
}  # fmt: skip
_NAME_WORDS = {
    "camera": "name of a camera of the scene",
    "pose": "name of a pose of the robot",
    "bin": "name of a bin of the scene",
    "tote": "name of a tote of the scene, or of a fixture with a heap on it",
    "hole": "name of a hole of the scene, or of a fixture with holes",
    "fixture": "name of a fixture or bin of the scene",
    "kind": "name of a kind of the scene's catalogue",
    "colour": "name of a colour",
    "planner": "name of a planner",
}

_ASSIGNMENTS = "Assignments, as `tries := tries + 1`, several with `;`: made when the node "
COMMON_DOCS: Mapping[str, str] = {
    "name": "What the node is called in pictures, logs and paths; its ID unless given.",
    "_failureIf": "An expression: when it holds as the node would start, it is FAILURE instead.",
    "_successIf": "An expression: when it holds as the node would start, it is SUCCESS instead.",
    "_skipIf": "An expression: when it holds as the node would start, it is SKIPPED, as if it were absent.",
    "_while": "An expression, asked at every tick: when it does not hold, the node is halted and SKIPPED.",
    "_onHalted": _ASSIGNMENTS + "is halted while it runs.",
    "_onFailure": _ASSIGNMENTS + "ends in FAILURE.",
    "_onSuccess": _ASSIGNMENTS + "ends in SUCCESS.",
    "_post": _ASSIGNMENTS + "ends, whatever the outcome.",
    "breakpoint": "Where `picktree run --debug` stops: `before` the node starts, or `after` its end.",
}
"""Documentation of the keys that every node may have."""


def type_words(port: PortDeclaration) -> str:
    """Return a port's type in words: `number in m, or as "30 mm"`, `name of a camera of the scene`."""
    if port.names is not None and not port.type.many:
        words = _NAME_WORDS[port.names]
    else:
        words = (_LIST_TYPE_WORDS if port.type.many else _TYPE_WORDS)[port.type.name]
    if port.unit:
        words += f" in {port.unit}"
        words += f', or as "{unit_example(port.unit)}"' if port.direction == "in" else ""
    elif port.type.name == "float" and not port.type.many and port.direction == "in":
        words += ', or as "50 %"'
    return f"{words}, or null" if port.type.optional else words


def unit_example(unit: str) -> str:
    """Return an example of a quantity with a unit, where a bare number is in `unit`."""
    return "2 s" if unit == "ms" else example(unit)


def default_words(port: PortDeclaration) -> str:
    """Return the default as a file writes it; `none` when it means "not given", empty when there is none."""
    match port.default:
        case Required():
            return ""
        case None | "" | []:
            return "none"
        case bool() as flag:
            return str(flag).lower()
        case int() | float() as number:
            return f"{number:g} {port.unit}" if port.unit else f"{number:g}"
        case other:
            return str(other)


def expression_words(port: PortDeclaration) -> str:
    """Return the names that an expression may use; empty for other ports."""
    if port.type.name != "expression":
        return ""
    return f"of the blackboard's keys and the facts {', '.join(FACTS)}"


def uses_words(node: NodeDeclaration) -> str:
    """Return the used resources, as `arm and gripper`; empty for none."""
    return listed([str(resource.value) for resource in node.uses])


def hand_words(node: NodeDeclaration) -> str:
    """Return a sentence about the hand after success; empty when the node does not change it."""
    match node.hand_after:
        case "full":
            return "After success the hand holds the object."
        case "empty":
            return "After success the hand is empty."
        case "kept":
            return "What the hand holds after success is in a safe place."
        case "unchanged":
            return ""


def unwrapped(doc: str) -> str:
    """Return a docstring without line breaks inside its paragraphs."""
    paragraphs = re.split(r"\n\s*\n", doc)
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)
