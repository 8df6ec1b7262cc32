"""Renderings of an explanation: text with a paragraph for each failure, and one JSON object."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, cast

from picktree.files import Paint, listed, plain, short_names
from picktree.logs import CureAttempt, Episodes, episode_counts, item_episodes, log_records
from picktree.robot.manipulation import pick_candidates
from picktree.world import Plain, event_types

from .explanation import (
    CandidateChoice,
    Explanation,
    FailureStory,
    ItemStory,
    RootCause,
    counted,
    seconds,
    wrapped,
)

if TYPE_CHECKING:
    from picktree.analysis import Run

MAX_PLANTED = 12
"""Maximum number of injected faults in the text."""


def recovery_lines(found: Episodes, paint: Paint) -> Iterator[str]:
    """Yield the lines about recovery; none without failures and injected faults."""
    if found.episodes:
        yield paint(_title(found), "place")
        width = max(5, *(len(each.cause) for each in found.causes))
        yield f"  {'cause':<{width}}  seen  cured  tries   s lost  by"
        for each in found.causes:
            total, tries = each.total, each.total.tries_a_cure
            attempts = "" if tries is None else f"{tries:.1f}"
            numbers = f"{total.seen:>4}  {total.cured:>5}  {attempts:>5}  {total.seconds:>7.1f}"
            row = f"  {each.cause:<{width}}  {numbers}  "
            first, *rest = wrapped(_by(each), " " * len(row))
            yield row + first.strip()
            yield from rest
    if found.planted:
        yield paint("Planted faults, and the first failure after each", "place")
        for fault in found.planted[:MAX_PLANTED]:
            yield from wrapped(f"{fault.time:7.2f} s  {fault.message}: {_then(fault)}", "  ", " " * 13)
        if len(found.planted) > MAX_PLANTED:
            yield f"  … {len(found.planted) - MAX_PLANTED} more (--json)"


def _title(found: Episodes) -> str:
    ends = [(label, sum(e.end == end for e in found.episodes)) for end, label in item_episodes.ENDS.items()]
    outcomes = ", ".join(f"{number} {label}" for label, number in ends if number)
    lost = sum(e.seconds for e in found.episodes)
    return f"Recovery ({counted(len(found.episodes), 'episode')}: {outcomes}; {lost:.1f} s lost)"


def _by(found: episode_counts.CauseCount) -> str:
    """Return the handlers that cured the cause, or else the vain ones; then those of `instead`."""
    instead = [f"{each.cure} instead ({each.done_instead})" for each in found.by_cure if each.done_instead]
    if instead and not found.total.to_cure:
        return ", ".join(instead)
    cured = [each for each in found.by_cure if each.cured]
    if cured:
        by = [each.cure if len(cured) == 1 else f"{each.cure} ({each.cured})" for each in cured]
        by[-1] += found.failed_before
    elif found.tried:
        by = [f"tried in vain: {', '.join(found.tried)}"]
    else:
        by = ["given up untried" if found.total.given_up else "nobody"]
    return ", ".join([*by, *instead])


def _then(fault: event_types.FaultOutcomeEvent) -> str:
    if fault.end is None or fault.after is None:
        return "nothing failed"
    return f"{fault.cause} {fault.after:.1f} s later, {item_episodes.ENDS[fault.end]}"


MAX_SINGLE = 8
"""Maximum number of failures that are described one by one, unless all are requested."""
MAX_GROUPS = 12
"""Maximum number of groups of failures in the text, unless all are requested."""
_BODY, _HANGING = " " * 13, " " * 15
_FATES = {
    "cured": "cured",
    "done_instead": "done instead",
    "passed_over": "passed over",
    "branched": "went another way",
    "ended": "ended the mission",
    "open": "still open when the log ends",
}


def _alike(failures: Sequence[FailureStory]) -> list[list[FailureStory]]:
    """Group failures with the same node, item, cause, root cause and outcome."""
    groups: dict[object, list[FailureStory]] = {}
    for f in failures:
        key = (f.node, f.item, f.cause, f.root_cause, f.fate, f.because_of is None)
        groups.setdefault(key, []).append(f)
    return list(groups.values())


def _has_details(choice: CandidateChoice, story: FailureStory) -> bool:
    """Whether a choice has more details than the failure's message."""
    if any(r.stage for r in choice.rejections) and all(r.reason in story.message for r in choice.rejections):
        return False
    return any(r.count > 1 or story.message not in r.reason for r in choice.rejections)


