"""Values of ports that are read at a node's start, and the attributes of objects.

References to the blackboard, `"{item}"` and `"{item.colour}"`, and expressions, `"{= rounds + 1}"`.
"""

from __future__ import annotations

import re
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Final, TypeAlias

from picktree.files import (
    BOOL,
    FLOAT,
    INT,
    OBJECT,
    PLACE,
    TEXT,
    Expression,
    Mark,
    ValueType,
    expression_syntax,
    suggest_name,
)
from picktree.files.yaml import Document
from picktree.world import ITEM_COLOURS, BeliefObject, Failure, ObjectId, Plain, PlanningScene, tree
from picktree.world.scene import Form

from .port_types import show

_LINE = re.compile(r"\r?\n")


class ExpressionLocator:
    """Locator of expression errors in the lines of a mission's files."""

    def __init__(self, documents: Iterable[Document]) -> None:
        self._texts = {str(document.path): document.text for document in documents}
        self._lines: dict[str, list[str]] = {}

    def describe(
        self, start: Mark, text: str, error: expression_syntax.ExpressionError, before: int = 0
    ) -> tuple[Mark, str]:
        """Return place and message of an error in an expression that begins `before` characters after
        `start`.

        Where the file's text differs from its value (escapes, lines), the message names the character.
        """
        line = self._line(start)
        quote = line[:1] if line[:1] in ("'", '"') else ""
        skipped = len(quote) + before
        if text and line[skipped:].startswith(text) and "\n" not in text:
            column = start.column + skipped + error.offset
            return Mark(start.file, start.line, column), str(error)
        return start, error.describe(text)

    def _line(self, start: Mark) -> str:
        """Return the rest of the line from there."""
        if start.file not in self._lines:
            self._lines[start.file] = _LINE.split(self._texts.get(start.file, ""))
        lines = self._lines[start.file]
        return lines[start.line - 1][start.column - 1 :] if start.line <= len(lines) else ""


ROOT_KEY: Final = "@"
"""First character of a key of the tree `Main`, from any tree."""
_REFERENCE = re.compile(r"\{(@?[A-Za-z_]\w{0,59})((?:\.[A-Za-z_]\w{0,59}){0,9})\}", re.ASCII)
REFERENCE_IN_TEXT: Final = re.compile(_REFERENCE.pattern, re.ASCII)
"""Reference anywhere in a text."""
VALUE_IN_TEXT: Final = re.compile(rf"{_REFERENCE.pattern}|\{{=[^{{}}]+\}}", re.ASCII)
"""Reference or `{= expression}` anywhere in a text."""
_BRACES = re.compile(r"\{.*\}", re.DOTALL)
_PLAIN: Mapping[object, ValueType] = {
    str: TEXT, int: INT, float: FLOAT, bool: BOOL, ObjectId: OBJECT,
    float | None: replace(FLOAT, optional=True),
}  # fmt: skip
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "form": (*typing.get_args(Form), "unknown"),
    "colour": (*ITEM_COLOURS, "unknown"),
}


def _attribute_types() -> dict[str, ValueType]:
    """Return the types of BeliefObject's plain fields, its plain properties, and `destination`."""
    hints = typing.get_type_hints(BeliefObject)
    names = ["id", *(f.name for f in fields(BeliefObject) if f.name not in ("id", "seen_size"))]  # see `size`
    found = {name: hints[name] for name in names}
    for name, member in vars(BeliefObject).items():
        # The type of a property is that of its getter.
        getter = member.fget if isinstance(member, property) else None
        if getter is not None:
            found[name] = typing.get_type_hints(getter).get("return")
    types: dict[str, ValueType] = {}
    for name, hint in found.items():
        if hint in _PLAIN:
            types[name] = replace(_PLAIN[hint], choices=_CHOICES.get(name, ()))
        elif typing.get_origin(hint) is typing.Literal:
            types[name] = replace(TEXT, choices=typing.get_args(hint))
    return {**types, "place": PLACE, "destination": replace(PLACE, optional=True)}


ATTRIBUTE_TYPES: Mapping[str, ValueType] = _attribute_types()
"""Attributes that are valid after the dot, with their types; choices where all texts are known."""
ATTRIBUTES: tuple[str, ...] = tuple(ATTRIBUTE_TYPES)


@dataclass(frozen=True, slots=True)
class Reference:
    """Reference to a key of the blackboard; with attributes, to those of the object whose id the key
    holds."""

    key: str
    attributes: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str) -> Reference | None:
        """Parse a reference; None for a literal. Raises ValueError for braces that are no reference."""
        match = _REFERENCE.fullmatch(text)
        if match is None:
            if _BRACES.fullmatch(text):
                raise ValueError(f"{show(text)} is not a reference")
            return None
        return cls(match[1], tuple(match[2].split(".")[1:]))

    def __str__(self) -> str:
        return "{" + ".".join((self.key, *self.attributes)) + "}"


@dataclass(frozen=True, slots=True)
class Constant:
    """Literal, converted to the port's type; `text` is its form in the file."""

    value: object
    text: Plain


@dataclass(frozen=True, slots=True)
class PortExpression:
    """Expression as the value of a port, `"{= rounds + 1}"`: evaluated when the node starts."""

    value: Expression
    text: str
    at: int
    """Index of the expression's first character in `text`."""

    @classmethod
    def parse(cls, text: str) -> PortExpression | None:
        """Parse a text that begins with `{=` and ends with `}`; None for any other.

        Raises ExpressionError with the index of the wrong character in `text`.
        """
        if not (text.startswith(_OPENED) and text.endswith("}")):
            return None
        inner = text[len(_OPENED) : -1]
        at = len(text) - 1 - len(inner.lstrip())
        try:
            return cls(Expression.parse(inner.strip()), text, at)
        except expression_syntax.ExpressionError as error:
            raise expression_syntax.ExpressionError(str(error), at + error.offset) from None

    def __str__(self) -> str:
        return self.text


_OPENED = "{="

Binding: TypeAlias = Reference | PortExpression | Constant


def attribute(scene: PlanningScene, owner: object, name: str) -> Plain:
    """Read `owner.name` from the present belief.

    Raises ValueError when there is no such attribute, Failure(world.unknown_object) when no such object.
    """
    if not isinstance(owner, str):
        raise ValueError(f"only an object has attributes, so not {name!r} either")
    if name not in ATTRIBUTES:
        raise ValueError(f"an object has no attribute {name!r}; {suggest_name(name, ATTRIBUTES)}")
    if name == "destination":
        return scene.destination(owner)
    value: Plain = getattr(scene.get(owner), name)
    return value


def resolve(scene: PlanningScene, reference: Reference, value: Plain) -> Plain:
    """Follow the reference's attributes from the value of its key. Raises Failure."""
    for name in reference.attributes:
        try:
            value = attribute(scene, value, name)
        except ValueError as error:
            raise Failure(tree.MISSING_INPUT, f"{reference}: {error}", reference=str(reference)) from None
    return value


@dataclass(frozen=True, slots=True)
class Assignment:
    """Assignment of a postcondition: `key := expression`, or without `new` `key = expression` for an existing
    key."""

    key: str
    value: Expression
    new: bool = True
    at: int = 0
    """Index of the value's first character in the postcondition's text."""
