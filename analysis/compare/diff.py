"""Difference of two whole runs: one value, which `diff_text` renders as text and JSON."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from ...logs.run_settings import lacking_topics
from ...logs.schema import topics
from ...logs.schema.json_records import arithmetic_difference
from ...logs.schema.records import RunInfo
from ...logs.schema.topics import is_simulated
from ...session.environment import SOURCES_ATTACHMENT, source_changes, sources_from_text
from ..run import Run
from .alignment import Alignment, align
from .divergence import MessageDifference, compared_topics, first_difference
from .run_outcome import (
    CountChange,
    EndingChange,
    ItemChange,
    RunOutcome,
    TimeSpent,
    cause_changes,
    ending_changes,
    item_changes,
    outcome_of,
    time_spent,
)

Verdict: TypeAlias = Literal["identical", "cut", "alike", "apart"]
"""Verdict: `identical`: every simulated message is the same. `cut`: they are, until one log ends.

`alike`: some values differ, but every node did the same at the same times. `apart`: the nodes did not.
"""


@dataclass(frozen=True, slots=True)
class RunDiff:
    """Differences of two runs; times are simulated s."""

    verdict: Verdict
    a: RunOutcome
    b: RunOutcome
    set_up: SetupDiff
    first: MessageDifference | None
    """First simulated value that differs. When the trees differ, messages about their nodes are ignored."""
    alignment: Alignment
    """Alignment of the runs, with their divergence."""
    time: TimeSpent
    causes: tuple[CountChange, ...]
    ways: tuple[EndingChange, ...]
    items: tuple[ItemChange, ...]
    left_out: tuple[str, ...] = ()
    """Sentences about what one of the logs lacks, which is not compared."""

    @property
    def same(self) -> bool:
        return self.verdict == "identical"


def diff(a: Run, b: Run) -> RunDiff:
    """Compare two runs of any missions, finished or cut.

    The comparison begins at the first tick that both have, also for a run and its continuation from a
    checkpoint. Raises PicktreeError for a damaged log.
    """
    alignment = align(a, b)
    since = alignment.since or None
    ends = [gap.start for run in (a, b) for gap in run.log.gaps if gap.end is None]
    last = min((end for end in ends if end is not None), default=None)
    first = first_difference(a, b, since=since, until=last)
    if first is not None and first.topic == topics.TREE.name:
        told = (topics.TREE.name, topics.TICK.name)
        first = first_difference(a, b, since=since, until=last, without=told) or first
    return RunDiff(
        _verdict(alignment, first),
        outcome_of(a),
        outcome_of(b),
        compare_settings(a, b),
        first,
        alignment,
        time_spent(alignment),
        cause_changes(alignment),
        ending_changes(alignment),
        item_changes(a, b, alignment),
        tuple(_left_out(a, b)),
    )


def _left_out(a: Run, b: Run) -> Iterator[str]:
    compared = compared_topics(a, b)
    for name, run, other in (("A", a, b), ("B", b, a)):
        yield from (f"{name}: {gap.text()}" for gap in run.log.gaps)
        if run.log.is_rewritten:
            held = [topic for topic, info in other.log.topics.items() if info.messages]
            lacking = [topic for topic in held if is_simulated(topic) and topic not in compared]
            if lacking:
                yield f"{name}: {lacking_topics(lacking)}"


def _verdict(alignment: Alignment, first: MessageDifference | None) -> Verdict:
    if first is None:
        return "identical"
    if first.missing and first.ended:
        return "cut"
    return "alike" if alignment.pairs and alignment.parting is None else "apart"


CONTEXT_LINES = 2
"""Number of unchanged lines around a change of a file."""
_RUN_FILE_PREFIXES = ("checkpoint-", "refused-")
"""Prefixes of attachments that a run makes itself."""


@dataclass(frozen=True, slots=True)
class ValueChange:
    """Value with a name in two runs; None where there is none."""

    name: str
    a: object
    b: object


@dataclass(frozen=True, slots=True)
class FileChange:
    """File that differs between the two logs.

    `diff` are the lines of a unified diff without its head; for picktree's sources, sentences. It is empty
    for a file that is no text, or that only one run has.
    """

    name: str
    how: Literal["changed", "only_a", "only_b"]
    diff: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SetupDiff:
    settings: tuple[ValueChange, ...]
    """Settings that differ: mission, scene, robot, seed, versions and others."""
    files: tuple[FileChange, ...]
    arithmetic: str = ""
    """Sentence when the runs were computed with different arithmetic, or it was not recorded; else empty."""


def compare_settings(a: Run, b: Run) -> SetupDiff:
    ours, theirs = _settings(a.info), _settings(b.info)
    settings = tuple(
        ValueChange(name, ours.get(name), theirs.get(name))
        for name in dict.fromkeys((*ours, *theirs))
        if ours.get(name) != theirs.get(name)
    )
    return SetupDiff(
        settings, tuple(_files(a, b)), arithmetic_difference(a.info.arithmetic, b.info.arithmetic, "in B")
    )


def value_changes(a: Mapping[str, object], b: Mapping[str, object]) -> tuple[ValueChange, ...]:
    """Return the values that differ, in the order of A."""
    return tuple(
        ValueChange(name, a.get(name), b.get(name))
        for name in dict.fromkeys((*a, *b))
        if a.get(name) != b.get(name)
    )


def _settings(info: RunInfo) -> dict[str, object]:
    """Return the settings by user-visible names; the version of picktree has no prefix."""
    named: dict[str, object] = {
        "mission": info.mission,
        "scene": info.scene,
        "robot": info.robot,
        "seed": info.seed,
        "backend": info.backend,
        "tick": info.tick,
        "revision": info.revision,
    }
    for prefix, values in (("set ", info.parameters), ("", info.physics), ("", info.versions)):
        named.update({f"{prefix}{name}": value for name, value in values.items()})
    return named


def _files(a: Run, b: Run) -> Iterator[FileChange]:
    in_a, in_b = _contents(a), _contents(b)
    for name in dict.fromkeys((*in_a, *in_b)):
        ours, theirs = in_a.get(name), in_b.get(name)
        if theirs is None:
            yield FileChange(name, "only_a", ())
        elif ours is None:
            yield FileChange(name, "only_b", ())
        elif name == SOURCES_ATTACHMENT:
            changes = source_changes(sources_from_text(ours.decode()), sources_from_text(theirs.decode()))
            if changes:
                yield FileChange(name, "changed", changes)
        elif ours != theirs:
            yield FileChange(name, "changed", _unified(ours, theirs))


def _contents(run: Run) -> dict[str, bytes]:
    names = [name for name in run.log.attachments if not name.startswith(_RUN_FILE_PREFIXES)]
    return {name: run.log.attachment(name) for name in names}


def _unified(a: bytes, b: bytes) -> tuple[str, ...]:
    try:
        ours, theirs = a.decode().splitlines(), b.decode().splitlines()
    except UnicodeDecodeError:
        return ()
    lines = difflib.unified_diff(ours, theirs, n=CONTEXT_LINES, lineterm="")
    return tuple(line for n, line in enumerate(lines) if n >= 2)
