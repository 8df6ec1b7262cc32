"""An explanation as its two renderings: text and one JSON object."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, cast

from ...files.diagnostics.fault_rendering import Paint, plain
from ...files.node_patterns import short_names
from ...files.value_wording import listed
from ...logs.episode_counts import CauseCount
from ...logs.schema.json_records import encode
from ...world.journal import Plain
from ...world.run_events import BlackboardSetEvent
from .explanation import RATES, Explanation, ItemStory, RootCause
from .failure_text import FailureText, recovery_lines
from .number_wording import counted, seconds, wrapped

if TYPE_CHECKING:
    from ..run import Run


CAUSES = 8
"""Root causes that are told, unless all are asked for."""
ITEMS = 30
"""Items up to which those that are done are told, too."""

EVENTS = 9
"""Events of an item that are told, unless all are asked for."""


class ExplanationText:
    """Turns an explanation into lines.

    `log` is what the reader typed for the log, `program` how picktree is called here, `names` gives short
    names of nodes by their paths.
    """

    def __init__(
        self, found: Explanation, log: str, program: str, names: Mapping[str, str], paint: Paint = plain
    ) -> None:
        self._found = found
        self._log, self._program, self._names, self._paint = log, program, names, paint

    def text(self, head: str, notes: Sequence[str] = (), *, everything: bool = False) -> str:
        """`head`: what was run. `notes`: what the reader should know of the log. Without a line's end."""
        found = self._found
        role = "hint" if found.outcome.status == "success" else "error"
        lines = [
            *self._outcome(role),
            head,
            *(line for note in notes for line in wrapped(f"Note: {note}", "")),
        ]
        for part in (
            self._causes(everything),
            FailureText(found.failures, self._names, self._paint, found.recovery.episodes).lines(everything),
            recovery_lines(found.recovery, self._paint),
            self._items(everything),
            self._look(),
        ):
            shown = list(part)
            if shown:
                lines += ["", *shown]
        return "\n".join(lines)

    def _outcome(self, role: str) -> list[str]:
        outcome = self._found.outcome
        first, *rest = wrapped(f"{outcome.status}: {outcome.sentence}", "")
        word, _, told = first.partition(":")
        return [f"{self._paint(word, 'hint' if role == 'hint' else 'error')}:{told}", *rest]

    def _title(self, text: str) -> str:
        return self._paint(text, "place")

    def _causes(self, everything: bool) -> Iterator[str]:
        causes = self._found.root_causes
        if not causes:
            if self._found.outcome.status == "success" and not self._found.failures:
                yield self._title("Nothing failed.")
            return
        yield self._title("Root cause" if len(causes) == 1 else f"Root causes ({len(causes)})")
        shown = causes if everything else causes[:CAUSES]
        for number, cause in enumerate(shown, 1):
            mark = self._paint(f"{number}", "error" if cause.ended_run else "warning")
            first, *rest = wrapped(_sentence(cause.title), "     ")
            yield f"  {mark}  {first.strip()}"
            yield from rest
            yield from wrapped(self._cost(cause), "     ")
            for reason in cause.reasons:
                yield from wrapped(f"- {reason}", "     ", "       ")
            for fact in cause.against:
                yield from wrapped(f"- against it: {fact}", "     ", "       ")
            for planted in cause.planted:
                yield from wrapped(f"- a fault was planted: {planted}", "     ", "       ")

        if len(shown) < len(causes):
            yield f"  … {counted(len(causes) - len(shown), 'more root cause')} that cost less (--all)"

    def _cost(self, cause: RootCause) -> str:
        """Return the consequences of a root cause: goal, failures, lost time."""
        failures = [self._found.failures[n] for n in cause.failures]
        status = self._found.outcome.status
        if cause.ended_run:
            weight = "This cost the goal" if status == "incomplete" else "This ended the run"
        else:
            weight = (
                "The run got over it" if status in ("success", "incomplete") else "It did not end the run"
            )
        cost = f" ({listed(list(cause.items), 4)})" if cause.items and cause.ended_run else ""
        told = f"[{cause.cause}] {cause.confidence[0].upper()}{cause.confidence[1:]}. {weight}{cost}"
        if not failures:
            return f"{told}." if self._found.failures else f"{told}, and nothing failed."
        lost = cause.seconds_lost
        times = listed([seconds(f.time) for f in failures], 4)
        took = f", {lost:.1f} s lost" if lost >= 0.05 else ""
        return f"{told}: {counted(len(failures), 'failure')} at {times}{took}."

    def _items(self, everything: bool) -> Iterator[str]:
        items = self._found.items
        if not items:
            return
        quiet = [i for i in items if i.state == "done" and "it belongs into" not in i.truth]
        few = everything or len(items) <= ITEMS
        shown = [i for i in items if few or i not in quiet]
        yield self._title(f"Items ({len(items)}, as the robot believed)")
        width = max((len(i.id) for i in shown), default=0)
        for item in shown:
            yield from wrapped(_timeline(item, width, everything), "  ", " " * (width + 10))
        if len(shown) < len(items):
            yield f"  … {len(items) - len(shown)} more, done without a word (--all)"

    def _look(self) -> Iterator[str]:
        looks = self._found.look_at
        if not looks:
            return
        yield self._title("Look at")
        for look in looks:
            yield from wrapped(f"{look.time:7.2f} s  {look.why}", "  ", " " * 13)
        first = looks[0].time
        for told, command in (
            ("step through it", f"replay {self._log} --at {first:.2f}"),
            ("see it", f"snapshot {self._log} --at {first:.2f} -o moment.png"),
            ("the whole run", f"report {self._log} -o report.html"),
        ):
            yield f"  {told:<16} {self._program} {command}"


