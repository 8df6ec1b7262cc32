"""Border to logs of format 2: their ticks as those of format 3.

Format 2 has the state of all nodes in each tick, and starts and ends alone as transitions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from picktree.world import NodeState, Tick, Transition


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
