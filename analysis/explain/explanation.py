"""Explanation of a run as values: failures, their outcomes and origins."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Literal, TypeAlias, cast

from picktree.logs import CureAttempt, Episodes, FailureLink
from picktree.world import Values, event_types

Spans: TypeAlias = tuple[tuple[float, float], ...]
"""Spans of time, s."""
Confidence: TypeAlias = Literal["likely", "possible", "the log does not tell"]
"""Confidence in a cause.

`likely`: at least 92 % of such causes were right in development situations. `possible`: fewer. `the log does
not tell`: only the failure's own message, because the log has no evidence of a cause.
"""
CONFIDENCES: tuple[Confidence, ...] = ("likely", "possible", "the log does not tell")
"""Stated confidences, the surest first."""


@dataclass(frozen=True, slots=True)
class RejectedCandidate:
    """Rejected candidate of a grasp, a placement or a plan, with the reason."""

    name: str
    reason: str
    count: int = 1
    """Number of candidates with the same rejection."""
    stage: str = ""
    """Stage that a grasp did not pass (`world.manipulation.stages`); empty in older logs."""
    by: str = ""
    """Id of the body in the way; empty without one, or in older logs."""


@dataclass(frozen=True, slots=True)
class CandidateChoice:
    """Choice of candidates shortly before a failure: numbers that reached each stage, and rejected ones."""

    time: float
    purpose: str
    object: str
    stages: tuple[tuple[str, int], ...]
    rejections: tuple[RejectedCandidate, ...]


@dataclass(frozen=True, slots=True)
class Finding:
    """Origin of a failure, or of an item that is not where it belongs."""

    cause: str
    about: str
    title: str
    reasons: tuple[str, ...] = ()
    item: str = ""
    """Id of the believed item, else of the true one."""
    time: float | None = None
    """Time of the finding, at least approximately, s."""
    confidence: Confidence = "likely"
    """`likely`: measured, or seen in the ground truth. `possible`: fits the log, as other causes may."""
    against: tuple[str, ...] = ()
    """Evidence that speaks against it."""
    spans: Spans = ()
    """Spans of a device's fault, s."""

    @property
    def key(self) -> tuple[str, str]:
        """Cause and what it is about: findings with the same key are one."""
        return self.cause, self.about

    def weakened(self, *against: str) -> Finding:
        """Return the finding with evidence against it; it is not likely any more."""
        sure: Confidence = "possible" if self.confidence == "likely" else self.confidence
        return replace(self, against=(*self.against, *against), confidence=sure)


@dataclass(frozen=True, slots=True)
class FailureStory:
    """Failure with its node, its cause and its outcome."""

    number: int
    """Index among the failures of the run, from 0."""
    time: Annotated[float, "simulated time", "s"]
    tick: Annotated[int, "number of the tick"]
    visit: Annotated[int, "number of the visit that failed, and not because a child failed"]
    node: Annotated[str, "path of the visit's node"]
    id: Annotated[str, "registered name of the node, such as `Grasp`"]
    item: Annotated[str, "object that the failure concerns; empty without an object"]
    attempt: Annotated[int, "number of visits of the node for this item so far"]
    cause: Annotated[str, "cause, such as `grasp.missed`"]
    sentence: str
    """Meaning of the cause; it concerns the cause, not this failure."""
    remedy: str
    """First remedy to try; empty where the mission cured the failure, or it follows from another one."""
    step: Annotated[str, "step of the skill that failed, such as `lift`; empty when the skill was in no step"]
    message: Annotated[str, "message of the node"]
    evidence: Values
    chain: tuple[FailureLink, ...]
    """Nodes that ended with the failure, from the parent upwards to the one that stopped it, or the root."""
    handled_by: tuple[CureAttempt, ...]
    fate: Annotated[event_types.Fate, "cured, done_instead, passed_over, branched, ended or open"]
    fate_by: Annotated[str, "path of the node that decided the outcome; empty when open"]
    fate_at: Annotated[float | None, "simulated time of the decision", "s"]
    because_of: Annotated[int | None, "number of the earlier failure that led to this one"]
    """Number of the failure that caused this one; a failing handler follows from its failure."""
    choices: tuple[CandidateChoice, ...]
    observed: tuple[str, ...]
    """Sentences on the moment of the failure: belief, hand, stops, changes, injected faults.

    For the analyst only, they say where the truth differed from the belief."""
    made_good_at: float | None = None
    """Believed time of the item's placement after this failure was passed over, s."""
    root_cause: int | None = None
    """Index of its root cause among those of the run."""
    episode: int | None = None
    """Index of its episode among those of the run."""
    seconds_lost: Annotated[
        float, "simulated time that the episode lost, at its first failure; 0 at its later failures", "s"
    ] = 0.0

    def finding(
        self,
        cause: str,
        about: str,
        title: str,
        reasons: tuple[str, ...] = (),
        confidence: Confidence = "likely",
        against: tuple[str, ...] = (),
    ) -> Finding:
        """Return a finding about the failure's item at the time of the failure."""
        return Finding(cause, about, title, reasons, self.item, self.time, confidence, against)

    @property
    def name(self) -> str:
        """Name of the node: the last part of its path."""
        return self.node.rsplit("/", 1)[-1]

    @property
    def name_and_item(self) -> str:
        """Name of the node and the item that the failure is about, as in `Grasp of block_1`."""
        return f"{self.name} of {self.item}" if self.item else self.name

    @property
    def cured(self) -> bool:
        return self.fate == "cured"

    @property
    def done_instead(self) -> bool:
        """Whether a handler of `instead` replaced the failed branch, as the mission specifies."""
        return self.fate == "done_instead"


