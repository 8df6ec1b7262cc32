"""Stepper of `picktree replay`: a run's ticks one by one, to a time or to a failure, as lines of text."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TextIO

from picktree.analysis import Run
from picktree.files import PicktreeError
from picktree.logs import node_visits
from picktree.trees import show
from picktree.world import NodeState, known_causes, remedy_of

from .command_prompt import Command, CommandPrompt, tick_count
from .state_text import NodeRow, belief_lines, blackboard_lines, status_text, tree_lines, tree_rows

_MAX_TREE_LINES = 18
"""Maximum number of tree lines shown after a move."""
_MAX_EVENTS = 8
"""Maximum number of events shown after a move."""


class ReplayStepper(CommandPrompt):
    """Prompt with commands on the ticks of a run. It begins at the tick of the time `at` (simulated s)."""

    def __init__(self, run: Run, at: float, read: Callable[[str], str], out: TextIO) -> None:
        super().__init__(read, out)
        self._run, self._number = run, run.ticks.number_at(at)
        failed = [visit for visit in run.account.visits if visit.failed_itself]
        self._failures = sorted(failed, key=lambda visit: (visit.last, -visit.path.count("/")))
        """Visits that failed by themselves, in the order of the failures, within a tick the deepest first."""
        self.offer(
            Command("next [N]", "go one tick forward, or N ticks", lambda n: self._step(tick_count(n)), "n"),
            Command("previous [N]", "go one tick back, or N "
            "ticks", lambda n: self._step(-tick_count(n)), "p"),
            Command("to TIME", "go to a time of the run, as 12.5; `to end`: go to its end", self._to),
            Command("failure [back]", "go to the next failure, or back to the previous one; show its "
            "evidence",
                    self._failure, "f"),
            Command("show", "show this tick again", lambda _: self.show_here()),
            Command("tree", "all nodes with their statuses", lambda _: self._show(tree_lines(self._rows()))),
            Command("events", "all events up to this tick", lambda _: self._show(self._events())),
            Command("blackboard [KEY]", "the keys that contain KEY, and values",
                    lambda key: self._show(blackboard_lines(run.blackboard_at(self._time), key))),
            Command("belief [ID]", "the objects that the robot believed in", self._belief),
            Command("quit", "end the replay", lambda _: True),
            Command("help [COMMAND]", "show this help", self.show_help),
        )  # fmt: skip

    @property
    def _time(self) -> float:
        """Time of the present tick, simulated s."""
        return self._run.ticks.times[self._number]

    def show_here(self) -> bool:
        """Show the tick: its number and time, the running nodes, the last events."""
        tick = self._run.ticks[self._number].record
        self._say(f"{self._time:.2f} s, tick {self._number} of 0 … {len(self._run.ticks) - 1}")
        changed = {edge.path for edge in tick.edges}
        self._show(f"  {row.plain}" for row in tree_rows(self._rows(), _MAX_TREE_LINES, changed))
        return self._show(list(self._events())[-_MAX_EVENTS:])

    def _rows(self) -> list[NodeRow]:
        """Return the nodes of the tree with their statuses."""
        known = {node.path: node for node in self._run.ticks[self._number].record.nodes}
        rows: list[NodeRow] = []
        for node in self._run.tree_at(self._time).nodes:
            one = known.get(node.path) or NodeState(node.path, node.id, "IDLE", ticked=False)
            rows.append(
                NodeRow(node.path, node.name, node.id, one.status, status_text(one.cause, one.message))
            )
        return rows

    def _events(self) -> Iterator[str]:
        for at in self._run.events:
            if at.time <= self._time + 1e-6:
                yield f"{at.time:9.2f} s  {at.record.kind}: {at.record.message}"

    def _belief(self, part: str) -> bool:
        scene = self._run.log.belief_at(self._time)
        return self._show(belief_lines(scene.record.bodies if scene else (), part, self._time))

    def _step(self, ticks: int) -> bool:
        """Go by that number of ticks, at most to an end of the log."""
        target = min(max(self._number + ticks, 0), len(self._run.ticks) - 1)
        if target == self._number:
            raise PicktreeError("this is the last tick" if ticks > 0 else "this is the first tick")
        self._number = target
        return self.show_here()

    def _to(self, text: str) -> bool:
        end = self._run.ticks.times[-1]
        self._number = self._run.ticks.number_at(end if text == "end" else _seconds(text))
        return self.show_here()

    def _failure(self, which: str) -> bool:
        if which not in ("", "back"):
            raise PicktreeError(f"failure {which}: write `failure` or `failure back`")
        if which:
            before = [visit for visit in self._failures if visit.last < self._number]
            found = next((visit for visit in before if visit.last == before[-1].last), None)
        else:
            found = next((visit for visit in self._failures if visit.last > self._number), None)
        if found is None:
            raise PicktreeError(f"there is no failure {'before' if which else 'after'} {self._time:.2f} s")
        self._number = found.last
        self.show_here()
        return self._show(evidence_lines(found))


def evidence_lines(visit: node_visits.Visit) -> Iterator[str]:
    """Yield the cause, message, remedy, inputs and evidence of a failure."""
    yield f"{visit.path}{visit.about} failed: {visit.cause}: {visit.message}"
    cause = known_causes().get(visit.cause)
    if cause is not None:
        yield f"  remedy: {remedy_of(cause, visit.evidence)}"
    yield f"  began at {visit.start:.2f} s"
    yield from (f"  read {port} = {show(value)}" for port, value in visit.inputs.items())
    for name, value in visit.evidence.items():
        lines = value.splitlines() if isinstance(value, str) and "\n" in value else [show(value)]
        yield f"  {name}: {lines[0]}"
        yield from (f"    {line}" for line in lines[1:])


def _seconds(text: str) -> float:
    try:
        return float(text.removesuffix("s"))
    except ValueError:
        raise PicktreeError(f"to {text or '?'}: write a time in seconds, as `to 12.5`, or `to end`") from None
