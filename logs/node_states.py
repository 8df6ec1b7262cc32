"""States of nodes from their transitions, and the transitions that format 2 lacks from the states of nodes.

Format 2 has the state of all nodes in each tick, and starts and ends alone as transitions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from picktree.world import NodeState, Tick, Transition, TreeNode


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
        """Return the states after a tick with these transitions; the same tuple without transitions."""
        changed = False
        for each in transitions:
            known = self._states.get(each.path)
            id = known.id if known is not None else self._ids.get(each.path, each.path.rsplit("/", 1)[-1])
            self._states[each.path] = each.state(id)
            changed = True
        if changed:
            self._whole = tuple(self._states.values())
        return self._whole


def with_updates(ticks: Iterable[tuple[float, Tick]]) -> Iterator[tuple[float, Tick]]:
    """Yield ticks of format 2 with all transitions; `ticks` are pairs of time (simulated s) and tick.

    Updates are derived from the states of the nodes. Their order within a tick is not recorded: they follow
    its starts and ends.
    """
    known: dict[str, NodeState] = {}
    nodes: tuple[NodeState, ...] = ()
    for time, tick in ticks:
        for edge in tick.transitions:
            if edge.path in known:
                known[edge.path] = edge.state(known[edge.path].id)
        updates = [_update(node) for node in tick.nodes if node != known.get(node.path, _idle(node))]
        if updates or tick.transitions or not known:
            known = {node.path: node for node in tick.nodes}
            nodes = tick.nodes
        yield time, replace(tick, nodes=nodes, transitions=(*tick.transitions, *updates))


def _idle(node: NodeState) -> NodeState:
    return NodeState(node.path, node.id, "IDLE", ticked=False)


def _update(node: NodeState) -> Transition:
    return Transition(
        node.path,
        node.status,
        cause=node.cause,
        message=node.message,
        evidence=node.evidence,
        ticked=node.ticked,
        update=True,
    )
