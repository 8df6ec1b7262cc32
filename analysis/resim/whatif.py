"""Continuation of a recorded run from a checkpoint, with changes (what-if)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ...errors import PicktreeError
from ...logs.run_result import RunResult
from ...logs.schema.arithmetic_record import arithmetic_difference
from ...session.arithmetic_probe import arithmetic
from ...session.observer import Observer
from ...session.recipe import Recipe, Recording
from ...session.resume.older_checkpoints import tally_of
from ...session.resume.recorded_recipe import RecordedRun
from ...session.run_tally import RunCounters
from ...session.session import Session
from ...simulation.faults.injector import new_states
from ..compare.alignment import align
from ..compare.run_outcome import KILLED_STATUS, RunOutcome
from ..compare.text.divergence_text import parting_lines
from ..run import Run
from .changes import ChangedRecipe, RunChanges, apply_changes, parse_tick
from .resim_comparison import RecordComparison, is_cut
from .whatif_result import Continuation, NodeTransfers


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
        raise PicktreeError("a what-if goes on with the seed and the scene of the run; `resim` takes others")
    with Run(where) as run, RecordedRun(run) as recorded:
        run.log.require_beginning()
        tick = parse_tick(at, run, "--at")
        found = recorded.last_checkpoint(run.ticks.times[tick])
        name, state = found or ("", None)
        recipe = recorded.recipe() if state is None else recorded.from_checkpoint(name, state)
        changed = apply_changes(changes, recipe)
        recipe = _with_fitting_checkpoint(recipe, changed, changes)
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
            record=Recording(out),
            observers=(*observers, comparison, recorded.answers(since), *edits),
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
            now=_new_outcome(result, session.execution.tally),
            status=result.status,
            parting=_parting(run, result.log, begin),
            arithmetic=arithmetic_difference(run.info.arithmetic, arithmetic()),
            warnings=changed.warnings,
            new_log=result.log,
        )


def _with_fitting_checkpoint(recipe: Recipe, changed: ChangedRecipe, changes: RunChanges) -> Recipe:
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
        return () if parting is None else tuple(parting_lines(parting))


def _recorded_outcome(run: Run) -> RunOutcome:
    result = run.result
    if result is not None:
        return _outcome(result, result.failures, tally_of(run, run.end), run.path, run.recovered)
    tally = tally_of(run, run.end)
    return RunOutcome(
        log=run.path,
        recovered=run.recovered,
        status=KILLED_STATUS,
        message="",
        end=run.ticks.times[-1],
        items_total=None,
        items_sorted=None,
        items_done=tally.done,
        picks_tried=tally.tried,
        picks_held=tally.held,
        failures=dict(tally.failures),
        recoveries=sum(tally.recovered.values()),
        digest="",
    )


def _new_outcome(result: RunResult, tally: RunCounters) -> RunOutcome:
    return _outcome(result, result.failures, tally, result.log, "")


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
