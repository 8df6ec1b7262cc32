"""Episode: one cause of failure in a run, from the first failure to the decision about it, with its cures.

- *Seen.* An episode begins when a node itself fails with a cause. A false condition is no failure, but one
  that a `Recover` answers counts as `tree.attempts`. Until the decision, the same cause at the same node
  belongs to the same episode, also within the next branch of a `Fallback`. Another cause is another episode.
- *Tried.* A `Recover`, a `RecoveryNode`, a `RetryUntilSuccessful`, a `Fallback` or a `RoundRobin` above the
  node handles the failure, or a plug-in's node that runs its failed child again. It runs a cure, the branch
  again, or its next branch. A branch that does nothing, such as `AlwaysSuccess`, is no cure. When that
  handler fails in the end and one further up handles the failure, the episode continues there. So it is
  counted once.
- *By what.* The cure that ran last against this cause: the sub-tree or the nodes of the handler. It is `Grasp
  again` where only the branch ran again, and the next branch of a `Fallback` or a `RoundRobin`.
- *Tries.* Runs after the failure that could succeed: 1 when the first of them did.
- *Cured* when the handling node then succeeds, and with it the work that had failed. After the same branch
  ran again, it did. The next branch of a `Fallback` or a `RoundRobin` must have done something for an item
  of the branch that failed: a skill other than a look or a push succeeded on it, and the item was not left
  outside of a bin or hole. A branch without items is cured by any branch that succeeds. A failure within a
  cure that another branch passed without that work ends as what the cure is for.
- *Given up* when that node fails and none further up handles the failure, when its next branch did not do
  that work, or when the cure sets the item aside. A branch of a `Fallback` with a `SetAside` in it gives
  the item up, even if it only counts this time, and is no try. *Done instead* when a handler of `instead`
  took the place of the branch, as the mission asks for this cause; such an episode is neither cured nor given
  up, and costs no time. *Unhandled* when no node tried anything. *Open* when the log ends before.
- *Time lost.* Simulated time from the start of the failed run of the branch to the start of the next one.
  For the last failure it is the time to the end of the node. Over all tries, that is from the start of the
  run that failed first to the start of the one that succeeded. Where a branch fails with several causes in
  turn, each is charged with the time up to the next run. The time of an inner episode is subtracted from the
  outer one, so that the times add up. Two branches of a `Parallel` are each charged with their own. An
  unhandled failure is charged with the time of the failed node, or with nothing if it occurred within
  another episode.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol, TypeAlias

AGAIN = "again"
_MAX_NAMED_NODES = 3
"""Maximum number of nodes that a handler's name lists."""
_TRANSPARENT_NODES = frozenset(
    {
        "Sequence",
        "SequenceWithMemory",
        "ReactiveSequence",
        "RetryUntilSuccessful",
        "Repeat",
        "Timeout",
        "Delay",
    }
)
"""Nodes that are named after the nodes below them."""
_FALLBACK_NODES = frozenset({"Fallback", "ReactiveFallback"})


class TreeNodeLike(Protocol):
    """Node of a recorded tree."""

    @property
    def path(self) -> str: ...
    @property
    def id(self) -> str: ...
    @property
    def children(self) -> Sequence[str]: ...


class NodeLike(TreeNodeLike, Protocol):
    """A node as a tree's record has it; the parent of the root is None or empty."""

    @property
    def parent(self) -> str | None: ...


class TransitionLike(Protocol):
    """A node that began or ended; see `records.Transition`."""

    @property
    def path(self) -> str: ...
    @property
    def status(self) -> str: ...
    @property
    def subject(self) -> str: ...
    @property
    def cause(self) -> str: ...
    @property
    def origin(self) -> str: ...


class CureNames:
    """Names of cures: a sub-tree or a leaf has its own, a sequence those of its parts."""

    def __init__(self, nodes: Iterable[TreeNodeLike]) -> None:
        self._nodes: Mapping[str, TreeNodeLike] = {node.path: node for node in nodes}

    def of(self, path: str) -> str:
        parts = list(dict.fromkeys(self._parts(path)))
        if len(parts) > _MAX_NAMED_NODES:
            return f"{' + '.join(parts[: _MAX_NAMED_NODES - 1])} + {len(parts) - _MAX_NAMED_NODES + 1} more"
        return " + ".join(parts)

    def _parts(self, path: str) -> list[str]:
        node = self._nodes.get(path)
        if node is None:
            return [_last(path)]
        if node.id in _TRANSPARENT_NODES and node.children:
            return [part for child in node.children for part in self._parts(child)]
        if node.id in _FALLBACK_NODES and node.children:
            either = [" + ".join(self._parts(child)) for child in node.children]
            return [" or ".join(either[:_MAX_NAMED_NODES])]
        own = _last(path).partition("#")[0]
        return [node.id if own == node.id else f"{node.id} ({own})"]


def _last(path: str) -> str:
    return path.rsplit("/", 1)[-1]


