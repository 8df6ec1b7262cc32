"""The prompt of `picktree run --debug`: look, step, go on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TextIO

from ...analysis.replay.node_names import fitting, one_fitting
from ...errors import PicktreeError
from ...files.expressions.expression import Expression, ExpressionError
from ...trees.node import Node
from ...trees.running.debugger import Debugger, Stop, When
from ...trees.running.runner import Tree
from ...trees.runtime import evaluate
from ...trees.values.port_types import show
from ...world.causes import Failure
from ..terminal.command_prompt import Command, Prompt
from . import debugger_views as views


@dataclass(frozen=True, slots=True)
class _Named:
    """A node by what it may be called."""

    path: str
    name: str
    id: str


class DebugPrompt(Prompt):
    """Reads commands at a stop until one of them lets the run go on.

    At the end of the input the run goes on without another stop, so that a script need not say so. An
    empty line repeats the last command.
    """

    def __init__(self, read: Callable[[str], str], out: TextIO) -> None:
        super().__init__(read, out)
        self._stop = Stop("tick")
        self._debugger: Debugger | None = None
        self.offer(
            Command("tree [PATH]", "the nodes with their statuses; PATH: those below it", self._show_tree),
            Command("where", "the nodes from the root to where the run stands", self._show_where),
            Command("node [PATH]", "a node: its ports, status, failure", self._show_node),
            Command(
                "blackboard [KEY]", "the keys that contain KEY, with their values", self._show_blackboard
            ),
            Command("belief [ID]", "the objects that the robot believes in", self._show_belief),
            Command("print EXPRESSION", "its value, as a node sees it where the run stands", self._print),
            Command("step [N]", "to the end of the present or next tick, of N ticks", self._step),
            Command("next", "to the next start or end of a node", self._next, "n"),
            Command("continue", "to the next breakpoint", lambda _: True),
            Command("break [PATH [before|after]]", "stop there; without PATH: list", self._break, "b"),
            Command("delete [NUMBER]", "a breakpoint, or all", self._delete),
            Command("quit", "interrupt the run", self._quit),
            Command("help [COMMAND]", "this", self.show_help),
        )

    def __call__(self, debugger: Debugger, stop: Stop) -> None:
        self._debugger, self._stop = debugger, stop
        self._say(views.place(debugger.tree, stop))
        if not self.converse():
            self._say("the input ends here: the run goes on without another stop")
            debugger.turn_off()

    def arguments(self, command: str) -> Iterable[str]:
        if self._debugger is None:
            return ()
        match command:
            case "tree" | "node" | "break":
                return [node.path for node in self._tree.nodes]
            case "blackboard":
                return self._tree.blackboard
            case "belief":
                return [str(o.id) for o in self._tree.root.world.scene.objects]
            case "delete":
                return map(str, self._debugger.breakpoints)
            case _:
                return super().arguments(command)

    @property
    def _tree(self) -> Tree:
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

    # Looking.

    def _show_tree(self, path: str) -> bool:
        top = self._one(path) if path else self._tree.root
        return self._show(views.tree_lines(self._tree, top, self._stop))

    def _show_where(self, _: str) -> bool:
        return self._show(views.where_lines(self._tree, self._stop))

    def _show_node(self, path: str) -> bool:
        node = self._one(path) if path else self._here
        return self._show(views.node_lines(node, self._stop, self._debug.breakpoints))

    def _show_blackboard(self, key: str) -> bool:
        return self._show(views.blackboard_lines(self._tree, key))

    def _show_belief(self, identity: str) -> bool:
        return self._show(views.belief_lines(self._tree, identity))

    def _print(self, text: str) -> bool:
        if not text:
            raise PicktreeError("print what? An expression, as 'items_left and not holding'")
        try:
            expression = Expression.parse(text)
            value = evaluate(expression, self._here.wiring.namespace, self._here.world)
        except ExpressionError as error:
            raise PicktreeError(f"{error}, at character {error.offset + 1} of {text!r}") from None
        except Failure as failure:
            raise PicktreeError(failure.message) from None
        return self._show([show(value)])

    @property
    def _here(self) -> Node:
        return self._tree.find(self._stop.path) if self._stop.path else views.deepest(self._tree)

    # Going on.

    def _step(self, count: str) -> bool:
        if count and not (count.isdecimal() and int(count) > 0):
            raise PicktreeError(f"{count!r} is no number of ticks")
        self._debug.step(int(count or 1))
        return True

    def _next(self, _: str) -> bool:
        self._debug.next()
        return True

    def _quit(self, _: str) -> bool:
        raise KeyboardInterrupt

    # Breakpoints.

    def _break(self, text: str) -> bool:
        if not text:
            return self._show(views.breakpoint_lines(self._debug.breakpoints))
        path, _, last = text.rpartition(" ")
        when: When = "after" if last == "after" else "before"
        nodes = self._fitting(path if path and last in ("before", "after") else text)
        for node in nodes:
            number = self._debug.add(node.path, when)
            self._say(f"{number}: {when} {node.path}")
        return False

    def _delete(self, number: str) -> bool:
        known = self._debug.breakpoints
        if number and not (number.isdecimal() and int(number) in known):
            raise PicktreeError(f"there is no breakpoint {number}; `break` lists them")
        for one in [int(number)] if number else list(known):
            self._debug.remove(one)
        return False

    # Nodes by name.

    def _one(self, text: str) -> Node:
        return self._tree.find(one_fitting(text, self._names).path)

    def _fitting(self, text: str) -> Sequence[Node]:
        return [self._tree.find(named.path) for named in fitting(text, self._names)]

    @property
    def _names(self) -> Sequence[_Named]:
        return [_Named(node.path, node.name, node.wiring.id) for node in self._tree.nodes]
