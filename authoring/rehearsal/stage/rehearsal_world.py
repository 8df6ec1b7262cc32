"""The world of a rehearsal: a clock that ticks move on, a belief, a journal; no robot stands behind it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NoReturn

from ....world.belief.attempts import Attempts
from ....world.belief.planning_scene import PlanningScene
from ....world.journal import Entry, Happened, Journal
from ....world.scene.description import SceneDescription
from .answer_choice import Prompter
from .rehearsal_belief import Belief
from .trace import Trace

TICK = 0.05
"""Simulated seconds between two ticks, as in a run."""


class TickClock:
    """Simulated time, which is the number of ticks that have passed."""

    def __init__(self) -> None:
        self.ticks = 0

    @property
    def now(self) -> float:
        return self.ticks * TICK


class _Notes(Journal):
    """Hands on what nodes tell, instead of keeping it for a log."""

    def __init__(self, trace: Trace) -> None:
        super().__init__()
        self._trace = trace

    def note(self, entry: Entry) -> None:
        if isinstance(entry, Happened):
            self._trace.noted(entry)


class RehearsalWorld:
    """What nodes see of the world while a case is rehearsed: as much as the language itself asks for."""

    tick = TICK

    def __init__(self, scene: SceneDescription | None, prompter: Prompter, trace: Trace) -> None:
        self.clock = TickClock()
        self.belief = Belief(scene)
        self.prompter = prompter
        self.trace = trace
        self.journal: Journal = _Notes(trace)
        self.attempts = Attempts()
        self.contradictions: list[str] = []

    @property
    def scene(self) -> PlanningScene:
        return self.belief.scene

    def facts(self) -> Mapping[str, bool | int | float | str]:
        return self.belief.facts(self.clock.now)

    def __getattr__(self, name: str) -> NoReturn:
        raise AttributeError(f"in a rehearsal there is no world.{name}: no robot stands behind it")
