"""Roles of a mission's nodes in a rehearsal, and the choice of the answer for a leaf."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from ....files.marks import Location
from ....files.node_patterns import node_matches
from ....trees.controls import NODES
from ....trees.declaration import Resource
from ....trees.mission import Mission, NodeSpec
from ....trees.node import Node
from ....trees.ports import PortDeclaration
from ....world.causes import Cause, Family, perception
from ..cases.case import LeafAnswer, LeafScript

_LANGUAGE_NODES = frozenset(NODES)


@dataclass(frozen=True, slots=True)
class NodeRole:
    """One node of the built tree. `text` is its path in the tree of the file."""

    path: str
    text: str
    spec: NodeSpec
    branch: str = ""
    """Slot and label of the node where they have a meaning: `when grasp.missed`, `otherwise`."""

    played: bool = False
    """Whether a case answers for the node; nodes of the language run themselves."""
    causes: tuple[Cause | Family, ...] = ()
    """Causes with which the node itself may fail under its wiring."""
    needed: tuple[PortDeclaration, ...] = ()
    """Outputs that the mission reads and that only a case can give."""


def is_stubbed(node: type[Node]) -> bool:
    """Whether a stub replaces the node: a leaf outside the language that does more than change the belief."""
    return node.played and node not in _LANGUAGE_NODES and not node.declaration.slots


def may_fail_with(role: NodeRole) -> tuple[Cause | Family, ...]:
    """Return the causes of a leaf under its wiring; a leaf that looks may lack an image under any wiring."""
    node = role.spec.node
    looks = node is not None and perception.NO_IMAGE in node.causes
    return (*role.causes, perception.NO_IMAGE) if looks else role.causes


def follows_from_belief(port: PortDeclaration, uses: tuple[Resource, ...]) -> bool:
    """Whether an output needs no answer: a camera lists the items that the belief has to do."""
    return Resource.CAMERA in uses and port.type.name == "object" and port.type.many


@dataclass(frozen=True, slots=True)
class NodeRoles:
    """All nodes of a mission, parents first."""

    all: tuple[NodeRole, ...]

    def fitting(self, pattern: str) -> tuple[NodeRole, ...]:
        return tuple(role for role in self.all if node_matches(pattern, role.path))


def roles_of(mission: Mission) -> NodeRoles:
    """Return the roles of all nodes of the built tree, without `Main` itself."""
    return NodeRoles(tuple(_walk(mission, mission.main.root, mission.main.name, mission.main.name, "")))


def _walk(mission: Mission, spec: NodeSpec, above: str, text: str, branch: str) -> Iterator[NodeRole]:
    path, text, node = f"{above}/{spec.name}", f"{text}/{spec.name}", spec.node
    role = NodeRole(path, text, spec, branch)
    if node is not None:
        declared = node.declaration
        wired = [port for port in declared.outputs if port.key in spec.ports]
        needed = tuple(port for port in wired if not follows_from_belief(port, declared.uses))
        role = NodeRole(path, text, spec, branch, is_stubbed(node), declared.causes_with(spec.ports), needed)
    yield role
    if spec.node is None:
        called = mission.trees[spec.id]
        yield from _walk(mission, called.root, role.path, called.name, "")
    for slot, filled in spec.slots.items():
        for label, child in filled:
            below = f"{slot} {label}".strip() if label or slot != "do" else ""
            yield from _walk(mission, child, role.path, role.text, below)


@dataclass(slots=True)
class _Turns:
    script: LeafScript
    given: int = 0


class ScriptedAnswers:
    """Answers by start count of each pattern; the first pattern that matches a node counts."""

    def __init__(self, scripts: Iterable[LeafScript]) -> None:
        self._turns = [_Turns(script) for script in scripts]

    def answer(self, path: str) -> LeafAnswer | None:
        """Return the next answer of the leaf at that path; None when the case gives none."""
        turns = next((t for t in self._turns if node_matches(t.script.pattern, path)), None)
        if turns is None or not turns.script.answers:
            return None
        number, turns.given = turns.given, turns.given + 1
        if number < len(turns.script.answers):
            return turns.script.answers[number]
        return turns.script.otherwise or turns.script.answers[-1]

    def unused(self) -> tuple[Location, ...]:
        """Return the places of answers that no leaf has used."""
        return tuple(
            answer.loc
            for turns in self._turns
            for number, answer in enumerate(turns.script.everything)
            if number >= turns.given
        )
