"""Going on under an edited mission: what the nodes of a new tree take over from the state of an old one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from ...errors import PicktreeError
from ...world.causes import Failure
from ...world.journal import Plain
from ..node import Node
from ..status import NodeStatus
from ..values.failure_reports import pack, report_from_plain, unpack
from ..values.references import Reference


@dataclass(frozen=True, slots=True)
class StateTransfer:
    """What became of the nodes: paths, parents first."""

    kept: tuple[str, ...]
    """They go on as they were."""
    fresh: tuple[str, ...]
    """They are new, of another type, or stood at a child that is gone: they begin anew."""
    gone: tuple[str, ...]


def transfer_state(nodes: Sequence[Node], saved: Mapping[str, Mapping[str, Plain]]) -> StateTransfer:
    """Give each node of a new tree (parents first) the saved state of the node of its path and type.

    What stands below a node that begins anew is halted: it is IDLE, and remembers what outlasts that.
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
    """Take over the state, and halt what cannot go on; False when it ran and begins anew."""
    memory = _memory(node, state)
    try:
        report_from_plain(state["failure"])
        for value in memory.values():
            unpack(value)
    except PicktreeError:  # a cause that the edited plug-in no longer has
        return False
    running = NodeStatus(str(state["state"])) is NodeStatus.RUNNING
    lost = any(name not in memory for name in node.positions) or _lost_count(node, state, saved)
    node.restore({**state, "inputs": _inputs(node, state), "memory": memory})
    if not active or (running and (lost or not _rewired(node, state))):
        node.halt()
        return not running
    return True


def _rewired(node: Node, state: Mapping[str, Plain]) -> bool:
    """Let a running node see what the edited text says of its ports; False when that has no value yet."""
    before = cast("dict[str, Plain]", state["ports"])
    now = cast("dict[str, Plain]", node.save()["ports"])
    changed = frozenset(key for key, text in now.items() if key not in before or before[key] != text)
    if any(isinstance(node.wiring.ports[key], Reference) for key in changed):
        try:
            node.read_inputs()
        except Failure:
            return False
    if changed:
        node.on_rewired(changed)
    return True


def _inputs(node: Node, state: Mapping[str, Plain]) -> dict[str, Plain]:
    """The inputs that were read from the blackboard and still are."""
    inputs = cast("dict[str, Plain]", state["inputs"])
    return {k: v for k, v in inputs.items() if isinstance(node.wiring.ports.get(k), Reference)}


def _memory(node: Node, state: Mapping[str, Plain]) -> dict[str, Plain]:
    """What the node remembers, its positions following their children; without those that are lost."""
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
    """Where the children that the position means stand now; None when one of them is gone."""
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
    """The place in the list of the child that had that place."""
    now = [child.path for child in node.below]
    if index == len(children):  # it has been through all of them
        return len(now)
    if not 0 <= index < len(children):
        return None
    return now.index(children[index]) if children[index] in now else None


def _lost_count(node: Node, state: Mapping[str, Plain], saved: Mapping[str, Mapping[str, Plain]]) -> bool:
    """Whether a child is gone that the node has counted."""
    now = {child.path for child in node.below}
    gone = (path for path in cast("list[str]", state["children"]) if path not in now)
    return any(NodeStatus(str(saved[path]["state"])) in node.counted for path in gone)
