"""Prompt of the debugger at the terminal during a run."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import TextIO

from picktree.files import Expression, PicktreeError, expression_syntax, find_node, find_nodes
from picktree.session import Breakpoint, Debugger, DebuggerStop, When
from picktree.trees import BehaviourTree, Node, NodeStatus, evaluate, references, runner, show
from picktree.world import Failure

from .command_prompt import (
    Command,
    CommandPrompt,
    complete_with,
    line_reader,
    tick_count,
)
from .state_text import (
    NodeRow,
    belief_lines,
    blackboard_lines,
    failure_lines,
    status_text,
    tree_lines,
    value_text,
    where_lines,
)


def breakpoint_place(text: str) -> tuple[str, When]:
    """Return the node and the side of `break PATH [before|after]`."""
    path, _, last = text.rpartition(" ")
    when: When = "after" if path and last == "after" else "before"
    return path if path and last in ("before", "after") else text, when


def breakpoint_lines(breakpoints: Mapping[int, Breakpoint]) -> Iterator[str]:
    if not breakpoints:
        yield "no breakpoints; `break PATH` sets one"
    for number, breakpoint_ in breakpoints.items():
        yield f"{number}: {breakpoint_.when} {breakpoint_.path}"


def breakpoint_numbers(text: str, known: Collection[int]) -> list[int]:
    """Return the breakpoints of `delete [NUMBER]`. Raises PicktreeError for an unknown one."""
    if text and not (text.isdecimal() and int(text) in known):
        raise PicktreeError(f"there is no breakpoint {text}; `break` lists them")
    return [int(text)] if text else list(known)


def place(tree: BehaviourTree, stop: DebuggerStop) -> str:
    now = f"{tree.root.world.clock.now:.2f} s"
    if not stop.path:
        return f"{now}, end of the tick; {deepest(tree).path} is {deepest(tree).state}"
    if stop.when == "before":
        return f"{now}, before {stop.path}"
    node = tree.find(stop.path)
    how = "was halted" if node.state is NodeStatus.IDLE else str(node.state)
    return f"{now}, after {stop.path}: {how}" + (f", {_status_text(node)}" if _status_text(node) else "")


def deepest(tree: BehaviourTree) -> Node:
    """Return the deepest running node; the root when none runs."""
    running = [node for node in tree.nodes if node.state is NodeStatus.RUNNING]
    return running[-1] if running else tree.root


def node_lines(node: Node, stop: DebuggerStop, breakpoints: Mapping[int, Breakpoint]) -> Iterator[str]:
    """Yield the state of one node, the values of its ports, and its failure."""
    yield f"{node.path}: {node.wiring.id}, {node.kind}, {node.state}"
    # A node that is about to start still has the inputs of its last activation.
    unread = node.state is NodeStatus.IDLE or stop == DebuggerStop("before", node.path)
    ports = {port.key: port for port in node.declaration.ports}
    for key in dict.fromkeys((*ports, *node.wiring.ports)):
        wired = node.wiring.ports.get(key)
        text = "" if wired is None or isinstance(wired, references.Constant) else f"{wired} "
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
        failure = node.failure
        yield from failure_lines(failure.node, failure.cause, failure.message, failure.evidence)
        for other in node.failure.attached:
            yield f"    attached: {other.node}: {other.cause}: {other.message}"
    elif node.feedback_message:
        yield f"  says: {node.feedback_message}"


def _status_text(node: Node) -> str:
    failure = node.failure
    return status_text(failure.cause, failure.message) if failure is not None else node.feedback_message


def _now(node: Node, key: str) -> str:
    """Return the value that a port would read now."""
    wired = node.wiring.ports.get(key)
    if wired is None:
        port = node.declaration.port(key)
        return f"{value_text(port.default)} by default" if port is not None else ""
    if isinstance(wired, references.Constant):
        return value_text(wired.value)
    try:
        if isinstance(wired, references.Reference):
            return value_text(node.wiring.namespace.read(wired, node.world.scene))
        return value_text(evaluate(wired.value, node.wiring.namespace, node.world))
    except KeyError:
        return "(nothing is written there yet)"
    except Failure as failure:
        return f"({failure.message})"


def _read(node: Node, key: str) -> str:
    """Return the value that a port had at the node's start."""
    try:
        return value_text(node.input(key))
    except KeyError:
        return _now(node, key)


def _written(node: Node, key: str) -> str:
    try:
        return value_text(node.written(key))
    except AttributeError:
        return "(not written)"


