"""Labels of situations by experiment: the same run from its strike on, with and without each deviation.

The outcome of a run is coarse: which items are not where they belong, whether the goal was missed, and its
failures as family of cause, skill and item. A run goes on from the last checkpoint before the strike, three
times each way. From the strike on, the noise of cameras and wrist and the planner's seeds are drawn from
another variant of their streams. What is taken away is switched off in its place.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any, Literal, TypeAlias

from _situation_drawing import LIMIT, Occasion, Situation, write
from picktree.analysis import Run, outcomes
from picktree.analysis.explain import GOAL
from picktree.session import RecordedRun, ResumeRequest, Resumption, RunRequest, Session
from picktree.session.run_recipe import Recipe, Recording, StartCheckpoint, read_recipe
from picktree.simulation import new_states
from picktree.simulation.fault_entries import FaultFile
from picktree.world import StreamVariant, event_types

import yaml

VARIANTS = (1, 2, 3)
"""Stream variants of the continuations. With and without a deviation they are the same."""
OFTEN, NEVER = 2, 0
"""Number of continuations from which an outcome is there, and number at which it is not."""
TICK = 0.05
"""Length of a tick, simulated s."""
LATER = 20.0
"""Time that a continuation may take longer than the run and the clean run, simulated s."""
FACTS = "facts.json"
"""File with the outcomes of a run, beside its folder."""

Facts: TypeAlias = frozenset[str]
Status: TypeAlias = Literal["cause", "no cause", "undecided"]


@dataclass(frozen=True)
class Strike:
    """Deviation as it happened in the run."""

    number: int
    """Number among the deviations of the situation."""
    at: float
    """Time of the strike, simulated s; 0 for a change of mission or scene."""
    item: str = ""
    """Id of the true item that it struck."""
    words: tuple[str, ...] = ()
    """Names of that item: true id, colour and kind, believed ids."""


@dataclass(frozen=True)
class Comparison:
    """Outcomes of continuations with all deviations, and without some, from the strike of these on."""

    with_all: Sequence[Facts]
    without: Sequence[Facts]

    def verdict(self, fact: str) -> Status:
        """Return whether what is taken away ends an outcome."""
        before, after = (sum(fact in facts for facts in runs) for runs in (self.with_all, self.without))
        if before == NEVER:
            return "no cause"  # it does not come again: chance
        if before >= OFTEN and after == NEVER:
            return "cause"
        as_often = after * len(self.with_all) >= before * len(self.without)
        return "no cause" if after and as_often else "undecided"


@dataclass(frozen=True)
class Label:
    """Result of the experiments about one run."""

    status: Literal["clean", "harmless", "cause", "no cause", "undecided"]
    groups: tuple[tuple[int, ...], ...] = ()
    """Deviations that belong to a smallest set whose removal ends the outcome, by outcome; that of most items
    first."""
    target: str = ""
    """Outcome that is explained: the missed goal, or the costliest failure."""
    excluded: tuple[int, ...] = ()
    """Deviations that the experiments exclude as a cause of any outcome."""


def label_of(
    tests: Mapping[frozenset[int], Comparison], all_of: frozenset[int], targets: Sequence[str]
) -> Label:
    """Return the label from comparisons of continuations, by the set of deviations that is taken away.

    targets: outcomes of the run that count; the first is the one that is explained.
    """
    found: dict[tuple[int, ...], int] = {}
    verdicts: list[Status] = []
    named = _named(targets)
    for fact in named:
        status, group = cause_of(tests, all_of, fact)
        verdicts.append(status)
        if status == "cause":
            found[group] = found.get(group, 0) + 1
    if not found and GOAL in targets and named != [GOAL]:
        status, group = cause_of(tests, all_of, GOAL)
        verdicts.append(status)
        if status == "cause":
            found[group] = 1
    groups = tuple(sorted(found, key=lambda group: (-found[group], group)))
    blamed = {number for group in groups for number in group}
    target = targets[0] if targets else ""
    if groups:
        return Label("cause", groups, target, tuple(sorted(all_of - blamed)))
    if "undecided" in verdicts:
        return Label("undecided", (), target)
    return Label("no cause", (), target, tuple(sorted(all_of)))


def _named(targets: Sequence[str]) -> list[str]:
    """Return the outcomes that have causes of their own: the items that miss the goal, or the one outcome."""
    return [fact for fact in targets if fact != GOAL] or list(targets)


def cause_of(
    tests: Mapping[frozenset[int], Comparison], all_of: frozenset[int], fact: str
) -> tuple[Status, tuple[int, ...]]:
    """Return whether deviations cause an outcome, and those that belong to a smallest set that ends it."""
    unclear = False
    for size in range(1, len(all_of) + 1):
        ended: set[int] = set()
        doubtful = False
        for taken in map(frozenset, combinations(sorted(all_of), size)):
            verdict = tests[taken].verdict(fact) if taken in tests else "undecided"
            if verdict == "cause":
                ended |= taken
            doubtful = doubtful or verdict == "undecided"
        if ended:  # sets of this size that do not end it clearly are no smaller ones
            return ("undecided", ()) if unclear else ("cause", tuple(sorted(ended)))
        unclear = unclear or doubtful
    return ("undecided", ()) if unclear else ("no cause", ())


class Experiment:
    """Run of a situation in a folder, and its continuations. What was run before is not run again."""

    def __init__(self, situation: Situation, folder: Path, cells: Path) -> None:
        """`cells`: folder of the clean runs, which situations of one cell share."""
        self.situation, self.folder, self._cells = situation, folder, cells
        self._all = tuple(range(len(situation.deviations)))
        self._file = folder / "outcomes.json"
        self._outcomes: dict[str, list[str]] = (
            json.loads(self._file.read_text()) if self._file.exists() else {}
        )

    @cached_property
    def prefix(self) -> Path:
        """Folder of the run without faults: the clean run of the cell, or the one with changed files."""
        files = tuple(n for n in self._all if self.situation.deviations[n].where != "fault")
        mission, scene = self.situation.trees(files)
        cell = self.situation.cell
        text = json.dumps([mission, scene, cell.robot, cell.backend, cell.seed], sort_keys=True)
        place = self._cells / hashlib.sha256(text.encode()).hexdigest()[:12]
        return self._run_once(place, files, ())

    @cached_property
    def entries(self) -> list[dict[str, Any]]:
        """Entries of the faults file, with absolute times and items by number, in the order of the draw."""
        with Run(self.prefix) as run:
            return [
                _placed(deviation.entry, deviation.occasion, run)
                for deviation in self.situation.deviations
                if deviation.where == "fault"
            ]

    @cached_property
    def run(self) -> Path:
        """Folder of the run that is explained."""
        files, faults = self._parts(self._all)
        if self.situation.resumed is not None:
            return self._resumed(files, faults)
        if any(each.kind == "kill" for each in self.situation.deviations):
            return self._killed(self.folder, files, self._written(self.folder, faults))
        return self._run_once(self.folder, files, faults) if faults else self.prefix

    def strikes(self) -> list[Strike]:
        """Return the deviations that happened, in the order of the draw."""
        found: list[Strike] = []
        with Run(self.whole) as run:
            planted = [at for at in run.events if isinstance(at.record, event_types.FaultEvent)]
            events = [at for at in planted if not at.record.gone and not at.record.waits]
            entries = iter(self.entries)
            for number, deviation in enumerate(self.situation.deviations):
                if deviation.where != "fault":
                    found.append(Strike(number, 0.0))
                    continue
                entry = next(entries)
                mine = [at for at in events if at.record.fault == deviation.kind]
                missed = mine and mine[0].record.extra.get("item", "") is None
                if not mine or missed:
                    continue
                item = str(mine[0].record.item or "")
                words = names_of(run, item, mine[0].time) if item else ()
                found.append(Strike(number, mine[0].time, item, words))
                assert entry["fault"] == deviation.kind
        return found

    @property
    def _place(self) -> Path:
        """Folder with the outcomes of the run that is explained."""
        return self.run.parent.parent

    @cached_property
    def whole(self) -> Path:
        """Folder of the log with the strikes: for a resumed run the one of the killed process."""
        run = self.run
        return run if self.situation.resumed is None else _only(self.folder / "killed" / "runs")

    def targets(self) -> tuple[str, ...]:
        """Return the outcomes of the run that are to be explained; empty when nothing went wrong."""
        known = json.loads((self._place / FACTS).read_text())
        facts, costly = known["facts"], known["costly"]
        if GOAL in facts:
            return (GOAL, *sorted(fact for fact in facts if fact.startswith("item ")))
        return (costly,) if costly else ()

    def label(self) -> Label:
        """Return the label. Runs the continuations that it needs."""
        targets, strikes = self.targets(), self.strikes()
        if not targets:
            return Label("harmless" if strikes else "clean")
        present = frozenset(strike.number for strike in strikes)
        if not present:
            return Label("no cause", (), targets[0])
        if any(self.situation.deviations[number].kind == "kill" for number in present):
            return Label("cause", (tuple(present),), GOAL)  # the log ends there, by construction
        named = _named(targets)
        tests: dict[frozenset[int], Comparison] = {}
        for size in range(1, len(present) + 1):
            for taken in map(frozenset, combinations(sorted(present), size)):
                tests[taken] = self._compared(present, taken, targets)
            if all(cause_of(tests, present, fact)[0] == "cause" for fact in named):
                break
        return label_of(tests, present, targets)

    def _compared(self, present: frozenset[int], taken: frozenset[int], targets: Sequence[str]) -> Comparison:
        """Return the outcomes with and without some deviations, from a tick before the first of them acts."""
        since = min(self._due(number) for number in taken)
        with_all = self._continued(present, since, targets)
        again = any(sum(fact in facts for facts in with_all) >= OFTEN for fact in _named(targets))
        return Comparison(with_all, self._continued(present - taken, since, targets) if again else ())

    def _due(self, number: int) -> float:
        """Return the time from which a deviation may act, simulated s: of a fault a tick before it is due."""
        if self.situation.deviations[number].where != "fault":
            return 0.0
        of_faults = [n for n, each in enumerate(self.situation.deviations) if each.where == "fault"]
        return max(0.0, float(self.entries[of_faults.index(number)]["when"]["at"]) - TICK)

    def _parts(self, present: Sequence[int]) -> tuple[tuple[int, ...], tuple[dict[str, Any], ...]]:
        """Return the numbers of changed files, and the faults: those that are not present are off."""
        entries, faults = iter(self.entries), list[dict[str, Any]]()
        for number, deviation in enumerate(self.situation.deviations):
            if deviation.where == "fault":
                entry = next(entries)
                faults.append(entry if number in present else {**entry, "off": True})
        return tuple(n for n in present if self.situation.deviations[n].where != "fault"), tuple(faults)

    def _continued(self, present: frozenset[int], since: float, targets: Sequence[str]) -> list[Facts]:
        """Return the outcomes of the continuations with these deviations, which are as few as decide."""
        found: list[Facts] = []
        recipe: Recipe | None = None
        for variant in VARIANTS:
            key = f"{sorted(present)} {since:g} {variant}"
            if key not in self._outcomes:
                if recipe is None:
                    recipe = self._recipe(present, since)
                self._outcomes[key] = sorted(self._outcome(recipe, StreamVariant(variant, since)))
                self._file.write_text(json.dumps(self._outcomes, indent=1))
            found.append(frozenset(self._outcomes[key]))
            if len(found) == OFTEN and all(all(fact in facts for facts in found) for fact in targets):
                break
        return found

    def _recipe(self, present: frozenset[int], since: float) -> Recipe:
        """Return the recipe with these deviations, from the last checkpoint before `since`."""
        files, faults = self._parts(sorted(present))
        place = self.folder / "continued"
        shutil.rmtree(place, ignore_errors=True)
        if since <= 0.0:
            return read_recipe(self._request(place, files, faults))
        with Run(self.whole) as run, Run(self.prefix) as clean, RecordedRun(run) as recorded:
            limit = min(LIMIT, max(run.end, clean.end) + LATER)
            found = recorded.last_checkpoint(since)
            recipe = read_recipe(self._request(place, files, faults))
            if found is not None:
                start = recorded.from_checkpoint(*found).start
                assert start is not None
                before = recorded.recipe().faults
                recipe = replace(recipe, start=_with_faults(start, recipe, before))
        return replace(recipe, limit=limit)

    def _outcome(self, recipe: Recipe, variant: StreamVariant) -> Facts:
        away = self.folder / "continued" / "runs"
        facts, _ = _ran(Session(replace(recipe, variant=variant), record=Recording(away)))
        shutil.rmtree(away, ignore_errors=True)
        return facts

    def _request(self, place: Path, files: Sequence[int], faults: Sequence[Mapping[str, Any]]) -> RunRequest:
        mission, scene = self.situation.trees(files)
        write(mission, scene, place)
        cell = self.situation.cell
        return RunRequest(
            mission=place / "mission.yaml",
            robot=cell.robot,
            seed=cell.seed,
            backend=cell.backend,
            faults=self._written(place, faults),
            out=place / "runs",
            limit=LIMIT,
        )

    def _written(self, place: Path, faults: Sequence[Mapping[str, Any]]) -> Path | None:
        if not faults:
            return None
        place.mkdir(parents=True, exist_ok=True)
        path = place / "faults.yaml"
        path.write_text(
            yaml.safe_dump({"picktree": 1, "kind": "faults", "faults": list(faults)}, sort_keys=False)
        )
        return path

    def _run_once(self, place: Path, files: Sequence[int], faults: Sequence[Mapping[str, Any]]) -> Path:
        """Return the folder of the run of these files, which is made unless it is there."""
        if not (place / FACTS).exists():
            shutil.rmtree(place / "runs", ignore_errors=True)
            _keep(place, *_ran(Session(self._request(place, files, faults))))
        return _only(place / "runs")

    def _killed(self, place: Path, files: Sequence[int], faults: Path | None) -> Path:
        """Return the folder of a run whose process a fault has killed."""
        if (place / FACTS).exists():
            return _only(place / "runs")
        shutil.rmtree(place / "runs", ignore_errors=True)
        mission, scene = self.situation.trees(files)
        write(mission, scene, place)
        cell = self.situation.cell
        words = [
            sys.executable,
            "-m",
            "picktree",
            "run",
            str(place / "mission.yaml"),
            "--seed",
            str(cell.seed),
        ]
        words += ["--backend", cell.backend, "--robot", cell.robot, "--limit", f"{LIMIT:g}"]
        words += ["--faults", str(faults), "--out", str(place / "runs")]
        ended = subprocess.run(words, capture_output=True, text=True)
        if ended.returncode not in (-signal.SIGKILL, 0, 1):  # it may end before it is killed
            raise RuntimeError(f"exit code {ended.returncode}: {ended.stderr[-300:]}")
        _keep(place, frozenset({GOAL} if ended.returncode == -signal.SIGKILL else ()), "")
        return _only(place / "runs")

    def _resumed(self, files: Sequence[int], faults: Sequence[Mapping[str, Any]]) -> Path:
        """Return the folder of the run that resumes the killed one; that one itself if it was not killed."""
        share = self.situation.resumed
        assert share is not None
        with Run(self.prefix) as run:
            kill = {"fault": "kill", "when": {"at": round(share * run.end, 2)}}
        place = self.folder / "killed"
        before = self._killed(place, files, self._written(place, (*faults, kill)))
        with Run(before) as run:
            if run.status != "killed":  # it had ended before
                return self._run_once(self.folder, files, faults)
        if not (self.folder / FACTS).exists():
            shutil.rmtree(self.folder / "runs", ignore_errors=True)
            with Resumption(ResumeRequest(before, self.folder / "runs")) as resumption:
                _keep(self.folder, *_ran(resumption.session()))
        return _only(self.folder / "runs")


def _with_faults(start: StartCheckpoint, recipe: Recipe, before: FaultFile | None) -> StartCheckpoint:
    """Return a checkpoint with the states of the recipe's faults; those that are the same keep theirs."""
    state = start.state
    faults = new_states(recipe.faults, recipe.seed, state.time, (before, state.faults))
    return replace(start, state=replace(state, faults=faults))