End: TypeAlias = Literal["cured", "done_instead", "given_up", "unhandled", "open"]
Fate: TypeAlias = Literal["cured", "done_instead", "passed_over", "branched", "ended", "open"]
"""Outcome of a single failure; it follows from the end of its episode.

`cured`, `done_instead` and `open`: as its episode. A failure whose episode was given up or unhandled is told
by what the mission did: `passed_over`: a loop went on with the next item. `branched`: a Fallback or another
node went another way. `ended`: it reached the root, and the mission ended with it.
"""


@dataclass(frozen=True, slots=True)
class DecidedFailure:
    """Failure of one node, and the decision about it."""

    path: str
    time: float
    """Time of the failure, simulated s."""
    cause: str
    fate: Fate
    by: str
    """Path of the node that decided it; empty when open."""


@dataclass(frozen=True, slots=True)
class Episode:
    """Episode: one cause from its first failure to the decision, in the terms of this module."""

    cause: str
    node: str
    """Path of the node that failed first."""
    item: str
    """Id of the item that the failure is about; empty when unknown."""
    times: tuple[float, ...]
    """Times of its failures, simulated s."""
    end: End
    ended: float
    """Time of the decision, or of the log's end, simulated s."""
    by: str
    """Path of the node that handled the failure last; empty when none did."""
    handler: str
    """Name of the last cure in that node: the pattern of `when`, `otherwise`, …"""
    tried: tuple[str, ...]
    """Names of the cures that were run, in order."""
    tries: int
    seconds: float
    """Time lost, simulated s."""

    @property
    def time(self) -> float:
        """Time of the first failure, simulated s."""
        return self.times[0]

    @property
    def cure(self) -> str:
        """Name of the last cure; empty when nothing was tried."""
        return self.tried[-1] if self.tried else ""


@dataclass(frozen=True, slots=True)
class Planted:
    """Injected fault, and the first failure after it; for the analyst only."""

    time: float
    """Time of the fault, simulated s."""
    fault: str
    """Kind of the fault: `remove`, `slip`, …"""
    message: str
    item: str
    """Id of the item in the simulation; empty when the fault is about none."""
    cause: str
    """Cause of the first failure after the fault; empty when none came."""
    after: float | None
    """Time from the fault to that failure, simulated s; None when none came."""
    end: End | None
    """End of that failure's episode; None when none came."""


@dataclass
class OpenEpisode:
    """An episode that is not decided yet."""

    cause: str
    node: str
    item: str
    times: list[float]
    """Times of its failures, s."""
    took: float
    """Duration of the failed node, s; 0 where another trouble bears it."""
    by: str = ""
    handler: str = ""
    tried: list[str] = field(default_factory=list[str])
    tries: int = 0
    seconds: float = 0.0
    planted: list[Planted] = field(default_factory=list[Planted])
    """Faults after which it was the first."""
    failures: list[tuple[str, float]] = field(default_factory=list[tuple[str, float]])
    """Path and time (s) of each failure; without those of conditions."""
    came_up: float = 0.0
    """When it last went up to a node around, s."""


@dataclass
class RunningNode:
    """A node between its beginning and its end. Troubles are told by their numbers."""

    path: str
    start: float
    subject: str
    taken: list[int] = field(default_factory=list[int])
    """Troubles that it takes care of."""
    arrived: list[int] = field(default_factory=list[int])
    """Troubles that have come up from below; what it does about them shows in what it does next."""
    failed: str = ""
    """Path of the child whose failure it deals with, or dealt with last."""
    failing: int = -1
    """Trouble with which that child failed."""
    run: float = 0.0
    """When the present run of the branch began, or the one that failed last, s."""
    about: list[str] = field(default_factory=list[str])
    """Items that nodes below have named since then."""
    failed_about: list[str] = field(default_factory=list[str])
    """The same of the runs before."""
    worked: list[str] = field(default_factory=list[str])
    """Items that a skill has succeeded on since then."""
    borne: float = 0.0
    """Time that troubles within have cost since then, s."""
    dealing: bool = False
    """A run has failed, and the next one has not begun."""
    called: str = ""
    """Handler that was told of and has not begun."""
    aside: bool = False
    """The item was set aside since a trouble was taken up."""
    answers: bool = False
    """It is one that tells which handler it runs."""
    instead: str = ""
    """Handler that it told of last, where that is done instead of the branch; empty: none."""
    again: bool = False
    """It has run the child again whose failure had come up."""
    settled: list[str] = field(default_factory=list[str])
    """Causes that came up here and were decided: the node may still fail with one of them."""


@dataclass(frozen=True, slots=True)
class EpisodeTrackerState:
    """Undecided troubles, for a checkpoint."""

    nodes: tuple[RunningNode, ...] = ()
    troubles: dict[int, OpenEpisode] = field(default_factory=dict[int, OpenEpisode])
    planted: tuple[Planted, ...] = ()
    number: int = 0
    elsewhere: tuple[str, ...] = ()
    """Items that were put down outside of bins and holes, and not held since."""
