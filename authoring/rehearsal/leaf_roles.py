"""Roles of a mission's nodes in a rehearsal: which are stubbed, with which causes they may fail."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from picktree.trees import (
    NODES,
    Mission,
    Node,
    NodeSpec,
    PortDeclaration,
    Resource,
    control_flow,
)
from picktree.world import Cause, Family, perception

_LANGUAGE_NODES = frozenset(NODES)


@dataclass(frozen=True, slots=True)
class NodeRole:
    """One node of the built tree. `text` is its path in the tree of the file."""

    path: str
    text: str
    spec: NodeSpec
    branch: str = ""
    """Slot and label of the node where they have a meaning: `when grasp.missed`, `otherwise`."""

    recovers: bool = False
    """Whether it runs only after a failure: a handler, or an alternative of a Fallback."""
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


def roles_of(mission: Mission) -> tuple[NodeRole, ...]:
    """Return the roles of all nodes of the built tree, parents first, without `Main` itself."""
    return tuple(_walk(mission, mission.main.root, mission.main.name, mission.main.name, ""))


def _walk(
    mission: Mission, spec: NodeSpec, above: str, text: str, branch: str, *, recovers: bool = False
) -> Iterator[NodeRole]:
    path, text, node = f"{above}/{spec.name}", f"{text}/{spec.name}", spec.node
    role = NodeRole(path, text, spec, branch, recovers)
    if node is not None:
        declared = node.declaration
        wired = [port for port in declared.outputs if port.key in spec.ports]
        needed = tuple(port for port in wired if not follows_from_belief(port, declared.uses))
        causes = declared.causes_with(spec.ports)
        role = replace(role, played=is_stubbed(node), causes=causes, needed=needed)
    yield role
    if spec.node is None:
        called = mission.trees[spec.id]
        yield from _walk(mission, called.root, role.path, called.name, "")
    for slot, filled in spec.slots.items():
        for index, (label, child) in enumerate(filled):
            below = f"{slot} {label}".strip() if label or slot != "do" else ""
            recovers = node is not None and _runs_after_failure(node, slot, index, len(filled))
            yield from _walk(mission, child, role.path, role.text, below, recovers=recovers)


def _runs_after_failure(parent: type[Node], slot: str, index: int, count: int) -> bool:
    """Whether that child starts only when another child has failed."""
    flow = parent.flow
    if isinstance(flow, control_flow.Recovery):
        return slot != "do" or index > 0
    if isinstance(flow, control_flow.CleanUp):
        return index == count - 1
    return type(flow) is control_flow.ChildFlow and flow.failure == control_flow.NEXT and index > 0
