"""Profiler: observer that measures where CPU and simulated time of a run go, by node and by part.

It wraps nodes, the simulation's step and the waits of the robot when a run starts. A run without it has none
of these wrappers, and one with it has the same digest.

The profile is written as text and as a speedscope file.
"""

from __future__ import annotations

import os
import threading
import time
from array import array
from collections import Counter, defaultdict
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import wraps
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final, TypeAlias, cast

import orjson

from picktree.files import PicktreeError
from picktree.logs import RunResult
from picktree.robot.control import HoldController
from picktree.trees import BehaviourTree, Node, NodeStatus, TickReport
from picktree.world import PartFollower

from .execution import Execution
from .observer import Observer

Stack: TypeAlias = tuple[int, ...]
"""Frames by number, the outermost first."""
NODES_PART: Final = "nodes"
"""Part of the work of the nodes' own code: control nodes, conditions, and skills outside of other parts."""
_SCHEMA: Final = "https://www.speedscope.app/file-format-schema.json"
_LEAST_SHARE: Final = 0.005
"""Share of CPU and of simulated time below which the text leaves out a node."""
_MAX_COLUMNS: Final = 6
"""Maximum number of parts with a column of their own in the table of nodes."""


@dataclass(frozen=True, slots=True)
class Frame:
    """Node of the tree, or part of the work."""

    name: str
    path: str = ""
    """Path of the node; empty for a part."""


