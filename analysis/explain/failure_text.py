"""Failures as text, a paragraph each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ...files.diagnostics.fault_rendering import Paint
from ...files.value_wording import listed
from ...logs.episode import Episode, Planted
from ...logs.episode_counts import ENDS, CauseCount
from ...logs.run_account import CureAttempt, Episodes
from ...robot.manipulation.pick_candidates import RANKED_STAGE
from .explanation import CandidateChoice, FailureStory
from .number_wording import counted, seconds, wrapped

PLANTED = 12
"""Planted faults that are told."""


def recovery_lines(found: Episodes, paint: Paint) -> Iterator[str]:
    """Nothing when nothing failed and nothing was planted."""
    if found.episodes:
        yield paint(_title(found), "place")
        width = max(5, *(len(each.cause) for each in found.causes))
        yield f"  {'cause':<{width}}  seen  cured  tries   s lost  by"
        for each in found.causes:
            total, tries = each.total, each.total.tries_a_cure
            said = "" if tries is None else f"{tries:.1f}"
            numbers = f"{total.seen:>4}  {total.cured:>5}  {said:>5}  {total.seconds:>7.1f}"
            row = f"  {each.cause:<{width}}  {numbers}  "
            first, *rest = wrapped(_by(each), " " * len(row))
            yield row + first.strip()
            yield from rest
    if found.planted:
        yield paint("Faults that were planted, and what failed first after them", "place")
        for fault in found.planted[:PLANTED]:
            yield from wrapped(f"{fault.time:7.2f} s  {fault.message}: {_then(fault)}", "  ", " " * 13)
        if len(found.planted) > PLANTED:
            yield f"  … {len(found.planted) - PLANTED} more (--json)"


def _title(found: Episodes) -> str:
    ends = [(said, sum(e.end == end for e in found.episodes)) for end, said in ENDS.items()]
    told = ", ".join(f"{number} {said}" for said, number in ends if number)
    lost = sum(e.seconds for e in found.episodes)
    return f"Recovery ({counted(len(found.episodes), 'episode')}: {told}; {lost:.1f} s lost)"


def _by(found: CauseCount) -> str:
    """Return the nodes that cured it, else those that were tried in vain; then those that ran instead."""
    instead = [f"{each.cure} instead ({each.done_instead})" for each in found.by_cure if each.done_instead]
    if instead and not found.total.to_cure:
        return ", ".join(instead)
    cured = [each for each in found.by_cure if each.cured]
    tried = [each.cure for each in found.by_cure if each.cure and each.to_cure]
    if cured:
        by = [each.cure if len(cured) == 1 else f"{each.cure} ({each.cured})" for each in cured]
    elif tried:
        by = [f"tried in vain: {', '.join(tried)}"]
    else:
        by = ["given up untried" if found.total.given_up else "nobody"]
    return ", ".join([*by, *instead])


def _then(fault: Planted) -> str:
    if fault.end is None or fault.after is None:
        return "nothing failed"
    return f"{fault.cause} {fault.after:.1f} s later, {ENDS[fault.end]}"


EACH = 8
"""Failures up to which each is told by itself, unless all are asked for."""
GROUPS = 12
"""Kinds of failures that are told, unless all are asked for."""
_BODY, _HANGING = " " * 13, " " * 15

_FATES = {
    "cured": "cured",
    "done_instead": "done instead",
    "passed_over": "passed over",
    "branched": "went another way",
    "ended": "ended the mission",
    "open": "still open when the log ends",
}


class FailureText:
    """Tells the failures of a run; `names` gives short names of nodes by their paths."""

    def __init__(
        self,
        failures: Sequence[FailureStory],
        names: Mapping[str, str],
        paint: Paint,
        episodes: Sequence[Episode] = (),
    ) -> None:
        self._failures, self._names, self._paint = failures, names, paint
        self._episodes = episodes

    def lines(self, everything: bool) -> Iterator[str]:
        """Grouped when they are many, unless `everything` is asked for."""
        failures = self._failures
        if not failures:
            return
        counts = [(fate, sum(f.fate == fate for f in failures)) for fate in _FATES]
        summary = ", ".join(f"{n} {_FATES[fate]}" for fate, n in counts if n)
        yield self._paint(f"Failures ({len(failures)}: {summary})", "place")
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
                yield from wrapped(f"And {len(group) - 1} more like it, at {times}.", _BODY)
        if len(groups) > len(shown):
            left = sum(len(group) for group in groups[len(shown) :])
            yield f"  … {counted(left, 'more failure')} of {counted(len(groups) - len(shown), 'other kind')}"
        if len(groups) < len(failures) or len(groups) > len(shown):
            yield "  --all tells each failure by itself."

    def _story(self, story: FailureStory) -> Iterator[str]:
        about = f" of {story.item}" if story.item else ""
        again = f", attempt {story.attempt}" if story.attempt > 1 else ""
        name = self._names.get(story.node, story.node)
        fine = story.fate in ("cured", "done_instead")
        cause = self._paint(story.cause, "hint" if fine else "warning")
        yield f"  {story.time:7.2f} s  {name}{about}{again}: {cause}"
        yield from wrapped(story.message or story.sentence, _BODY)
        for choice in (c for c in story.choices if _tells(c, story)):
            yield from wrapped(_choice(choice), _BODY, _HANGING)
        for sentence in story.observed:
            yield from wrapped(sentence, _BODY, _HANGING)
        if story.because_of is not None:
            earlier = self._failures[story.because_of]
            yield from wrapped(
                f"It follows from the failure at {seconds(earlier.time)} ({earlier.cause}).", _BODY
            )
        yield from wrapped(self._course(story), _BODY)

    def _course(self, story: FailureStory) -> str:
        """Return the way of a failure, from the first node that failed with it to the one that stopped it."""
        parts: list[str] = []
        way = [self._names.get(link.path, link.path) for link in story.chain if link.outcome == "FAILURE"]
        way = list(dict.fromkeys(way))
        if way:
            parts.append(f"With it failed {listed(way, 6)}.")
        parts += [self._handling(handling) for handling in story.handled_by]
        by = self._names.get(story.fate_by, story.fate_by)
        match story.fate:
            case "cured":
                told = f"Cured{self._cure(story)}: {by} went on at {seconds(story.fate_at or 0.0)}"
                told += f"; {story.seconds_lost:.1f} s lost." if story.seconds_lost else "."
            case "done_instead":
                told = f"{by} did that instead of the branch, as the mission asks."
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

    def _cure(self, story: FailureStory) -> str:
        """` by LookAgain after 2 tries`; nothing where that is not known."""
        if story.episode is None:
            return ""
        episode = self._episodes[story.episode]
        if episode.end != "cured" or not episode.cure:
            return ""
        return f" by {episode.cure} after {counted(episode.tries, 'try', 'tries')}"

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


def _alike(failures: Sequence[FailureStory]) -> list[list[FailureStory]]:
    """Failures of the same node, item and cause that came from the same, and to the same end."""
    groups: dict[object, list[FailureStory]] = {}
    for f in failures:
        key = (f.node, f.item, f.cause, f.root_cause, f.fate, f.because_of is None)
        groups.setdefault(key, []).append(f)
    return list(groups.values())


def _tells(choice: CandidateChoice, story: FailureStory) -> bool:
    """Whether a choice says more than the failure's own words."""
    if any(r.stage for r in choice.rejections) and all(r.reason in story.message for r in choice.rejections):
        return False
    return any(r.count > 1 or story.message not in r.reason for r in choice.rejections)


def _choice(choice: CandidateChoice) -> str:
    if any(r.stage for r in choice.rejections):
        asked = counted(dict(choice.stages).get(RANKED_STAGE, 0), "candidate")
        return f"Grasps at {seconds(choice.time)}: {asked}: {'; '.join(_few(_counts(choice)))}."
    stages = ", ".join(f"{count} {name}" for name, count in choice.stages)
    what = "Plans" if choice.purpose == "plan" else f"Grasps at {seconds(choice.time)}"
    told = f"{what}: {stages}."
    refused = [f"{r.reason} ({r.count})" if r.count > 1 else r.reason for r in choice.rejections]
    return f"{told} Refused: {'; '.join(_few(refused))}." if refused else told


def _few(words: Sequence[str], most: int = 4) -> list[str]:
    return [*words[:most], f"{len(words) - most} other reasons"] if len(words) > most else [*words]


def _counts(choice: CandidateChoice) -> list[str]:
    """`11 the hand would touch wall (1.2 mm from it at best)`."""
    return [f"{r.count} {r.reason}" for r in choice.rejections]
