"""Resumption of an unfinished run: from its last checkpoint, or from the last recorded state of the
simulation."""

from __future__ import annotations

import gc
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from picktree.files import PicktreeError
from picktree.logs import (
    Digest,
    RunRecord,
    arithmetic_record,
    fixed_of,
    log_files,
    log_records,
    motions_of,
    topics,
)
from picktree.logs.recording import WHOLE_STATE_PERIOD, RecordingState, fold_states, read_state
from picktree.robot.planning import has_second_core
from picktree.simulation import FaultState, checkpoints
from picktree.world import JournalEvent

from .arithmetic_probe import arithmetic
from .checkpoints import NOTHING_RECORDED, RunState
from .execution import Execution
from .observer import Observer, PresetAnswers
from .recorded_recipe import RecordedRun, simulated_messages
from .run_recipe import Recipe, Recording, StartCheckpoint
from .run_tally import RunCounters
from .session import Session
from .session_recording import START_ATTACHMENT

_FAULTS = TypeAdapter(tuple[FaultState, ...])
_NEVER_WRITTEN = -1.0


def recipe_from_truth(recorded: RecordedRun) -> tuple[Recipe, str, float]:
    """Return the recipe that resumes from the last recorded state, a sentence about it, and the end of its
    knowledge.

    The end of its knowledge is the simulated time up to which the robot remembers events, s; -1 for nothing.
    Raises PicktreeError for a log that lacks the state of the simulation.
    """
    run = recorded.run
    if not len(run.ticks.times):
        return _from_start(recorded, "has no tick")
    last = _last_state(run)
    time = last.time
    found = recorded.last_checkpoint(time)
    if found is not None:
        name, known = found
        recipe, knows = recorded.from_checkpoint(name, known), known.time
        knowledge = f"the belief is from {name.removesuffix('.json')}, {known.time:.2f} s"
    else:
        recipe = recorded.recipe()
        if recipe.start is not None:
            name, known = START_ATTACHMENT, recipe.start.state
            knows, knowledge = known.time, f"the belief is from the start of the run, {known.time:.2f} s"
        else:
            name, known, knows, knowledge = (
                "",
                Execution(recipe).checkpoint(NOTHING_RECORDED),  # nothing is seen or done yet
                _NEVER_WRITTEN,
                "there is no checkpoint: the belief is empty",
            )
    snapshot = checkpoints.snapshot_at_rest(recipe.backend, last.simulation, len(recipe.robot.joints))
    state = replace(
        known,
        time=time,
        simulation=snapshot.plain,
        faults=last.faults,
        control=_control(known.control, snapshot.position, last.bias),
        thinking_owed=0.0,
        way=None,
        grip=None,
        tally=_tally(run, known, knows, time),
        recording=_recording(run, known, knows, time),
    )
    assert state.recording is not None
    continues = log_records.ResumedFrom(
        str(run.path.absolute()), name, time, known.items_done, state.recording.digest, as_it_stands=True
    )
    text = (
        f"resuming {run.path} from its last state at {time:.2f} s, at rest; {knowledge}; the robot "
        "looks first"
    )
    return replace(recipe, start=StartCheckpoint(state, continues)), text, knows


@dataclass(frozen=True, slots=True)
class _LastState:
    """Last recorded state of the simulation."""

    time: float
    """Time of the state, simulated s."""
    simulation: dict[str, Any]
    faults: tuple[FaultState, ...]
    """Progress of the faults."""
    bias: tuple[float, ...]
    """Bias of the wrist sensor, (6,), N and Nm; empty when it was not learnt yet."""


