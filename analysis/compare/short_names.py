"""Short names of nodes: the end of a path that no other node's path ends with."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping


def short_names(paths: Iterable[str]) -> Mapping[str, str]:
    """By path.

    >>> short_names(["Main", "Main/A", "Main/A/Grasp", "Main/Recover/Grasp"])["Main/Recover/Grasp"]
    'Recover/Grasp'
    """
    known = list(dict.fromkeys(paths))
    uses = Counter(end for path in known for end in _ends(path))
    return {path: next((end for end in _ends(path) if uses[end] == 1), path) for path in known}


def _ends(path: str) -> list[str]:
    """The last part, the last two, and so on up to the whole."""
    parts = path.split("/")
    return ["/".join(parts[-k:]) for k in range(1, len(parts) + 1)]
