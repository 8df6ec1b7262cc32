"""The failure atlas: which runs of the campaign are the worst, and a page about each."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from _fault_measures import Measure
from _fault_table import sortable
from picktree.simulation.fault_entries import FaultExpectation

if TYPE_CHECKING:
    from picktree.analysis import Run
    from picktree.analysis.explain import FailureStory

MOST_OF_A_FAULT = 2


@dataclass(frozen=True, slots=True)
class Badness:
    """How bad a run was; the greater the worse."""

    lost: int
    """Items that could have been sorted and were not."""
    late: float
    """Simulated s more than the same seed took without any fault, or than those runs took on average."""
    force: float
    """N"""

    @property
    def rank(self) -> tuple[int, float, float]:
        return self.lost, self.late, self.force


@dataclass(frozen=True, slots=True)
class Entry:
    """A run of the atlas."""

    measure: Measure
    badness: Badness


def worst(measures: Sequence[Measure], expects: Mapping[str, FaultExpectation], most: int) -> list[Entry]:
    """The worst runs with recovery and a fault that took effect: first by items lost, then by time lost, then
    by force; at most two of a fault."""
    calm = {one.seed: one.seconds for one in measures if one.recovery and one.fault == "none" and one.seconds}
    usual = sum(calm.values()) / len(calm) if calm else 0.0
    entries = [
        Entry(one, _badness(one, expects.get(one.fault, FaultExpectation(())), calm.get(one.seed, usual)))
        for one in measures
        if one.recovery and one.fault != "none" and one.took_effect
    ]
    entries.sort(key=lambda entry: entry.badness.rank, reverse=True)
    taken: Counter[str] = Counter()
    chosen: list[Entry] = []
    for entry in entries:
        if len(chosen) < most and taken[entry.measure.fault] < MOST_OF_A_FAULT:
            taken[entry.measure.fault] += 1
            chosen.append(entry)
    return chosen


def _badness(one: Measure, expect: FaultExpectation, usual: float) -> Badness:
    lost = 0 if one.total is None else max(0, sortable(one, expect) - (one.sorted or 0))
    if one.total is None:
        lost = 99  # nothing came of it at all
    return Badness(lost, round((one.seconds or 0.0) - usual, 2), one.force)


def telling(run: Run, struck: float) -> FailureStory | None:
    """The failure that says most of why the run went as it did: of the root cause that ended it, or of the
    dearest; else the first after the fault; None when none was reported."""
    failures, roots = run.failures, run.explanation.root_causes
    after = [failure for failure in failures if failure.time >= struck - 1e-9]
    for root in sorted(roots, key=lambda root: (not root.ended_run, -root.seconds_lost)):
        of_it = [failure for failure in after if failure.number in root.failures]
        if of_it:
            return of_it[0]
    return after[0] if after else None


def planted(run: Run) -> Iterable[str]:
    """What the simulation did, as the record says it."""
    for at in run.events:
        if at.record.kind == "fault":
            yield f"{at.time:.2f} s: {at.record.message}"


def chain_of(failure: FailureStory) -> str:
    """From where it came up towards the root, as far as its fate was decided there."""
    names = [f"`{failure.id}`"]
    for link in failure.chain:
        names.append(f"`{link.id}`" if link.outcome == "FAILURE" else f"`{link.id}` ({link.outcome})")
        if link.path == failure.fate_by:
            break
    return " → ".join(names)


def cure_of(failure: FailureStory) -> str:
    """What was tried, what came of it, and what the cause itself advises."""
    tried = [
        f"*{handling.handler}* (attempt {handling.attempt}, {handling.seconds:.1f} s, {handling.ended})"
        for handling in failure.handled_by
    ]
    fates = {
        "cured": "That cured it",
        "passed_over": "Nothing cured it, and the mission went on with the next item",
        "branched": "The mission went another way",
        "done_instead": "What the mission asks for instead was done",
        "ended": "It ended the mission",
        "open": "The log ends before anything came of it",
    }
    lost = failure.seconds_lost
    fate = fates[failure.fate] + (f"; {lost:.1f} s lost." if lost else ".")
    advice = f" What helps against `{failure.cause}` in general: {failure.remedy}."
    return (f"Tried: {', '.join(tried)}. " if tried else "Nothing was tried. ") + fate + advice


def heading(number: int, entry: Entry) -> str:
    one = entry.measure
    return f"## {number}. {one.fault.replace('_', ' ').capitalize()}, seed {one.seed}"


def outcome(entry: Entry, expect: FaultExpectation) -> str:
    one, bad = entry.measure, entry.badness
    if one.total is None:
        return f"No result: {one.message}"
    able = sortable(one, expect)
    parts = [f"{min(one.sorted or 0, able)} of {able} sortable items sorted"]
    if one.misplaced:
        parts.append(f"{one.misplaced} in a wrong bin")
    if one.on_floor:
        parts.append(f"{one.on_floor} beside the table")
    parts.append(f"ended as `{one.status}`" + (f" ({one.message})" if one.message else ""))
    parts.append(f"{bad.late:+.1f} s against the run without a fault")
    parts.append(f"at most {one.force:.0f} N at the wrist")
    return "; ".join(parts) + "."


def command(entry: Entry, mission: str, scene: str, faults: str) -> str:
    one = entry.measure
    words = ["picktree", "run", mission, "--scene", scene, "--faults", faults, "--seed", str(one.seed)]
    resume = "\npicktree run --resume last" if one.killed else ""
    return f"{shlex.join(words)}{resume}\npicktree explain last"


def section(
    number: int,
    entry: Entry,
    expect: FaultExpectation,
    run: Run | None,
    picture: Path | None,
    shown: str,
) -> str:
    """All that is said of one run. `shown`: the command; `picture`: relative to the page."""
    one = entry.measure
    parts = [heading(number, entry), ""]
    failure = telling(run, one.fault_at or 0.0) if run is not None else None
    if picture is not None:
        what = f"{failure.cause} at {failure.time:.2f} s" if failure else "the end of the run"
        parts += [f"![{what}: belief, and the truth as outlines]({picture})", ""]
    if run is not None:
        told = list(planted(run))
        more = f" … and {len(told) - 3} more" if len(told) > 3 else ""
        parts.append(f"- **Planted**: {'; '.join(told[:3])}{more}.")
    parts.append(f"- **Came of it**: {outcome(entry, expect)}")
    if failure is not None:
        about = f", about {failure.item}" if failure.item else ""
        parts += [
            f"- **Cause**: `{failure.cause}` at {failure.time:.2f} s{about}: {failure.message}",
            f"- **Chain**: {chain_of(failure)}",
            f"- **Cure**: {cure_of(failure)}",
        ]
    elif run is not None:
        parts.append("- **Cause**: no failure was reported after the fault.")
    return "\n".join([*parts, "", "```sh", shown, "```", ""])