class TimeLine:
    """Time spent by one thread, or simulated time, in chronological order of its segments.

    Within a segment the time of each stack is added up: a segment is as fine as the file gets.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.totals: defaultdict[Stack, float] = defaultdict(float)
        """Seconds of each stack, frames within it excluded."""
        self.end = 0.0
        """Seconds in all, those of the present segment excluded."""
        self._segment: dict[Stack, float] = {}
        self._open: Stack = ()
        self._times, self._changes = array("d"), array("l")

    def spend(self, stack: Stack, seconds: float) -> None:
        """Add seconds to a stack in the present segment."""
        self._segment[stack] = self._segment.get(stack, 0.0) + seconds

    def end_segment(self) -> None:
        """End the present segment; its stacks follow each other in the order of their frames."""
        for stack in sorted(self._segment):
            seconds = self._segment[stack]
            self._go_to(stack)
            self.totals[stack] += seconds
            self.end += seconds
        self._segment.clear()

    def finish(self) -> None:
        """End the last segment and close all frames."""
        self.end_segment()
        self._go_to(())

    def _go_to(self, stack: Stack) -> None:
        shared = 0
        for before, now in zip(self._open, stack, strict=False):
            if before != now:
                break
            shared += 1
        for frame in reversed(self._open[shared:]):
            self._times.append(self.end)
            self._changes.append(~frame)
        for frame in stack[shared:]:
            self._times.append(self.end)
            self._changes.append(frame)
        self._open = stack

    def to_plain(self, name: str) -> dict[str, Any]:
        """Return the evented profile of the speedscope format, under a name."""
        changes = zip(self._times, self._changes, strict=True)
        return {
            "type": "evented",
            "name": name,
            "unit": "seconds",
            "startValue": 0,
            "endValue": round(self.end, 7),
            "events": [
                {"type": "O" if frame >= 0 else "C", "frame": max(frame, ~frame), "at": round(at, 7)}
                for at, frame in changes
            ],
        }


@dataclass(frozen=True)
class NodeCost:
    """Figures of one node, its descendants included."""

    path: str
    starts: int
    simulated: float
    """Simulated time while the node was RUNNING, s."""
    parts: Mapping[str, float]
    """CPU seconds by part, while the node was ticked and while time passed for it."""

    @property
    def cpu(self) -> float:
        """CPU seconds of all parts."""
        return sum(self.parts.values())


@dataclass(frozen=True)
class RunProfile:
    """Profile of a finished run."""

    title: str
    frames: Sequence[Frame]
    threads: Sequence[TimeLine]
    """CPU time by thread; the first is the main thread."""
    simulated: Sequence[TimeLine]
    """Simulated time: that of the first running leaf, then of leaves that run beside it."""
    starts: Mapping[str, int]
    """Number of starts by node path."""
    running: Mapping[str, float]
    """Simulated seconds RUNNING by node path, in the order of the tree."""

    @property
    def cpu_parts(self) -> Mapping[str, float]:
        """CPU seconds of the main thread by part."""
        return self._parts(self.threads[0])

    @property
    def simulated_parts(self) -> Mapping[str, float]:
        """Simulated seconds by the activity of the robot."""
        return self._parts(self.simulated[0])

    def nodes(self) -> tuple[NodeCost, ...]:
        """Return the figures of each node, parents first. A node that was never ticked is left out."""
        spent = {path: defaultdict[str, float](float) for path in self.running}
        for stack, seconds in self.threads[0].totals.items():
            part = self._part(stack)
            for number in stack:
                if path := self.frames[number].path:
                    spent[path][part] += seconds
        return tuple(
            NodeCost(path, self.starts.get(path, 0), self.running[path], parts)
            for path, parts in spent.items()
            if parts
        )

    def to_text(self) -> str:
        """Return the tables for a terminal, without a trailing newline."""
        cpu = sum(line.end for line in self.threads)
        others = {line.name: line.end for line in self.threads[1:]}
        lines = [
            f"profile     {self.title}",
            f"CPU time    {cpu:.2f} s of all threads, start of the program included",
            *_shares({**self.cpu_parts, **others}, cpu),
            f"simulated   {self.simulated[0].end:.2f} s, by what the robot does",
            *_shares(self.simulated_parts, self.simulated[0].end),
            *self._node_lines(),
        ]
        return "\n".join(lines)

    def write(self, file: Path) -> None:
        """Write the profile for speedscope. Raises PicktreeError when the disk refuses."""
        plain = {
            "$schema": _SCHEMA,
            "name": self.title,
            "exporter": "picktree",
            "activeProfileIndex": 0,
            "shared": {
                "frames": [
                    {"name": frame.name, "file": frame.path} if frame.path else {"name": frame.name}
                    for frame in self.frames
                ]
            },
            "profiles": [
                *(line.to_plain(f"CPU time, {line.name}") for line in self.threads),
                *(line.to_plain(line.name) for line in self.simulated),
            ],
        }
        try:
            file.write_bytes(orjson.dumps(plain))
        except OSError as error:
            raise PicktreeError(f"{file}: the profile cannot be written: {error.strerror}") from None

    def _part(self, stack: Stack) -> str:
        frame = self.frames[stack[-1]]
        return NODES_PART if frame.path else frame.name

    def _parts(self, line: TimeLine) -> dict[str, float]:
        found: defaultdict[str, float] = defaultdict(float)
        for stack, seconds in line.totals.items():
            found[self._part(stack)] += seconds
        return found

    def _node_lines(self) -> Iterator[str]:
        """Yield the table of nodes with a column for each of the dearest parts."""
        nodes = self.nodes()
        simulated, cpu = self.simulated[0].end, max((node.cpu for node in nodes), default=0.0)
        shown = [
            node
            for node in nodes
            if node.cpu >= _LEAST_SHARE * cpu or node.simulated >= _LEAST_SHARE * simulated
        ]
        parts: Mapping[str, float] = nodes[0].parts if nodes else {}
        columns = sorted(parts, key=lambda part: -parts[part])[:_MAX_COLUMNS]
        rows: list[tuple[str, ...]] = [("node", "starts", "simulated s", "CPU s", *columns, "other")]
        for node in shown:
            name = "  " * node.path.count("/") + node.path.rpartition("/")[2]
            own = [node.parts.get(part, 0.0) for part in columns]
            figures = (node.simulated, node.cpu, *own, max(node.cpu - sum(own), 0.0))
            rows.append((name, str(node.starts), *(f"{seconds:.2f}" for seconds in figures)))
        widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
        for name, *figures in rows:
            yield "  ".join((name.ljust(widths[0]), *map(str.rjust, figures, widths[1:])))
        if hidden := len(nodes) - len(shown):
            yield f"{hidden} more nodes, each below {_LEAST_SHARE:.1%} of both times"


def require_writable(file: Path) -> None:
    """Raise PicktreeError when the file of a profile cannot be written, before a run begins."""
    folder = file.absolute().parent
    if file.is_dir():
        raise PicktreeError(f"{file}: the profile cannot be written: it is a folder")
    if not folder.is_dir():
        raise PicktreeError(f"{file}: the profile cannot be written: there is no folder {folder}")
    if not os.access(file if file.exists() else folder, os.W_OK):
        raise PicktreeError(f"{file}: the profile cannot be written: permission denied")


def _shares(parts: Mapping[str, float], total: float) -> Iterator[str]:
    """Yield a line for each part, the dearest first."""
    for name, seconds in sorted(parts.items(), key=lambda item: -item[1]):
        share = seconds / total if total else 0.0
        yield f"  {name:<24}{seconds:8.2f} s {share:7.1%}"


_PART_NAMES: Final = {"tree": "ticking", "logging": "recording"}
"""Names of the stopwatch's parts in a profile, where they differ."""
_SEGMENT: Final = 1.0
"""Longest segment of a profile, simulated s."""
_THREAD_CPU_CLOCK: Final = 6
"""Bits of Linux' clock id of one thread's CPU time; the others are the complement of the thread's id."""
_LEAST_THREAD_TIME: Final = 1e-3
"""CPU time from which another thread is part of a profile, s."""
_WAITS: Final = (
    ("thinking", ("charge",), "perception"),
    ("plan", ("charge",), "planning"),
    ("control", ("settle",), "settling"),
    ("gripper", ("open", "release", "close", "move", "sound"), "gripper"),
)
"""Generators of the world in which simulated time passes: attribute, methods, activity of the robot.

Planning calls the generator of thinking; the outer one counts.
"""


