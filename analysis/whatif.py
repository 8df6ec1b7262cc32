"""Continuation of a recorded run from a checkpoint, with changes (what-if)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from picktree.analysis.compare import RunOutcome, align, message_differences, outcome_of, run_diff
from picktree.files import Diagnostic, PicktreeError
from picktree.logs import RunResult, RunStatus, arithmetic_record
from picktree.session import Observer, RecordedRun, RunCounters, Session, arithmetic, run_recipe, tally_of
from picktree.simulation import new_states

from .record_comparison import RecordComparison, difference_json, difference_lines, is_cut, outcome_table
from .run import Run
from .run_changes import ChangedRecipe, RunChanges, apply_changes, parse_tick

_MAX_NAMED_NODES = 8
"""Maximum number of nodes that the text names; for more it gives the number."""


@dataclass(frozen=True, slots=True)
class NodeTransfers:
    """Transfer of the checkpoint's nodes to another mission's tree; paths."""

    kept: int
    """Number of nodes that keep their state."""
    fresh: tuple[str, ...]
    """Nodes that start afresh: their path or type is new, or their element of an iteration is gone."""
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
    difference: message_differences.MessageDifference | None
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
            *self._node_transfer_lines(),
        ]
        if self.difference is None:
            lines.append(self._same())
        lines += ["", *outcome_table(self.recorded, self.now, "recorded", "what if")]
        if self.difference is not None:
            lines += ["", *self._divergence_lines(self.difference)]
        lines.append(f"new log     {self.new_log}")
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
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
            "nodes": self.nodes and asdict(self.nodes),
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
        requested = f"the last checkpoint before {moment}"
        if self.start_tick == self.at_tick:
            requested = "the requested tick"
        name = self.checkpoint.removesuffix(".json")
        start = f"tick {self.start_tick}, {self.start:.2f} s, {self.items_done} items done"
        return f"from {name}, {requested}: {start}"

    def _node_transfer_lines(self) -> Iterator[str]:
        nodes = self.nodes
        if nodes is None:
            return
        fresh, gone = len(nodes.fresh), len(nodes.gone)
        yield f"nodes       {nodes.kept} keep their state, {fresh} start without a state, {gone} are gone"
        for word, paths in (("anew", nodes.fresh), ("gone", nodes.gone)):
            for path in paths[:_MAX_NAMED_NODES]:
                yield f"  {word}      {path}"
            if len(paths) > _MAX_NAMED_NODES:
                yield f"  {word}      and {len(paths) - _MAX_NAMED_NODES} more"

    def _same(self) -> str:
        what = "the same" if self.changes else "identical continuation"
        if self.cut:
            what += " up to the end of the recorded run"
        how = ", byte for byte" if self.exact and not self.changes else ""
        return f"{what}: {self.ticks} ticks{how}"

    def _divergence_lines(self, difference: message_differences.MessageDifference) -> Iterator[str]:
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


def what_if(
    where: str | Path,
    at: str,
    *,
    changes: RunChanges | None = None,
    out: Path | None = None,
    observers: Sequence[Observer] = (),
) -> Continuation:
    """Resume a logged run from its last checkpoint at or before `at`, with changes, and compare both runs.

    `at` is a tick or a time, see `parse_tick`. Without a checkpoint there, the run starts from its beginning.
    The new run's folder is made in `out`, by default in `runs`. Raises PicktreeError (FileError with the
    errors of the checker).
    """
    changes = changes or RunChanges()
    if changes.seed is not None or changes.scene is not None:
        raise PicktreeError("a what-if keeps the seed and the scene of the run; `resim` takes others")
    with Run(where) as run, RecordedRun(run) as recorded:
        run.log.require_repeatable()
        tick = parse_tick(at, run, "--at")
        name, changed = continued_recipe(recorded, run.ticks.times[tick], changes)
        recipe = changed.recipe
        begin = recipe.start.state.time if recipe.start else None
        comparison = RecordComparison(
            run,
            settings=changes.settings if changes else None,
            since=begin,
            other_tree=changed.other_tree,
        )
        since = -1.0 if begin is None else begin
        edits = () if changes.mission else (recorded.edits(since),)
        session = Session(
            recipe,
            record=run_recipe.Recording(out),
            observers=(*observers, comparison, recorded.operator(since), *edits),
        )
        result = session.run()
        if result.status != "interrupted":
            comparison.finish()
        first = 0 if begin is None else run.ticks.number_at(begin)
        adoption = session.execution.adoption
        return Continuation(
            log=run.path.absolute(),
            at_tick=tick,
            at=run.ticks.times[tick],
            checkpoint=name,
            start_tick=first,
            start=run.ticks.times[first],
            items_done=recipe.start.state.items_done if recipe.start else 0,
            changes=changed.told,
            nodes=NodeTransfers(len(adoption.kept), adoption.fresh, adoption.gone) if adoption else None,
            cut=is_cut(run),
            ticks=comparison.ticks,
            recorded_ticks=len(run.ticks) - (first + 1 if begin is not None else 0),
            exact=comparison.exact,
            difference=comparison.difference or comparison.trees,
            recorded=_recorded_outcome(run),
            now=_outcome(result, result.failures, session.execution.tally, result.log, ""),
            status=result.status,
            parting=_parting(run, result.log, begin),
            arithmetic=arithmetic_record.arithmetic_difference(run.info.arithmetic, arithmetic()),
            warnings=changed.warnings,
            new_log=result.log,
        )


def continued_recipe(recorded: RecordedRun, at: float, changes: RunChanges) -> tuple[str, ChangedRecipe]:
    """Return the changed recipe from the last checkpoint at `at`, simulated s, or before, and the name of the
    checkpoint; empty: from the beginning."""
    name, state = recorded.last_checkpoint(at) or ("", None)
    recipe = recorded.recipe() if state is None else recorded.from_checkpoint(name, state)
    changed = apply_changes(changes, recipe, at)
    return name, replace(changed, recipe=_with_fitting_checkpoint(recipe, changed, changes))


def _with_fitting_checkpoint(
    recipe: run_recipe.Recipe, changed: ChangedRecipe, changes: RunChanges
) -> run_recipe.Recipe:
    """Return the changed recipe with a checkpoint that fits it."""
    start = changed.recipe.start
    if start is None:
        return changed.recipe
    state = start.state
    if changes.faults is not None or changes.no_faults:
        before = (recipe.faults, state.faults)
        faults = new_states(changed.recipe.faults, recipe.seed, state.time, before)
        state = replace(state, faults=faults)
    names = tuple(name for name in changes.settings if "." not in name)
    start = replace(start, state=state, adopt=changed.other_tree, changed=names)
    return replace(changed.recipe, start=start)


def _parting(run: Run, log: Path, begin: float | None) -> tuple[str, ...]:
    with Run(log) as other:
        # Messages of both logs at the moment of the checkpoint belong to the time before.
        since = 0.0 if begin is None else begin + run.info.tick / 2
        parting = align(run, other, since=since).parting
        return () if parting is None else tuple(run_diff.parting_lines(parting))


def _recorded_outcome(run: Run) -> RunOutcome:
    tally = tally_of(run, run.end)
    if run.result is not None:
        return _outcome(run.result, run.result.failures, tally, run.path, run.recovered)
    return replace(
        outcome_of(run),
        items_done=tally.done,
        picks_tried=tally.tried,
        picks_held=tally.held,
        failures=dict(tally.failures),
        recoveries=sum(tally.recovered.values()),
    )


def _outcome(
    result: RunResult, failures: Mapping[str, int], tally: RunCounters, log: Path, recovered: str
) -> RunOutcome:
    """Return the outcome of the whole run, the time before the checkpoint included."""
    return RunOutcome(
        log=log,
        recovered=recovered,
        status=result.status,
        message=result.message,
        end=result.sim_seconds,
        items_total=result.items.total,
        items_sorted=result.items.sorted,
        items_done=tally.done,
        picks_tried=result.picks.tried,
        picks_held=result.picks.held,
        failures=dict(failures),
        recoveries=sum(result.recoveries.values()),
        digest=result.digest,
    )