def _last_state(run: RunRecord) -> _LastState:
    topic, end = topics.STATE.name, run.end
    for start in (end - 2 * WHOLE_STATE_PERIOD, None):
        messages = list(run.log.messages([topic], start))
        if not messages:
            continue
        try:
            states = [read_state(message.data) for message in messages]
            whole = max((n for n, state in enumerate(states) if state.whole), default=None)
            if whole is None:
                continue
            state = fold_states(states[whole:])
            assert state is not None
            faults = _FAULTS.validate_python(state.pop("faults", ()))
            bias = tuple(float(value) for value in state.pop("wrist_bias", ()))
        except (ValueError, KeyError, ValidationError) as error:
            raise PicktreeError(f"{run.path}: {topic}: unreadable state: {error}") from None
        return _LastState(messages[-1].time / 1e9, state, faults, bias)
    raise PicktreeError(
        f"{run.path}: the log has no state of the simulation (an older version wrote it): leave out "
        "--as-it-stands to resume from the last checkpoint"
    )


def _control(
    known: Mapping[str, Any], position: tuple[float, ...], bias: tuple[float, ...]
) -> dict[str, Any]:
    """Return a control loop state that holds the arm at `position`; the learnt bias is kept."""
    now = {"hold": list(position), "readings": [], "stamps": [], "standing": 0}
    return {**known, **now, **({"bias": list(bias)} if bias else {})}


def _tally(run: RunRecord, known: RunState, since: float, until: float) -> RunCounters:
    """Return the counters of the run up to `until`, simulated s: events between the checkpoint and then
    count.

    The number of items done and the open episodes are those of the checkpoint, since the robot must find out
    about them itself.
    """
    before = known.tally if known.tally is not None else RunCounters().state()
    tally = RunCounters.resumed(before)
    tally.figures.fixed = fixed_of(run.log)
    tally.follow(run.tree_at(since).nodes)
    events: dict[float, list[JournalEvent]] = {}
    begin = since + 1e-6 if since >= 0.0 else None
    for at in run.log.events(begin, until + 1e-9):
        events.setdefault(at.time, []).append(at.record)
    motions = motions_of(run.log, run.joint_names[0], begin, until)
    for at in run.log.ticks(begin, until):
        leaves = frozenset(node.path for node in run.tree_at(at.time).nodes if not node.children)
        tally.take(at.time, events.get(at.time, ()), leaves, at.record.edges, motions.get(at.time))
    return replace(tally.state(), done=before.done, episodes=before.episodes)


def _recording(run: RunRecord, known: RunState, since: float, until: float) -> RecordingState:
    before = known.recording
    digest = Digest(bytes.fromhex(before.digest)) if before is not None else Digest()
    for message in simulated_messages(run.log, since if since >= 0.0 else None, until):
        digest.add(message.topic, message.time, message.data)
    return RecordingState(
        _NEVER_WRITTEN, _NEVER_WRITTEN, (), before.cameras if before is not None else (), digest.hex
    )


_FINISHED_TEXTS: Final = {
    "success": "the goal is reached",
    "incomplete": "its tree ended in SUCCESS",
    "failure": "its tree ended in FAILURE",
}


@dataclass(frozen=True)
class ResumeRequest:
    """Request to resume a run: the run, and the folder of its further log. The log determines everything
    else."""

    log: str | Path
    """Log file, a run's folder, or `last`."""
    out: Path | None = None
    """Folder in which the new run's folder is made; None: `runs`."""
    limit: float | None = None
    """Limit in simulated s, counted from the beginning of the first run; None: the same limit."""
    rotation: log_files.Rotation = log_files.NO_ROTATION
    as_it_stands: bool = False
    """Whether to resume from the last recorded state of the simulation instead of the checkpoint's.

    The robot's knowledge is still that of the checkpoint, and it looks first.
    """
    answers: tuple[str, ...] = ()
    """Answers for the run's requests for help, one for each question."""


