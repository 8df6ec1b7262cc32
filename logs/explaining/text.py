"""An explanation as text for a terminal: what matters first, and commands to look closer."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence

from ...world.files.rendering import Paint, plain
from .explanation import Choice, Explanation, FailureStory, Handling, ItemStory, RootCause
from .wording import counted, listed, seconds

WIDTH = 96
EACH = 8
"""Failures up to which each is told by itself, unless all are asked for."""
GROUPS = 12
"""Kinds of failures that are told, unless all are asked for."""
ITEMS = 30
"""Items up to which those that are done are told, too."""

EVENTS = 9
"""Events of an item that are told, unless all are asked for."""
_BODY, _HANGING = " " * 13, " " * 15
_FATES = {
    "cured": "cured",
    "passed_over": "passed over",
    "branched": "answered another way",
    "ended": "ended the mission",
    "open": "still open when the log ends",
}


class Page:
    """Turns an explanation into lines.

    `log` is what the reader typed for the log, `program` how picktree is called here, `names` gives short
    names of nodes by their paths.
    """

    def __init__(
        self, found: Explanation, log: str, program: str, names: dict[str, str], paint: Paint = plain
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
            *(line for note in notes for line in _wrapped(f"Note: {note}", "")),
        ]
        for part in (self._causes(), self._failures(everything), self._items(everything), self._look()):
            shown = list(part)
            if shown:
                lines += ["", *shown]
        return "\n".join(lines)

    def _outcome(self, role: str) -> list[str]:
        outcome = self._found.outcome
        first, *rest = _wrapped(f"{outcome.status}: {outcome.sentence}", "")
        word, _, told = first.partition(":")
        return [f"{self._paint(word, 'hint' if role == 'hint' else 'error')}:{told}", *rest]

    def _title(self, text: str) -> str:
        return self._paint(text, "place")

    def _causes(self) -> Iterator[str]:
        causes = self._found.root_causes
        if not causes:
            if self._found.outcome.status == "success" and not self._found.failures:
                yield self._title("Nothing failed.")
            return
        yield self._title("Root cause" if len(causes) == 1 else f"Root causes ({len(causes)})")
        for number, cause in enumerate(causes, 1):
            mark = self._paint(f"{number}", "error" if cause.ended_run else "warning")
            first, *rest = _wrapped(_sentence(cause.title), "     ")
            yield f"  {mark}  {first.strip()}"
            yield from rest
            yield from _wrapped(self._cost(cause), "     ")
            for reason in cause.reasons:
                yield from _wrapped(f"- {reason}", "     ", "       ")
            for planted in cause.planted:
                yield from _wrapped(f"- a fault was planted: {planted}", "     ", "       ")

    def _cost(self, cause: RootCause) -> str:
        """What came of it."""
        failures = [self._found.failures[n] for n in cause.failures]
        status = self._found.outcome.status
        if cause.ended_run:
            weight = "This cost the goal" if status == "incomplete" else "This ended the run"
        else:
            weight = (
                "The run got over it" if status in ("success", "incomplete") else "It did not end the run"
            )
        told = f"[{cause.cause}] {weight}"
        if not failures:
            return f"{told}, and nothing failed."
        lost = cause.seconds_lost
        times = listed([seconds(f.time) for f in failures], 4)
        took = f", {lost:.0f} s lost" if lost >= 1.0 else ""
        return f"{told}: {counted(len(failures), 'failure')} at {times}{took}."

    def _failures(self, everything: bool) -> Iterator[str]:
        failures = self._found.failures
        if not failures:
            return
        counts = [(fate, sum(f.fate == fate for f in failures)) for fate in _FATES]
        summary = ", ".join(f"{n} {_FATES[fate]}" for fate, n in counts if n)
        yield self._title(f"Failures ({len(failures)}: {summary})")
        groups = [[f] for f in failures]
        if not everything and len(failures) > EACH:
            groups = _alike(failures)
        shown = groups if everything else groups[:GROUPS]
        for number, group in enumerate(shown):
            if number:
                yield ""
            yield from self._story(group[0])
            if len(group) > 1:
                times = listed([seconds(f.time) for f in group[1:]], 8)
                yield from _wrapped(f"And {len(group) - 1} more like it, at {times}.", _BODY)
        if len(groups) > len(shown):
            left = sum(len(group) for group in groups[len(shown) :])
            yield f"  … {counted(left, 'more failure')} of {counted(len(groups) - len(shown), 'other kind')}"
        if len(groups) < len(failures) or len(groups) > len(shown):
            yield "  --all tells each failure by itself."

    def _story(self, story: FailureStory) -> Iterator[str]:
        about = f" of {story.item}" if story.item else ""
        again = f", attempt {story.attempt}" if story.attempt > 1 else ""
        name = self._names.get(story.node, story.node)
        cause = self._paint(story.cause, "hint" if story.fate == "cured" else "warning")
        yield f"  {story.time:7.2f} s  {name}{about}{again}: {cause}"
        yield from _wrapped(story.message or story.sentence, _BODY)
        for choice in (c for c in story.choices if _tells(c, story)):
            yield from _wrapped(_choice(choice), _BODY, _HANGING)
        for sentence in story.observed:
            yield from _wrapped(sentence, _BODY, _HANGING)
        if story.because_of is not None:
            earlier = self._found.failures[story.because_of]
            yield from _wrapped(
                f"It follows from the failure at {seconds(earlier.time)} ({earlier.cause}).", _BODY
            )
        yield from _wrapped(self._course(story), _BODY)

    def _course(self, story: FailureStory) -> str:
        """From the first node that failed with it to who stopped it."""
        parts: list[str] = []
        way = [self._names.get(link.path, link.path) for link in story.chain if link.outcome == "FAILURE"]
        way = list(dict.fromkeys(way))
        if way:
            parts.append(f"With it failed {listed(way, 6)}.")
        parts += [self._handling(handling) for handling in story.handled_by]
        by = self._names.get(story.fate_by, story.fate_by)
        match story.fate:
            case "cured":
                told = f"Cured: {by} went on after {story.seconds_lost or 0.0:.1f} s."
            case "passed_over":
                told = f"Passed over by {by} at {seconds(story.fate_at or 0.0)}"
                after = story.made_good_at
                told += f"; the item was placed after all at {seconds(after)}." if after else "."
            case "branched":
                told = f"{by} went another way at {seconds(story.fate_at or 0.0)}, as the mission says."
            case "ended":
                told = (
                    f"It reached the root, and the mission ended with it at {seconds(story.fate_at or 0.0)}."
                )
            case _:
                told = "The log ends before it was decided."
        return " ".join([*parts, told])

    def _handling(self, handling: Handling) -> str:
        node = self._names.get(handling.node, handling.node)
        took = f"{handling.ended} after {handling.seconds:.1f} s"
        if handling.handler == "again":
            return f"{node} ran it again."
        if handling.handler == "give_up":
            return f"{node} gave up (its give_up: {took})."
        return f"{node} tried {handling.handler} ({took})."

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
            yield from _wrapped(_timeline(item, width, everything), "  ", " " * (width + 10))
        if len(shown) < len(items):
            yield f"  … {len(items) - len(shown)} more, done without a word (--all)"

    def _look(self) -> Iterator[str]:
        looks = self._found.look_at
        if not looks:
            return
        yield self._title("Look at")
        for look in looks:
            yield from _wrapped(f"{look.time:7.2f} s  {look.why}", "  ", " " * 13)
        first = looks[0].time
        for told, command in (
            ("step through it", f"replay {self._log} --at {first:.2f}"),
            ("see it", f"snapshot {self._log} --at {first:.2f} -o moment.png"),
            ("the whole run", f"report {self._log} -o report.html"),
        ):
            yield f"  {told:<16} {self._program} {command}"


def _alike(failures: Sequence[FailureStory]) -> list[list[FailureStory]]:
    """Failures of the same node, item and cause that came from the same, and to the same end."""
    groups: dict[object, list[FailureStory]] = {}
    for f in failures:
        key = (f.node, f.item, f.cause, f.root_cause, f.fate, f.because_of is None)
        groups.setdefault(key, []).append(f)
    return list(groups.values())


def _tells(choice: Choice, story: FailureStory) -> bool:
    """Whether a choice says more than the failure's own words."""
    return any(r.count > 1 or story.message not in r.reason for r in choice.rejections)