class DebugPrompt(CommandPrompt):
    """Prompt that reads commands at a stop until one of them continues the run.

    At the end of the input the run continues without another stop, so that a script need not request it. An
    empty line repeats the last command.
    """

    def __init__(self, read: Callable[[str], str], out: TextIO) -> None:
        super().__init__(read, out)
        self._stop = DebuggerStop("tick")
        self._debugger: Debugger | None = None
        self.offer(
            Command(
                "tree [PATH]",
                "the nodes with their statuses; with PATH, only the nodes below it",
                self._show_tree,
            ),
            Command("where", "the nodes from the root to the stopped one", self._show_where),
            Command("node [PATH]", "a node: its ports, status, failure", self._show_node),
            Command(
                "blackboard [KEY]", "the keys that contain KEY, with their values", self._show_blackboard
            ),
            Command("belief [ID]", "the objects that the robot believes in", self._show_belief),
            Command(
                "print EXPRESSION", "the expression's value, as the stopped node reads it", self._print, "p"
            ),
            Command(
                "set KEY = VALUE",
                "change a blackboard entry: a value as in a mission, or {= expression}",
                self._set,
            ),
            Command("step [N]", "continue to the end of the tick, or of N ticks", self._step, "s"),
            Command("next", "continue to the next start or end of a node", self._next, "n"),
            Command("continue", "continue to the next breakpoint", lambda _: True),
            Command(
                "break [PATH [before|after]]", "set a breakpoint; without PATH, list all", self._break, "b"
            ),
            Command("delete [NUMBER]", "delete a breakpoint, or all", self._delete),
            Command("quit", "interrupt the run", self._quit),
            Command("help [COMMAND]", "show this help", self.show_help),
        )

    def __call__(self, debugger: Debugger, stop: DebuggerStop) -> None:
        self._debugger, self._stop = debugger, stop
        self._say(place(debugger.tree, stop))
        if not self.converse():
            self._say("the input ends here: the run continues without another stop")
            debugger.turn_off()

    def arguments(self, command: str) -> Iterable[str]:
        if self._debugger is None:
            return ()
        match command:
            case "tree" | "node" | "break":
                return [node.path for node in self._tree.nodes]
            case "blackboard" | "set":
                return self._tree.blackboard
            case "belief":
                return [str(o.id) for o in self._tree.root.world.scene.objects]
            case "delete":
                return map(str, self._debugger.breakpoints)
            case _:
                return super().arguments(command)

    @property
    def _tree(self) -> BehaviourTree:
        return self._debug.tree

    @property
    def _debug(self) -> Debugger:
        assert self._debugger is not None
        return self._debugger

    def carry_out(self, line: str) -> bool:
        try:
            return super().carry_out(line)
        except Exception as error:  # noqa: BLE001 - whatever is wrong with a view must not reach the run
            self._say(f"`{line}` failed: {type(error).__name__}: {error}")
        return False

    # Views.

    def _show_tree(self, path: str) -> bool:
        top = self._one(path) if path else self._tree.root
        return self._show(tree_lines(self._nodes, top.path, self._stop.path))

    def _show_where(self, _: str) -> bool:
        return self._show(where_lines(self._nodes, self._here.path))

    def _show_node(self, path: str) -> bool:
        node = self._one(path) if path else self._here
        return self._show(node_lines(node, self._stop, self._debug.breakpoints))

    def _show_blackboard(self, key: str) -> bool:
        board = {each: self._tree.blackboard.read(each) for each in self._tree.blackboard}
        return self._show(blackboard_lines(board, key))

    def _show_belief(self, identity: str) -> bool:
        world = self._tree.root.world
        return self._show(belief_lines(world.scene.objects, identity, world.clock.now))

    def _print(self, text: str) -> bool:
        if not text:
            raise PicktreeError("print what? An expression, as 'items_left and not holding'")
        try:
            expression = Expression.parse(text)
            value = evaluate(expression, self._here.wiring.namespace, self._here.world)
        except expression_syntax.ExpressionError as error:
            raise PicktreeError(f"{error}, at character {error.offset + 1} of {text!r}") from None
        except Failure as failure:
            raise PicktreeError(failure.message) from None
        return self._show([show(value)])

    def _set(self, text: str) -> bool:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise PicktreeError("set what? A key and its value, as 'set rounds = 3'")
        key = runner.entry_key(self._tree, name, self._here)
        value = runner.entry_value(self._tree, key, value, self._here)
        return self._show([self._debug.set_entry(key, value, self._stop.path)])

    @property
    def _here(self) -> Node:
        return self._tree.find(self._stop.path) if self._stop.path else deepest(self._tree)

    # Continuation.

    def _step(self, count: str) -> bool:
        self._debug.step(tick_count(count))
        return True

    def _next(self, _: str) -> bool:
        self._debug.next()
        return True

    def _quit(self, _: str) -> bool:
        raise KeyboardInterrupt

    # Breakpoints.

    def _break(self, text: str) -> bool:
        if not text:
            return self._show(breakpoint_lines(self._debug.breakpoints))
        name, when = breakpoint_place(text)
        for node in find_nodes(name, self._nodes):
            number = self._debug.add(node.path, when)
            self._say(f"{number}: {when} {node.path}")
        return False

    def _delete(self, number: str) -> bool:
        for one in breakpoint_numbers(number, self._debug.breakpoints):
            self._debug.remove(one)
        return False

    # Nodes by name.

    def _one(self, text: str) -> Node:
        return self._tree.find(find_node(text, self._nodes).path)

    @property
    def _nodes(self) -> Sequence[NodeRow]:
        return [
            NodeRow(node.path, node.name, node.wiring.id, str(node.state), _status_text(node))
            for node in self._tree.nodes
        ]


def debug_prompt(out: TextIO) -> DebugPrompt:
    prompt = DebugPrompt(line_reader(out), out)
    if sys.stdin.isatty():
        complete_with(prompt)
    return prompt
