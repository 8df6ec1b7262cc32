"""Views of the tick at the cursor of a replay, as lines of text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ...analysis.cursor import Cursor
from ...files.node_patterns import find_node
from ...logs.schema.records import NodeStatusRecord, TreeNode, Values
from ...logs.visits import Visit
from ...trees.values.port_types import show
from ..terminal.state_text import NodeState, belief_lines, failure_lines, status_text


def place(cursor: Cursor) -> str:
    """Return the cursor's place in a line."""
    tick = cursor.tick.record
    status = {node.path: node for node in tick.nodes}
    where = status.get(tick.tip) or (tick.nodes[0] if tick.nodes else None)
    doing = "" if where is None else f"; {where.path} is {where.status}"
    return f"{cursor.time:.2f} s, tick {cursor.number} of {len(cursor) - 1}{doing}"


def node_lines(cursor: Cursor, text: str) -> Iterator[str]:
    """Yield the state of one node, its inputs at the start, and its end."""
    node = find_node(text or deepest(cursor), cursor.tree.nodes)
    one = _by_path(cursor)[node.path]
    yield f"{node.path}: {node.id}, {one.status}"
    visit = cursor.last_visit(node.path)
    read: Values = {} if visit is None else visit.inputs
    for port in dict.fromkeys((*node.ports, *read)):
        said = (node.ports.get(port, ""), show(read[port]) if port in read else "")
        yield f"  {port} = {' '.join(part for part in said if part)}"
    if visit is None:
        yield "  it has not begun yet"
        return
    yield f"  {_span(cursor, visit)}"
    if visit.last <= cursor.number and visit.cause:
        yield from failure_lines(visit.origin, visit.cause, visit.message, visit.evidence)
    elif one.message:
        yield f"  says: {one.message}"


def _span(cursor: Cursor, visit: Visit) -> str:
    about = f" for {visit.item}" if visit.item else ""
    times = f", attempt {visit.attempt}{about}" if visit.attempt > 1 else about
    if visit.outcome == "RUNNING" or visit.last > cursor.number:
        return f"began at {visit.start:.2f} s{times}"
    return f"began at {visit.start:.2f} s{times}, ended at {visit.end:.2f} s: {visit.outcome}"


def deepest(cursor: Cursor) -> str:
    """Return the path of the deepest node that runs or has ended; else of the root."""
    return cursor.tick.record.tip or cursor.tree.nodes[0].path


def believed_lines(cursor: Cursor, part: str) -> Iterator[str]:
    """Yield the believed objects at the cursor whose id contains `part`."""
    scene = cursor.belief
    return belief_lines(scene.bodies if scene else (), part, cursor.time)


def joint_lines(cursor: Cursor) -> Iterator[str]:
    """Yield the joints with the servo's remaining error, and the gripper."""
    joints, control = cursor.joints, cursor.control
    if joints is None:
        yield "the log has no joints here"
        return
    errors = control.error if control is not None else ()
    width = max(map(len, joints.names), default=0)
    yield f"{'':<{width}}  rad, m   per s    Nm, N    to go"
    for k, name in enumerate(joints.names):
        to_go = f"{errors[k]:+.4f}" if k < len(errors) else ""
        position, velocity, effort = joints.position[k], joints.velocity[k], joints.effort[k]
        yield f"{name:<{width}}  {position:+.4f}  {velocity:+.4f}  {effort:+7.2f}  {to_go}".rstrip()
    opening = [joints.position[joints.names.index(n)] for n in cursor.run.joint_names[1]]
    if opening:
        yield f"gripper opening {1000 * sum(opening):.1f} mm"
    if control is not None:
        yield f"commanded by {control.controller}"


def wrench_line(cursor: Cursor) -> str:
    wrench = cursor.wrench
    if wrench is None:
        return "the log has no wrench here"
    f, t = wrench.force, wrench.torque
    return (
        f"force ({f.x:+.2f}, {f.y:+.2f}, {f.z:+.2f}) N, {wrench.magnitude:.2f} N in all; "
        f"torque ({t.x:+.2f}, {t.y:+.2f}, {t.z:+.2f}) Nm"
    )


def changed_paths(cursor: Cursor) -> frozenset[str]:
    """Return the paths of the nodes that started or ended at the cursor."""
    return frozenset(move.transition.path for move in cursor.changes().moves)


def statuses(cursor: Cursor) -> Sequence[NodeStatusRecord]:
    """Return the statuses of all nodes of the tree; idle where the tick has none."""
    known = {node.path: node for node in cursor.tick.record.nodes}
    return [known.get(node.path) or _idle(node) for node in cursor.tree.nodes]


def node_states(cursor: Cursor) -> list[NodeState]:
    """Return the nodes of the tree with their statuses at the cursor."""
    status = _by_path(cursor)
    return [
        NodeState(node.path, node.name, node.id, one.status, status_text(one.cause, one.message))
        for node in cursor.tree.nodes
        for one in (status[node.path],)
    ]


def _by_path(cursor: Cursor) -> Mapping[str, NodeStatusRecord]:
    return {node.path: node for node in statuses(cursor)}


def _idle(node: TreeNode) -> NodeStatusRecord:
    return NodeStatusRecord(node.path, node.id, "IDLE", ticked=False)
