"""Views of the tick at the cursor of a replay, as lines of text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ...analysis.replay.cursor import Cursor
from ...analysis.replay.node_names import find_node
from ...logs.schema.records import NodeStatusRecord, TreeNode, Values
from ...logs.visits import Visit
from ...trees.values.port_types import show
from ..terminal.belief_text import belief_line
from ..terminal.progress import STYLED_STATUS_MARKS


def place(cursor: Cursor) -> str:
    """Return the cursor's place in a line."""
    tick = cursor.tick.record
    status = {node.path: node for node in tick.nodes}
    where = status.get(tick.tip) or (tick.nodes[0] if tick.nodes else None)
    doing = "" if where is None else f"; {where.path} is {where.status}"
    return f"{cursor.time:.2f} s, tick {cursor.number} of {len(cursor) - 1}{doing}"


def tree_lines(cursor: Cursor, text: str) -> Iterator[str]:
    """Yield a line for each node, or for the node that `text` names and its descendants."""
    nodes = cursor.tree.nodes
    top = find_node(text, nodes).path if text else ""
    indent = top.count("/")
    status = _by_path(cursor)
    for node in nodes:
        if not top or node.path == top or node.path.startswith(f"{top}/"):
            depth = node.path.count("/") - indent
            name = node.name if node.name.split("#")[0] == node.id else f"{node.id} {node.name}"
            yield f"  {'  ' * depth}{_mark(status[node.path])} {name}{_status_text(status[node.path], '  ')}"


def where_lines(cursor: Cursor) -> Iterator[str]:
    """Yield the nodes from the root to the deepest that runs, or has ended."""
    status, tip = _by_path(cursor), cursor.tick.record.tip
    for node in cursor.tree.nodes:
        if node.path == tip or tip.startswith(f"{node.path}/") or not (tip or node.parent):
            one = status[node.path]
            yield f"{_mark(one)} {node.path} is {one.status}{_status_text(one, ': ')}"


def node_lines(cursor: Cursor, text: str) -> Iterator[str]:
    """Yield the state of one node, its inputs at the start, and its end."""
    node = find_node(text or cursor.tick.record.tip or cursor.tree.nodes[0].path, cursor.tree.nodes)
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
        yield f"  failed in {visit.origin}: {visit.cause}: {visit.message}"
        for name, value in visit.evidence.items():
            yield f"    {name}: {show(value)}"
    elif one.message:
        yield f"  says: {one.message}"


def _span(cursor: Cursor, visit: Visit) -> str:
    about = f" for {visit.item}" if visit.item else ""
    times = f", attempt {visit.attempt}{about}" if visit.attempt > 1 else about
    if visit.outcome == "RUNNING" or visit.last > cursor.number:
        return f"began at {visit.start:.2f} s{times}"
    return f"began at {visit.start:.2f} s{times}, ended at {visit.end:.2f} s: {visit.outcome}"


def blackboard_lines(cursor: Cursor, part: str) -> Iterator[str]:
    """Yield the keys that contain `part`, with their values; a single one in full."""
    board = cursor.blackboard
    keys = sorted(key for key in board if part in key)
    if not keys:
        yield f"no key contains {part!r}" if part else "nothing is written yet"
    for key in keys:
        yield f"{key} = {board[key]!r}" if len(keys) == 1 else f"{key} = {show(board[key])}"


def belief_lines(cursor: Cursor, part: str) -> Iterator[str]:
    """Yield the believed objects whose id contains `part`."""
    scene = cursor.belief
    bodies = [body for body in scene.bodies if part in body.id] if scene else []
    if not bodies:
        yield f"no object is called {part!r}" if part else "no object is known yet"
    for body in bodies:
        yield belief_line(body, cursor.time)


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
    opening = [joints.position[joints.names.index(n)] for n in cursor.fingers if n in joints.names]
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


def _by_path(cursor: Cursor) -> Mapping[str, NodeStatusRecord]:
    return {node.path: node for node in statuses(cursor)}


def _idle(node: TreeNode) -> NodeStatusRecord:
    return NodeStatusRecord(node.path, node.id, "IDLE", ticked=False)


def _mark(node: NodeStatusRecord) -> str:
    return STYLED_STATUS_MARKS[node.status][0]


def _status_text(node: NodeStatusRecord, lead: str) -> str:
    said = f"{node.cause}: {node.message}" if node.cause else node.message
    return f"{lead}{said}" if said else ""
