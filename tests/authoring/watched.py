"""A wild mission, what the analysis says of it, and a run that is held against that node by node."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING, cast

from picktree.authoring.lint.keys import KeyBits
from picktree.authoring.lint.mission_survey import FlowAnalysis
from picktree.authoring.lint.outcomes import HAND_EMPTY, HELD_OUTSIDE, UNREPORTED, FlowState
from picktree.recovery import Recover
from picktree.recovery.recover import RecoveryControl
from picktree.trees import (
    BehaviourTree,
    Mission,
    Node,
    NodeSpec,
    NodeStatus,
    PipelineSequence,
    ReactiveFallback,
    RetryUntilSuccessful,
    build,
)
from picktree.trees.control_nodes import AsyncFallback, Fallback, RoundRobin, SequenceWithMemory
from picktree.trees.decorators import RunOnce
from picktree.trees.loading import parse_mission
from picktree.trees.references import Reference
from picktree.trees.runner import SubTree
from picktree.world import JournalEvent

from ..trees.scripted import FILE, TICK
from .wild_leaves import WildWorld, registry

if TYPE_CHECKING:
    from picktree.robot import World


TRIES = (Fallback, AsyncFallback, ReactiveFallback, RoundRobin, RetryUntilSuccessful, RecoveryControl)
"""Nodes that try something against a failure below them."""


class _Unsound(Exception):
    """Something happened that the analysis had ruled out."""


@dataclass(frozen=True, slots=True)
class WatchedRun:
    """Result of one run. `unsound`: what happened that the analysis had ruled out; empty: nothing."""

    status: NodeStatus
    unsound: str = ""


class Watched:
    """A mission with what the analysis says of it."""

    def __init__(self, text: str) -> None:
        self.mission: Mission = parse_mission(text, FILE, registry())
        self.walk = FlowAnalysis(self.mission)
        self.walk.enter(self.mission.main)
        self.ends = self.walk.ends["Main"]

    def run(self, seed: int, ticks: int = 30) -> WatchedRun:
        """Run it, all chances drawn from the seed, to its end or to the first tick that is unsound."""
        world = WildWorld(chance=random.Random(seed))
        tree = build(self.mission, cast("World", world))
        watch = _Watch(self, tree, world)
        tree.on_end.append(watch.ended)
        try:
            for _ in range(ticks):
                tree.tick()
                watch.after_tick()
                world.clock.now += TICK
                if tree.status is not NodeStatus.RUNNING:
                    watch.finished()
                    break
        except _Unsound as error:
            return WatchedRun(tree.status, str(error))
        return WatchedRun(tree.status)


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a node of the running tree stands in the text: its spec, and the instance of its tree."""

    spec: NodeSpec
    instance: SubTree
    tree: str