def _choice(choice: Choice) -> str:
    stages = ", ".join(f"{count} {name}" for name, count in choice.stages)
    what = "Plans" if choice.purpose == "plan" else f"Grasps at {seconds(choice.time)}"
    told = f"{what}: {stages}."
    refused = [f"{r.reason} ({r.count})" if r.count > 1 else r.reason for r in choice.rejections]
    return f"{told} Refused: {'; '.join(_few(refused))}." if refused else told


def _few(words: Sequence[str], most: int = 4) -> list[str]:
    return [*words[:most], f"{len(words) - most} other reasons"] if len(words) > most else [*words]


def _timeline(item: ItemStory, width: int, everything: bool) -> str:
    done = item.state == "done" and all(e.failure is None for e in item.events)
    told = [f"{e.time:.2f} s {_BRIEF.sub('', e.what) if done else e.what}" for e in item.events]
    if len(told) > EVENTS and not everything:
        told = [*told[: EVENTS - 3], f"… {len(told) - EVENTS + 1} more", *told[-2:]]
    events = "; ".join(told)
    truth = f" ({item.truth})" if item.truth else ""
    return f"{item.id:<{width}}  {item.state:<5} {events}{truth}"


_BRIEF = re.compile(r",? (?:for the first time|at x|\().*")
"""What is left out of the timeline of an item that nothing happened to."""


def _sentence(text: str) -> str:
    return text if text.endswith((".", "!", "?")) else text + "."


def _wrapped(text: str, first: str, rest: str | None = None) -> Iterable[str]:
    lines = textwrap.wrap(
        _TOGETHER.sub("\N{NO-BREAK SPACE}", text),
        WIDTH,
        initial_indent=first,
        subsequent_indent=first if rest is None else rest,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines]


_TOGETHER = re.compile(r"(?<=\b[xy]) (?=-?\d)|(?<=\d) (?=(?:s|m|cm|mm|N)\b)")
"""Spaces at which no line ends: between a number and its unit."""
