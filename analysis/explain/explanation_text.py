"""Renderings of an explanation: text with a paragraph for each failure, and one JSON object."""

from __future__ import annotations

import json
import re
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Final, cast

from picktree.files import Paint, listed, plain, short_names
from picktree.logs import CureAttempt, Episodes, episode_counts, item_episodes, log_records
from picktree.robot.manipulation import pick_candidates
from picktree.world import Plain, event_types

from .explanation import CandidateChoice, Explanation, FailureStory, ItemStory, RootCause
from .wording import counted, seconds, wrapped

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
_OUTCOMES: Final[Mapping[event_types.Fate, tuple[str, str]]] = {
    "cured": ("cured", "Cured{cure}: {by} continued at {at}{lost}."),
    "done_instead": ("done instead", "{by} ran this handler instead of the branch, as the mission asks."),
    "passed_over": ("passed over", "Passed over by {by} at {at}{later}."),
    "branched": ("went another way", "{by} took another branch at {at}, as the mission says."),
    "ended": ("ended the mission", "The failure reached the root and ended the mission at {at}."),
    "open": ("still open when the log ends", "The log ends before the outcome was decided."),
}
"""Outcome of a failure in the summary, and as a sentence."""


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


@dataclass(frozen=True, slots=True)
class ExplanationText:
    """Text renderer of an explanation."""

    found: Explanation
    log: str
    """Argument of the reader for the log."""
    program: str
    """Command name of picktree."""
    names: Mapping[str, str]
    """Short names of nodes by their paths."""
    paint: Paint = plain
    everything: bool = False
    """Whether all failures, causes and items are shown."""

    def text(self, head: str, notes: Sequence[str] = ()) -> str:
        """`head`: what was run. `notes`: what the reader should know of the log. Without a line's end."""
        lines = [*self._outcome(), head]
        lines += [line for note in notes for line in wrapped(f"Note: {note}", "")]
        recovery = recovery_lines(self.found.recovery, self.paint)
        for part in (self._causes(), self._failures(), recovery, self._items(), self._look()):
            if shown := list(part):
                lines += ["", *shown]
        return "\n".join(lines)

    def _outcome(self) -> list[str]:
        outcome = self.found.outcome
        first, *rest = wrapped(f"{outcome.status}: {outcome.sentence}", "")
        word, _, sentence = first.partition(":")
        return [f"{self.paint(word, 'hint' if outcome.status == 'success' else 'error')}:{sentence}", *rest]

    def _causes(self) -> Iterator[str]:
        causes = self.found.root_causes
        if not causes:
            if self.found.outcome.status == "success" and not self.found.failures:
                yield self.paint("Nothing failed.", "place")
            return
        yield self.paint("Root cause" if len(causes) == 1 else f"Root causes ({len(causes)})", "place")
        shown = causes if self.everything else causes[:MAX_CAUSES]
        for number, cause in enumerate(shown, 1):
            mark = self.paint(f"{number}", "error" if cause.ended_run else "warning")
            stop = "" if cause.title.endswith((".", "!", "?")) else "."
            first, *rest = wrapped(cause.title + stop, "     ")
            yield f"  {mark}  {first.strip()}"
            yield from rest
            yield from wrapped(f"[{cause.cause}] {cause_account(self.found, cause)}", "     ")
            facts = [
                *cause.reasons,
                *(f"against it: {fact}" for fact in cause.against),
                *(f"a fault was planted: {fact}" for fact in cause.planted),
            ]
            for fact in facts:
                yield from wrapped(f"- {fact}", "     ", "       ")
        if len(shown) < len(causes):
            yield f"  … {counted(len(causes) - len(shown), 'more root cause')} with lower costs (--all)"

    def _failures(self) -> Iterator[str]:
        """Yield the failures. Many failures are grouped unless `everything` is set."""
        failures = self.found.failures
        if not failures:
            return
        counts = Counter(f.fate for f in failures)
        ends = ((words, counts[fate]) for fate, (words, _) in _OUTCOMES.items())
        summary = ", ".join(f"{number} {words}" for words, number in ends if number)
        yield self.paint(f"Failures ({len(failures)}: {summary})", "place")
        grouped = not self.everything and len(failures) > MAX_SINGLE
        groups = _alike(failures) if grouped else [[f] for f in failures]
        shown = groups[:MAX_GROUPS] if grouped else groups
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
        step = f", step {story.step}" if story.step else ""
        cause = self.paint(story.cause, "hint" if story.cured or story.done_instead else "warning")
        yield f"  {story.time:7.2f} s  {self._name(story.node)}{about}{again}{step}: {cause}"
        yield from wrapped(story.message or story.sentence, _BODY)
        choices = [_choice(choice) for choice in story.choices if _has_details(choice, story)]
        for sentence in (*choices, *story.observed):
            yield from wrapped(sentence, _BODY, _HANGING)
        if story.because_of is not None:
            earlier = self.found.failures[story.because_of]
            follows = f"This failure follows from the failure at {seconds(earlier.time)} ({earlier.cause})."
            yield from wrapped(follows, _BODY)
        yield from wrapped(self._course(story), _BODY)

    def _name(self, path: str) -> str:
        return self.names.get(path, path)

    def _course(self, story: FailureStory) -> str:
        """Return the path of a failure through the tree, from the first failing node to the one that stopped
        it."""
        way = dict.fromkeys(self._name(link.path) for link in story.chain if link.outcome == "FAILURE")
        parts = [f"Because of it, {listed(list(way), 6)} failed, too."] if way else []
        parts += [self._handling(handling) for handling in story.handled_by]
        after = story.made_good_at
        outcome = _OUTCOMES[story.fate][1].format(
            by=self._name(story.fate_by),
            at=seconds(story.fate_at or 0.0),
            cure=self._cure(story) if story.cured else "",
            lost=f"; {story.seconds_lost:.1f} s lost" if story.seconds_lost else "",
            later=f"; the item was placed after all at {seconds(after)}" if after else "",
        )
        return " ".join([*parts, outcome])

    def _cure(self, story: FailureStory) -> str:
        """Return ` by LookAgain after 2 tries`; empty when the handler is unknown."""
        episode = None if story.episode is None else self.found.recovery.episodes[story.episode]
        if episode is None or episode.end != "cured" or not episode.cure:
            return ""
        failed = f" ({', '.join(episode.failed_before)} failed before)" if episode.failed_before else ""
        return f" by {episode.cure} after {counted(episode.tries, 'try', 'tries')}{failed}"

    def _handling(self, handling: CureAttempt) -> str:
        node, took = self._name(handling.node), f"{handling.ended} after {handling.seconds:.1f} s"
        if handling.handler == "again":
            return f"{node} ran it again."
        if handling.handler == "give_up":
            return f"{node} gave up ({handling.ran or 'its give_up'}: {took})."
        ran = handling.ran or handling.handler
        against = f" for {handling.handler}" if handling.handler != ran else ""
        return f"{node} tried {ran}{against} ({took})."

    def _items(self) -> Iterator[str]:
        items = self.found.items
        if not items:
            return
        few = self.everything or len(items) <= MAX_ITEMS
        shown = [i for i in items if few or i.state != "done" or "it belongs into" in i.truth]
        yield self.paint(f"Items ({len(items)}, as the robot believed)", "place")
        width = max((len(i.id) for i in shown), default=0)
        for item in shown:
            yield from wrapped(_timeline(item, width, self.everything), "  ", " " * (width + 10))
        if len(shown) < len(items):
            yield f"  … {len(items) - len(shown)} more items, done without a failure (--all)"

    def _look(self) -> Iterator[str]:
        looks = self.found.look_at
        if not looks:
            return
        yield self.paint("Look at", "place")
        for look in looks:
            yield from wrapped(f"{look.time:7.2f} s  {look.why}", "  ", " " * 13)
        at = f"--at {looks[0].time:.2f}"
        for title, command in (
            ("step through it", f"replay {self.log} {at}"),
            ("see it", f"snapshot {self.log} {at} -o moment.png"),
            ("the whole run", f"report {self.log} -o report.html"),
        ):
            yield f"  {title:<16} {self.program} {command}"


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
    names = short_names(node.path for node in run.nodes)
    page = ExplanationText(found, shlex.quote(log), program, names, paint, everything)
    cell = f"{run.info.mission}, scene {run.info.scene}, {run.info.seed_text}, {run.info.backend}"
    return page.text(f"{cell}: {run.duration:.1f} s simulated", notes_on(run))


