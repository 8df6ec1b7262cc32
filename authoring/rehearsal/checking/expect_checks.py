"""Whether what a case expects names nodes, causes, facts and keys that there are."""

from __future__ import annotations

from collections.abc import Iterator

from ....files.node_patterns import node_matches
from ....files.yaml.document import Location, nearest
from ....trees.mission import MAIN, TreeSpec
from ....trees.values.references import Reference
from ....world.causes import Cause, matches
from ..cases.case import ANY_LEAVES, OUTCOMES, Expectation, TakenUp, Turn
from ..stage.node_roles import Role, may_fail_with
from .known_names import Known
from .world_checks import WorldChecks


class ExpectChecks:
    """Holds the expectation of one case against the mission."""

    def __init__(self, known: Known, expect: Expectation, worlds: WorldChecks) -> None:
        self._known, self._expect, self._worlds = known, expect, worlds

    def run(self) -> None:
        expect, loc = self._expect, self._expect.loc
        if expect.cause is not None:
            self._known.cause(expect.cause, (*loc, "cause"), family=True)
        for turn in expect.order or ():
            if turn.pattern != ANY_LEAVES:
                self._turn(turn)
        for taken_up in expect.handled:
            self._taken_up(taken_up)
        for number, pattern in enumerate(expect.never):
            self._known.nodes(pattern, (*loc, "never", number))
        self._worlds.facts(expect.facts, loc, "facts", may_set=False)
        self._worlds.objects(expect.objects, loc, "objects")
        for key in expect.blackboard:
            self._key(key, (*loc, "blackboard", key))

    def _turn(self, turn: Turn) -> None:
        leaves = self._known.leaves(turn.pattern, turn.loc)
        if not turn.outcome or turn.outcome in OUTCOMES:
            return
        at = (*turn.loc, turn.pattern)
        if "." not in turn.outcome and turn.outcome != "*":
            hint = nearest(turn.outcome, (*OUTCOMES, *(c for role in leaves for c in _causes(role))))
            self._known.fault(at, f"{turn.outcome!r} is neither an outcome nor a cause", hint, code="P714")
            return
        causes = self._known.cause(turn.outcome, at, family=True)
        if causes and leaves and not any(_may_fail(role, causes) for role in leaves):
            declared = ", ".join(dict.fromkeys(c for role in leaves for c in _causes(role))) or "none"
            message = f"{turn.pattern} does not fail with {turn.outcome}"
            self._known.fault(at, message, f"it declares {declared}", code="P706")

    def _taken_up(self, wanted: TakenUp) -> None:
        self._known.cause(wanted.cause, (*wanted.loc, "cause"), family=True)
        if self._known.roles is None:
            return
        by = self._known.nodes(wanted.by, (*wanted.loc, "by")) if wanted.by else self._known.roles.all
        labels = list(dict.fromkeys(label for role in by for label in _handlers(role)))
        if wanted.handler and by and wanted.handler not in labels:
            owner = wanted.by or "the mission"
            message = f"{owner} has no handler {wanted.handler!r}"
            hint = nearest(wanted.handler, labels) or "there are none"
            self._known.fault((*wanted.loc, "handler"), message, hint, code="P718")

    def _key(self, key: str, loc: Location) -> None:
        mission = self._known.mission
        if mission is None or self._known.roles is None:
            return
        owner, _, name = key.rpartition("/")
        trees = [mission.main] if not owner else [
            mission.trees[role.spec.id]
            for role in self._known.roles.all
            if role.spec.node is None and node_matches(owner, role.path)
        ]  # fmt: skip
        if owner and not trees and node_matches(owner, MAIN):
            trees = [mission.main]
        if owner and not trees:
            names = [role.spec.name for role in self._known.roles.all if role.spec.node is None]
            message = f"no sub-tree of the mission fits {owner!r}"
            self._known.fault(loc, message, nearest(owner, (MAIN, *names)), code="P715", key=True)
            return
        keys = list(dict.fromkeys(one for tree in trees for one in _keys(tree)))
        if name not in keys:
            hint = nearest(name, keys) or "it has none"
            message = f"{owner or MAIN} has no key {name!r}"
            self._known.fault(loc, message, hint, code="P715", key=True)


def _keys(tree: TreeSpec) -> Iterator[str]:
    """All keys of a tree's blackboard that its text names."""
    yield from (port.key for port in tree.ports)
    for spec in tree.root.iterate():
        yield from (bound.key for bound in spec.ports.values() if isinstance(bound, Reference))
        for assignments in spec.postconditions.values():
            yield from (one.key for one in assignments)


def _handlers(role: Role) -> Iterator[str]:
    """What a node calls its handlers: the patterns of its table of causes, and what stands beside it."""
    node = role.spec.node
    tables = [slot for slot in node.declaration.slots if slot.of == "cause"] if node else []
    for slot in tables:
        yield from (label for label, _ in role.spec.slots.get(slot.key, ()))
    if tables and "otherwise" in role.spec.slots:
        yield "otherwise"


def _causes(role: Role) -> Iterator[str]:
    return map(str, role.causes)


def _may_fail(role: Role, causes: tuple[Cause, ...]) -> bool:
    declared = (*may_fail_with(role), "tree.missing_input", "world.unknown_object", "internal.error")
    return any(matches(str(one), cause) for one in declared for cause in causes)
