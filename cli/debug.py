"""The prompt of `picktree run --debug`: look, step, go on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TextIO

from ..trees.debugger import Debugger, Stop, When
from ..trees.node import Node
from ..trees.runner import Tree
from ..trees.runtime import evaluate
from ..trees.types import show
from ..world.causes import Failure
from ..world.errors import PicktreeError
from ..world.files.expressions import Expression, ExpressionError
from ..world.files.nearest import nearest
from . import debug_views as views

PROMPT = "(picktree) "
_MOST = 10
"""Nodes that are named when several fit."""


@dataclass(frozen=True, slots=True)
class Command:
    """What may be typed; `run` answers whether the run goes on then."""

    usage: str
    help: str
    run: Callable[[str], bool]
    short: str = ""


class DebugPrompt:
    """Reads commands at a stop until one of them lets the run go on.

    At the end of the input the run goes on without another stop, so that a script need not say so. An
    empty line repeats the last command.
    """

    def __init__(self, read: Callable[[str], str], out: TextIO) -> None:
        """`read` shows a prompt and gives a line; it raises EOFError at the end of the input."""
        self._read, self._out = read, out
        self._last = ""
        self._stop = Stop("tick")
        self._debugger: Debugger | None = None
        listed = (
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
            Command("help [COMMAND]", "this", self._help),
        )
        self._commands = {command.usage.split()[0]: command for command in listed}

    def __call__(self, debugger: Debugger, stop: Stop) -> None:
        self._debugger, self._stop = debugger, stop
        self._say(views.place(debugger.tree, stop))
        while True:
            try:
                line = self._read(PROMPT).strip() or self._last
            except EOFError:
                self._say("the input ends here: the run goes on without another stop")
                debugger.turn_off()
                return
            self._last = line
            if line and self._carry_out(line):
                return

    def completions(self, line: str) -> list[str]:
        """What the last word of a line may become."""
        word, _, rest = line.lstrip().partition(" ")
        if not rest and not line.endswith(" "):
            return [f"{name} " for name in self._commands if name.startswith(word)]
        if self._debugger is None:
            return []
        last = rest.split(" ")[-1]
        known: Iterable[str] = ()
        match self._meant(word):
            case ["tree" | "node" | "break"]:
                known = [node.path for node in self._tree.nodes]
            case ["blackboard"]:
                known = self._tree.blackboard
            case ["belief"]:
                known = [str(o.id) for o in self._tree.root.world.scene.objects]
            case ["delete"]:
                known = map(str, self._debugger.breakpoints)
            case ["help"]:
                known = self._commands
            case _:
                pass
        return sorted(text for text in known if text.startswith(last))

    @property
    def _tree(self) -> Tree:
        return self._debug.tree

    @property
    def _debug(self) -> Debugger:
        assert self._debugger is not None
        return self._debugger

    def _carry_out(self, line: str) -> bool:
        word, _, rest = line.partition(" ")
        name = self._named(word)
        if not name:
            return False
        try:
            return self._commands[name].run(rest.strip())
        except PicktreeError as error:
            self._say(str(error))
        except Exception as error:  # noqa: BLE001 - whatever is wrong with a view must not reach the run
            self._say(f"`{line}` failed: {type(error).__name__}: {error}")
        return False

    def _named(self, word: str) -> str:
        """The command that a word or its beginning means; empty, and said, when none or several do."""
        fitting = self._meant(word)
        if len(fitting) == 1:
            return fitting[0]
        if fitting:
            self._say(f"{word!r} may be {', '.join(fitting)}")
        else:
            hint = nearest(word, self._commands)
            hint = hint if hint.startswith("did you mean") else "`help` lists the commands"
            self._say(f"no command {word!r} ({hint})")
        return ""

    def _meant(self, word: str) -> list[str]:
        """The commands that a word or its beginning may mean."""
        exact = [name for name, command in self._commands.items() if word in (name, command.short)]
        return exact or [name for name in self._commands if name.startswith(word)]

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

    def _help(self, word: str) -> bool:
        name = self._named(word) if word else ""
        if word and not name:
            return False
        wanted = [self._commands[name]] if name else list(self._commands.values())
        width = max(len(command.usage) for command in wanted)
        lines = [f"{command.usage:<{width}}  {command.help}" for command in wanted]
        if not word:
            lines.append(
                "A command may be shortened; an empty line repeats the last. PATH may be the end of one."
            )
        return self._show(lines)

    # Nodes by name.

    def _one(self, text: str) -> Node:
        nodes = self._fitting(text)
        if len(nodes) > 1:
            named = ", ".join(node.path for node in nodes[:_MOST]) + (", …" if len(nodes) > _MOST else "")
            raise PicktreeError(f"{len(nodes)} nodes fit {text!r}: {named}")
        return nodes[0]

    def _fitting(self, text: str) -> Sequence[Node]:
        """The nodes of that path, or with a path that ends so, or of that type. Raises PicktreeError."""
        nodes = self._tree.nodes
        for fits in (
            [node for node in nodes if node.path == text],
            [node for node in nodes if node.path.endswith(f"/{text}")],
            [node for node in nodes if node.wiring.id == text],
        ):
            if fits:
                return fits
        hint = nearest(text, [*(node.name for node in nodes), *(node.path for node in nodes)])
        raise PicktreeError(f"no node fits {text!r}" + (f" ({hint})" if hint.startswith("did") else ""))

    def _show(self, lines: Iterable[str]) -> bool:
        for line in lines:
            self._say(line)
        return False

    def _say(self, text: str) -> None:
        print(text, file=self._out, flush=True)