def _choice(choice: CandidateChoice) -> str:
    if any(r.stage for r in choice.rejections):
        candidates = counted(dict(choice.stages).get(pick_candidates.RANKED_STAGE, 0), "candidate")
        counts = _few([f"{r.count} {r.reason}" for r in choice.rejections])
        return f"Grasps at {seconds(choice.time)}: {candidates}: {'; '.join(counts)}."
    stages = ", ".join(f"{count} {name}" for name, count in choice.stages)
    what = "Plans" if choice.purpose == "plan" else f"Grasps at {seconds(choice.time)}"
    text = f"{what}: {stages}."
    refused = [f"{r.reason} ({r.count})" if r.count > 1 else r.reason for r in choice.rejections]
    return f"{text} Refused: {'; '.join(_few(refused))}." if refused else text


def _few(words: Sequence[str], most: int = 4) -> list[str]:
    return [*words[:most], f"{len(words) - most} other reasons"] if len(words) > most else [*words]


MAX_CAUSES = 8
"""Maximum number of root causes in the text, unless all are requested."""
MAX_ITEMS = 30
"""Maximum number of items up to which finished items are listed, too."""
MAX_EVENTS = 9
"""Maximum number of events of an item in the text, unless all are requested."""


def cause_account(found: Explanation, cause: RootCause) -> str:
    """Return confidence and consequences of a root cause: goal, items, failures, lost time."""
    failures = [found.failures[n] for n in cause.failures]
    status = found.outcome.status
    if cause.ended_run:
        ended = status != "incomplete" and (not cause.items or any(f.fate == "ended" for f in failures))
        weight = "This ended the run" if ended else "This cost the goal"
    else:
        recovered = status in ("success", "incomplete")
        weight = "The run recovered from it" if recovered else "This cause did not end the run"
    cost = f" ({listed(list(cause.items), 4)})" if cause.items and cause.ended_run else ""
    text = f"{cause.confidence[0].upper()}{cause.confidence[1:]}. {weight}{cost}"
    if not failures:
        return f"{text}." if found.failures else f"{text}, and nothing failed."
    times = listed([seconds(f.time) for f in failures], 4)
    took = f", {cause.seconds_lost:.1f} s lost" if cause.seconds_lost >= 0.05 else ""
    return f"{text}: {counted(len(failures), 'failure')} at {times}{took}."