def _only(folder: Path) -> Path:
    return next(iter(sorted(folder.glob("*/"))))


def _placed(entry: Mapping[str, Any], occasion: Occasion | None, run: Run) -> dict[str, Any]:
    """Return the entry of a faults file with its absolute time and its item's number."""
    at, item, end = 0.0, "", run.end
    if occasion is not None:
        at = occasion.share * end
        visits = [visit for visit in run.visits if visit.id in occasion.skills]
        if visits:
            visit = visits[min(int(occasion.visit * len(visits)), len(visits) - 1)]
            at, item = visit.start + occasion.share * (visit.end - visit.start), visit.item
    placed = {**entry, "when": {"at": round(TICK * math.floor(at / TICK), 2)}}
    if "target" in entry:
        placed["target"] = {"index": _true_number(run, at, item, occasion)}
    return placed


def _true_number(run: Run, at: float, item: str, occasion: Occasion | None) -> int:
    """Return the number of the true item that a believed one is, else of a drawn one."""
    scene = run.at(at)
    bodies = [
        body
        for body in (scene.truth.bodies if scene.truth else ())
        if re.fullmatch(r"item_\d+", str(body.id))
    ]
    believed = {body.id: body for body in (scene.belief.bodies if scene.belief else ())}.get(item)
    if not bodies:
        return 0
    if believed is not None:
        near = min(bodies, key=lambda body: math.dist(body.pose.position, believed.pose.position))
    else:
        near = bodies[int((occasion.share if occasion else 0.5) * len(bodies)) % len(bodies)]
    return int(str(near.id).removeprefix("item_"))


