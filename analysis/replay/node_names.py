"""Node names as people write them: a path, the end of one, a type, or a pattern."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Protocol, TypeVar

from ...errors import PicktreeError
from ...files.value_wording import suggest_name


class NamedNode(Protocol):
    @property
    def path(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def id(self) -> str:
        """Registered name, such as `Grasp`."""
        ...


N = TypeVar("N", bound=NamedNode)


def find_nodes(text: str, nodes: Sequence[N]) -> list[N]:
    """Return the nodes of that path, or else with a path that ends so, or else of that type.

    With `*` in the text, return the nodes whose path, or end of a path, matches the pattern. Raises
    PicktreeError with similar names when there are none.
    """
    if "*" in text:
        found = [n for n in nodes if fnmatchcase(n.path, text) or fnmatchcase(n.path, f"*/{text}")]
        if found:
            return found
    for fits in (
        [node for node in nodes if node.path == text],
        [node for node in nodes if node.path.endswith(f"/{text}")],
        [node for node in nodes if node.id == text],
    ):
        if fits:
            return fits
    hint = suggest_name(text, [*(node.name for node in nodes), *(node.path for node in nodes)])
    raise PicktreeError(f"no node fits {text!r}" + (f" ({hint})" if hint.startswith("did") else ""))


def find_node(text: str, nodes: Sequence[N], *, most: int = 10) -> N:
    """Return the only such node. Raises PicktreeError with the names of `most` of them when there are
    several."""
    found = find_nodes(text, nodes)
    if len(found) > 1:
        named = ", ".join(node.path for node in found[:most]) + (", …" if len(found) > most else "")
        raise PicktreeError(f"{len(found)} nodes fit {text!r}: {named}")
    return found[0]
