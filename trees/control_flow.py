"""Statuses of a node in BehaviorTree.CPP's words, and its flow as data: the order of its children, and the
consequences of their results. The linter analyses it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, StrEnum, auto
from typing import Final, Literal, TypeAlias

from py_trees.common import Status


class NodeStatus(StrEnum):
    """Status of a node, in the words of BehaviorTree.CPP.

    IDLE: not ticked in the present activation of its parent, or halted. SKIPPED: it had nothing to do.
    """

    IDLE = "IDLE"
    RUNNING = "RUNNING"
    SUCCESS = "SUCCESS"
    FAILURE = "FAILURE"
    SKIPPED = "SKIPPED"


PY_TREES_STATUS: Mapping[NodeStatus, Status] = {
    NodeStatus.IDLE: Status.INVALID,
    NodeStatus.RUNNING: Status.RUNNING,
    NodeStatus.SUCCESS: Status.SUCCESS,
    NodeStatus.FAILURE: Status.FAILURE,
    NodeStatus.SKIPPED: Status.INVALID,
}
"""Status that py_trees' tools see."""


class Then(Enum):
    """Consequence of a child's result other than the end of the node."""

    NEXT = auto()
    """Tick of the next child. Past the last child the node ends as this child; SKIPPED only if all were."""
    AGAIN = auto()
    """Another run in a later tick. After the last run the node ends as this child."""


NEXT: Final = Then.NEXT
"""`Then.NEXT`: the next child is ticked."""
AGAIN: Final = Then.AGAIN
IDLE, RUNNING = NodeStatus.IDLE, NodeStatus.RUNNING
SUCCESS, FAILURE, SKIPPED = NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.SKIPPED
Lead: TypeAlias = NodeStatus | Then
Hand: TypeAlias = Literal["unchanged", "full", "empty", "kept"]
"""Content of the hand after success; `kept`: an object is still held, on purpose and in a safe place."""


@dataclass(frozen=True, slots=True)
class LeafFlow:
    """Flow of a leaf. It may end in the statuses `ends`; it fails with its declared causes."""

    instant: bool = False
    """Whether it ends in the tick in which it starts."""
    steady: bool = False
    """Whether it is instant, writes the blackboard only, and follows from keys and facts."""
    ends: tuple[NodeStatus, ...] = (SUCCESS, FAILURE)
    asks: str = ""
    """Input with the expression that decides; empty: none."""
    fails_with: str = ""
    """Input without which the leaf has none of its declared causes; empty: it always has them."""
    hand_by: tuple[str, Mapping[object, Hand]] | tuple[()] = ()
    """Input whose value decides the content of the hand, with the contents by value; else it is
    `hand_after`."""
    empties: tuple[str, str] = ("", "")
    """Input with the bin that success empties, and the input that prevents it in a rehearsal; empty: none."""
    gives_up: bool = False
    """Whether success drops an item from the work that is left, though it is not done."""


@dataclass(frozen=True, slots=True)
class ChildFlow:
    """Children one after the other, from the first. Each result leads to the next child, or to an end."""

    success: Lead = SUCCESS
    failure: Lead = FAILURE
    skipped: Lead = SKIPPED
    reactive: bool = False
    """Whether the children before the running one are ticked again at every tick."""
    own: Mapping[NodeStatus, NodeStatus] = field(default_factory=dict[NodeStatus, NodeStatus])
    """Ends of the node itself, by the status of the child; IDLE: before its first tick."""
    own_unless: str = ""
    """Input that prevents the ends in `own` when it is 0; empty: none."""
    pauses: bool = False
    """Whether the tick ends after a child that ended in its first tick and leads to the next child."""

    @property
    def by_turns(self) -> bool:
        """Whether one child runs at a time, each until it ends."""
        return not self.reactive and not isinstance(self, AtOnce)

    @property
    def steady(self) -> bool:
        """Whether the node takes no time of its own, and remembers nothing."""
        if isinstance(self, Branch | Choice | CleanUp):
            return True
        return type(self) is ChildFlow and not (self.own or self.pauses)

    def of(self, status: NodeStatus) -> Lead:
        """Return the consequence of a child's result."""
        leads = {SUCCESS: self.success, FAILURE: self.failure, SKIPPED: self.skipped}
        return leads.get(status, status)


@dataclass(frozen=True, slots=True)
class Branch(ChildFlow):
    """Success of the first child leads to the second, its failure to the third, whose ends are the node's.

    Without a third child the failure of the first is the node's.
    """


@dataclass(frozen=True, slots=True)
class Choice(ChildFlow):
    """One child: the case named as the value of the input that the table `matches`, else the default."""


@dataclass(frozen=True, slots=True)
class CleanUp(ChildFlow):
    """Children as in `ChildFlow`, but the last runs only after a failure; the node then fails, too."""

    on_halt: str = ""
    """Input: whether a halt ticks the last child, too."""


@dataclass(frozen=True, slots=True)
class Loop(ChildFlow):
    """Several runs of the children. Without any allowed run a loop is SUCCESS, a retry FAILURE."""

    runs: str = ""
    """Input with the maximum number of runs, -1 for any number; empty: there is no maximum."""
    each_of: str = ""
    """Input with the list whose elements have a run each; empty: none."""
    guard: str = ""
    """Input with the expression that must hold before each run, else the loop ends with SUCCESS."""
    passes_over: tuple[str, str] = ("", "")
    """Input and value with which a failure counts as success, unless it is one that may not be hidden."""


@dataclass(frozen=True, slots=True)
class Turns(ChildFlow):
    """Children as in `ChildFlow`, from the child after the last successful one."""

    wraps: str = ""
    """Input: whether the first child follows the last."""


@dataclass(frozen=True, slots=True)
class Resumed(ChildFlow):
    """Children as in `ChildFlow`, from the child at which the last activation failed or was halted."""


@dataclass(frozen=True, slots=True)
class Pipeline(ChildFlow):
    """Reactive children as in `ChildFlow`. A child that ended in this activation leads on, even when it runs
    again."""


@dataclass(frozen=True, slots=True)
class AtOnce(ChildFlow):
    """All children in each tick, until enough have succeeded or too many failed."""

    wanted: str = ""
    """Input with the number of successes; -1: all, without those that are skipped."""
    tolerated: str = ""
    """Input with the number of failures that is too many; -1: all."""
    waits: bool = False
    """Whether it runs until all children have ended."""


@dataclass(frozen=True, slots=True)
class Once(ChildFlow):
    """The child runs until it has ended once in a mission."""

    skips: str = ""
    """Input: whether the node is SKIPPED afterwards. Otherwise it repeats the first answer."""


@dataclass(frozen=True, slots=True)
class Recovery(ChildFlow):
    """The first child runs; after a failure the handler of its cause, then the first child again.

    The other children are handlers: those of a table `of` causes for their pattern, the rest for any cause.
    Those of the table `instead` end the node with their success, and come before the others.
    """

    runs: str = ""
    """Input with the maximum number of runs, or of handlers."""
    first_is_free: bool = False
    """Whether the first run does not count."""
    resort: str = ""
    """Slot of the child that runs before the node fails for good; empty: none."""
    instead: str = ""
    """Table of handlers that take the place of the first child; empty: none."""
    skipped_handler: Lead = AGAIN
    """Consequence of a skipped handler."""


Flow: TypeAlias = LeafFlow | ChildFlow
