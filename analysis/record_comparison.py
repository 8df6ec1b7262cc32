"""Comparison of a run with its record during the run, message by message, and its result as text and JSON."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Iterator
from typing import Any

import orjson

from picktree.analysis.compare import RunOutcome, message_differences, run_diff
from picktree.logs import Digest, Topic, topics
from picktree.logs.mcap import RawMessage
from picktree.session import Interrupter, simulated_messages
from picktree.trees import MAIN

from .run import Run


def without_updates(data: bytes) -> bytes:
    """Return a tick with starts and ends alone, which are compared between different trees, too."""
    tick = orjson.loads(data)
    tick["transitions"] = [each for each in tick["transitions"] if not each["update"]]
    return orjson.dumps(tick)


def without_settings(data: bytes, settings: Collection[str]) -> bytes:
    """Return a tick without the inputs of its nodes, and without writes of these parameters."""
    tick = orjson.loads(data)
    for transition in tick.get("transitions", ()):
        transition.pop("inputs", None)
    keys = {f"{MAIN}/{name}" for name in settings}
    tick["writes"] = [write for write in tick["writes"] if write["key"] not in keys]
    return orjson.dumps(tick)


class RecordComparison(Interrupter):
    """Comparison of a run's simulated messages with the record; an observer of the run.


    `until`: end of the comparison, simulated s, inclusive; by default the record's end. For a record of a run
    that was cut off, messages after its last whole tick are not compared.
    """

    def __init__(
        self,
        run: Run,
        until: float | None = None,
        settings: Collection[str] | None = None,
        *,
        since: float | None = None,
        other_tree: bool = False,
        stop_at_difference: bool = False,
    ) -> None:
        """Prepare the comparison.

        `settings`: parameters of the mission that were changed on purpose. Then inputs of nodes are not
        compared, only their behaviour. None: the same run. `since`: the run resumes at this time, simulated
        s. `other_tree`: its tree differs from the recorded one. `stop_at_difference`: the run
        ends at the first difference.
        """
        self.difference: message_differences.MessageDifference | None = None
        self.trees: message_differences.MessageDifference | None = None
        """First difference of the trees. The behaviour is compared nevertheless."""
        self.ticks = 0
        """Number of ticks that agree."""
        self.exact = not run.log.lacks_something
        """Whether the log has all messages, and those of a tick agree without leaving out settings."""
        self._run = run
        self._times = run.ticks.times
        self._whole = until is None and not is_cut(run)
        end = self._times[-1] if not self._whole and self._times else None
        self.until = end if until is None else until if end is None else min(until, end)
        """End of the comparison, simulated s; None: the end of the run."""
        expected = _without_final_truth(simulated_messages(run.log, since, self.until), cut=is_cut(run))
        self._expected = message_differences.moments(message_differences.present(expected, run.log.gaps))
        self._at = next(self._expected, None)
        """Messages of the record at the time that is compared now; None: its end."""
        self._schemas = {name: topic.schema for name, topic in run.log.topics.items()}
        self._settings = settings
        self._stop_at_difference = stop_at_difference
        self._other_tree = other_tree
        self._taken: Counter[str] = Counter()
        """Number of compared messages at this time, by topic."""
        continues = run.info.continues
        self._digest = Digest(bytes.fromhex(continues.digest)) if continues else Digest()

    @property
    def digest(self) -> str:
        """Digest of the compared messages of the present run, in hex."""
        return self._digest.hex

    def stops(self) -> bool:
        return self.difference is not None and self._stop_at_difference

    def recorded(self, topic: Topic, at: int, data: bytes, in_digest: bool) -> None:
        if in_digest:
            self._take(topic.name, at, data)

    def _take(self, topic: str, time: int, data: bytes) -> None:
        """Compare the next message of the run, `time` in simulated ns."""
        if self.difference is not None:
            return
        if self._is_unknown(topic):
            self.exact = self.exact and not self._run.log.is_rewritten
            return
        if self.until is not None and time > round(self.until * 1e9) + 1000:
            return
        if any(gap.contains(time / 1e9) for gap in self._run.log.gaps):
            return
        self._advance(time)
        if self.difference is not None:
            return
        if self._at is None:
            if self._whole:
                self._differ(topic, time, "a")
            return
        held = self._at.messages.get(topic, ()) if self._at.time == time else ()
        number = self._taken[topic]
        if number >= len(held):
            if self._whole or topic != topics.TRUTH.name or time < round((self.until or 0.0) * 1e9):
                self._differ(topic, time, "a")
            return  # else the ground truth at the end of the run, which ends here and did not then
        self._taken[topic] += 1
        expected = recorded = held[number]
        if topic == topics.TICK.name and recorded != data:
            if self._other_tree:
                recorded, data = without_updates(recorded), without_updates(data)
            if self._settings is not None:
                recorded, data = (without_settings(tick, self._settings) for tick in (recorded, data))
        if recorded != data:
            schema = self._schemas[topic]
            found = (
                message_differences.first_differing_field(schema, recorded, data)
                or message_differences.NO_FIELD
            )
            apart = message_differences.MessageDifference.at(self._run, topic, time, field=found)
            if topic == topics.TREE.name:
                self.trees, self._other_tree = self.trees or apart, True
            else:
                self.difference = apart
            return
        self.exact = self.exact and data == expected
        self._digest.add(topic, time, data)
        self.ticks += topic == topics.TICK.name

    def finish(self) -> None:
        """End the comparison: messages that the record still holds are missing in the run."""
        self._advance(None)

    def _advance(self, time: int | None) -> None:
        """Go on to the record's messages of this time (simulated ns), or of a later one; None: to its end.

        Messages of the record before it are missing in the run.
        """
        while self.difference is None and self._at is not None and (time is None or self._at.time < time):
            for topic, held in self._at.messages.items():
                if len(held) > self._taken[topic]:
                    self.ticks -= self._taken[topics.TICK.name]
                    self._differ(topic, self._at.time, "b")
                    return
            self._at = next(self._expected, None)
            self._taken.clear()

    def _is_unknown(self, topic: str) -> bool:
        """Whether the record cannot have the topic: another program has left it out."""
        return topic not in self._schemas and self._run.log.is_rewritten

    def _differ(self, topic: str, time: int, missing: message_differences.Missing) -> None:
        self.difference = message_differences.MessageDifference.at(self._run, topic, time, missing=missing)


def is_cut(run: Run) -> bool:
    """Whether the record ends before the run's own end."""
    status = run.log.result.get("status", "")
    ended = status in ("success", "incomplete", "failure", "timeout", "paused")
    return not ended or any(gap.end is None for gap in run.log.gaps)


