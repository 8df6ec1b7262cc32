"""What an episode is.

An *episode* is one trouble of a run: a cause that came up, and what was done about it until it was decided.

- *Seen.* It begins when a node fails by itself with a cause. A false condition is no failure; but one that a
  `Recover` answers counts as `tree.attempts`. While it is being dealt with, the same cause at the same node
  belongs to the same episode, and so it does within the next branch of a `Fallback`; another cause is
  another one.
- *Tried.* A `Recover`, a `RecoveryNode`, a `RetryUntilSuccessful` or a `Fallback` above it takes it up: it
  runs a cure, or the branch again, or its next branch. When that node fails in the end and one further up
  takes the failure up, the episode goes on there; so a trouble that goes through several hands is seen once.
- *By what.* What was run last against this cause: the sub-tree or the nodes of the handler; `Grasp again`
  where the branch was just run again; the next branch of a `Fallback`.
- *Tries.* Runs after the failure that were to succeed: 1 when the first of them did.
- *Cured* when the node that took it up then succeeds. *Given up* when that node fails and nobody further up
  takes it up, or when what was tried sets the item aside; a branch of a `Fallback` with a `SetAside` in it
  gives the item up, though it may only count this time, and is no try. *Unhandled* when nobody tried
  anything. *Open* when the log ends before.
- *Time lost.* Simulated time from the beginning of the run of the branch that failed to the beginning of the
  next one; of the last failure, to the end of the node. Over all tries that is from the beginning of the run
  that failed first to the beginning of the one that succeeded. Where a branch fails with several causes in
  turn, each bears the time up to the next run. What an episode within already bears is taken off around it,
  so that the times add up; two branches of a `Parallel` each bear their own. An unhandled failure bears the
  time of the node that failed, and nothing if it came up within what another one bears."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

AGAIN = "again"
_MOST = 3
"""Nodes that are named of a handler that is a list."""
_AROUND = frozenset(
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
"""Nodes that are called as what is below them."""
_CHOOSING = frozenset({"Fallback", "ReactiveFallback"})


class TreeNodeLike(Protocol):
    """A node as a tree's record has it."""

    @property
    def path(self) -> str: ...
    @property
    def id(self) -> str: ...
    @property
    def children(self) -> Sequence[str]: ...


class CureNames:
    """Names of branches: of a sub-tree or a leaf its own, of a list those of its parts."""

    def __init__(self, nodes: Iterable[TreeNodeLike]) -> None:
        self._nodes: Mapping[str, TreeNodeLike] = {node.path: node for node in nodes}

    def of(self, path: str) -> str:
        parts = list(dict.fromkeys(self._parts(path)))
        if len(parts) > _MOST:
            return f"{' + '.join(parts[: _MOST - 1])} + {len(parts) - _MOST + 1} more"
        return " + ".join(parts)

    def _parts(self, path: str) -> list[str]:
        node = self._nodes.get(path)
        if node is None:
            return [_last(path)]
        if node.id in _AROUND and node.children:
            return [part for child in node.children for part in self._parts(child)]
        if node.id in _CHOOSING and node.children:
            either = [" + ".join(self._parts(child)) for child in node.children]
            return [" or ".join(either[:_MOST])]
        own = _last(path).partition("#")[0]
        return [node.id if own == node.id else f"{node.id} ({own})"]


def _last(path: str) -> str:
    return path.rsplit("/", 1)[-1]


End: TypeAlias = Literal["cured", "given_up", "unhandled", "open"]


@dataclass(frozen=True, slots=True)
class Episode:
    """One cause from where it was seen until it was decided; the words are those of this module."""

    cause: str
    node: str
    """Path of the node that failed first."""
    item: str
    """That it was about; empty when that is not known."""
    times: tuple[float, ...]
    """Simulated s of its failures."""
    end: End
    ended: float
    """Simulated s at which that was decided, or at which the log ends."""
    by: str
    """Path of the node that took it up last; empty when nobody did."""
    handler: str
    """What that node calls what it tried last: the pattern of `when`, `otherwise`, …"""
    tried: tuple[str, ...]
    """What was run against it, one after the other, as a reader knows it."""
    tries: int
    seconds: float
    """Simulated s that it cost."""

    @property
    def time(self) -> float:
        """Simulated s of the first failure."""
        return self.times[0]

    @property
    def cure(self) -> str:
        """What was tried last; empty when nothing was."""
        return self.tried[-1] if self.tried else ""


@dataclass(frozen=True, slots=True)
class Planted:
    """A fault that was planted in the simulation, and what the robot then saw first: for the analyst only."""

    time: float
    """Simulated s."""
    fault: str
    """Its kind: `remove`, `slip`, …"""
    message: str
    item: str
    """Of the simulation; empty when it is about none."""
    cause: str
    """Of the first failure after it; empty when none came."""
    after: float | None
    """Simulated s from the fault to that failure."""
    end: End | None
    """What became of that failure; None when none came."""
