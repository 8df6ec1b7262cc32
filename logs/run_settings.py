"""Settings of a run from the metadata of its log, and the parts of a run that a log lacks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Final

import orjson

from ..files.errors import PicktreeError
from ..files.value_wording import listed
from .recording.rotated_log import JoinedLog
from .schema import topics
from .schema.json_records import Arithmetic
from .schema.records import FORMAT, ResumedFrom, RunInfo

SETTINGS: Final = "picktree"
"""Name of the metadata record with the settings of the run."""
UNKNOWN: Final = "unknown"
"""Value of a setting that the log does not state."""
_TIME_TOLERANCE: Final = 1e-6
_MAX_NAMED_TOPICS: Final = 5
"""Maximum number of topics that a message names."""
_MIN_GAP_TICKS: Final = 2.9
"""Distance of two ticks from which on there is a gap, in ticks. Clocks of two computers may jitter by one."""
_ALWAYS_RECORDED: Final = (topics.TREE, topics.TICK, topics.JOINTS, topics.TF, topics.OBJECTS)


def run_settings(metadata: Mapping[str, Mapping[str, str]], tick: float, path: Path) -> RunInfo:
    """Return the settings of the run. `tick`: length of a tick (s) where the metadata do not state it.

    Raises PicktreeError when the metadata are incomplete.
    """
    words = metadata.get(SETTINGS)
    if words is None:
        return RunInfo(f"{UNKNOWN} mission", UNKNOWN, UNKNOWN, None, f"{UNKNOWN} backend", tick)
    continues = metadata.get("picktree.continues")
    try:
        return RunInfo(
            mission=words["mission"],
            scene=words["scene"],
            robot=words["robot"],
            seed=int(words["seed"]),
            backend=words["backend"],
            tick=float(words["tick"]),
            parameters=metadata.get("picktree.parameters", {}),
            physics=metadata.get("picktree.physics", {}),
            versions=metadata.get("picktree.versions", {}),
            revision=words["revision"],
            verify=words["verify"] == "true",
            limit=float(words["limit"]) if "limit" in words else None,
            own_scene=words.get("own_scene", "true") == "true",
            machine=metadata.get("picktree.machine", {}),
            arithmetic=Arithmetic.from_words(metadata.get("picktree.files.arithmetic", {})),
            files=metadata.get("picktree.files", {}),
            continues=ResumedFrom.from_words(continues) if continues else None,
        )
    except (KeyError, ValueError) as error:
        raise PicktreeError(f"{path}: the log's metadata are incomplete: {error}") from None


def log_format(metadata: Mapping[str, Mapping[str, str]], first_tick: bytes | None, path: Path) -> int:
    """Return the number of the log's format; without metadata as the first tick shows it.

    Raises PicktreeError for a newer format than this picktree reads.
    """
    words = metadata.get(SETTINGS)
    if words is None:
        return 2 if first_tick is None or b'"transitions":' in first_tick else 1
    stated = words.get("format", "")
    if not stated.isdigit():
        raise PicktreeError(f"{path}: the log's metadata are incomplete: they state no format")
    if int(stated) > FORMAT:
        raise PicktreeError(
            f"{path}: the log has format {stated}, and this picktree reads up to {FORMAT}; "
            "upgrade picktree to read it"
        )
    return int(stated)


@dataclass(frozen=True, slots=True)
class Gap:
    """Span that a log lacks, simulated s: from the last tick before it to the first tick after it."""

    start: float | None
    """None: the beginning of the run."""
    end: float | None
    """None: the end of the run."""

    def contains(self, time: float) -> bool:
        """Whether this time (simulated s) is in the gap, or at the tick before or after it.

        The last tick before the end of a log is outside.
        """
        if self.end is None:
            return self.start is not None and time > self.start + _TIME_TOLERANCE
        start = -math.inf if self.start is None else self.start
        return start - _TIME_TOLERANCE < time < self.end + _TIME_TOLERANCE

    def text(self) -> str:
        if self.start is None:
            return f"the log begins at {self.end:.2f} s: everything before is missing"
        if self.end is None:
            return f"the log ends at {self.start:.2f} s, before its run: everything after is missing"
        return f"{self.start:.2f} s to {self.end:.2f} s are missing"


def gaps_between(ticks: Sequence[float], begin: float, end: float | None) -> tuple[Gap, ...]:
    """Return the gaps of a log with these times of ticks, simulated s.

    `begin`: time of the run's first tick; `end`: that of its last one, None when it is unknown.
    """
    if not ticks:
        return ()
    longest = _MIN_GAP_TICKS * tick_length(ticks)
    gaps = [Gap(None, ticks[0])] if ticks[0] - begin > longest else []
    gaps += [Gap(a, b) for a, b in pairwise(ticks) if b - a > longest]
    gaps += [Gap(ticks[-1], None)] if end is not None and end - ticks[-1] > longest else []
    return tuple(gaps)


def tick_length(ticks: Sequence[float]) -> float:
    """Return the length of a tick, s, from the times of ticks."""
    return round(median(b - a for a, b in pairwise(ticks)), 6) if len(ticks) > 1 else 0.05


def stated_end(result: Mapping[str, str]) -> float | None:
    """Return the end of the run by its result, simulated s; None when there is none."""
    try:
        return float(orjson.loads(result["json"])["sim_seconds"])
    except (KeyError, ValueError, TypeError):
        return None


def require_run(file: JoinedLog, metadata: Mapping[str, object]) -> None:
    """Raise PicktreeError for the file of another program, and for a log without ticks.

    The log of a run that was killed at its start has no ticks, and no message at a later time.
    """
    channels = file.channels
    known = [channel.topic for channel in channels if channel.messages]
    there = f"it has {listed(known, _MAX_NAMED_TOPICS)}" if known else "it has no messages"
    by = f", written by {file.writers}" if file.writers else ""
    if SETTINGS not in metadata and not any(c.schema.startswith("picktree.") for c in channels):
        raise PicktreeError(
            f"{file.path}: an MCAP file, but not a log of picktree{by}: {there}; `picktree run MISSION` "
            "records one"
        )
    if topics.TICK.name not in known and file.end > file.start:
        raise PicktreeError(
            f"{file.path}: a log without ticks{by}: {there}; keep {topics.TICK.name} when a log is filtered"
        )


def lacking_topics(names: Sequence[str]) -> str:
    """
    >>> lacking_topics(["/tf", "/bt/tree"])
    'it lacks the topics /tf and /bt/tree'
    """
    return f"it lacks the topic{'s' if len(names) > 1 else ''} {listed(names)}"


def lacks(file: JoinedLog, metadata: Mapping[str, object], gaps: Sequence[Gap]) -> str:
    """Return what another program has left out of a log, as clauses; empty when nothing is known to be."""
    told = [gap.text() for gap in gaps]
    known = {channel.topic for channel in file.channels if channel.messages}
    dropped = [topic.name for topic in _ALWAYS_RECORDED if topic.name not in known]
    if dropped and file.end > file.start:
        told.append(lacking_topics(dropped))
    if SETTINGS not in metadata:
        told.append("it lacks its metadata: settings and result of the run are unknown")
    if not file.attachments:
        told.append("it lacks its files: mission, scene and robot are unknown")
    return "; ".join(told)