class ExplanationText:
    """Text renderer of an explanation.

    `log` is the reader's argument for the log, `program` the command name of picktree, `names` the short
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
        lines = [
            *self._outcome(),
            head,
            *(line for note in notes for line in wrapped(f"Note: {note}", "")),
        ]
        for part in (
            self._causes(everything),
            self._failures(everything),
            recovery_lines(found.recovery, self._paint),
            self._items(everything),
            self._look(),
        ):
            shown = list(part)
            if shown:
                lines += ["", *shown]
        return "\n".join(lines)

    def _outcome(self) -> list[str]:
        outcome = self._found.outcome
        first, *rest = wrapped(f"{outcome.status}: {outcome.sentence}", "")
        word, _, sentence = first.partition(":")
        return [f"{self._paint(word, 'hint' if outcome.status == 'success' else 'error')}:{sentence}", *rest]

    def _title(self, text: str) -> str:
        return self._paint(text, "place")

    def _causes(self, everything: bool) -> Iterator[str]:
        causes = self._found.root_causes
        if not causes:
            if self._found.outcome.status == "success" and not self._found.failures:
                yield self._title("Nothing failed.")
            return
        yield self._title("Root cause" if len(causes) == 1 else f"Root causes ({len(causes)})")
        shown = causes if everything else causes[:MAX_CAUSES]
        for number, cause in enumerate(shown, 1):
            mark = self._paint(f"{number}", "error" if cause.ended_run else "warning")
            stop = "" if cause.title.endswith((".", "!", "?")) else "."
            first, *rest = wrapped(cause.title + stop, "     ")
            yield f"  {mark}  {first.strip()}"
            yield from rest
            yield from wrapped(f"[{cause.cause}] {cause_account(self._found, cause)}", "     ")
            for facts, title in (
                (cause.reasons, ""),
                (cause.against, "against it: "),
                (cause.planted, "a fault was planted: "),
            ):
                for fact in facts:
                    yield from wrapped(f"- {title}{fact}", "     ", "       ")
        if len(shown) < len(causes):
            yield f"  … {counted(len(causes) - len(shown), 'more root cause')} with lower costs (--all)"

    def _failures(self, everything: bool) -> Iterator[str]:
        """Yield the failures. Many failures are grouped unless `everything` is set."""
        failures = self._found.failures
        if not failures:
            return
        counts = [(fate, sum(f.fate == fate for f in failures)) for fate in _FATES]
        summary = ", ".join(f"{n} {_FATES[fate]}" for fate, n in counts if n)
        yield self._title(f"Failures ({len(failures)}: {summary})")
        groups = [[f] for f in failures]
        if not everything and len(failures) > MAX_SINGLE:
            groups = _alike(failures)
        shown = groups if everything else groups[:MAX_GROUPS]
        for number, group in enumerate(shown):
            if number:
                yield ""
            yield from self._story(group[0])
            if len(group) > 1:
                times = listed([seconds(f.time) for f in group[1:]], 8)
                yield from wrapped(f"And {len(group) - 1} more failures of the same kind, at {times}.", _BODY)
        if len(groups) > len(shown):
            left = sum(len(group) for group in groups[len(shown) :])
            yield f"  … {counted(left, 'more failure')} of {counted(len(groups) - len(shown), 'other kind')}"
        if len(groups) < len(failures) or len(groups) > len(shown):
            yield "  --all describes each failure separately."

    def _story(self, story: FailureStory) -> Iterator[str]:
        about = f" of {story.item}" if story.item else ""
        again = f", attempt {story.attempt}" if story.attempt > 1 else ""
        name = self._names.get(story.node, story.node)
        fine = story.fate in ("cured", "done_instead")
        cause = self._paint(story.cause, "hint" if fine else "warning")
        step = f", step {story.step}" if story.step else ""
        yield f"  {story.time:7.2f} s  {name}{about}{again}{step}: {cause}"
        yield from wrapped(story.message or story.sentence, _BODY)
        for choice in (c for c in story.choices if _has_details(c, story)):
            yield from wrapped(_choice(choice), _BODY, _HANGING)
        for sentence in story.observed:
            yield from wrapped(sentence, _BODY, _HANGING)
        if story.because_of is not None:
            earlier = self._found.failures[story.because_of]
            yield from wrapped(
                f"This failure follows from the failure at {seconds(earlier.time)} ({earlier.cause}).", _BODY
            )
        yield from wrapped(self._course(story), _BODY)

    def _course(self, story: FailureStory) -> str:
        """Return the path of a failure through the tree, from the first failing node to the one that stopped
        it."""
        parts: list[str] = []
        way = [self._names.get(link.path, link.path) for link in story.chain if link.outcome == "FAILURE"]
        way = list(dict.fromkeys(way))
        if way:
            parts.append(f"Because of it, {listed(way, 6)} failed, too.")
        parts += [self._handling(handling) for handling in story.handled_by]
        by = self._names.get(story.fate_by, story.fate_by)
        match story.fate:
            case "cured":
                outcome = f"Cured{self._cure(story)}: {by} continued at {seconds(story.fate_at or 0.0)}"
                outcome += f"; {story.seconds_lost:.1f} s lost." if story.seconds_lost else "."
            case "done_instead":
                outcome = f"{by} ran this handler instead of the branch, as the mission asks."
            case "passed_over":
                outcome = f"Passed over by {by} at {seconds(story.fate_at or 0.0)}"
                after = story.made_good_at
                outcome += f"; the item was placed after all at {seconds(after)}." if after else "."
            case "branched":
                outcome = f"{by} took another branch at {seconds(story.fate_at or 0.0)}, as the mission says."
            case "ended":
                outcome = (
                    f"The failure reached the root and ended the mission at {seconds(story.fate_at or 0.0)}."
                )
            case _:
                outcome = "The log ends before the outcome was decided."
        return " ".join([*parts, outcome])

    def _cure(self, story: FailureStory) -> str:
        """Return ` by LookAgain after 2 tries`; empty when the handler is unknown."""
        if story.episode is None:
            return ""
        episode = self._found.recovery.episodes[story.episode]
        if episode.end != "cured" or not episode.cure:
            return ""
        failed = f" ({', '.join(episode.failed_before)} failed before)" if episode.failed_before else ""
        return f" by {episode.cure} after {counted(episode.tries, 'try', 'tries')}{failed}"

    def _handling(self, handling: CureAttempt) -> str:
        node = self._names.get(handling.node, handling.node)
        took = f"{handling.ended} after {handling.seconds:.1f} s"
        if handling.handler == "again":
            return f"{node} ran it again."
        if handling.handler == "give_up":
            return f"{node} gave up ({handling.ran or 'its give_up'}: {took})."
        ran = handling.ran or handling.handler
        against = f" for {handling.handler}" if handling.handler != ran else ""
        return f"{node} tried {ran}{against} ({took})."

    def _items(self, everything: bool) -> Iterator[str]:
        items = self._found.items
        if not items:
            return
        quiet = [i for i in items if i.state == "done" and "it belongs into" not in i.truth]
        few = everything or len(items) <= MAX_ITEMS
        shown = [i for i in items if few or i not in quiet]
        yield self._title(f"Items ({len(items)}, as the robot believed)")
        width = max((len(i.id) for i in shown), default=0)
        for item in shown:
            yield from wrapped(_timeline(item, width, everything), "  ", " " * (width + 10))
        if len(shown) < len(items):
            yield f"  … {len(items) - len(shown)} more items, done without a failure (--all)"

    def _look(self) -> Iterator[str]:
        looks = self._found.look_at
        if not looks:
            return
        yield self._title("Look at")
        for look in looks:
            yield from wrapped(f"{look.time:7.2f} s  {look.why}", "  ", " " * 13)
        first = looks[0].time
        for title, command in (
            ("step through it", f"replay {self._log} --at {first:.2f}"),
            ("see it", f"snapshot {self._log} --at {first:.2f} -o moment.png"),
            ("the whole run", f"report {self._log} -o report.html"),
        ):
            yield f"  {title:<16} {self._program} {command}"


def _timeline(item: ItemStory, width: int, everything: bool) -> str:
    done = item.state == "done" and all(e.failure is None for e in item.events)
    parts = [f"{e.time:.2f} s {_DETAILS.sub('', e.what) if done else e.what}" for e in item.events]
    if len(parts) > MAX_EVENTS and not everything:
        parts = [*parts[: MAX_EVENTS - 3], f"… {len(parts) - MAX_EVENTS + 1} more", *parts[-2:]]
    events = "; ".join(parts)
    truth = f" ({item.truth})" if item.truth else ""
    return f"{item.id:<{width}}  {item.state:<5} {events}{truth}"


_DETAILS = re.compile(r",? (?:for the first time|at x|\().*")
"""Parts that the timeline of an uneventful item leaves out."""


def to_text(
    run: Run,
    found: Explanation,
    log: str,
    *,
    program: str = "picktree",
    paint: Paint = plain,
    everything: bool = False,
) -> str:
    """Return the text without a trailing newline. `log`: the reader's argument; `program`: command name."""
    page = ExplanationText(
        found, shlex.quote(log), program, short_names(node.path for node in run.nodes), paint
    )
    return page.text(_head(run), notes_on(run), everything=everything)


