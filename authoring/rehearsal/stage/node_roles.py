"""Which nodes a mission has once its sub-trees are written out, and which of them a case answers for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ....files.node_patterns import node_matches
from ....trees.controls import NODES
from ....trees.declaration import Resource
from ....trees.mission import Mission, NodeSpec
from ....trees.node import Node
from ....trees.ports import PortDeclaration
from ....world.causes import Cause, Family, perception

_OWN = frozenset(NODES)


@dataclass(frozen=True, slots=True)
class NodeRole:
    """One node as it will be built. `text` is its path in the tree that the file writes down."""

    path: str
    text: str
    spec: NodeSpec
    branch: str = ""
    """The slot and label under which it stands where they say something: `when grasp.missed`, `otherwise`."""

    played: bool = False
    """Whether a case answers for it; the language's own nodes do their own work."""
    causes: tuple[Cause | Family, ...] = ()
    """What it may fail with by itself, as its ports are wired."""
    needed: tuple[PortDeclaration, ...] = ()
    """Outputs that the mission reads and that only a case can say."""


def is_stubbed(node: type[Node]) -> bool:
    """Whether a stand-in takes the node's place: a leaf that is not of the language itself, unless it does
    nothing but change the belief."""
    return node.played and node not in _OWN and not node.declaration.slots


def may_fail_with(role: NodeRole) -> tuple[Cause | Family, ...]:
    """What a leaf declares as it is wired; one that looks may be without an image however it is wired."""
    node = role.spec.node
    looks = node is not None and perception.NO_IMAGE in node.causes
    return (*role.causes, perception.NO_IMAGE) if looks else role.causes


def follows_from_belief(port: PortDeclaration, uses: tuple[Resource, ...]) -> bool:
    """Whether an output needs no answer: what a camera lists are the items that the belief has to do."""
    return Resource.CAMERA in uses and port.type.name == "object" and port.type.many


@dataclass(frozen=True, slots=True)
class NodeRoles:
    """All nodes of a mission, parents first."""

    all: tuple[NodeRole, ...]

    def fitting(self, pattern: str) -> tuple[NodeRole, ...]:
        return tuple(role for role in self.all if node_matches(pattern, role.path))


def roles_of(mission: Mission) -> NodeRoles:
    """Every node of the tree that `build` makes of the mission, but for `Main` itself."""
    return NodeRoles(tuple(_walk(mission, mission.main.root, mission.main.name, mission.main.name, "")))


def _walk(mission: Mission, spec: NodeSpec, above: str, text: str, branch: str) -> Iterator[NodeRole]:
    path, text, node = f"{above}/{spec.name}", f"{text}/{spec.name}", spec.node
    role = NodeRole(path, text, spec, branch)
    if node is not None:
        uses = node.declaration.uses
        wired = [port for port in node.declaration.outputs if port.key in spec.ports]
        needed = tuple(port for port in wired if not follows_from_belief(port, uses))
        role = NodeRole(path, text, spec, branch, is_stubbed(node), node.causes_with(spec.ports), needed)
    yield role
    if spec.node is None:
        called = mission.trees[spec.id]
        yield from _walk(mission, called.root, role.path, called.name, "")
    for slot, filled in spec.slots.items():
        for label, child in filled:
            below = f"{slot} {label}".strip() if label or slot != "do" else ""
            yield from _walk(mission, child, role.path, role.text, below)