def names_of(run: Run, item: str, at: float) -> tuple[str, ...]:
    """Return the names of a true item: its id, colour and kind, and the ids of what was believed near it."""
    found = {item: None}
    for time in (at - 1.0, at - 0.3, at, at + 1.0, run.end):  # a removed item is there before only
        moment = run.at(min(max(time, run.ticks.times[0]), run.ticks.times[-1]))
        body = next((b for b in (moment.truth.bodies if moment.truth else ()) if b.id == item), None)
        if body is None:
            continue
        found[f"{body.colour} {body.kind}"] = None
        for believed in moment.belief.bodies if moment.belief else ():
            if believed.role == "item" and math.dist(believed.pose.position, body.pose.position) < 0.06:
                found[str(believed.id)] = None
    return tuple(found)


def _keep(place: Path, facts: Facts, costly: str) -> None:
    """Write the outcomes of a run beside it: they say that it is whole, too."""
    part = place / f"{FACTS}.part"
    part.write_text(json.dumps({"facts": sorted(facts), "costly": costly}))
    part.replace(place / FACTS)


def _ran(session: Session) -> tuple[Facts, str]:
    """Run a session; return the outcomes, and the costliest failure of the log; empty without one."""
    facts = outcomes(session, session.run())
    failures = {fact: cost for fact, cost in facts.items() if fact.startswith("failure ")}
    return frozenset(facts), max(failures, key=lambda fact: failures[fact], default="")
