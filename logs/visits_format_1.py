"""Visits of a log of format 1, which does not tell when nodes began and ended: from their statuses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from .run_log import At, RunLog
from .schema.records import NodeStatus, Tick, Transition, Tree
from .visits import Following, Visit

ENDED = frozenset({"SUCCESS", "FAILURE", "SKIPPED"})


def derived_visits(log: RunLog) -> tuple[Visit, ...]:
    """As `visits_of`. A node that ended and began anew within one tick counts as one visit, and what a node
    read when it began is not known."""
    trees = list(log.trees())
    following = Following(trees[0].record if trees else Tree(()))
    coming = trees[1:]
    for at in with_transitions(log.ticks()):
        while coming and coming[0].time <= at.time:
            following.follow(coming.pop(0).record)
        following.take(at.time, at.record)
    return following.finish()


def with_transitions(ticks: Iterator[At[Tick]]) -> Iterator[At[Tick]]:
    """The ticks with the transitions that their statuses speak of."""
    running: set[str] = set()
    for at in ticks:
        begun = [
            Transition(node.path, "RUNNING")
            for node in at.record.nodes
            if node.ticked and node.status != "IDLE" and node.path not in running
        ]
        running |= {transition.path for transition in begun}
        ended = [
            _end(node, at.record.nodes)
            for node in reversed(at.record.nodes)
            if node.path in running and (node.status in ENDED if node.ticked else node.status != "RUNNING")
        ]
        running -= {transition.path for transition in ended}
        yield At(at.time, replace(at.record, transitions=(*begun, *ended)))


def _end(node: NodeStatus, nodes: Sequence[NodeStatus]) -> Transition:
    if not node.ticked or node.status != "FAILURE":
        return Transition(node.path, node.status if node.ticked else "IDLE", message=node.message)
    source = _origin(node, nodes) if node.cause else node
    return Transition(
        node.path,
        "FAILURE",
        cause=node.cause,
        origin=source.path if node.cause else "",
        message=source.message,
        evidence=source.evidence,
    )


def _origin(node: NodeStatus, nodes: Sequence[NodeStatus]) -> NodeStatus:
    """The lowest node below it that stands in the same failure, or itself."""
    same = [
        below
        for below in nodes
        if below.status == "FAILURE"
        and below.path.startswith(node.path + "/")
        and below.cause == node.cause
        and node.message in ("", below.message)
    ]
    return max(same, key=lambda below: below.path.count("/"), default=node)