class Resumption:
    """Run of a log that is ready to resume. A context manager: unpacked files are deleted at its exit.

    Raises PicktreeError for a run that is finished, and where the log lacks necessary data.
    """

    def __init__(self, request: ResumeRequest) -> None:
        self.request = request
        with ExitStack() as stack:
            self.recipe, self.description, self._recorded = self._read(stack)
            self._open = stack.pop_all()
        gc.collect()  # Readers of logs refer to themselves, and a session never frees what exists before it.

    def __enter__(self) -> Resumption:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def session(self, observers: Sequence[Observer] = ()) -> Session:
        """Return the session that resumes the run. To be called once.

        The interrupters among the observers answer the questions that have no recorded answer.
        """
        return Session(
            self.recipe,
            record=Recording(self.request.out, self.request.rotation),
            observers=(*self._recorded, PresetAnswers(self.request.answers), *observers),
            planning_worker=has_second_core(),
        )

    @property
    def since(self) -> float:
        """Time at which the run resumes, simulated s; -1 when it starts from the beginning."""
        return _since(self.recipe)

    def _read(self, stack: ExitStack) -> tuple[Recipe, str, tuple[Observer, ...]]:
        """Return the recipe, a sentence about its start, and the observers that repeat later interventions.

        The log is closed then: that of hours takes much memory. `stack` keeps the unpacked files.
        """
        as_it_stands, limit = self.request.as_it_stands, self.request.limit
        with RunRecord(self.request.log) as run:
            _refuse_finished(run, limit)
            recorded = RecordedRun(run)
            stack.enter_context(recorded.folder)
            recipe, text, knows = (recipe_from_truth if as_it_stands else _from_checkpoint)(recorded)
            if limit is not None:
                recipe = replace(recipe, limit=limit)
            return recipe, text, (recorded.edits(knows), recorded.operator(_since(recipe)))


def _from_checkpoint(recorded: RecordedRun) -> tuple[Recipe, str, float]:
    """Return the recipe from the last checkpoint, else from the beginning, as `recipe_from_truth` does."""
    run = recorded.run
    found = recorded.last_checkpoint(run.end)
    if found is None:
        recipe, text, _ = _from_start(recorded, "has no checkpoint")
    else:
        name, state = found
        recipe = recorded.from_checkpoint(name, state)
        text = (
            f"resuming {run.path} from {name.removesuffix('.json')}: {state.time:.2f} s, "
            f"{_done(state.items_done)}"
        )
    departed = arithmetic_record.arithmetic_difference(run.info.arithmetic, arithmetic())
    if departed:
        text = f"{text}\n{departed}"
    return recipe, text, _since(recipe)


def _since(recipe: Recipe) -> float:
    return recipe.start.state.time if recipe.start else -1.0


def _from_start(recorded: RecordedRun, why: str) -> tuple[Recipe, str, float]:
    """Return the recipe with which a run began, as `recipe_from_truth` does. `why`: reason, in words."""
    run = recorded.run
    run.log.require_beginning()
    recipe = recorded.recipe()
    before = recipe.start
    if before is None:
        return recipe, f"{run.path} {why}: the run starts from the beginning", _NEVER_WRITTEN
    text = (
        f"{run.path} {why} of its own: the run resumes from its own start, at {before.state.time:.2f} s, "
        f"{_done(before.state.items_done)}"
    )
    return recipe, text, before.state.time


def _done(items: int) -> str:
    return f"{items} item done" if items == 1 else f"{items} items done"


def _refuse_finished(run: RunRecord, limit: float | None) -> None:
    """Raise PicktreeError for a run that has come to its end, and for a limit that it has already reached."""
    status = run.log.result.get("status", "")
    if status in _FINISHED_TEXTS:
        raise PicktreeError(
            f"{run.path}: the run is finished: {_FINISHED_TEXTS[status]}; "
            "`picktree whatif` resumes it from a checkpoint with changes"
        )
    if limit is not None and limit <= run.end:
        raise PicktreeError(f"--limit {limit:g} s: the run has come to {run.end:.2f} s already")
    if status == "timeout" and limit is None:
        raise PicktreeError(
            f"{run.path}: the run was ended at its limit, {run.end:.2f} s; give a later one, as in "
            f"--limit '{max(60, round(2 * run.end / 60) * 60)} s'"
        )