def _timeline(item: ItemStory, width: int, everything: bool) -> str:
    done = item.state == "done" and all(e.failure is None for e in item.events)
    told = [f"{e.time:.2f} s {_BRIEF.sub('', e.what) if done else e.what}" for e in item.events]
    if len(told) > EVENTS and not everything:
        told = [*told[: EVENTS - 3], f"… {len(told) - EVENTS + 1} more", *told[-2:]]
    events = "; ".join(told)
    truth = f" ({item.truth})" if item.truth else ""
    return f"{item.id:<{width}}  {item.state:<5} {events}{truth}"


_BRIEF = re.compile(r",? (?:for the first time|at x|\().*")
"""Parts left out of the timeline of an item that nothing happened to."""


def _sentence(text: str) -> str:
    return text if text.endswith((".", "!", "?")) else text + "."


def to_text(
    run: Run,
    found: Explanation,
    log: str,
    *,
    program: str = "picktree",
    paint: Paint = plain,
    everything: bool = False,
) -> str:
    """Without a line's end. `log`: what the reader typed for the log; `program`: how picktree is called."""
    page = ExplanationText(
        found, shlex.quote(log), program, short_names(node.path for node in run.nodes), paint
    )
    return page.text(_head(run), notes_on(run), everything=everything)


def to_json_text(run: Run, found: Explanation) -> str:
    """One object, with a line's end: outcome, failures, recovery, root_causes, items, look_at."""
    info = run.info
    outcome = {
        **_plain(found.outcome),
        "mission": info.mission,
        "scene": info.scene,
        "seed": info.seed,
        "backend": info.backend,
        "log": str(run.path),
        "notes": list(notes_on(run)),
    }
    failures = [{**_plain(f), "cured": f.cured} for f in found.failures]
    whole = {
        "outcome": outcome,
        "failures": failures,
        "recovery": {
            "causes": [_cause(each) for each in found.recovery.causes],
            "episodes": [
                {**_plain(each), "time": each.time, "cure": each.cure} for each in found.recovery.episodes
            ],
            "planted": [_plain(each) for each in found.recovery.planted],
        },
        "root_causes": [
            {**_plain(cause), "confidence_rate": RATES[cause.confidence]} for cause in found.root_causes
        ],
        "items": [_plain(item) for item in found.items],
        "look_at": [_plain(look) for look in found.look_at],
    }
    return json.dumps(json.loads(encode(whole)), ensure_ascii=False, indent=2) + "\n"


def notes_on(run: Run) -> tuple[str, ...]:
    """Return the limits of this log that a reader should know before believing the explanation."""
    notes: list[str] = []
    if run.recovered:
        notes.append(run.recovered.removeprefix(f"{run.path}: "))
    origin = run.info.continues
    if origin is not None and origin.time > 0.0:
        of = f" of {origin.log}" if origin.log else ""
        notes.append(f"the log begins at {origin.time:.2f} s, at a checkpoint{of}; it lacks what was before")
    if run.log.format < 2:
        notes.append(
            f"the log is of format {run.log.format}: when nodes began and ended is derived from their "
            "statuses, and what they read is not known"
        )
    edits = [at.time for at in run.events if at.record.kind == "mission_edited"]
    if edits:
        told = ", ".join(f"{time:.2f} s" for time in edits)
        notes.append(f"the mission was edited while it ran, at {told}; nodes are those of their time")
    for at in run.events:
        if isinstance(at.record, BlackboardSetEvent):
            notes.append(f"{at.time:.2f} s: {at.record.message}")
    return tuple(notes)


def _head(run: Run) -> str:
    info = run.info
    length = f"{run.duration:.1f} s simulated"
    return f"{info.mission}, scene {info.scene}, {info.seed_text}, {info.backend}: {length}"


def _cause(found: CauseCount) -> dict[str, Plain]:
    """All episodes of one cause, with what was tried in `by`."""
    parts: list[Plain] = [_plain(each) for each in found.by_cure]
    return {**_plain(found.total), "by": parts}


def _plain(value: object) -> dict[str, Plain]:
    return cast("dict[str, Plain]", asdict(value))  # type: ignore[call-overload]
