"""Profiler: observer that measures where the time of a run goes, by part of the work, node and function.

The parts are those of the run's stopwatch, a node has the time of its ticks, and cProfile measures the
functions. A run has the same digest with and without it.
"""

from __future__ import annotations

import cProfile
import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from picktree.files import PicktreeError
from picktree.logs import RunResult
from picktree.robot.control import HoldController
from picktree.trees import NodeStatus
from picktree.world import Tick

from .execution import Execution
from .observer import Observer

_PART_NAMES: Final = {"tree": "nodes", "logging": "recording"}
"""Names of the stopwatch's parts in a profile, where they differ."""
_MIN_SHARE: Final = 0.005
"""Share of wall and of simulated time below which the table leaves out a node."""


@dataclass
class NodeCost:
    """Figures of one node, its descendants included."""

    starts: int = 0
    simulated: float = 0.0
    """Simulated time while the node was RUNNING, s."""
    wall: float = 0.0
    """Wall time of its ticks, s."""


class Profiler(Observer):
    """Observer that profiles one run, from its first tick to its end."""

    def __init__(self) -> None:
        self.nodes: dict[str, NodeCost] = {}
        """Figures of each node by its path, in the order of the tree."""
        self.parts: Mapping[str, float] = {}
        """Wall seconds by part of the work; available when the run has ended."""
        self.activities: dict[str, float] = {}
        """Simulated seconds by the activity of the arm."""
        self._functions = cProfile.Profile()
        self._title = ""
        self._running: tuple[str, ...] = ()
        """Paths of the nodes for which simulated time passes now."""
        self._activity = "rest"

    def started(self, run: Execution, folder: Path) -> None:
        self._run = run
        self._ticked = run.world.clock.now
        self._began, self._before = time.perf_counter(), run.stopwatch.seconds()
        self._running = tuple(node.path for node in run.tree.nodes if node.state is NodeStatus.RUNNING)
        self.edited(run)
        self._functions.enable()

    def edited(self, run: Execution) -> None:
        for node in run.tree.nodes:
            self.nodes.setdefault(node.path, NodeCost())

    def ticked(self, now: float, report: Tick, items_done: int, items_total: int) -> None:
        self._pass_simulated(now)
        for path, seconds in self._run.tree.seconds().items():
            self.nodes[path].wall += seconds
        for edge in report.edges:
            self.nodes[edge.path].starts += edge.starts
        self._running = tuple(node.path for node in report.nodes if node.status == NodeStatus.RUNNING)
        controller = self._run.world.control.controller
        self._activity = "rest" if controller == HoldController.name else f"arm: {controller}"

    def finished(self, result: RunResult) -> None:
        self._functions.disable()
        self._pass_simulated(self._run.world.clock.now)
        spent = self._run.stopwatch.seconds()
        parts = {_PART_NAMES.get(name, name): spent[name] - self._before.get(name, 0.0) for name in spent}
        rest = time.perf_counter() - self._began - sum(parts.values())
        self.parts = {**parts, "session": rest}
        self._title = f"{self._run.mission.name}, seed {result.seed}"

    def to_text(self) -> str:
        """Return the tables for a terminal, without a trailing newline."""
        wall, simulated = sum(self.parts.values()), sum(self.activities.values())
        return "\n".join(
            (
                f"profile     {self._title}",
                f"wall time   {wall:.2f} s from the first tick on, profiling included",
                *_shares(self.parts, wall),
                f"simulated   {simulated:.2f} s, by the arm's controller",
                *_shares(self.activities, simulated),
                *self._node_lines(wall, simulated),
            )
        )

    def write(self, file: Path) -> None:
        """Write the functions for `pstats`. Raises PicktreeError when the disk refuses."""
        try:
            self._functions.dump_stats(file)
        except OSError as error:
            raise PicktreeError(f"{file}: the profile cannot be written: {error.strerror}") from None

    def _node_lines(self, wall: float, simulated: float) -> Iterator[str]:
        """Yield the table of the nodes that were ticked."""
        ticked = {path: cost for path, cost in self.nodes.items() if cost.wall}
        rows = [("node", "starts", "simulated s", "ticks s")]
        for path, cost in ticked.items():
            if cost.wall >= _MIN_SHARE * wall or cost.simulated >= _MIN_SHARE * simulated:
                name = "  " * path.count("/") + path.rpartition("/")[2]
                rows.append((name, str(cost.starts), f"{cost.simulated:.2f}", f"{cost.wall:.2f}"))
        width = max(len(name) for name, *_ in rows)
        for name, starts, seconds, ticks in rows:
            yield f"{name:<{width}}  {starts:>6}  {seconds:>11}  {ticks:>7}"
        if hidden := len(ticked) - len(rows) + 1:
            yield f"{hidden} more nodes, each below {_MIN_SHARE:.1%} of both times"

    def _pass_simulated(self, now: float) -> None:
        """Count the simulated time since the last tick for the nodes that were running."""
        seconds, self._ticked = now - self._ticked, now
        for path in self._running:
            self.nodes[path].simulated += seconds
        if seconds > 0.0:
            self.activities[self._activity] = self.activities.get(self._activity, 0.0) + seconds


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