class Profiler(Observer, PartFollower):
    """Observer that profiles one run. CPU time between ticks counts for the first running leaf."""

    def __init__(self, *, whole_program: bool = False) -> None:
        """`whole_program`: the program's start belongs to the profile; else it begins here."""
        self._profile: RunProfile | None = None
        self._frames: list[Frame] = []
        self._numbers: dict[Frame, int] = {}
        self._main = TimeLine("main thread")
        self._others = _OtherThreads(whole_program=whole_program)
        self._simulated = [TimeLine("simulated time")]
        self._session = (self._frame("session"),)
        self._stack: Stack = self._session
        self._outer: list[Stack] = []
        self._since = time.thread_time()
        if whole_program:
            self._main.spend((self._frame("start of the program"),), self._since)
        self._wrapped = ExitStack()
        """Removal of the wrappers."""
        self._stacks: dict[str, Stack] = {}
        """Stack of each node by its path."""
        self._leaves: tuple[Stack, ...] = ()
        """Stacks of the running leaves, in the order of the tree."""
        self._waits: list[str] = []
        """Activities in whose generators the tree is suspended, the outermost first."""
        self._activity = self._frame("rest")
        """Activity of the robot from the last tick on."""
        self._ticked = self._segment_began = 0.0
        self._starts: Counter[str] = Counter()
        self._running: dict[str, float] = {}
        self._passing: tuple[tuple[str, ...], tuple[Stack, ...]] = ((), ())
        """Paths of the nodes and stacks of the leaves for which simulated time passes now."""

    @property
    def profile(self) -> RunProfile:
        """Profile of the run; available when the run has ended."""
        assert self._profile is not None, "the run goes on"
        return self._profile

    # Called by the session.

    def started(self, run: Execution, folder: Path) -> None:
        self._run = run
        self._ticked = self._segment_began = run.world.clock.now
        self._stack = (self._frame("assembly"),)
        self._switch(self._session)
        run.stopwatch.follower = self
        step = run.hardware.step
        physics = self._frame("physics")

        def timed_step() -> None:
            within = self._stack
            self._switch((*within, physics))
            step()
            self._switch(within)

        self._wrap(run.hardware, "step", timed_step)
        for attribute, methods, activity in _WAITS:
            for method in methods:
                self._mark(getattr(run.world, attribute), method, activity)
        self.edited(run)
        self._leaves = tuple(self._running_leaves(run.tree))
        running = tuple(node.path for node in run.tree.nodes if node.state is NodeStatus.RUNNING)
        self._passing = (running, self._leaves)
        self._end_segment(self._ticked)

    def edited(self, run: Execution) -> None:
        for node in run.tree.nodes:
            self._running.setdefault(node.path, 0.0)
            above = self._stacks[cast("Node", node.parent).path] if node.parent is not None else ()
            self._stacks[node.path] = (*above, self._frame(node.path.rpartition("/")[2], node.path))
            self._wrap(node, "step", self._timed(node))

    def ticked(self, now: float, report: TickReport, items_done: int, items_total: int) -> None:
        self._pass_simulated(now)
        for transition in report.transitions:
            if transition.status is NodeStatus.RUNNING:
                self._starts[transition.path] += 1
        running = tuple(node.path for node in report.nodes if node.status is NodeStatus.RUNNING)
        self._passing = (running, self._leaves)
        controller = self._run.world.control.controller
        if controller != HoldController.name:
            self._activity = self._frame(f"arm: {controller}")
        else:
            self._activity = self._frame(self._waits[0] if self._waits else "rest")

    def finished(self, result: RunResult) -> None:
        self._pass_simulated(self._run.world.clock.now)
        self._switch(self._session)
        self._run.stopwatch.follower = None
        self._wrapped.close()
        self._end_segment(self._ticked)
        threads = (self._main, *self._others.lines())
        for line in (*threads, *self._simulated):
            line.finish()
        self._profile = RunProfile(
            f"{self._run.mission.name}, seed {result.seed}",
            tuple(self._frames),
            threads,
            tuple(self._simulated),
            self._starts,
            self._running,
        )

    # Called by the stopwatch.

    def begin(self, part: str) -> None:
        self._outer.append(self._stack)
        frame = self._frame(_PART_NAMES.get(part, part))
        within = self._stack
        if within == self._session:
            within = self._leaves[0] if self._leaves and part != "tree" else ()
        self._switch((*within, frame))

    def end(self, part: str) -> None:
        self._switch(self._outer.pop())
        if part == "tree":
            leaves = tuple(self._running_leaves(self._run.tree))
            now = self._run.world.clock.now
            if leaves != self._leaves or now - self._segment_began >= _SEGMENT:
                self._end_segment(now)
            self._leaves = leaves

    # Private.

    def _frame(self, name: str, path: str = "") -> int:
        frame = Frame(name, path)
        number = self._numbers.get(frame)
        if number is None:
            number = self._numbers[frame] = len(self._frames)
            self._frames.append(frame)
        return number

    def _switch(self, stack: Stack) -> None:
        """Count the CPU time since the last call for the present stack, and go on with another one."""
        now = time.thread_time()
        self._main.spend(self._stack, now - self._since)
        self._since, self._stack = now, stack

    def _end_segment(self, now: float) -> None:
        self._segment_began = now
        self._main.end_segment()
        within = self._leaves[0] if self._leaves else ()
        self._others.end_segment(lambda name: (*within, self._frame(name)))

    def _pass_simulated(self, now: float) -> None:
        """Count the simulated time since the last tick for the nodes that were running."""
        seconds = now - self._ticked
        self._ticked = now
        if seconds <= 0.0:
            return
        nodes, leaves = self._passing
        for path in nodes:
            self._running[path] += seconds
        while len(self._simulated) < len(leaves):
            self._simulated.append(TimeLine(f"simulated time, leaf {len(self._simulated) + 1} at once"))
            self._simulated[-1].spend((), self._simulated[0].end)
        for line, leaf in zip_longest(self._simulated, leaves or ((),)):
            line.spend((*leaf, self._activity) if leaf is not None else (), seconds)
            line.end_segment()

    def _running_leaves(self, tree: BehaviourTree) -> Iterator[Stack]:
        """Yield the stacks of the running nodes of which no child runs."""
        for node in tree.nodes:
            runs_below = (below.state is NodeStatus.RUNNING for below in node.below)
            if node.state is NodeStatus.RUNNING and not any(runs_below):
                yield self._stacks[node.path]

    def _timed(self, node: Node) -> Callable[[], NodeStatus]:
        """Return the node's step with its CPU time counted for the node."""
        step, stack = node.step, self._stacks[node.path]

        @wraps(step)
        def timed() -> NodeStatus:
            caller = self._stack
            self._switch(stack)
            try:
                return step()
            finally:
                self._switch(caller)

        return timed

    def _mark(self, owner: object, method: str, activity: str) -> None:
        """Note the activity while the tree is suspended in a generator of the owner."""
        begin: Callable[..., Generator[None, None, Any]] = getattr(owner, method)

        @wraps(begin)
        def marked(*arguments: Any, **options: Any) -> Generator[None, None, Any]:
            self._waits.append(activity)
            try:
                return (yield from begin(*arguments, **options))
            finally:
                self._waits.remove(activity)

        self._wrap(owner, method, marked)

    def _wrap(self, owner: object, method: str, wrapper: Callable[..., object]) -> None:
        """Replace a method of one object until the end of the run."""
        setattr(owner, method, wrapper)
        self._wrapped.callback(delattr, owner, method)


