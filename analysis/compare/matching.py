"""Matching of two runs: pairs of nodes of two missions, and pairs of items.

Nodes with the same path are a pair. The others (a node inside a renamed one, or wrapped into another, as in a
new `Recover`) are paired below the nearest pair above them. There, nodes of the same type and name form pairs
in their order.

Ids of items are the robot's own: `red_block_3` is the third red block that it found. Two runs may number the
same block differently. With one seed, items start at the same places, so the place decides. The rest, and all
items when the seeds differ, are paired by the order of discovery within one kind and colour. With different
seeds, a pair therefore only means the same kind and colour.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import Final, Literal, TypeAlias, cast

from picktree.analysis import Run
from picktree.logs import log_records, node_visits

MAX_SAME_PLACE_DISTANCE = 0.02
"""Maximum distance of the same place, m: half an item, above the error of perception, below the gap of two
items."""
Basis: TypeAlias = Literal["place", "order"]


@dataclass(frozen=True, slots=True)
class ItemPair:
    a: str
    b: str
    basis: Basis
    """Reason for the pair. `place`: the items were at the same place. `order`: kind, colour and number in the
    order of discovery agree."""


@dataclass(frozen=True, slots=True)
class ItemMatch:
    """Pairs of the objects of two runs, by their ids."""

    pairs: tuple[ItemPair, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]

    @property
    def a_by_b(self) -> Mapping[str, str]:
        """Ids in run A of the objects of B."""
        return {pair.b: pair.a for pair in self.pairs}


def match_items(a: Run, b: Run, *, since: float = 0.0) -> ItemMatch:
    """Pair the objects of two runs. Objects that are known at `since` (simulated s) count with their place
    then."""
    in_a, in_b = first_bodies(a, since), first_bodies(b, since)
    pairs: list[ItemPair] = []
    if a.info.seed == b.info.seed:
        near = sorted(
            (math.dist(one.pose.position, other.pose.position), one.id != other.id, n, m)
            for n, one in enumerate(in_a)
            for m, other in enumerate(in_b)
            if (one.kind, one.colour) == (other.kind, other.colour)
        )
        taken_a: set[int] = set()
        taken_b: set[int] = set()
        for distance, _, n, m in near:
            if distance <= MAX_SAME_PLACE_DISTANCE and n not in taken_a and m not in taken_b:
                taken_a.add(n)
                taken_b.add(m)
                pairs.append(ItemPair(in_a[n].id, in_b[m].id, "place"))
    left_a = _unpaired_ids(in_a, (pair.a for pair in pairs))
    left_b = _unpaired_ids(in_b, (pair.b for pair in pairs))
    for sort, ones in left_a.items():
        for one, other in zip(ones, left_b.get(sort, ()), strict=False):
            pairs.append(ItemPair(one, other, "order"))
    paired_a, paired_b = {pair.a for pair in pairs}, {pair.b for pair in pairs}
    order = {sighting.id: n for n, sighting in enumerate(in_a)}
    return ItemMatch(
        tuple(sorted(pairs, key=lambda pair: order[pair.a])),
        tuple(s.id for s in in_a if s.id not in paired_a),
        tuple(s.id for s in in_b if s.id not in paired_b),
    )


def first_bodies(run: Run, since: float = 0.0) -> tuple[log_records.BodyRecord, ...]:
    """Return every object as the robot first believed in it from `since` (simulated s) on, in the order of
    discovery."""
    found: dict[str, log_records.BodyRecord] = {}
    known = run.log.belief_at(since)
    for at in run.log.beliefs(known.time if known else since):
        for body in at.record.bodies:
            found.setdefault(body.id, body)
    return tuple(found.values())


def _unpaired_ids(
    known: Iterable[log_records.BodyRecord], paired: Iterable[str]
) -> dict[tuple[str, str], list[str]]:
    """Return the ids without a partner, by kind and colour."""
    done = set(paired)
    left: dict[tuple[str, str], list[str]] = {}
    for sighting in known:
        if sighting.id not in done:
            left.setdefault((sighting.kind, sighting.colour), []).append(sighting.id)
    return left


@dataclass(frozen=True, slots=True)
class PortChange:
    """Port with different values in the two missions; empty where the mission does not set it."""

    path: str
    """Path of the node in A."""
    port: str
    a: str
    b: str


@dataclass(frozen=True, slots=True)
class NodePair:
    a: log_records.TreeNode
    b: log_records.TreeNode


@dataclass(frozen=True, slots=True)
class NodeMatch:
    """Pairs of the nodes of two runs. When the mission was edited during a run, all its trees count."""

    pairs: tuple[NodePair, ...]
    only_a: tuple[log_records.TreeNode, ...]
    only_b: tuple[log_records.TreeNode, ...]

    @property
    def a_by_b(self) -> Mapping[str, str]:
        """Paths in A of the nodes of B."""
        return {pair.b.path: pair.a.path for pair in self.pairs}

    @property
    def moved(self) -> tuple[NodePair, ...]:
        """Pairs with different paths."""
        return tuple(pair for pair in self.pairs if pair.a.path != pair.b.path)

    @property
    def retyped(self) -> tuple[NodePair, ...]:
        """Pairs of the same path, but of another type."""
        return tuple(pair for pair in self.pairs if pair.a.id != pair.b.id)

    @property
    def rewired(self) -> tuple[PortChange, ...]:
        return tuple(
            PortChange(pair.a.path, port, pair.a.ports.get(port, ""), pair.b.ports.get(port, ""))
            for pair in self.pairs
            for port in dict.fromkeys((*pair.a.ports, *pair.b.ports))
            if pair.a.ports.get(port, "") != pair.b.ports.get(port, "")
        )


def match_nodes(a: Run, b: Run) -> NodeMatch:
    return match_trees(a.nodes, b.nodes)


def match_trees(a: Iterable[log_records.TreeNode], b: Iterable[log_records.TreeNode]) -> NodeMatch:
    in_a, in_b = {node.path: node for node in a}, {node.path: node for node in b}
    b_of = {path: path for path in in_a if path in in_b}
    same_in_b = {path: path for path in b_of}
    left_a, left_b = _unpaired_below(in_a, b_of), _unpaired_below(in_b, same_in_b)
    for top, ones in left_a.items():
        others = left_b.get(top, [])
        matcher = SequenceMatcher(None, [_kind(n) for n in ones], [_kind(n) for n in others], autojunk=False)
        for block in matcher.get_matching_blocks():
            for k in range(block.size):
                b_of[ones[block.a + k].path] = others[block.b + k].path
    taken = set(b_of.values())
    return NodeMatch(
        tuple(NodePair(node, in_b[b_of[path]]) for path, node in in_a.items() if path in b_of),
        tuple(node for path, node in in_a.items() if path not in b_of),
        tuple(node for path, node in in_b.items() if path not in taken),
    )


def _unpaired_below(
    nodes: Mapping[str, log_records.TreeNode], paired: Mapping[str, str]
) -> dict[str, list[log_records.TreeNode]]:
    """Return the unpaired nodes in the order of the tree, by the nearest paired node above them."""
    below: dict[str, list[log_records.TreeNode]] = {}
    for node in nodes.values():
        if node.path in paired:
            continue
        above = node.parent
        while above and above not in paired and above in nodes:
            above = nodes[above].parent
        below.setdefault(above, []).append(node)
    return below


def _kind(node: log_records.TreeNode) -> tuple[str, str]:
    """Return type and name without the number that distinguishes siblings; nodes with equal results are
    alike."""
    return node.id, node.name.split("#")[0]


TIME_TOLERANCE: Final = 1e-6
"""Difference below which two times are equal, s."""
Aspect: TypeAlias = Literal["type", "inputs", "outcome", "cause", "length"]


@dataclass(frozen=True, slots=True)
class VisitPair:
    """Same visit in both runs, each with the item, path and times of its own run."""

    a: node_visits.Visit
    b: node_visits.Visit
    differs: tuple[Aspect, ...]
    """Aspects that differ, apart from the start time."""


def differences(
    a: node_visits.Visit, b: node_visits.Visit, items: Mapping[str, str], *, resumed: bool
) -> tuple[Aspect, ...]:
    """Return the aspects in which two visits differ.

    `items`: ids in A of the objects of B. `resumed`: one of the visits had begun before the comparison, so
    its inputs are unknown. A visit that is cut off by the end of its log differs only when the other one had
    ended by that time.
    """
    found: list[Aspect] = []
    if a.id != b.id:
        found.append("type")
    if not resumed and a.inputs != {port: renamed(value, items) for port, value in b.inputs.items()}:
        found.append("inputs")
    if "RUNNING" in (a.outcome, b.outcome):
        open_, other = (a, b) if a.outcome == "RUNNING" else (b, a)
        if other.outcome != "RUNNING" and other.end - other.start < open_.end - open_.start - TIME_TOLERANCE:
            found.append("length")
        return tuple(found)
    if a.outcome != b.outcome:
        found.append("outcome")
    if (a.cause, a.origin == a.path) != (b.cause, b.origin == b.path):
        found.append("cause")
    if abs(a.duration - b.duration) > TIME_TOLERANCE:
        found.append("length")
    return tuple(found)


def renamed(value: object, names: Mapping[str, str]) -> object:
    """Return the value with each text that is a name in `names` replaced, also in lists and mappings.

    >>> renamed(["red_ball_1", {"object": "red_ball_2"}], {"red_ball_1": "red_ball_2", "red_ball_2": "x"})
    ['red_ball_2', {'object': 'x'}]
    """
    if isinstance(value, str):
        return names.get(value, value)
    if isinstance(value, list):
        return [renamed(one, names) for one in cast("list[object]", value)]
    if isinstance(value, dict):
        return {key: renamed(one, names) for key, one in cast("dict[str, object]", value).items()}
    return value