@dataclass(frozen=True, slots=True)
class RootCause:
    """Root cause of one or more failures."""

    cause: str
    title: str
    """Description in one sentence, with the item and the node."""
    failures: tuple[int, ...]
    """Numbers of the failures that it explains, in order of time."""
    ended_run: bool
    """Whether the run failed, or its goal was missed, because of it."""
    reasons: tuple[str, ...]
    """Evidence for it in the log."""
    item: str = ""
    """Id of the believed item that it is about; of the true one when it was never seen."""
    time: float | None = None
    """Time of the cause, at least approximately, simulated s."""
    seconds_lost: float = 0.0
    """Simulated s that the episodes of its failures cost."""
    planted: tuple[str, ...] = ()
    """Injected faults that concern the same items. They are listed next to the cause, and the cause was found
    without them."""
    confidence: Confidence = "likely"
    against: tuple[str, ...] = ()
    """Evidence in the log that speaks against it."""
    items: tuple[str, ...] = ()
    """Items that are not where they belong because of it, by their believed names where they have one."""
    about: str = ""
    """Device, true item, bin, body or node that it is about, as its finding names it."""
    doubtful: bool = False
    """Whether a prediction does not hold, a rival is near, or the evidence itself leaves doubt."""
    rate: float | None = None
    """Share of right ones among such causes in development situations; None without enough of them."""


@dataclass(frozen=True, slots=True)
class ItemVerdict:
    """Verdict on one item at the end: the scorer's, or the belief's for a log without ground truth."""

    destination: str
    """Bin, hole or fixture by the scene's rules; empty without one."""
    bin: str
    """Bin or hole in which the item rests; empty outside of all."""
    verdict: str
    """`sorted`, `misplaced`, `crushed`, `left` or `no destination`."""
    depth: float | None = None
    """Depth in a hole, m; None when the item is at none."""
    reason: str = ""
    """Reason why an item at a hole is not in it, or why it is lost anywhere."""
    moving: bool = False
    """Whether it still moved in its bin."""

    @property
    def is_in_place(self) -> bool:
        """Whether the item is where it belongs, or lies in no bin and belongs into none."""
        return self.verdict in ("sorted", "no destination")


@dataclass(frozen=True, slots=True)
class ItemEvent:
    time: float
    what: str
    """Event in one line: seen, grasp failed with …, held, placed in …, lost from sight, …"""
    node: str = ""
    failure: int | None = None


ItemState: TypeAlias = Literal["done", "held", "left", "gone", "aside"]
"""Believed state of an item at the end; `aside`: the mission had given it up."""


@dataclass(frozen=True, slots=True)
class ItemStory:
    """Events of one item, as the robot believed."""

    id: str
    kind: str
    colour: str
    state: ItemState
    events: tuple[ItemEvent, ...]
    truth: str = ""
    """True place at the end, in the scorer's words; for the analyst only."""
    names: tuple[str, ...] = ()
    """Ids under which the robot knew the item, the first one first."""


@dataclass(frozen=True, slots=True)
class KeyMoment:
    """Moment of the run that a reader should look at."""

    time: float
    why: str
    failure: int | None = None


@dataclass(frozen=True, slots=True)
class ExplainedOutcome:
    status: str
    """Status of the result; without a result `killed`, `crashed`, `running`, `continued` or `unknown`.

    It is `running` while the log is being written, and `continued` for a file that another one continues. It
    is `unknown` when another program has left out the result.
    """
    sentence: str
    end: float
    """End of the run or of its log, simulated s."""
    items_sorted: int | None
    """Number of sorted items by the scorer; None when the run was killed."""
    items_total: int | None


@dataclass(frozen=True, slots=True)
class Explanation:
    """Explanation of a run: outcome, failures, root causes, stories of the items."""

    outcome: ExplainedOutcome
    failures: tuple[FailureStory, ...]
    root_causes: tuple[RootCause, ...]
    """Root causes: first those that ended the run, then by decreasing cost."""
    items: tuple[ItemStory, ...]
    look_at: tuple[KeyMoment, ...]
    recovery: Episodes
    """Episodes by cause with their attempts and outcomes."""
    with_truth: bool = True
    """Whether the ground truth was used."""


def number(failure: FailureStory, name: str) -> float | None:
    value = failure.evidence.get(name)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def word(failure: FailureStory, name: str) -> str:
    value = failure.evidence.get(name)
    return value if isinstance(value, str) else ""


def numbers(failure: FailureStory, name: str) -> tuple[float, ...]:
    return tuple(float(v) for v in _items(failure, name) if isinstance(v, int | float))


def words(failure: FailureStory, name: str) -> tuple[str, ...]:
    return tuple(v for v in _items(failure, name) if isinstance(v, str))


def _items(failure: FailureStory, name: str) -> list[object]:
    value = failure.evidence.get(name)
    return cast("list[object]", value) if isinstance(value, list) else []


MIN_VERTICAL = 0.8
"""Vertical share of a contact's direction from which it pulls straight down, or pushes from below."""


def contact_of(failure: FailureStory) -> tuple[float | None, float]:
    """Return the force of a contact, N, and the vertical share of its direction, -1 … 1."""
    vector = numbers(failure, "force")  # of a safety stop
    way = numbers(failure, "direction") or vector
    size, length = math.hypot(*vector) if vector else number(failure, "force"), math.hypot(*way)
    return size, way[2] / length if len(way) == 3 and length > 0.0 else 0.0
