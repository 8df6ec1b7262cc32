"""What stands around a node: who may stop it from outside, and what goes on beside it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ...trees.controls import Parallel, ReactiveFallback, ReactiveSequence, Timeout
from ...trees.mission import MAIN, NodeSpec, TreeSpec
from .mission_survey import Survey


@dataclass(frozen=True, slots=True)
class Context:
    """`stopped`: something above may halt it while it runs. `beside`: something else is ticked meanwhile."""

    stopped: bool = False
    beside: bool = False

    def below(self, spec: NodeSpec, child: NodeSpec, survey: Survey) -> Context:
        """That of a child."""
        stopped = self.stopped or "_while" in spec.preconditions
        if spec.node is None:
            return Context(stopped, self.beside)
        if issubclass(spec.node, Timeout):
            stopped = stopped or survey.walk.number(spec, "msec") != 0
        if spec.node.by_turns:
            return Context(stopped, self.beside)
        if issubclass(spec.node, Parallel):
            return Context(stopped or _may_end_early(spec, child, survey), beside=True)
        if issubclass(spec.node, ReactiveSequence | ReactiveFallback):
            stopped = stopped or child is not spec.children[0]
            return Context(stopped, self.beside or len(spec.children) > 1)
        # Switch and WhileDoElse leave a branch for another, and of a plug-in's node nothing is known.
        return Context(stopped=True, beside=True)


def _may_end_early(spec: NodeSpec, child: NodeSpec, survey: Survey) -> bool:
    """Whether a Parallel may end by what its other children do."""
    others = [survey.summary(part) for part in spec.children if part is not child]
    wanted = survey.walk.number(spec, "success_count")
    return any(other.fails for other in others) or wanted not in (-1, len(spec.children))


def contexts(survey: Survey) -> Iterator[tuple[NodeSpec, Context]]:
    """The nodes of the mission in each context in which they stand. Of a library none: who knows where its
    trees will stand."""
    seen: set[tuple[str, Context]] = set()
    todo: list[tuple[TreeSpec, Context]] = []
    if survey.main is not None:
        todo.append((survey.mission.trees[MAIN], Context()))
    while todo:
        tree, context = todo.pop()
        if (tree.name, context) in seen:
            continue
        seen.add((tree.name, context))
        for spec, around in _inside(tree.root, context, survey):
            yield spec, around
            if spec.node is None:
                todo.append((survey.mission.trees[spec.id], around.below(spec, spec, survey)))


def _inside(root: NodeSpec, context: Context, survey: Survey) -> Iterator[tuple[NodeSpec, Context]]:
    todo = [(root, context)]
    while todo:
        spec, around = todo.pop()
        yield spec, around
        todo += [(child, around.below(spec, child, survey)) for child in reversed(spec.children)]
