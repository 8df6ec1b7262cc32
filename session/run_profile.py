"""Profile of a run: time by stack of nodes and parts, as text and as a speedscope file."""

from __future__ import annotations

import os
from array import array
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import orjson

from ..files.errors import PicktreeError

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
