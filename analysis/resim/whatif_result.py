"""What came of a what-if, rendered once as text and once as JSON."""

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
from .resim_result import difference_json, difference_lines, table

_NAMED = 8
"""Nodes that are named in the text; of more their number is said."""


@dataclass(frozen=True, slots=True)
class NodeTransfers:
    """What became of the nodes of the checkpoint; paths."""

    kept: int
    """They go on with what they remember."""
    fresh: tuple[str, ...]
    """They begin anew: of another path or type than any, or what they stood at is gone."""
    gone: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Continuation:
    """A recorded run, and how it goes on from one of its checkpoints. Times are simulated seconds."""

    log: Path
    at_tick: int
    at: float
    """What was asked for."""
    checkpoint: str
    """Name of the checkpoint from which it goes on; empty: from the beginning."""
    start_tick: int
    start: float
    items_done: int
    """By then."""
    changes: tuple[str, ...]
    nodes: NodeTransfers | None
    """None when the mission is the same, or begins anew as a whole."""
    cut: bool
    """The recorded run did not come to an end of its own."""
    ticks: int
    """That are the same in both, from the start on."""
    recorded_ticks: int
    """That the record has from there on."""
    exact: bool
    """They are the same in their bytes."""
    difference: RecordDifference | None
    recorded: RunOutcome
    now: RunOutcome
    status: RunStatus
    """Of the new run."""
    parting: tuple[str, ...]
    """Where the two take different ways, as lines; A is the record."""
    arithmetic: str
    """A sentence when the record was computed with other arithmetic, else empty."""
    warnings: tuple[Diagnostic, ...]
    """Of the checker, about another mission."""
    new_log: Path

    @property
    def identical(self) -> bool:
        """Whether everything happens as recorded, as far as the record goes."""
        return self.difference is None

    def to_text(self) -> str:
        """For a terminal, without a line's end."""
        lines = [
            f"what if     {self.log}",
            *([f"the log     {self.recorded.recovered}"] if self.recorded.recovered else []),
            f"goes on     {self._from()}",
            *(f"changed     {line}" for line in self.changes or ("nothing",)),
            *self._fates(),
        ]
        if self.difference is None:
            lines.append(self._same())
        lines += ["", *table(self.recorded, self.now, "recorded", "what if")]
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
            for path in paths[:_NAMED]:
                yield f"  {word}      {path}"
            if len(paths) > _NAMED:
                yield f"  {word}      and {len(paths) - _NAMED} more"

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
