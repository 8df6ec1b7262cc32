"""State transfer to an edited mission: nodes of the new tree take over the state of the old one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from ..files.errors import PicktreeError
from ..world.causes import Failure
from ..world.journal import Plain
from .failure_reports import pack, report_from_plain, unpack
from .node import Node
from .references import Constant
from .status import NodeStatus


@dataclass(frozen=True, slots=True)
class StateTransfer:
    """Result of a state transfer: paths of nodes, parents first."""

    kept: tuple[str, ...]
    """Nodes that continue."""
    fresh: tuple[str, ...]
    """Nodes that restart: new, of another type, or positioned at a child that is gone."""
    gone: tuple[str, ...]


def transfer_state(nodes: Sequence[Node], saved: Mapping[str, Mapping[str, Plain]]) -> StateTransfer:
    """Give each node of a new tree (parents first) the saved state of the node with its path and type.

    Descendants of a node that restarts are halted: they are IDLE, and keep memory that outlasts a halt.
    """
    kept: list[str] = []
    for node in nodes:
        state = saved.get(node.path)
        above = cast("Node | None", node.parent)
        if state is None or state.get("id") != node.wiring.id:
            continue
        if _take_over(node, state, saved, above is None or above.state is not NodeStatus.IDLE):
            kept.append(node.path)
    going_on, now = set(kept), {node.path: None for node in nodes}
    fresh = tuple(path for path in now if path not in going_on)
    return StateTransfer(tuple(kept), fresh, tuple(path for path in saved if path not in now))


def _take_over(
    node: Node, state: Mapping[str, Plain], saved: Mapping[str, Mapping[str, Plain]], active: bool
) -> bool:
    """Take over the state, and halt nodes that cannot continue; False when the node was RUNNING and
    restarts."""
    memory = _memory(node, state)
    try:
        report_from_plain(state["failure"])
        for value in memory.values():
            unpack(value)
    except PicktreeError:  # a cause that the edited plug-in no longer has
        return False
    running = NodeStatus(str(state["state"])) is NodeStatus.RUNNING
    lost = any(name not in memory for name in node.positions) or _lost_count(node, state, saved)
    node.restore_state({**state, "inputs": _inputs(node, state), "memory": memory})
    if not active or (running and (lost or not _rewired(node, state))):
        node.halt()
        return not running
    return True


def _rewired(node: Node, state: Mapping[str, Plain]) -> bool:
    """Pass changed port values to a running node; False when a new value does not exist yet."""
    before = cast("dict[str, Plain]", state["ports"])
    now = cast("dict[str, Plain]", node.save_state()["ports"])
    changed = frozenset(key for key, text in now.items() if key not in before or before[key] != text)
    if any(not isinstance(node.wiring.ports[key], Constant) for key in changed):
        try:
            node.read_inputs()
        except Failure:
            return False
    if changed:
        node.on_rewired(changed)
    return True


def _inputs(node: Node, state: Mapping[str, Plain]) -> dict[str, Plain]:
    """Return the inputs that were read at the node's start and still are."""
    inputs = cast("dict[str, Plain]", state["inputs"])
    constant = (Constant, type(None))
    return {k: v for k, v in inputs.items() if not isinstance(node.wiring.ports.get(k), constant)}


def _memory(node: Node, state: Mapping[str, Plain]) -> dict[str, Plain]:
    """Return the node's memory with positions moved to their children's new places; lost positions are left
    out."""
    memory = cast("dict[str, Plain]", state["memory"])
    found: dict[str, Plain] = {}
    for name in node.remembers:
        if name not in memory:
            continue
        if name not in node.positions:
            found[name] = memory[name]
            continue
        position = _position(node, unpack(memory[name]), cast("list[str]", state["children"]))
        if position is not None:
            found[name] = pack(position)
    return found


def _position(node: Node, position: object, children: Sequence[str]) -> object:
    """Return the new position of the children that a position names; None when one is gone."""
    match position:
        case str():
            keys = [slot.key for slot in node.declaration.slots]
            filled = [(key, *child) for key in keys for child in node.slot(key)]
            labels = {word for key, label, child in filled for word in (label or key, child.name)}
            return position if not position or position in labels else None
        case int():
            return _index(node, position, children)
        case tuple():
            moved = [_index(node, cast("int", one), children) for one in cast("Iterable[object]", position)]
            return None if None in moved else tuple(moved)
        case _:
            return None


def _index(node: Node, index: int, children: Sequence[str]) -> int | None:
    """Return the new list index of the child at an old index; None when it is gone."""
    now = [child.path for child in node.below]
    if index == len(children):  # it has been through all of them
        return len(now)
    if not 0 <= index < len(children):
        return None
    return now.index(children[index]) if children[index] in now else None


def _lost_count(node: Node, state: Mapping[str, Plain], saved: Mapping[str, Mapping[str, Plain]]) -> bool:
    """Return whether a child that the node has counted is gone."""
    now = {child.path for child in node.below}
    gone = (path for path in cast("list[str]", state["children"]) if path not in now)
    return any(NodeStatus(str(saved[path]["state"])) in node.counted for path in gone)
