"""Names of nodes in a tree: patterns as fault files and cases write them, and short names for people."""

from __future__ import annotations

import fnmatch
from collections import Counter
from collections.abc import Iterable, Mapping


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
