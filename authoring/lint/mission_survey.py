"""Survey that all rules read: the mission, the places of its nodes, and its possible flow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from ...files.marks import Diagnostic, Mark
from ...trees.loading.scene_names import SceneNames
from ...trees.mission import MAIN, Mission, NodeSpec, TreeSpec, bottom_up, reachable
from ...trees.ports import PortDeclaration
from ...trees.values.references import Reference
from .failure_reasons import joined
from .flow_analysis import FlowAnalysis
from .keys import expressions_of
from .outcomes import EMPTY, KEPT, Outcomes


@dataclass(frozen=True, slots=True)
class KeyAccess:
    """One place of the text that reads or writes a key: under the key `at` of a node."""

    spec: NodeSpec
    at: str


class KeyUsage:
    """The keys of one tree. A wire to a port of a sub-tree reads or writes as the port's direction says."""

    def __init__(self, tree: TreeSpec, trees: Mapping[str, TreeSpec]) -> None:
        self.reads: dict[str, list[KeyAccess]] = {}
        self.writes: dict[str, list[KeyAccess]] = {}
        for spec in tree.root.iterate():
            outputs = {port.key for port in ports_of(spec, trees) if port.direction == "out"}
            for key, bound in spec.ports.items():
                if isinstance(bound, Reference):
                    touched = self.writes if key in outputs else self.reads
                    touched.setdefault(bound.key, []).append(KeyAccess(spec, key))
            for at, expression in expressions_of(spec):
                for name in sorted(expression.names):
                    self.reads.setdefault(name, []).append(KeyAccess(spec, at))
            for at, assignments in spec.postconditions.items():
                for assignment in assignments:
                    self.writes.setdefault(assignment.key, []).append(KeyAccess(spec, at))


def ports_of(spec: NodeSpec, trees: Mapping[str, TreeSpec]) -> tuple[PortDeclaration, ...]:
    """Return the ports of the node, or of the sub-tree that it stands for."""
    return trees[spec.id].ports if spec.node is None else spec.node.declaration.ports


@dataclass(frozen=True, slots=True)
class NodeLocation:
    """Where a node stands in the text: its tree, its path in it, and the nodes above it."""

    spec: NodeSpec
    path: str
    tree: TreeSpec
    above: tuple[NodeSpec, ...]


@dataclass(frozen=True, slots=True)
class OutcomeSummary:
    """Ends of a node over all states that it was reached in. `certain`: only those ways that
    some node declares."""

    succeeds: bool
    fails: bool
    skipped: bool
    runs: bool
    certain_failure: bool
    causes: int


class LintModel:
    """One mission, walked through once; a rule asks it and yields faults."""

    def __init__(self, mission: Mission, known: SceneNames | None) -> None:
        self.mission = mission
        self.known = known
        self.file = mission.document.root.mark.file
        self.walk = FlowAnalysis(mission)
        if MAIN in mission.trees and not mission.library:
            self.walk.enter(mission.main)
        # The remaining trees are judged by themselves, callers first: from those the others are entered.
        for name in reversed(bottom_up(mission.trees)):
            if name not in self.walk.entered and self.own(mission.trees[name].mark):
                self.walk.enter(mission.trees[name], EMPTY | KEPT)
        self._places = {id(place.spec): place for tree in mission.trees.values() for place in _placed(tree)}
        self.usage = {name: KeyUsage(tree, mission.trees) for name, tree in mission.trees.items()}

    def own(self, mark: Mark) -> bool:
        """Whether it stands in the mission's own file; others are judged when they are checked."""
        return mark.file == self.file

    @cached_property
    def used(self) -> frozenset[str]:
        """The trees that `Main` comes to; of a library all."""
        return frozenset(self.mission.trees) if self.mission.library else reachable(self.mission.trees)

    def trees(self) -> Iterator[TreeSpec]:
        """Those of the mission's own file, in its order."""
        return (tree for tree in self.mission.trees.values() if self.own(tree.mark))

    def places(self) -> Iterator[NodeLocation]:
        """The nodes of the mission's own file, parents first."""
        for tree in self.trees():
            for spec in tree.root.iterate():
                yield self._places[id(spec)]

    def place(self, spec: NodeSpec) -> NodeLocation:
        return self._places[id(spec)]

    def fault(
        self, spec: NodeSpec, message: str, hint: str = "", *, code: str, at: str = "", error: bool = False
    ) -> Diagnostic:
        """A finding at a node, or at the value under its key `at`."""
        mark = spec.places.get(at, spec.mark) if at else spec.mark
        path = self._places[id(spec)].path
        return Diagnostic(mark, path, message, hint, code, "error" if error else "warning")

    # How the mission and its nodes may go.

    @property
    def main(self) -> Outcomes | None:
        """How the mission ends; None for a library."""
        return None if self.mission.library else self.walk.ends.get(MAIN)

    def reached(self, spec: NodeSpec) -> bool:
        """Whether the node is ticked in any way that the mission may go."""
        return id(spec) in self.walk.reached

    def started(self, spec: NodeSpec) -> bool:
        """Whether it is, and its preconditions let it start."""
        return id(spec) in self.walk.started

    def summary(self, spec: NodeSpec) -> OutcomeSummary:
        """How the node ends, of all that was found."""
        flows = self._flows.get(id(spec), [])
        failures = [pair for flow in flows for pair in flow.failure.items()]
        reasons = joined(why for _, why in failures) if failures else None
        return OutcomeSummary(
            any(flow.success for flow in flows),
            bool(failures),
            any(flow.skipped for flow in flows),
            any(flow.running for flow in flows),
            any(not state.doubtful and why.loud for state, why in failures),
            reasons.any if reasons else 0,
        )

    @cached_property
    def _flows(self) -> dict[int, list[Outcomes]]:
        found: dict[int, list[Outcomes]] = {}
        for name in self.mission.trees:
            for frame in self.walk.frames_of(name):
                for (spec, _), flow in frame.memo.items():
                    found.setdefault(spec, []).append(flow)
        return found


def _placed(tree: TreeSpec) -> Iterator[NodeLocation]:
    todo: list[tuple[NodeSpec, str, tuple[NodeSpec, ...]]] = [(tree.root, tree.name, ())]
    while todo:
        spec, above, parents = todo.pop()
        path = f"{above}/{spec.name}"
        yield NodeLocation(spec, path, tree, parents)
        todo += [(child, path, (*parents, spec)) for child in reversed(spec.children)]
