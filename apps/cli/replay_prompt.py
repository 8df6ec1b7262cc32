"""Prompt of `picktree replay`: moves to a tick, and views of it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal, TextIO, TypeAlias

from ...analysis.cursor import Cursor, Edge
from ...files.errors import PicktreeError
from ...files.node_patterns import find_node, find_nodes, short_names
from . import replay_views
from .command_prompt import Command, CommandPrompt
from .progress import tree_rows
from .state_text import blackboard_lines, tree_lines, where_lines

MAX_TREE_LINES = 18
"""Maximum number of tree lines shown after a move."""
MAX_CHANGE_LINES = 12
"""Maximum number of change lines shown after a move."""

TO = (
    "12.5, #250, start, end: that time in seconds, that tick; PATH, ITEM: its next start; PATH after: its "
    "next end; with back: the one before"
)

When: TypeAlias = Literal["before", "after"]


@dataclass(frozen=True, slots=True)
class ReplayBreakpoint:
    """Breakpoint of `continue`: at the start of a node, or at its end."""

    path: str
    when: When


class ReplayPrompt(CommandPrompt):
    """Prompt with commands on a cursor. `since` is the tick that was shown before."""

    def __init__(self, cursor: Cursor, read: Callable[[str], str], out: TextIO) -> None:
        super().__init__(read, out)
        self.cursor = cursor
        self.since: int | None = None
        self._breakpoints: dict[int, ReplayBreakpoint] = {}
        self._made = 0
        self.offer(
            Command("step [N]", "a tick on, or N", lambda n: self._step(n, 1)),
            Command("back [N]", "a tick back, or N", lambda n: self._step(n, -1)),
            Command("next", "to the next start or end of a node", lambda _: self._go_change(back=False), "n"),
            Command("previous", "to the one before", lambda _: self._go_change(back=True), "p"),
            Command("failure [back|N]", "to the next failure, the last, or number N", self._failure, "f"),
            Command("to WHERE", TO, self._to),
            Command("continue [back]", "to the next breakpoint, or the one before", self._continue, "c"),
            Command("break [PATH [before|after]]", "stop there; without PATH: list", self._break, "b"),
            Command("delete [NUMBER]", "a breakpoint, or all", self._delete),
            Command("show", "the tick at the cursor again, with the belief", self._show_all),
            Command("tree [PATH]", "all nodes with their statuses; PATH: those below it", self._show_tree),
            Command("where", "the nodes from the root to the one that runs", self._show_where),
            Command("node [PATH]", "a node: its ports, what it read, how it ended", self._show_node),
            Command("changes", "all that changed since the tick that was shown before", self._show_changes),
            Command("failures", "all failures of the run, with their numbers", self._show_failures),
            Command("evidence", "all that is known of the last failure", self._show_evidence),
            Command("blackboard [KEY]", "the keys that contain KEY, and values", self._show_blackboard),
            Command("belief [ID]", "the objects that the robot believed in", self._show_belief),
            Command("joints", "the arm's joints and the fingers", self._show_joints),
            Command("wrench", "the force and torque at the wrist", self._show_wrench),
            Command("quit", "end the replay", lambda _: True),
            Command("help [COMMAND]", "this", self.show_help),
        )  # fmt: skip

    def show_here(self, rows: int = MAX_TREE_LINES, news: int = MAX_CHANGE_LINES) -> None:
        """Show the cursor's place, the running nodes, and the changes."""
        cursor = self.cursor
        self._say(replay_views.place(cursor))
        shown = tree_rows(
            cursor.tree.nodes, replay_views.statuses(cursor), rows, replay_views.changed_paths(cursor)
        )
        self._show(f"  {row.plain}" for row in shown)
        self._show(replay_views.change_lines(cursor, cursor.changes(self.since), news))

    def arguments(self, command: str) -> Iterable[str]:
        match command:
            case "tree" | "node" | "break":
                return self._nodes()
            case "to":
                items = {visit.item for visit in self.cursor.run.account.visits if visit.item}
                return ["start", "end", *items, *self._nodes()]
            case "blackboard":
                return self.cursor.blackboard
            case "belief":
                scene = self.cursor.belief
                return [body.id for body in scene.bodies] if scene else ()
            case "delete":
                return map(str, self._breakpoints)
            case "failure":
                return ["back", *map(str, range(len(self.cursor.failures)))]
            case _:
                return super().arguments(command)

    def _nodes(self) -> list[str]:
        """Return all names of nodes: their paths, and unique ends of these."""
        names = short_names(node.path for node in self.cursor.run.nodes)
        return list(dict.fromkeys((*names, *names.values())))

    # Moves.

    def _moved(self, move: Callable[[], object]) -> bool:
        before = self.cursor.number
        move()
        self.since = before
        self.show_here()
        return False

    def _step(self, count: str, way: int) -> bool:
        if count and not (count.isdecimal() and int(count) > 0):
            raise PicktreeError(f"{count!r} is no number of ticks")
        return self._moved(lambda: self.cursor.step(way * int(count or 1)))

    def _go_change(self, *, back: bool) -> bool:
        return self._moved(lambda: self.cursor.next_change(back=back))

    def _failure(self, which: str) -> bool:
        if which.isdecimal():
            known = self.cursor.failures
            if int(which) >= len(known):
                raise PicktreeError(f"there is no failure {which}; `failures` lists them")
            return self._moved(lambda: self.cursor.to_tick(known[int(which)].last))
        if which not in ("", "back"):
            raise PicktreeError(f"failure {which}: write `failure`, `failure back`, or its number")
        return self._moved(lambda: self.cursor.next_failure(back=bool(which)))

    def _to(self, text: str) -> bool:
        cursor = self.cursor
        if not text:
            raise PicktreeError("to what? A time in seconds, #TICK, a node, an item, `start` or `end`")
        if text in ("start", "end"):
            return self._moved(lambda: cursor.to_tick(0 if text == "start" else len(cursor) - 1))
        if tick := re.fullmatch(r"#(\d+)", text):
            return self._moved(lambda: cursor.to_tick(int(tick[1])))
        if time := re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+) ?s?", text):
            return self._moved(lambda: cursor.to_time(float(time[1])))
        name, back = _without(text, "back")
        name, after = _without(name, "after")
        name, _ = _without(name, "before")
        if any(visit.item == name for visit in cursor.run.account.visits):
            return self._moved(lambda: cursor.next_item(name, back=back))
        edge: Edge = "end" if after else "begin"
        return self._moved(lambda: cursor.next_of(name, edge, back=back))

    def _continue(self, way: str) -> bool:
        if way not in ("", "back"):
            raise PicktreeError(f"continue {way}: write `continue` or `continue back`")
        if not self._breakpoints:
            raise PicktreeError("no breakpoints; `break PATH` sets one")
        return self._moved(lambda: self.cursor.next_stop(self._stops(), back=bool(way)))

    def _stops(self) -> frozenset[tuple[str, Edge]]:
        return frozenset(
            (b.path, "end" if b.when == "after" else "begin") for b in self._breakpoints.values()
        )

    # Breakpoints.

    def _break(self, text: str) -> bool:
        if not text:
            if not self._breakpoints:
                self._say("no breakpoints; `break PATH` sets one")
            return self._show(f"{n}: {b.when} {b.path}" for n, b in self._breakpoints.items())
        name, after = _without(text, "after")
        name, _ = _without(name, "before")
        when: When = "after" if after else "before"
        for node in find_nodes(name, self.cursor.run.nodes):
            self._made += 1
            self._breakpoints[self._made] = ReplayBreakpoint(node.path, when)
            self._say(f"{self._made}: {when} {node.path}")
        return False

    def _delete(self, number: str) -> bool:
        if number and not (number.isdecimal() and int(number) in self._breakpoints):
            raise PicktreeError(f"there is no breakpoint {number}; `break` lists them")
        for one in [int(number)] if number else list(self._breakpoints):
            del self._breakpoints[one]
        return False

    # Views.

    def _show_all(self, _: str) -> bool:
        self.show_here()
        return self._show(replay_views.believed_lines(self.cursor, ""))

    def _show_tree(self, path: str) -> bool:
        return self._show(
            tree_lines(
                replay_views.node_states(self.cursor),
                find_node(path, self.cursor.tree.nodes).path if path else "",
            )
        )

    def _show_where(self, _: str) -> bool:
        return self._show(
            where_lines(replay_views.node_states(self.cursor), replay_views.deepest(self.cursor))
        )

    def _show_node(self, path: str) -> bool:
        return self._show(replay_views.node_lines(self.cursor, path))

    def _show_changes(self, _: str) -> bool:
        return self._show(replay_views.change_lines(self.cursor, self.cursor.changes(self.since)))

    def _show_failures(self, _: str) -> bool:
        return self._show(replay_views.failure_list(self.cursor))

    def _show_evidence(self, _: str) -> bool:
        return self._show(replay_views.evidence_lines(self.cursor))

    def _show_blackboard(self, key: str) -> bool:
        return self._show(blackboard_lines(self.cursor.blackboard, key))

    def _show_belief(self, identity: str) -> bool:
        return self._show(replay_views.believed_lines(self.cursor, identity))

    def _show_joints(self, _: str) -> bool:
        return self._show(replay_views.joint_lines(self.cursor))

    def _show_wrench(self, _: str) -> bool:
        self._say(replay_views.wrench_line(self.cursor))
        return False


def _without(text: str, word: str) -> tuple[str, bool]:
    """Return the text without that word at its end, and whether it had it."""
    name, space, last = text.rpartition(" ")
    return (name, True) if space and last == word else (text, False)
