"""A run that did not come to its end, made ready to go on: from its last checkpoint, or as things stand."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Final

from ...errors import PicktreeError
from ...logs.recording.recorder import Listener
from ...logs.recording.rotation import NEVER, Rotation
from ...logs.run_record import RunRecord
from ...logs.schema.arithmetic_record import departure
from ...trees.running.debugger import Debugger
from ..arithmetic_probe import arithmetic
from ..observer import Watcher
from ..operators import GivenAnswers, Operator
from ..recipe import Recipe
from ..session import Session
from .recorded_recipe import Recorded
from .resume_from_last_state import as_it_stands

_FINISHED: Final = {
    "success": "the goal is reached",
    "incomplete": "its tree ended in SUCCESS",
    "failure": "its tree ended in FAILURE",
}


@dataclass(frozen=True)
class ResumeRequest:
    """Which run goes on, and where its further record goes. Everything else is said by its log."""

    log: str | Path
    """Log file, a run's folder, or `last`."""
    out: Path | None = None
    """Folder in which the new run's folder is made; by default `runs`."""
    limit: float | None = None
    """Simulated s, counted from the beginning of the first run; None: as it was."""
    rotation: Rotation = NEVER
    as_it_stands: bool = False
    """Not from where things stood at the checkpoint, but from where they stood last: only what the robot
    knows is that of the checkpoint. It looks first."""
    answers: tuple[str, ...] = ()
    """What is answered when the run asks for help, one for each question."""


class Resumption:
    """The run of a log, ready to go on. A context manager: what was unpacked goes when it is left.

    Raises PicktreeError for a run that is finished, and where the log lacks what is needed.
    """

    def __init__(self, request: ResumeRequest) -> None:
        self.request = request
        with ExitStack() as stack:
            self.run = stack.enter_context(RunRecord(request.log))
            _refuse_finished(self.run, request.limit)
            self.recorded = stack.enter_context(Recorded(self.run))
            self.recipe, self.told, self._knows = self._recipe()
            self._open = stack.pop_all()

    def __enter__(self) -> Resumption:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def session(
        self,
        watcher: Watcher | None = None,
        debugger: Debugger | None = None,
        *,
        listener: Listener | None = None,
        operator: Operator | None = None,
    ) -> Session:
        """What goes on when it is run; `operator` answers what nobody has answered before."""
        return Session(
            self.recipe,
            watcher,
            debugger,
            out=self.request.out,
            revisions=self.recorded.edits(self._knows),
            listener=listener,
            operator=self.recorded.answers(self.since, GivenAnswers(self.request.answers, operator)),
            rotation=self.request.rotation,
        )

    @property
    def since(self) -> float:
        """When it goes on, simulated s; -1 when it begins anew."""
        return self.recipe.start.state.time if self.recipe.start else -1.0

    def _recipe(self) -> tuple[Recipe, str, float]:
        """What goes on, which it is, as a sentence, and up to when it knows what happened, simulated s."""
        limit = self.request.limit
        found = as_it_stands(self.recorded) if self.request.as_it_stands else self._from_checkpoint()
        recipe, told, knows = found
        return (recipe if limit is None else replace(recipe, limit=limit)), told, knows

    def _from_checkpoint(self) -> tuple[Recipe, str, float]:
        """From the last one, else from the beginning."""
        run, recorded = self.run, self.recorded
        found = recorded.last_checkpoint(run.end)
        if found is None:
            run.log.require_beginning()
            recipe = recorded.recipe()
            before = recipe.start
            if before is None:
                told = f"{run.path} has no checkpoint: the run begins anew"
            else:
                told = (
                    f"{run.path} has no checkpoint of its own: it goes on where that run did, at "
                    f"{before.state.time:.2f} s, {_done(before.state.items_done)}"
                )
        else:
            name, state = found
            recipe = recorded.from_checkpoint(name, state)
            told = (
                f"going on with {run.path} from {name.removesuffix('.json')}: {state.time:.2f} s, "
                f"{_done(state.items_done)}"
            )
        departed = departure(run.info.arithmetic, arithmetic())
        if departed:
            told = f"{told}\n{departed}"
        return recipe, told, recipe.start.state.time if recipe.start else -1.0


def _done(items: int) -> str:
    return f"{items} item done" if items == 1 else f"{items} items done"


def _refuse_finished(run: RunRecord, limit: float | None) -> None:
    """Raises PicktreeError for a run that came to its end, and for a limit that it has reached already."""
    status = run.log.result.get("status", "")
    if status in _FINISHED:
        raise PicktreeError(
            f"{run.path}: the run is finished: {_FINISHED[status]}; `picktree whatif` lets it go on from a "
            "checkpoint with something changed"
        )
    if limit is not None and limit <= run.end:
        raise PicktreeError(f"--limit {limit:g} s: the run has come to {run.end:.2f} s already")
    if status == "timeout" and limit is None:
        raise PicktreeError(
            f"{run.path}: the run was ended at its limit, {run.end:.2f} s; give a later one, as in "
            f"--limit '{_later(run.end)} s'"
        )


def _later(end: float) -> int:
    return max(60, round(2 * end / 60) * 60)
