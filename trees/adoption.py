"""Going on under an edited mission: what the nodes of a new tree take over from the state of an old one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from ..world.causes import Failure
from ..world.errors import PicktreeError
from ..world.journal import Plain
from .node import Node
from .references import Reference
from .reports import pack, report_from_plain, unpack
from .status import NodeStatus


@dataclass(frozen=True, slots=True)
class Adoption:
    """What became of the nodes: paths, parents first."""

    kept: tuple[str, ...]
    """They go on as they were."""
    fresh: tuple[str, ...]
    """They are new, of another type, or stood at a child that is gone: they begin anew."""
    gone: tuple[str, ...]


def adopt(nodes: Sequence[Node], saved: Mapping[str, Mapping[str, Plain]]) -> Adoption:
    """Give each node of a new tree (parents first) the saved state of the node of its path and type.

    A node runs on only under a parent that does: what stands below a node that begins anew is IDLE.
    """
    kept: list[str] = []
    running: set[str] = set()
    for node in nodes:
        state = saved.get(node.path)
        if state is None or state.get("id") != node.wiring.id:
            continue
        above = cast("Node | None", node.parent)
        if _take_over(node, state, saved, above is None or above.path in running):
            kept.append(node.path)
        if node.state is NodeStatus.RUNNING:
            running.add(node.path)
    paths = [node.path for node in nodes]
    known = set(kept)
    fresh = tuple(path for path in paths if path not in known)
    return Adoption(tuple(kept), fresh, tuple(path for path in saved if path not in set(paths)))


def _take_over(
    node: Node, state: Mapping[str, Plain], saved: Mapping[str, Mapping[str, Plain]], may_run: bool
) -> bool:
    """Whether the node goes on as it was; if not it is IDLE, with what it keeps beyond an activation."""
    was = NodeStatus(str(state["state"]))
    active = may_run or was is not NodeStatus.RUNNING
    memory = _memory(node, state)
    try:
        report_from_plain(state["failure"])
        for value in memory.values():
            unpack(value)
    except PicktreeError:  # a cause that the edited plug-in no longer has
        return False
    lost = any(name not in memory for name in node.positions)
    if was is NodeStatus.RUNNING and (not active or lost or _lost_a_skipped_child(node, state, saved)):
        _begin_anew(node, memory)
        return False
    node.restore({**state, "inputs": _inputs(node, state), "memory": memory})
    if was is NodeStatus.RUNNING:
        return _rewire(node, state, memory)
    return True


def _begin_anew(node: Node, memory: Mapping[str, Plain]) -> None:
    node.restore({"state": "IDLE", "failure": None, "message": "", "inputs": {}, "memory": dict(memory)})


def _rewire(node: Node, state: Mapping[str, Plain], memory: Mapping[str, Plain]) -> bool:
    """Let a running node see what the edited text says of its ports; False when that has no value yet."""
    before = cast("dict[str, Plain]", state["ports"])
    now = cast("dict[str, Plain]", node.save()["ports"])
    changed = frozenset(key for key, text in now.items() if key not in before or before[key] != text)
    if any(isinstance(node.wiring.ports[key], Reference) for key in changed):
        try:
            node.read_inputs()
        except Failure:
            _begin_anew(node, memory)
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
            labels = {label or key for key in keys for label, _ in node.slot(key)}
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


def _lost_a_skipped_child(
    node: Node, state: Mapping[str, Plain], saved: Mapping[str, Mapping[str, Plain]]
) -> bool:
    """Whether a child is gone that the node has counted as skipped."""
    now = {child.path for child in node.below}
    gone = (path for path in cast("list[str]", state["children"]) if path not in now)
    return bool(node.positions) and any(saved[path]["state"] == NodeStatus.SKIPPED.value for path in gone)