def to_json_text(run: Run, found: Explanation) -> str:
    """Return one JSON object with a trailing newline: outcome, failures, recovery, root_causes, items,
    look_at, with_truth."""
    info, recovery = run.info, found.recovery
    whole = {
        "outcome": {
            **_plain(found.outcome),
            "mission": info.mission,
            "scene": info.scene,
            "seed": info.seed,
            "backend": info.backend,
            "log": str(run.path),
            "notes": list(notes_on(run)),
        },
        "failures": [{**_plain(f), "cured": f.cured} for f in found.failures],
        "recovery": {
            "causes": [{**_plain(c.total), "by": [_plain(e) for e in c.by_cure]} for c in recovery.causes],
            "episodes": [
                {"node": each.node, **each.data, "time": each.time, "cure": each.cure}
                for each in recovery.episodes
            ],
            "planted": [
                {"message": each.message, "after": None, "end": None, **each.data}
                for each in recovery.planted
            ],
        },
        "root_causes": [
            {**_plain(cause), "confidence_rate": cause.rate, "account": cause_account(found, cause)}
            for cause in found.root_causes
        ],
        "items": [_plain(item) for item in found.items],
        "look_at": [_plain(look) for look in found.look_at],
        "with_truth": found.with_truth,
    }
    return json.dumps(json.loads(log_records.encode(whole)), ensure_ascii=False, indent=2) + "\n"


def notes_on(run: Run) -> tuple[str, ...]:
    """Return the limits of this log that matter for the explanation."""
    notes = [run.recovered.removeprefix(f"{run.path}: ")] if run.recovered else []
    origin = run.info.continues
    if origin is not None and origin.time > 0.0:
        of = f" of {origin.log}" if origin.log else ""
        begins = f"the log begins at {seconds(origin.time)}, at a checkpoint{of}"
        notes.append(f"{begins}; earlier events are not in it")
    if edits := [seconds(at.time) for at in run.events if at.record.kind == "mission_edited"]:
        edited = f"the mission was edited while it ran, at {', '.join(edits)}"
        notes.append(f"{edited}; each node is shown as it was at the time")
    changes = (at for at in run.events if isinstance(at.record, event_types.BlackboardSetEvent))
    return (*notes, *(f"{seconds(at.time)}: {at.record.message}" for at in changes))


def _plain(value: object) -> dict[str, Plain]:
    return cast("dict[str, Plain]", asdict(value))  # type: ignore[call-overload]