class _OtherThreads:
    """CPU time of the threads besides that of the simulation, such as that of the log, by Linux' clocks."""

    def __init__(self, *, whole_program: bool) -> None:
        self._lines: dict[int, TimeLine] = {}
        self._main = threading.get_native_id()
        self._read = {} if whole_program else dict(self._clocks())
        """Last reading of each thread, s."""

    def end_segment(self, stack_of: Callable[[str], Stack]) -> None:
        """Count the CPU time since the last call for the stack of the thread's name."""
        names = {each.native_id: each.name for each in threading.enumerate()}
        for thread, seconds in self._clocks():
            line = self._lines.setdefault(thread, TimeLine(f"thread {names.get(thread, 'of a library')}"))
            line.spend(stack_of(line.name), seconds - self._read.get(thread, 0.0))
            line.end_segment()
            self._read[thread] = seconds

    def lines(self) -> tuple[TimeLine, ...]:
        """Return the threads that took any time worth showing."""
        return tuple(line for line in self._lines.values() if line.end >= _LEAST_THREAD_TIME)

    def _clocks(self) -> Iterator[tuple[int, float]]:
        """Yield thread id and CPU seconds of each thread but the simulation's."""
        for name in os.listdir("/proc/self/task"):
            thread = int(name)
            if thread != self._main:
                with suppress(OSError):  # the thread has ended
                    yield thread, time.clock_gettime((~thread << 3) | _THREAD_CPU_CLOCK)
