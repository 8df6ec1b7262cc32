"""Result of a what-if, as text and as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...files.yaml.document import Diagnostic
from ...logs.run_result import RunStatus
from ..compare.run_outcome import RunOutcome
from .resim_comparison import RecordDifference
from .resim_result import difference_json, difference_lines, outcome_table

_MAX_NAMED_NODES = 8
"""Maximum number of nodes that the text names; for more it gives the number."""


@dataclass(frozen=True, slots=True)
class NodeTransfers:
    """Transfer of the checkpoint's nodes to another mission's tree; paths."""

    kept: int
    """Number of nodes that keep their state."""
    fresh: tuple[str, ...]
    """Nodes that start afresh: path or type is new, or the element at which they stood is gone."""
    gone: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Continuation:
    """Recorded run, and its continuation from one of its checkpoints. Times are simulated seconds."""

    log: Path
    at_tick: int
    at: float
    """Requested time, simulated s."""
    checkpoint: str
    """Name of the checkpoint; empty: the run starts from the beginning."""
    start_tick: int
    start: float
    items_done: int
    """Number of items done at the start."""
    changes: tuple[str, ...]
    nodes: NodeTransfers | None
    """Transfer of nodes; None when the mission is the same, or starts from the beginning."""
    cut: bool
    """Whether the recorded run was cut off before its own end."""
    ticks: int
    """Number of equal ticks, from the start on."""
    recorded_ticks: int
    """Number of the record's ticks from the start on."""
    exact: bool
    """Whether the equal messages agree in their bytes."""
    difference: RecordDifference | None
    recorded: RunOutcome
    now: RunOutcome
    status: RunStatus
    """Status of the new run."""
    parting: tuple[str, ...]
    """Divergence of the two runs, as lines; A is the record."""
    arithmetic: str
    """Sentence when the record was computed with other arithmetic, else empty."""
    warnings: tuple[Diagnostic, ...]
    """Warnings of the checker about another mission."""
    new_log: Path

    @property
    def identical(self) -> bool:
        """Whether everything happens as recorded, up to the end of the record."""
        return self.difference is None

    def to_text(self) -> str:
        """Return the text for a terminal, without a trailing newline."""
        lines = [
            f"what if     {self.log}",
            *([f"the log     {self.recorded.recovered}"] if self.recorded.recovered else []),
            f"goes on     {self._from()}",
            *(f"changed     {line}" for line in self.changes or ("nothing",)),
            *self._fates(),
        ]
        if self.difference is None:
            lines.append(self._same())
        lines += ["", *outcome_table(self.recorded, self.now, "recorded", "what if")]
        if self.difference is not None:
            lines += ["", *self._apart(self.difference)]
        lines.append(f"new log     {self.new_log}")
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        nodes = self.nodes
        return {
            "identical": self.identical,
            "exact": self.exact,
            "log": str(self.log),
            "at": {"tick": self.at_tick, "time": round(self.at, 6)},
            "start": {
                "checkpoint": self.checkpoint or None,
                "tick": self.start_tick,
                "time": round(self.start, 6),
                "items_done": self.items_done,
            },
            "changes": list(self.changes),
            "nodes": None
            if nodes is None
            else {"kept": nodes.kept, "fresh": list(nodes.fresh), "gone": list(nodes.gone)},
            "ticks": self.ticks,
            "recorded_ticks": self.recorded_ticks,
            "cut": self.cut,
            "difference": difference_json(self.difference),
            "recorded": _outcome_json(self.recorded),
            "now": _outcome_json(self.now),
            "parting": list(self.parting),
            "arithmetic": self.arithmetic,
            "new_log": str(self.new_log),
        }

    def to_json_text(self) -> str:
        return json.dumps(self.to_json(), ensure_ascii=False, indent=2) + "\n"

    def _from(self) -> str:
        moment = f"tick {self.at_tick} ({self.at:.2f} s)"
        if not self.checkpoint:
            return f"from the beginning: there is no checkpoint at or before {moment}"
        asked = f"the last checkpoint before {moment}"
        if self.start_tick == self.at_tick:
            asked = "the tick that was asked for"
        name = self.checkpoint.removesuffix(".json")
        return (
            f"from {name}, {asked}: tick {self.start_tick}, {self.start:.2f} s, {self.items_done} items done"
        )

    def _fates(self) -> Iterator[str]:
        nodes = self.nodes
        if nodes is None:
            return
        fresh, gone = len(nodes.fresh), len(nodes.gone)
        yield f"nodes       {nodes.kept} go on as they were, {fresh} begin anew, {gone} are gone"
        for word, paths in (("anew", nodes.fresh), ("gone", nodes.gone)):
            for path in paths[:_MAX_NAMED_NODES]:
                yield f"  {word}      {path}"
            if len(paths) > _MAX_NAMED_NODES:
                yield f"  {word}      and {len(paths) - _MAX_NAMED_NODES} more"

    def _same(self) -> str:
        what = "the same" if self.changes else "identical continuation"
        if self.cut:
            what += " as far as the record goes"
        how = ", byte for byte" if self.exact and not self.changes else ""
        return f"{what}: {self.ticks} ticks{how}"

    def _apart(self, difference: RecordDifference) -> Iterator[str]:
        for line in self.parting:
            yield (
                line.replace(" s:", " s (A: recorded, B: what if):", 1) if line in self.parting[:1] else line
            )
        yield from difference_lines(difference)
        if self.arithmetic:
            yield f"{'likely why' if not self.changes else 'besides':<10}  {self.arithmetic}"


def _outcome_json(outcome: RunOutcome) -> dict[str, Any]:
    return {
        "status": outcome.status,
        "message": outcome.message,
        "sim_seconds": round(outcome.end, 6),
        "items": {
            "total": outcome.items_total,
            "sorted": outcome.items_sorted,
            "done_as_believed": outcome.items_done,
        },
        "picks": {"tried": outcome.picks_tried, "held": outcome.picks_held},
        "failures": dict(sorted(outcome.failures.items())),
        "recoveries": outcome.recoveries,
        "digest": outcome.digest,
    }
