"""What the debugger shows: tree, nodes, blackboard and belief at a moment, as lines of text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ...files.expressions.expression import Expression
from ...trees.node import Node
from ...trees.running.debugger import Breakpoint, Stop
from ...trees.running.runner import Tree
from ...trees.status import NodeStatus
from ...trees.values.port_types import show
from ...trees.values.references import Constant
from ...world.causes import Failure
from ..terminal.belief_text import belief_line

MARKS: Mapping[NodeStatus, str] = {
    NodeStatus.IDLE: "·",
    NodeStatus.RUNNING: "▶",
    NodeStatus.SUCCESS: "✓",
    NodeStatus.FAILURE: "✗",
    NodeStatus.SKIPPED: "–",
}


def place(tree: Tree, stop: Stop) -> str:
    """Where the run stands still, in a line."""
    now = f"{tree.root.world.clock.now:.2f} s"
    if not stop.path:
        return f"{now}, end of the tick; {deepest(tree).path} is {deepest(tree).state}"
    if stop.when == "before":
        return f"{now}, before {stop.path}"
    node = tree.find(stop.path)
    how = "was halted" if node.state is NodeStatus.IDLE else str(node.state)
    return f"{now}, after {stop.path}: {how}" + (f", {_said(node)}" if _said(node) else "")


def deepest(tree: Tree) -> Node:
    """The node that runs and below which none does; the root when none runs."""
    running = [node for node in tree.nodes if node.state is NodeStatus.RUNNING]
    return running[-1] if running else tree.root


def tree_lines(tree: Tree, top: Node, stop: Stop) -> Iterator[str]:
    """A line for each node from `top` down, the one of the stop marked."""
    indent = top.path.count("/")
    for node in tree.nodes:
        if node.path != top.path and not node.path.startswith(f"{top.path}/"):
            continue
        margin = "→ " if node.path == stop.path else "  "
        name = node.name if node.name.split("#")[0] == node.wiring.id else f"{node.wiring.id} {node.name}"
        said = f"  {_said(node)}" if _said(node) else ""
        yield f"{margin}{'  ' * (node.path.count('/') - indent)}{MARKS[node.state]} {name}{said}"


def where_lines(tree: Tree, stop: Stop) -> Iterator[str]:
    """The nodes from the root to where the run stands."""
    end = stop.path or deepest(tree).path
    for node in tree.nodes:
        if node.path == end or end.startswith(f"{node.path}/"):
            said = f": {_said(node)}" if _said(node) else ""
            yield f"{MARKS[node.state]} {node.path} is {node.state}{said}"


def node_lines(node: Node, stop: Stop, breakpoints: Mapping[int, Breakpoint]) -> Iterator[str]:
    """What one node is, what its ports hold, and why it failed."""
    yield f"{node.path}: {node.wiring.id}, {node.kind}, {node.state}"
    # A node that is about to start still has the inputs of its last activation.
    unread = node.state is NodeStatus.IDLE or stop == Stop("before", node.path)
    ports = {port.key: port for port in node.declaration.ports}
    for key in dict.fromkeys((*ports, *node.wiring.ports)):
        wired = node.wiring.ports.get(key)
        text = "" if wired is None or isinstance(wired, Constant) else f"{wired} "
        if key in ports and ports[key].direction == "out":
            yield f"  {key} → {text or 'nowhere '}{_written(node, key)}"
        else:
            yield f"  {key} = {text}{_now(node, key) if unread else _read(node, key)}"
    for name, expression in node.wiring.preconditions.items():
        yield f"  {name}: {expression}"
    for number, breakpoint_ in breakpoints.items():
        if breakpoint_.path == node.path:
            yield f"  breakpoint {number}: {breakpoint_.when}"
    if node.failure is not None:
        yield f"  failed in {node.failure.node}: {node.failure.cause}: {node.failure.message}"
        for key, value in node.failure.evidence.items():
            yield f"    {key}: {_value(value)}"
        for other in node.failure.attached:
            yield f"    attached: {other.node}: {other.cause}: {other.message}"
    elif node.feedback_message:
        yield f"  says: {node.feedback_message}"


def blackboard_lines(tree: Tree, part: str) -> Iterator[str]:
    """The keys that contain `part`, with their values; one alone is shown whole."""
    board = tree.blackboard
    keys = sorted(key for key in board if part in key)
    if not keys:
        yield f"no key contains {part!r}" if part else "nothing is written yet"
    for key in keys:
        value = board.read(key)
        yield f"{key} = {value!r}" if len(keys) == 1 else f"{key} = {_value(value)}"


def belief_lines(tree: Tree, part: str) -> Iterator[str]:
    """The objects whose id contains `part`, as the robot believes them."""
    world = tree.root.world
    objects = [o for o in world.scene.objects if part in o.id]
    if not objects:
        yield f"no object is called {part!r}" if part else "no object is known yet"
    for o in objects:
        yield belief_line(o, world.clock.now)


def breakpoint_lines(breakpoints: Mapping[int, Breakpoint]) -> Iterator[str]:
    if not breakpoints:
        yield "no breakpoints; `break PATH` sets one"
    for number, breakpoint_ in breakpoints.items():
        yield f"{number}: {breakpoint_.when} {breakpoint_.path}"


def _said(node: Node) -> str:
    failure = node.failure
    return f"{failure.cause}: {failure.message}" if failure is not None else node.feedback_message


def _now(node: Node, key: str) -> str:
    """What a port would read at this moment."""
    wired = node.wiring.ports.get(key)
    if wired is None:
        port = node.declaration.port(key)
        return f"{_value(port.default)} by default" if port is not None else ""
    if isinstance(wired, Constant):
        return _value(wired.value)
    try:
        return _value(node.wiring.namespace.read(wired, node.world.scene))
    except KeyError:
        return "(nothing is written there yet)"
    except Failure as failure:
        return f"({failure.message})"


def _read(node: Node, key: str) -> str:
    """What a port held when the node started."""
    try:
        return _value(node.input(key))
    except KeyError:
        return _now(node, key)


def _written(node: Node, key: str) -> str:
    try:
        return _value(node.written(key))
    except AttributeError:
        return "(not written)"


def _value(value: object) -> str:
    return str(value) if isinstance(value, Expression) else show(value)