def _without_final_truth(messages: Iterator[RawMessage], *, cut: bool) -> Iterator[RawMessage]:
    """Yield the messages without the ground truth that an interrupted run writes at its end, at any point of
    a tick."""
    last: RawMessage | None = None
    for message in messages:
        if last is not None:
            yield last
        last = message
    if last is not None and not (cut and last.topic == topics.TRUTH.name):
        yield last


_MAX_VALUE_LENGTH = 100
"""Maximum number of characters of a displayed value."""


def difference_lines(apart: message_differences.MessageDifference) -> Iterator[str]:
    field = f" {apart.field}" if apart.field else ""
    of = f" ({apart.of})" if apart.of else ""
    yield f"different from tick {apart.tick} on, {apart.time:.2f} s: {apart.topic}{field}{of}"
    if apart.missing:
        only = "new" if apart.missing == "a" else "recorded"
        yield f"  only the {only} run has this message"
    elif not apart.field:
        yield "  the bytes differ, the values do not"
    else:
        recorded, now = _value_texts(apart.a, apart.b)
        yield f"  recorded  {recorded}"
        yield f"  now       {now}"


def outcome_table(a: RunOutcome, b: RunOutcome, name_a: str, name_b: str) -> Iterator[str]:
    """Yield two outcomes side by side, as lines."""
    rows = [("", name_a, name_b)]
    rows += [(what, say_a, say_b) for (what, say_a), (_, say_b) in zip(_rows(a), _rows(b), strict=True)]
    causes = sorted({*a.failures, *b.failures})
    rows += [(f"  {cause}", str(a.failures.get(cause, 0)), str(b.failures.get(cause, 0))) for cause in causes]
    yield from run_diff.aligned(rows)


def _rows(outcome: RunOutcome) -> list[tuple[str, str]]:
    sorted_ = "–" if outcome.items_sorted is None else f"{outcome.items_sorted} of {outcome.items_total}"
    return [
        ("status", outcome.status),
        ("items sorted", sorted_),
        ("items done, as believed", str(outcome.items_done)),
        ("grasps held", f"{outcome.picks_held} of {outcome.picks_tried}"),
        ("simulated time", f"{outcome.end:.2f} s"),
        ("handler runs", str(outcome.recoveries)),
        ("failures", str(sum(outcome.failures.values()))),
    ]


def difference_json(apart: message_differences.MessageDifference | None) -> dict[str, Any] | None:
    if apart is None:
        return None
    return {
        "tick": apart.tick,
        "time": round(apart.time, 6),
        "topic": apart.topic,
        "missing": {"": "", "a": "recorded", "b": "now"}[apart.missing],
        "field": apart.field,
        "of": apart.of,
        "recorded": apart.a,
        "now": apart.b,
    }


def _value_texts(one: object, other: object) -> tuple[str, str]:
    """Return both values as text, cut around their first difference."""
    a, b = (v if isinstance(v, str) else json.dumps(v, ensure_ascii=False, default=str) for v in (one, other))
    same = next((n for n, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))
    begin = max(0, same - _MAX_VALUE_LENGTH // 2) if max(len(a), len(b)) > _MAX_VALUE_LENGTH else 0
    return _cut(a, begin), _cut(b, begin)


def _cut(text: str, begin: int) -> str:
    end = begin + _MAX_VALUE_LENGTH
    return ("…" if begin else "") + text[begin:end] + ("…" if len(text) > end else "")
