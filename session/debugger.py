"""Debugger: stops a tree before a node starts, after it ended, or between ticks; sets entries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final, Literal, Protocol, TypeAlias

from picktree.trees import BehaviourTree, show
from picktree.world import Plain, Tick, event_types

from .execution import Execution
from .observer import Observer

OPERATOR: Final = "operator"
"""Writer of an entry that the operator changed, in place of a node's path."""


@dataclass(frozen=True, slots=True)
class EntryChange:
    """Change of a blackboard entry."""

    key: str
    """Full key."""
    value: Plain
    passes: int
    """Number of starts and ends of nodes in the tick before the change; 0: it comes before the tick."""
    node: str = ""
    """Path of the node at which the run is stopped; empty between two ticks."""


def set_entry(tree: BehaviourTree, change: EntryChange) -> str:
    """Change a blackboard entry and note it in the journal; return what was done, as a sentence."""
    board, key = tree.blackboard, change.key
    previous = board.read(key) if key in board else None
    board.write(key, change.value, OPERATOR)
    before = f"was {show(previous)}" if previous is not None else "had no value"
    message = f"{key} is set to {show(change.value)} by the operator; it {before}"
    tree.root.world.journal.note(
        event_types.BlackboardSetEvent(
            message, change.node, key=key, value=change.value, previous=previous, passes=change.passes
        )
    )
    return message


When: TypeAlias = Literal["before", "after"]


@dataclass(frozen=True, slots=True)
class Breakpoint:
    """Stop before a node starts, or after it has ended or was halted."""

    path: str
    when: When


@dataclass(frozen=True, slots=True)
class DebuggerStop:
    """Place where the tree is stopped. `path` is empty between two ticks."""

    when: When | Literal["tick"]
    path: str = ""


class DebuggerPrompt(Protocol):
    """User interface at a stop. It inspects the tree, sets how the debugger continues, and returns."""

    def __call__(self, debugger: Debugger, stop: DebuggerStop) -> None: ...


class Debugger(Observer):
    """Stops at breakpoints and steps, called by tree and session. Simulated time is frozen during a stop.

    Only `set_entry` changes the run; otherwise a run is the same with and without it. An exception from the
    prompt ends the run like any other: KeyboardInterrupt interrupts it.
    """

    def __init__(
        self, prompt: DebuggerPrompt, *, at_start: bool = True, file_breakpoints: bool = True
    ) -> None:
        """`at_start`: also stop before the first node starts, so that breakpoints can be set.
        `file_breakpoints`: stop at the breakpoints of the mission's file, too."""
        self._prompt = prompt
        self._file_breakpoints = file_breakpoints
        self._tree: BehaviourTree | None = None
        self._breakpoints: dict[int, Breakpoint] = {}
        self._of_the_file: set[int] = set()
        self._number = 0
        self._ticks: int | None = None
        self._passes = 0
        self._next = at_start
        self._off = False

    # Called by the session.

    def started(self, run: Execution, folder: Path) -> None:
        self.attach(run.tree)

    def edited(self, run: Execution) -> None:
        self.follow(run.tree)

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        self.pause_after_tick()

    def attach(self, tree: BehaviourTree) -> None:
        """Observe the tree from its first tick on."""
        tree.on_start.insert(0, partial(self._pass, "before"))
        tree.on_end.insert(0, partial(self._pass, "after"))
        self.follow(tree)

    def follow(self, tree: BehaviourTree) -> None:
        """Follow another version of the mission: its breakpoints replace those of the former file."""
        self._tree = tree
        for number in self._of_the_file:
            self._breakpoints.pop(number, None)
        self._of_the_file.clear()
        for node in tree.nodes:
            if self._file_breakpoints and node.wiring.breakpoint is not None:
                self._of_the_file.add(self.add(node.path, node.wiring.breakpoint))

    def pause_after_tick(self) -> None:
        """Stop at the end of a tick, when the steps are over. Call it after each tick."""
        self._passes = 0
        if self._ticks is None:
            return
        self._ticks -= 1
        if self._ticks <= 0:
            self._stop(DebuggerStop("tick"))

    def _pass(self, when: When, path: str) -> None:
        self._passes += 1
        if self._next or Breakpoint(path, when) in self._breakpoints.values():
            self._stop(DebuggerStop(when, path))

    def _stop(self, stop: DebuggerStop) -> None:
        if self._off:
            return
        self._ticks, self._next = None, False
        self._prompt(self, stop)

    # Called by the prompt.

    @property
    def tree(self) -> BehaviourTree:
        assert self._tree is not None, "the session attaches the debugger before anything is ticked"
        return self._tree

    @property
    def breakpoints(self) -> Mapping[int, Breakpoint]:
        """Breakpoints by number."""
        return dict(self._breakpoints)

    def add(self, path: str, when: When = "before") -> int:
        """Add a breakpoint; return its number."""
        for number, known in self._breakpoints.items():
            if known == Breakpoint(path, when):
                return number
        self._number += 1
        self._breakpoints[self._number] = Breakpoint(path, when)
        return self._number

    def remove(self, number: int) -> bool:
        """Remove a breakpoint; return whether it existed."""
        self._of_the_file.discard(number)
        return self._breakpoints.pop(number, None) is not None

    def set_entry(self, key: str, value: Plain, path: str) -> str:
        """Change a blackboard entry, and note it in the log; return what was done, as a sentence.

        `key` is a full key, `path` the node at which the run is stopped; empty between two ticks. Nodes have
        the value when they read the key next."""
        return set_entry(self.tree, EntryChange(key, value, self._passes, path))

    def step(self, ticks: int = 1) -> None:
        """Continue to the end of a tick; inside a tick, to the end of the present one."""
        self._ticks = ticks

    def next(self) -> None:
        """Continue to the next start or end of any node."""
        self._next = True

    def turn_off(self) -> None:
        """Continue to the end of the run without another stop."""
        self._off = True
