"""Survey that all rules read: the mission, the places of its nodes, and its possible flow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property

from ...files.marks import Diagnostic, Mark
from ...files.node_patterns import short_names
from ...trees.key_writers import PlacedNode, placed_nodes
from ...trees.loading.loader import SceneNames
from ...trees.mission import MAIN, Mission, NodeSpec, TreeSpec, bottom_up, reachable
from ...trees.node import Node
from .flow_analysis import FlowAnalysis
from .outcomes import EMPTY, KEPT, FlowState, Outcomes


class LintModel:
    """One mission, walked through once; a rule asks it and yields faults."""

    def __init__(self, mission: Mission, known: SceneNames | None) -> None:
        self.mission = mission
        self.known = known
        self.file = mission.document.root.mark.file
        self.walk = FlowAnalysis(mission)
        self._ends: dict[int, Outcomes] = {}
        if MAIN in mission.trees and not mission.library:
            self.walk.enter(mission.main)
        # The remaining trees are judged by themselves, callers first: from those the others are entered.
        for name in reversed(bottom_up(mission.trees)):
            if name not in self.walk.entered and self.own(mission.trees[name].mark):
                self.walk.enter(mission.trees[name], EMPTY | KEPT)
        self._places = {id(p.spec): p for tree in mission.trees.values() for p in placed_nodes(tree)}
        self.usage = {name: self.walk.layout_of(name).usage for name in mission.trees}

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

    def places(self) -> Iterator[PlacedNode]:
        """The nodes of the mission's own file, parents first."""
        for tree in self.trees():
            for spec in tree.root.iterate():
                yield self._places[id(spec)]

    def nodes(self, *kinds: type[Node]) -> Iterator[NodeSpec]:
        """Those of these classes, or all but sub-trees."""
        for place in self.places():
            if place.spec.node is not None and issubclass(place.spec.node, kinds or Node):
                yield place.spec

    def fault(
        self, spec: NodeSpec, message: str, hint: str = "", *, code: str, at: str = "", error: bool = False
    ) -> Diagnostic:
        """A finding at a node, or at the value under its key `at`."""
        path = self._places[id(spec)].path
        return Diagnostic(spec.mark_at(at), path, message, hint, code, "error" if error else "warning")

    def around(self, spec: NodeSpec) -> tuple[NodeSpec, ...]:
        """The nodes above it in its tree, the outermost first."""
        return self._places[id(spec)].above

    def short_name(self, spec: NodeSpec) -> str:
        """The shortest end of its path that no other node of the mission's own file has."""
        return self._short_names[self._places[id(spec)].path]

    @cached_property
    def _short_names(self) -> Mapping[str, str]:
        return short_names(place.path for place in self.places())

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

    def ends(self, spec: NodeSpec) -> Outcomes:
        """How the node ends, over all states that it was reached in."""
        known = self._ends.get(id(spec))
        if known is None:
            known = self._ends[id(spec)] = Outcomes()
            for ends in self._found.get(id(spec), ()):
                known.take(ends)
        return known

    def entries(self, spec: NodeSpec) -> tuple[FlowState, ...]:
        """The states that the node was reached in."""
        return tuple(
            state
            for name in self.mission.trees
            for frame in self.walk.frames_of(name)
            for other, state in frame.memo
            if other == id(spec)
        )

    @cached_property
    def _found(self) -> dict[int, list[Outcomes]]:
        found: dict[int, list[Outcomes]] = {}
        for name in self.mission.trees:
            for frame in self.walk.frames_of(name):
                for (spec, _), ends in frame.memo.items():
                    found.setdefault(spec, []).append(ends)
        return found
