"""States of nodes, rebuilt from snapshots and the transitions of ticks."""

from __future__ import annotations

from collections.abc import Iterable

from picktree.world import NodeState, Transition, TreeNode


class NodeStates:
    """States of all nodes of a tree, tick by tick; before the first snapshot all are idle."""

    def __init__(self, nodes: Iterable[TreeNode] = ()) -> None:
        """`nodes`: nodes of all trees of the run, for a log without snapshots."""
        self._ids = {node.path: node.id for node in nodes}
        self._states = {path: NodeState(path, id, "IDLE", ticked=False) for path, id in self._ids.items()}
        self._whole = tuple(self._states.values())

    def take(self, nodes: Iterable[NodeState]) -> None:
        """Take over a snapshot. A state that is equal to the former keeps its object."""
        known = self._states
        self._states = {
            node.path: known[node.path] if known.get(node.path) == node else node for node in nodes
        }
        self._whole = tuple(self._states.values())

    def after(self, transitions: Iterable[Transition]) -> tuple[NodeState, ...]:
        """Return the states after a tick with these transitions; the same tuple when there are none."""
        changed = False
        for each in transitions:
            known = self._states.get(each.path)
            id = known.id if known is not None else self._ids.get(each.path, each.path.rsplit("/", 1)[-1])
            self._states[each.path] = each.state(id)
            changed = True
        if changed:
            self._whole = tuple(self._states.values())
        return self._whole