def to_json_text(run: Run, found: Explanation) -> str:
    """Return one JSON object with a trailing newline: outcome, failures, recovery, root_causes, items,
    look_at, with_truth."""
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
                {"node": each.node, **each.data, "time": each.time, "cure": each.cure}
                for each in found.recovery.episodes
            ],
            "planted": [
                {"message": each.message, "after": None, "end": None, **each.data}
                for each in found.recovery.planted
            ],
        },
        "root_causes": [
            {
                **_plain(cause),
                "confidence_rate": cause.rate,
                "account": cause_account(found, cause),
            }
            for cause in found.root_causes
        ],
        "items": [_plain(item) for item in found.items],
        "look_at": [_plain(look) for look in found.look_at],
        "with_truth": found.with_truth,
    }
    return json.dumps(json.loads(log_records.encode(whole)), ensure_ascii=False, indent=2) + "\n"


def notes_on(run: Run) -> tuple[str, ...]:
    """Return the limits of this log that matter for the explanation."""
    notes: list[str] = []
    if run.recovered:
        notes.append(run.recovered.removeprefix(f"{run.path}: "))
    origin = run.info.continues
    if origin is not None and origin.time > 0.0:
        of = f" of {origin.log}" if origin.log else ""
        notes.append(
            f"the log begins at {origin.time:.2f} s, at a checkpoint{of}; earlier events are not in it"
        )
    edits = [at.time for at in run.events if at.record.kind == "mission_edited"]
    if edits:
        times = ", ".join(f"{time:.2f} s" for time in edits)
        notes.append(
            f"the mission was edited while it ran, at {times}; each node is shown as it was at the time"
        )
    for at in run.events:
        if isinstance(at.record, event_types.BlackboardSetEvent):
            notes.append(f"{at.time:.2f} s: {at.record.message}")
    return tuple(notes)


def _head(run: Run) -> str:
    info = run.info
    length = f"{run.duration:.1f} s simulated"
    return f"{info.mission}, scene {info.scene}, {info.seed_text}, {info.backend}: {length}"


def _cause(found: episode_counts.CauseCount) -> dict[str, Plain]:
    """Return all episodes of one cause as JSON, with the handlers in `by`."""
    parts: list[Plain] = [_plain(each) for each in found.by_cure]
    return {**_plain(found.total), "by": parts}


def _plain(value: object) -> dict[str, Plain]:
    return cast("dict[str, Plain]", asdict(value))  # type: ignore[call-overload]
