"""Table of the ticks of a run: statuses of all nodes, as the panels of a report need them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import compress
from operator import is_not
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from picktree.analysis import Run
from picktree.world import BlackboardWrite, NodeState, Tree, TreeNode


@dataclass(frozen=True, slots=True)
class RunNode:
    """Node of any of the run's trees."""

    path: str
    id: str
    name: str
    parent: int
    """Number of the parent; -1 for a root."""
    leaf: bool


def nodes_of(trees: Iterable[Tree]) -> tuple[RunNode, ...]:
    """Return all nodes, parents before their children, siblings in the order of their trees.

    A node's number is its place in the result. Nodes that an edit has added come after their older siblings.
    """
    known: dict[str, TreeNode] = {}
    children: dict[str, dict[str, None]] = {}
    for tree in trees:
        for node in tree.nodes:
            known[node.path] = node
            children.setdefault(node.parent, {})[node.path] = None
    numbers: dict[str, int] = {}
    found: list[RunNode] = []
    for path in _below("", children):
        node = known[path]
        numbers[path] = len(found)
        parent = numbers.get(node.parent, -1)
        found.append(RunNode(path, node.id, node.name, parent, path not in children))
    return tuple(found)


def _below(path: str, children: dict[str, dict[str, None]]) -> Iterator[str]:
    waiting = list(reversed(children.get(path, {})))
    while waiting:
        path = waiting.pop()
        yield path
        waiting += reversed(children.get(path, {}))


STATUSES: Final = ("IDLE", "RUNNING", "SUCCESS", "FAILURE", "SKIPPED")
"""Statuses by code."""


ABSENT: Final = 255
"""Code of a node that is not in the tree of that tick."""


TICKED: Final = 8
"""Addend of the code where the tick reached the node."""


_CODES: Final = {status: code for code, status in enumerate(STATUSES)}


@dataclass(frozen=True, slots=True)
class TickWrite:
    """Write to the blackboard, with the number of its tick."""

    tick: int
    write: BlackboardWrite


@dataclass(frozen=True, slots=True, eq=False)
class TickTable:
    nodes: tuple[RunNode, ...]
    times: NDArray[np.float64]
    """Times of the ticks, (ticks,), simulated s."""
    codes: NDArray[np.uint8]
    """Status codes, (nodes, ticks), with `TICKED` added; or `ABSENT`."""
    writes: tuple[TickWrite, ...]

    @property
    def statuses(self) -> NDArray[np.uint8]:
        """Status codes without `TICKED`, (nodes, ticks)."""
        return np.where(self.codes == ABSENT, ABSENT, self.codes % TICKED).astype(np.uint8)


_TABLES: WeakKeyDictionary[Run, TickTable] = WeakKeyDictionary()


def tick_table(run: Run) -> TickTable:
    """Return the table, read once for each run. Raises PicktreeError where the log is damaged."""
    table = _TABLES.get(run)
    if table is None:
        table = _TABLES[run] = _read(run)
    return table


def _read(run: Run) -> TickTable:
    nodes = nodes_of(at.record for at in run.trees)
    numbers = {node.path: number for number, node in enumerate(nodes)}
    times: list[float] = []
    writes: list[TickWrite] = []
    columns: list[NDArray[np.uint8]] = []
    column = np.full(len(nodes), ABSENT, dtype=np.uint8)
    before: tuple[NodeState, ...] = ()
    for number, at in enumerate(run.log.ticks()):
        now = at.record.nodes
        changed: Iterable[NodeState] = now
        if len(now) == len(before):  # the decoder keeps the records of nodes that report the same
            changed, column = compress(now, map(is_not, now, before)), column.copy()
        else:
            column = np.full(len(nodes), ABSENT, dtype=np.uint8)
        for node in changed:
            row = numbers.get(node.path)
            if row is not None:
                column[row] = _CODES.get(node.status, 0) + (TICKED if node.ticked else 0)
        before = now
        times.append(at.time)
        columns.append(column)
        writes += [TickWrite(number, write) for write in at.record.writes]
    codes = np.array(columns, dtype=np.uint8).reshape(len(times), len(nodes)).T
    return TickTable(nodes, np.array(times), np.ascontiguousarray(codes), tuple(writes))
