"""Occurrences of a tree's blackboard keys in a text, for completion, hover and rename.

The text may be unfinished, so keys are found in its values and not in nodes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

from picktree.files import Location, Mark
from picktree.files.yaml import YamlNode
from picktree.trees import MAIN, POSTCONDITIONS, PRECONDITIONS, references

from .cursor import CURSOR, walk

IsExpression: TypeAlias = Callable[[Location], bool]
"""Whether an expression is allowed at a location."""

_REFERENCE = re.compile(r"\{(@?[A-Za-z_]\w*)((?:\.\w*)*)\}?")
_TOKEN = re.compile(
    r"'[^']*'|\"[^\"]*\"|(?P<dot>\.\s*)?(?P<name>@?[A-Za-z_]\w*)(?P<set>\s*(?:[-+*/:]?=)(?!=))?"
)
_WORDS = frozenset({"and", "or", "not", "if", "else", "in", "true", "false", "null"})


@dataclass(frozen=True, slots=True)
class KeyPlace:
    """Occurrence of a key: mark of the value that contains it, and its first character in the value."""

    key: str
    """Name in the text; `@` before a key of Main is a part of it."""
    path: Location
    mark: Mark
    at: int
    """Index in the value; 0 for the name of a port."""
    kind: str
    """Kind: "port", "reference", "name" in an expression, or "assignment"."""


def tree_of(path: Location) -> str | None:
    return path[1] if len(path) > 1 and path[0] == "trees" and isinstance(path[1], str) else None


def places_of(root: YamlNode, key: str, tree: str, is_expression: IsExpression) -> Iterator[KeyPlace]:
    """Yield the occurrences of one key of a tree; of a key of Main also those as `@key`, in all trees."""
    trees = root.entries.get("trees")
    for name in trees.entries if trees is not None else ():
        for place in key_places(root, name, is_expression):
            if (name == tree and place.key == key) or (
                tree == MAIN and place.key == references.ROOT_KEY + key
            ):
                yield place


def key_places(root: YamlNode, tree: str, is_expression: IsExpression) -> Iterator[KeyPlace]:
    """Yield the occurrences of keys in a tree, its ports first."""
    trees = root.entries.get("trees")
    body = trees.entries.get(tree) if trees is not None else None
    if body is None:
        return
    ports = body.entries.get("ports")
    for name, mark in (ports.keys if ports is not None else {}).items():
        if CURSOR not in name:
            yield KeyPlace(name, ("trees", tree, "ports", name), mark, 0, "port")
    for path, node in walk(body, ("trees", tree)):
        text = node.value
        if not isinstance(text, str) or CURSOR in text or path[2:3] == ("ports",):
            continue
        reference = _REFERENCE.fullmatch(text)
        if reference is not None:
            yield KeyPlace(reference[1], path, node.mark, 1, "reference")
        elif text.startswith("{=") or (
            not text.startswith("{") and (path[-1] in PRECONDITIONS or assigns(path) or is_expression(path))
        ):
            for found in _TOKEN.finditer(text):
                if found["name"] and not found["dot"] and found["name"].lower() not in _WORDS:
                    kind = "assignment" if found["set"] and assigns(path) else "name"
                    yield KeyPlace(found["name"], path, node.mark, found.start("name"), kind)


def assigns(path: Location) -> bool:
    """Whether a location of a mission has assignments."""
    return path[-1] in POSTCONDITIONS or path[-2:] == ("Script", "code")