class _Watch:
    def __init__(self, watched: Watched, tree: BehaviourTree, world: WildWorld) -> None:
        self._watched, self._walk, self._tree, self._world = watched, watched.walk, tree, world
        self._places: dict[str, _Place] = {}
        self._callers: dict[str, _Place] = {}
        self._wrong: list[_Unsound] = []
        main = cast("SubTree", tree.root)
        self._locate(main.body, _Place(watched.mission.main.root, main, "Main"))

    def _locate(self, node: Node, place: _Place) -> None:
        self._places[node.path] = place
        if isinstance(node, SubTree):
            self._callers[node.path] = place
            root = self._watched.mission.trees[place.spec.id].root
            self._locate(node.body, _Place(root, node, place.spec.id))
            return
        for below, spec in zip(node.below, place.spec.children, strict=True):
            self._locate(below, _Place(spec, place.instance, place.tree))

    def after_tick(self) -> None:
        """No node that is never reached, no handler that is never used."""
        if self._wrong:
            raise self._wrong[0]
        for entry in self._world.journal.take():
            if isinstance(entry, JournalEvent) and entry.kind == "recovery":
                spec = self._places[entry.node].spec
                handler = str(entry.data["handler"])
                if spec.node is Recover and (id(spec), handler) not in self._walk.handled:
                    raise _Unsound(f"{entry.node} uses its handler {handler!r}")
        for node in self._tree.nodes:
            place = self._places.get(node.path)
            if place is not None and node.ticked and id(place.spec) not in self._walk.reached:
                raise _Unsound(f"{node.path} is ticked: {self._walk.blocked.get(id(place.spec))}")
            if place is not None and node.state is NodeStatus.RUNNING:
                self._check(place, node)

    def finished(self) -> None:
        """A cause that ended the mission, with nothing on its way that tries twice, was announced."""
        report = self._tree.failure
        node = self._tree.find(report.node) if report is not None else None
        if report is None or node is None or report.cause.name == "tree.missing_input":
            return
        above = node
        while isinstance(above, Node):
            if isinstance(above, TRIES):
                return
            above = above.parent
        spec, cause = self._places[node.path].spec, self._walk.causes.matching(report.cause.name)
        for reasons in self._watched.ends.failure.values():
            for source in reasons.sources(str(FILE)):
                if source.node is spec and source.causes & cause and not source.met:
                    return
        raise _Unsound(f"{report.cause} from {report.node} ends the mission, and was not announced")

    def ended(self, path: str) -> None:
        """Called in the midst of a tick, where no exception comes through."""
        try:
            self._ended(path)
        except _Unsound as error:
            self._wrong.append(error)

    def _ended(self, path: str) -> None:
        place, node = self._places.get(path), self._tree.find(path)
        if place is None or node.state is NodeStatus.IDLE:
            return
        if node.failure is not None and node.failure.cause.name == "internal.error":
            raise _Unsound(f"{path}: {node.failure.message}: {node.failure.evidence.get('traceback')}")
        if node.state is NodeStatus.SUCCESS:
            self._no_read_fails_surely(place, path)
        cause = self._check(place, node)
        if cause == "tree.missing_input" and node.failure is not None and node.failure.node == path:
            self._announced(place, node.failure.message, path)

    def _check(self, place: _Place, node: Node) -> str:
        """Hold the node's status, the keys and the hand against what the analysis allows; its cause."""
        bits, hand = self._bits(place.instance, place.tree), self._hand(place.tree)
        status, cause = node.state, self._cause(node)
        if not any(self._allows(end, place.tree, bits, hand) for end in self._ends(place, status, cause)):
            known = sorted(map(str, self._ends(place, status, cause)))
            message = f"{node.path} is {status} {cause} with {bits:b}, hand {hand}; it was to be {known}"
            raise _Unsound(message)
        return cause

    def _ends(self, place: _Place, status: NodeStatus, cause: str) -> Iterator[FlowState]:
        """The states in which the node may end so, as far as the analysis has come by."""
        wanted = UNREPORTED if not cause else self._walk.causes.matching(cause)
        for frame in self._walk.frames_of(place.tree):
            for (spec, _), flow in frame.memo.items():
                if spec != id(place.spec):
                    continue
                match status:
                    case NodeStatus.SUCCESS:
                        yield from flow.success
                    case NodeStatus.SKIPPED:
                        yield from flow.skipped
                    case NodeStatus.RUNNING:
                        yield from flow.running
                    case _:
                        yield from (s for s, reasons in flow.failure.items() if reasons.any & wanted)

    def _allows(self, end: FlowState, tree: str, bits: int, hand: int) -> bool:
        unseen = self._unseen(tree)
        sure, written = end.sure & ~unseen, bits & ~unseen
        return sure & ~bits == 0 and written & ~end.maybe == 0 and hand & end.hand != 0

    def _unseen(self, tree: str) -> int:
        """Bits of which nothing can be said: keys that other trees write, too, and flags that cannot be read
        off the nodes, as whether a RoundRobin has had a success."""
        layout, bits = self._walk.layout_of(tree), self._rooted(tree)
        for spec in self._watched.mission.trees[tree].root.iterate():
            if spec.node is None:
                shift, _ = layout.calls[id(spec)]
                bits |= self._unseen(spec.id) << shift
            elif spec.node in (RoundRobin, SequenceWithMemory, PipelineSequence):
                bits |= sum(layout.flags[id(spec)])
        return bits

    def _rooted(self, tree: str) -> int:
        wired = (frame.rooted for frame in self._walk.frames_of(tree))
        return reduce(int.__or__, wired, self._walk.layout_of(tree).rooted)

    def _may_be_rooted(self, tree: str, name: str) -> bool:
        """Whether other trees may write the key, or another one that the caller's wires make the same."""
        layout = self._walk.layout_of(tree)
        bit = layout.keys.get(name, 0)
        frames = self._walk.frames_of(tree)
        return any(frame.same.get(bit, bit) & frame.rooted for frame in frames) or bit & layout.rooted != 0

    def _doubted(self, place: _Place, name: str) -> bool:
        """Whether the node is reached with the key unwritten in a way of which nothing is reported."""
        return any(
            spec == id(place.spec) and state.doubtful and not state.sure & frame.layout.keys[name]
            for frame in self._walk.frames_of(place.tree)
            for spec, state in frame.memo
        )

    def _cause(self, node: Node) -> str:
        return node.failure.cause.name if node.state is NodeStatus.FAILURE and node.failure else ""

    def _hand(self, tree: str) -> int:
        if not self._world.holds:
            return HAND_EMPTY
        filler = self._walk.filler(self._places[self._world.holds].spec)
        return filler if tree == "Main" else filler | HELD_OUTSIDE

    def _bits(self, instance: SubTree, tree: str) -> int:
        """Which keys are written now, as the analysis numbers them."""
        layout = self._walk.layout_of(tree)
        bits = sum(bit for key, bit in layout.keys.items() if instance.inside.has(key))
        return bits | self._below(instance, instance.body, self._watched.mission.trees[tree].root, layout)

    def _below(self, instance: SubTree, node: Node, spec: NodeSpec, layout: KeyBits) -> int:
        bits = 0
        if isinstance(node, SubTree):
            shift, inner = layout.calls[id(spec)]
            inside = self._bits(node, spec.id)
            for port_ in inner.tree.ports:
                bound = spec.ports.get(port_.key)
                if bound is not None or port_.direction == "in":
                    inside &= ~inner.keys[port_.key]  # wired, or written anew at each start
            return inside << shift
        if isinstance(node, RunOnce):
            ended, failed = layout.flags[id(spec)]
            answer = getattr(node, "_first_answer")  # noqa: B009
            bits |= (ended if answer else 0) | (failed if answer == NodeStatus.FAILURE else 0)
        for below, child in zip(node.below, spec.children, strict=True):
            bits |= self._below(instance, below, child, layout)
        return bits

    def _no_read_fails_surely(self, place: _Place, path: str) -> None:
        """A node that read an input has found it: nobody may have said that nothing ever writes it."""
        for read in self._walk.reads.values():
            started = not {"_successIf", "_skipIf"} & place.spec.preconditions.keys()
            direct = place.spec.node is not None and isinstance(place.spec.ports.get(read.place), Reference)
            if read.spec is place.spec and direct and started and read.missing and not read.ever:
                raise _Unsound(f"{path} has read {read.key!r}, which was said to be never written")

    def _announced(self, place: _Place, message: str, path: str) -> None:
        """A key that nothing has written: the analysis must have said so, here or where it is wired."""
        key = _unwritten(message)
        if not key:
            return
        name = key
        while True:
            if self._may_be_rooted(place.tree, name):
                return
            for read in self._walk.reads.values():
                if read.spec is place.spec and read.key == name and read.missing:
                    return
            if self._doubted(place, name):
                return
            caller = self._callers.get(place.instance.path)
            bound = caller.spec.ports.get(name) if caller is not None else None
            if caller is None or not isinstance(bound, Reference):
                break
            place, name = caller, bound.key
        raise _Unsound(f"{path}: {message}: nobody has said that {key!r} may be unwritten")


def _unwritten(message: str) -> str:
    for before, after in (
        ("nothing has written {", "}"),
        ("unknown name '", "'"),
        ("nothing has written '", "'"),
    ):
        if before in message:
            return message.split(before, 1)[1].split(after, 1)[0].split(".")[0]
    return ""
