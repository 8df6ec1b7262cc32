"""What a node says of its keys together (`check_ports`), asked of it: for editors and the reference."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from itertools import chain, combinations

from ...trees.node import Node
from ...trees.values.port_values import Given

_MOST = 10
"""Optional keys of a node of which all combinations are tried."""


@dataclass(frozen=True, slots=True)
class OneNeeded:
    """Without any of the keys the node is wrong, whatever else is given; `sentence` says so."""

    keys: tuple[str, ...]
    sentence: str


def one_needed_of(node: type[Node]) -> OneNeeded | None:
    """The keys of which the node needs one, asked of its own rule; None when it needs none so."""
    declaration = node.declaration
    every = (*declaration.ports, *declaration.slots)
    required = [part.key for part in every if part.required]
    optional = [part.key for part in every if not part.required]
    sentence = _complaint(node, required)
    if not sentence or len(optional) > _MOST:
        return None
    cures = tuple(key for key in optional if not _complaint(node, (*required, key)))
    others = [key for key in optional if key not in cures]
    if cures and all(_complaint(node, (*required, *some)) for some in _subsets(others)):
        return OneNeeded(cures, sentence)
    return None


def _complaint(node: type[Node], keys: Collection[str]) -> str:
    """What is wrong when just these keys are given, whatever their values; empty when nothing is."""
    found = node.check_ports(Given(frozenset(keys)))
    return next((wrong for wrong in found if isinstance(wrong, str)), "")


def _subsets(keys: list[str]) -> Iterable[tuple[str, ...]]:
    return chain.from_iterable(combinations(keys, size) for size in range(len(keys) + 1))
