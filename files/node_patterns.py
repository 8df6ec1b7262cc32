"""Names of nodes in a tree: patterns in files, names as people write them, short names."""

from __future__ import annotations

import fnmatch
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Protocol, TypeVar

from .errors import PicktreeError
from .value_wording import suggest_name


def node_matches(pattern: str, path: str) -> bool:
    """Whether a node's path fits: `Grasp` any node of that name, `SortOne/Grasp` one somewhere below SortOne.

    Each part may use `*` and `?`; the last part is the node itself. `Grasp` fits `Grasp#2` as well. With `/`
    before it a pattern is a whole path: `/Main/Sequence/Grasp` is that node and no other.

    >>> node_matches("SortOne/Grasp", "Main/SortOne/Sequence/Grasp")
    True
    >>> node_matches("/Main/Grasp", "Main/SortOne/Grasp")
    False
    """
    wanted = [part for part in pattern.split("/") if part]
    given = [part for part in path.split("/") if part]
    if not wanted or not given:
        return False
    if pattern.startswith("/"):
        return len(wanted) == len(given) and all(map(_part_fits, wanted, given))
    if not _part_fits(wanted[-1], given[-1]):
        return False
    above = iter(given[:-1])
    return all(any(_part_fits(part, name) for name in above) for part in wanted[:-1])


def _part_fits(pattern: str, name: str) -> bool:
    plain = name if "#" in pattern else name.partition("#")[0]
    # A name may hold brackets, which are a pattern's too: taken literally it fits itself.
    return name == pattern or fnmatch.fnmatchcase(plain, pattern)


def short_names(paths: Iterable[str]) -> Mapping[str, str]:
    """Return for each path its shortest unique end.

    >>> short_names(["Main", "Main/A", "Main/A/Grasp", "Main/Recover/Grasp"])["Main/Recover/Grasp"]
    'Recover/Grasp'
    """
    known = list(dict.fromkeys(paths))
    uses = Counter(end for path in known for end in _ends(path))
    return {path: next((end for end in _ends(path) if uses[end] == 1), path) for path in known}


def _ends(path: str) -> list[str]:
    """Return the last part of the path, the last two, and so on up to the whole."""
    parts = path.split("/")
    return ["/".join(parts[-k:]) for k in range(1, len(parts) + 1)]


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
    """Return the nodes with that path; if none has it, those whose path ends with it, then those of that
    type.

    With `*` in the text, return the nodes whose path, or end of a path, matches the pattern. Raises
    PicktreeError with similar names when no node fits.
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
