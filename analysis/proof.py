"""Proof of a root cause by experiment: continuations of the run with the cause and with the cause taken away.

Both ways resume from the last checkpoint before the cause has its effect. From there on, the noise of cameras
and wrist and the seeds of the planner are drawn anew, with the same variants both ways.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, cast

from picktree.analysis.explain import GOAL, Experiment, Fact, Removal, RootCause, experiment, explain
from picktree.files import listed
from picktree.logs import RunRecord
from picktree.session import RecordedRun, Session, run_recipe
from picktree.trees import MAIN, Mission, RecordedFiles
from picktree.trees.loading import parse_mission
from picktree.world import StreamVariant

from .run import Run
from .run_changes import RunChanges
from .trials import (
    OFTEN,
    VARIANTS,
    SettledItems,
    Trial,
    Verdict,
    has_fact,
    joint_verdict,
    outcomes,
    verdict_of,
)
from .whatif import continued_recipe

DEFAULT_BOUND: Final = 60.0
"""Simulated time after the last failure of the cause at which a continuation ends, s."""
OVERTIME: Final = 20.0
"""Simulated time that a continuation may take longer than the record, s."""


@dataclass(frozen=True, slots=True)
class Forecast:
    """Costs of a proof before it starts, at most."""

    continuations: int
    sim_seconds: float
    cpu_seconds: float | None
    """None: the log does not tell the costs of its run."""

    def to_text(self) -> str:
        cpu = "" if self.cpu_seconds is None else f", about {self.cpu_seconds:.0f} CPU s"
        return f"up to {self.continuations} continuations, {self.sim_seconds:.0f} simulated s together{cpu}"


@dataclass(frozen=True, slots=True)
class Proof:
    """Verdict on a root cause, with the continuations that it follows from. Times are simulated s."""

    log: Path
    experiment: Experiment
    verdict: Verdict
    sentence: str
    """Verdict in words."""
    checkpoint: str = ""
    """Name of the checkpoint from which the continuations resume; empty: the beginning of the run."""
    start: float = 0.0
    bound: float = 0.0
    """Time at which a continuation ends at the latest."""
    with_cause: tuple[Trial, ...] = ()
    without: tuple[Trial, ...] = ()
    verdicts: Mapping[Fact, Verdict] | None = None
    """Verdict on each outcome; None: there is no experiment."""

    @property
    def sim_seconds(self) -> float:
        return sum(trial.end - self.start for trial in (*self.with_cause, *self.without))

    @property
    def cpu_seconds(self) -> float:
        return sum(trial.cpu_seconds for trial in (*self.with_cause, *self.without))

    def to_text(self) -> str:
        """Return the text for a terminal, without a trailing newline."""
        asked, removal = self.experiment, self.experiment.removal
        lines = [f"cause       {asked.number} [{asked.root.cause}] {asked.root.title}"]
        if removal is not None:
            begin = self.checkpoint.removesuffix(".json") or "the beginning of the log"
            lines += [
                f"without it  {removal.sentence}",
                f"resumed     from {begin}, {self.start:.2f} s; "
                f"noise drawn anew from {asked.since:.2f} s on; to {self.bound:.1f} s at most",
            ]
            for fact in asked.facts:
                counts = [
                    f"{sum(fact in trial.facts for trial in trials)} of {len(trials)} {way}"
                    for way, trials in (("with the cause", self.with_cause), ("without", self.without))
                ]
                lines.append(f"outcome     {asked.names[fact]}: {', '.join(counts)}")
        lines.append(f"{self.verdict}: {self.sentence}")
        if removal is not None:
            lines.append(f"cost        {self.sim_seconds:.0f} simulated s, {self.cpu_seconds:.0f} CPU s")
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        asked = self.experiment

        def trials(found: Sequence[Trial]) -> list[dict[str, Any]]:
            return [{**asdict(each), "facts": sorted(each.facts)} for each in found]

        return {
            "log": str(self.log),
            "cause": {"number": asked.number, "code": asked.root.cause, "title": asked.root.title},
            "removal": None if asked.removal is None else asdict(asked.removal),
            "advice": asked.advice,
            "verdict": self.verdict,
            "sentence": self.sentence,
            "checkpoint": self.checkpoint or None,
            "start": round(self.start, 6),
            "since": round(asked.since, 6),
            "bound": round(self.bound, 6),
            "outcomes": [
                {"fact": fact, "words": asked.names[fact], "verdict": (self.verdicts or {}).get(fact)}
                for fact in asked.facts
            ],
            "with": trials(self.with_cause),
            "without": trials(self.without),
            "sim_seconds": round(self.sim_seconds, 3),
            "cpu_seconds": round(self.cpu_seconds, 3),
        }

    def to_json_text(self) -> str:
        return json.dumps(self.to_json(), ensure_ascii=False, indent=2) + "\n"


def prove(
    where: str | Path,
    *,
    cause: str | RootCause = "1",
    truth: bool | None = None,
    bound: float = DEFAULT_BOUND,
    forecast: Callable[[Forecast], None] = lambda costs: None,
    progress: Callable[[int, float], None] = lambda number, now: None,
) -> Proof:
    """Prove a root cause of a run by continuations with and without it, at most three each way.

    cause: its place among the root causes, from 1, its code, or a root cause of your own. truth: as in
    `explain`. bound: simulated s after the last failure of the cause; a continuation ends there, or as soon
    as the items rest where they belong. `forecast` is called with the costs before the first continuation,
    `progress` with the number of the continuation, from 1, and its time, simulated s.

    Raises PicktreeError for a run without that root cause, and for a log that cannot be run again.
    """
    with Run(where) as run, RecordedRun(run) as recorded:
        run.log.require_repeatable()
        recorded.recipe()  # a run on a robot is refused at once
        asked = experiment(run, explain(run, faults=False, items=False, truth=truth), cause)
        if asked.removal is None:
            sentence = f"no way to take it away is known. A person could {asked.advice}"
            return Proof(run.path.absolute(), asked, "not decided", sentence)
        return Continuations(run, recorded, asked, asked.removal, bound, progress).proof(forecast)


def _looking_first(mission: Mission, camera: str) -> Mission:
    """Return the mission with a look before all else. It writes the list that the mission reads."""
    path, data = mission.document.path, cast("dict[str, Any]", mission.document.data)
    main = cast("dict[str, Any]", data["trees"])[MAIN]
    kept = {key: main[key] for key in ("ports", "doc") if key in main}
    rest = {key: value for key, value in main.items() if key not in kept}
    look = {"camera": camera} | ({"objects": "{items}"} if "{items}" in mission.text else {})
    trees = {**data["trees"], MAIN: {**kept, "Sequence": [{"Observe": look}, rest]}}
    text = run_recipe.yaml_text({**data, "trees": trees})
    return parse_mission(text, path, files=RecordedFiles(mission.files, path.parent))


class Continuations:
    """Continuations of a run with a root cause and without it."""

    def __init__(
        self,
        run: RunRecord,
        recorded: RecordedRun,
        asked: Experiment,
        removal: Removal,
        bound: float,
        progress: Callable[[int, float], None],
    ) -> None:
        self._run, self._recorded, self._asked, self._removal = run, recorded, asked, removal
        self._progress, self._count = progress, 0
        self._at = run.ticks.times[run.ticks.number_at(max(asked.since, run.ticks.times[0]))]
        self.checkpoint, kept = continued_recipe(recorded, self._at, RunChanges())
        change = RunChanges(settings=removal.settings, nominal=removal.nominal)
        _, gone = continued_recipe(recorded, self._at, change)
        self.start = 0.0 if kept.recipe.start is None else kept.recipe.start.state.time
        self.bound = min(asked.last + bound, run.end + (bound if removal.longer else OVERTIME))
        limit = min(self.bound, kept.recipe.limit)
        self._with = replace(kept.recipe, limit=limit)
        mission = _looking_first(gone.recipe.mission, removal.look) if removal.look else gone.recipe.mission
        limit = self.bound if removal.longer else limit
        self._without = replace(gone.recipe, mission=mission, limit=limit)

    def proof(self, forecast: Callable[[Forecast], None]) -> Proof:
        """Run the continuations, as few as decide, and return the verdict."""
        forecast(self._forecast())
        before, after = list[Trial](), list[Trial]()
        self._extend(before, self._with, while_=lambda: not self._all(before, OFTEN))
        if any(has_fact(before, fact).count(True) for fact in self._asked.facts):
            self._extend(after, self._without, while_=lambda: not self._all(after, OFTEN))
            self._extend(before, self._with, while_=lambda: self._unclear(before, after))
        verdicts = self._verdicts(before, after)
        return Proof(
            self._run.path.absolute(),
            self._asked,
            joint_verdict(verdicts.values()),
            self._sentence(verdicts, before, after),
            self.checkpoint,
            self.start,
            self.bound,
            tuple(before),
            tuple(after),
            verdicts,
        )

    def _verdicts(self, before: Sequence[Trial], after: Sequence[Trial]) -> dict[Fact, Verdict]:
        void = self._is_void(before, after)
        return {
            fact: verdict_of(has_fact(before, fact), has_fact(after, fact), void=void)
            for fact in self._asked.facts
        }

    def _is_void(self, before: Sequence[Trial], after: Sequence[Trial]) -> bool:
        """Return whether the removal of an event has changed nothing at all."""
        digests = {trial.variant: trial.digest for trial in before}
        return not self._removal.is_state and any(digests.get(t.variant) == t.digest for t in after)

    def _all(self, trials: Sequence[Trial], number: int) -> bool:
        return all(sum(has_fact(trials, fact)) >= number for fact in self._asked.facts)

    def _unclear(self, before: Sequence[Trial], after: Sequence[Trial]) -> bool:
        """Return whether a further continuation with the cause may show that it comes as often without."""
        verdicts = self._verdicts(before, after)
        return any(verdicts[fact] == "not decided" and any(has_fact(after, fact)) for fact in verdicts)

    def _extend(self, trials: list[Trial], recipe: run_recipe.Recipe, while_: Callable[[], bool]) -> None:
        """Run further continuations with the next variants."""
        for variant in VARIANTS[len(trials) :]:
            if not while_():
                return
            self._count += 1
            trials.append(self._trial(recipe, variant))

    def _trial(self, recipe: run_recipe.Recipe, variant: int) -> Trial:
        recipe = replace(recipe, variant=StreamVariant(variant, self._at))
        asked = self._asked.facts
        items = frozenset(fact.removeprefix("item ") for fact in asked if fact.startswith("item "))
        watch = SettledItems(items, self._asked.last, lambda now: self._progress(self._count, now))
        with tempfile.TemporaryDirectory(prefix="picktree-") as folder:
            session = Session(
                recipe,
                record=run_recipe.Recording(Path(folder)),
                observers=(watch, self._recorded.operator(self.start), self._recorded.edits(self.start)),
            )
            result = session.run()
            facts = frozenset(outcomes(session, result))
            return Trial(variant, facts, result.sim_seconds, result.digest, result.cpu_seconds)

    def _forecast(self) -> Forecast:
        number = 2 * len(VARIANTS)
        seconds = number * max(self._with.limit, self._without.limit) - number * self.start
        result = self._run.result
        known = result is not None and result.sim_seconds > 0.0
        rate = result.cpu_seconds / result.sim_seconds if result is not None and known else None
        return Forecast(number, seconds, None if rate is None else rate * seconds)

    def _sentence(
        self, verdicts: Mapping[Fact, Verdict], before: Sequence[Trial], after: Sequence[Trial]
    ) -> str:
        names, found = self._asked.names, verdicts

        def those(verdict: Verdict) -> str:
            return listed([names[fact] for fact in found if found[fact] == verdict], 3)

        proven = [fact for fact in found if found[fact] == "proven"]
        if proven:
            items = [names[fact].partition(" is not where")[0] for fact in proven if fact.startswith("item ")]
            rest = those("refuted")
            also = f"; it is not the reason that {rest}" if rest else ""
            if items and self._asked.root.cause == "item.appeared":
                return f"without it {listed(items, 3)} would not be there{also}"
            if items:
                return f"without it {listed(items, 3)} {'is' if len(items) == 1 else 'are'} sorted{also}"
            return f"without it {'the goal is reached' if proven == [GOAL] else 'the failure is gone'}{also}"
        if "not decided" not in found.values():
            return f"without it the same happens: {those('refuted')}"
        if not after:
            return "with it, too, the outcome does not come again: chance has a part in it"
        if self._is_void(before, after):
            return "nothing in the simulation was taken away: the cause is no event that it could leave out"
        return "it happens sometimes with it and sometimes without it"
