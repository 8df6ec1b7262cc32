"""Episode: one cause of failure in a run, from the first failure to the decision about it, with its cures.

- *Seen.* An episode begins when a node itself fails with a cause. A false condition is no failure, but one
  that a `Recover` answers counts as `tree.attempts`. Until the decision, the same cause at the same node
  belongs to the same episode, also within the next branch of a `Fallback`. Another cause is another episode.
- *Tried.* A `Recover`, a `RecoveryNode`, a `RetryUntilSuccessful`, a `Fallback` or a `RoundRobin` above the
  node handles the failure, or a plug-in's node that runs its failed child again. It runs a cure, the branch
  again, or its next branch. A branch that does nothing, such as `AlwaysSuccess`, is no cure. When that
  handler fails in the end and one further up handles the failure, the episode continues there. So it is
  counted once.
- *By.* The cure that ran last against this cause: the sub-tree or the nodes of the handler. It is `Grasp
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

from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Protocol, TypeAlias

from picktree.world import JournalEvent, event_types

Decision: TypeAlias = (
    event_types.FailureDecidedEvent | event_types.EpisodeEvent | event_types.FaultOutcomeEvent
)
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


class NodeLike(Protocol):
    """Node in the record of a tree; the parent of the root is None or empty."""

    @property
    def path(self) -> str: ...
    @property
    def id(self) -> str: ...
    @property
    def children(self) -> Sequence[str]: ...
    @property
    def parent(self) -> str | None: ...


class TransitionLike(Protocol):
    """Start or end of a node; see `log_records.Transition`."""

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
    @property
    def message(self) -> str: ...


class CureNames:
    """Names of cures: a sub-tree or a leaf has its own, a sequence those of its parts."""

    def __init__(self, nodes: Iterable[NodeLike]) -> None:
        self._nodes: Mapping[str, NodeLike] = {node.path: node for node in nodes}

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


@dataclass(frozen=True, slots=True)
class InjectedFault:
    """Injected fault after which nothing has been decided yet."""

    time: float
    """Time of the fault, simulated s."""
    fault: str
    """Kind of the fault: `remove`, `slip`, …"""
    message: str
    item: str
    """Id of the item in the simulation; empty when the fault is about none."""


@dataclass
class OpenEpisode:
    """Episode without a decision yet, which the tracker calls a trouble."""

    cause: str
    node: str
    item: str
    times: list[float]
    """Times of its failures, s."""
    took: float
    """Duration of the failed node, s; 0 when another trouble is charged with it."""
    by: str = ""
    handler: str = ""
    tried: list[str] = field(default_factory=list[str])
    tries: int = 0
    seconds: float = 0.0
    planted: list[InjectedFault] = field(default_factory=list[InjectedFault])
    """Injected faults whose first following failure belongs to this episode."""
    failures: list[tuple[str, float]] = field(default_factory=list[tuple[str, float]])
    """Path and time (s) of each failure; without those of conditions."""
    came_up: float = 0.0
    """Time of its last propagation to a parent node, s."""


FailureKey: TypeAlias = tuple[str, str, str]
"""Cause, origin and message: a node that fails with those of a child passes the child's failure on."""


@dataclass
class RunningNode:
    """Running node with the troubles that it handles, by their numbers."""

    path: str
    start: float
    subject: str
    taken: list[int] = field(default_factory=list[int])
    """Numbers of the troubles that it handles."""
    arrived: list[int] = field(default_factory=list[int])
    """Numbers of the troubles that its children have passed up. Its next action shows whether it handles
    them."""
    failed: str = ""
    """Path of the child whose failure it handles, or handled last."""
    failing: int = -1
    """Number of the trouble with which that child failed."""
    run: float = 0.0
    """Start of the present run of the branch, or of the last failed one, s."""
    about: list[str] = field(default_factory=list[str])
    """Items that nodes below have named since then."""
    failed_about: list[str] = field(default_factory=list[str])
    """Items that nodes below named in the earlier runs."""
    worked: list[str] = field(default_factory=list[str])
    """Items for which a skill has succeeded since then."""
    borne: float = 0.0
    """Time that is charged to inner troubles since then, s."""
    dealing: bool = False
    """Whether a run has failed, and the next one has not begun."""
    called: str = ""
    """Announced handler that has not begun."""
    aside: bool = False
    """Whether the item was set aside since a trouble was taken up."""
    answers: bool = False
    """Whether the node announces the handler that it runs."""
    instead: str = ""
    """Last announced handler if it replaces the branch; empty: it does not."""
    again: bool = False
    """Whether it has run the failed child again."""
    failed_children: dict[str, FailureKey] = field(default_factory=dict[str, "FailureKey"])
    """Last failure of each child that failed, by the child's path."""
    settled: list[str] = field(default_factory=list[str])
    """Causes that came up here and were decided: the node may still fail with one of them."""


@dataclass(frozen=True, slots=True)
class EpisodeTrackerState:
    """Undecided troubles, for a checkpoint."""

    nodes: tuple[RunningNode, ...] = ()
    troubles: dict[int, OpenEpisode] = field(default_factory=dict[int, OpenEpisode])
    planted: tuple[InjectedFault, ...] = ()
    number: int = 0
    elsewhere: tuple[str, ...] = ()
    """Items that were put down outside of bins and holes, and not held since."""


class EpisodeTracker:
    """Tracker that derives decisions from ticks: outcomes of failures, episodes and injected faults, as
    events."""

    def __init__(self, state: EpisodeTrackerState | None = None) -> None:
        state = deepcopy(state) if state is not None else EpisodeTrackerState()
        self._decisions: list[Decision] = []
        """Decisions that were not returned yet."""
        self._open = {node.path: node for node in state.nodes}
        self._troubles = dict(state.troubles)
        self._waiting = list(state.planted)
        """Injected faults without a following failure yet."""
        self._number = state.number
        self._elsewhere = set(state.elsewhere)
        """Items that were put down outside of bins and holes, and not held since."""
        self._leaves: frozenset[str] = frozenset()
        self._ids: Mapping[str, str] = {}
        self._parents: Mapping[str, str] = {}
        self._names = CureNames(())
        self._giving_up: frozenset[str] = frozenset()
        """Paths of the branches that may set an item aside, or do nothing."""
        self._time = 0.0

    def state(self) -> EpisodeTrackerState:
        """Return a copy of the state for a checkpoint."""
        return deepcopy(
            EpisodeTrackerState(
                tuple(self._open.values()),
                self._troubles,
                tuple(self._waiting),
                self._number,
                tuple(sorted(self._elsewhere)),
            )
        )

    def follow(self, nodes: Iterable[NodeLike]) -> None:
        """Take over a tree that is ticked from the next tick on."""
        known = tuple(nodes)
        self._ids = {node.path: node.id for node in known}
        self._parents = {node.path: node.parent or "" for node in known}
        self._names = CureNames(known)
        self._leaves = frozenset(node.path for node in known if not node.children)
        giving_up = [node.path for node in known if node.id == _SET_ASIDE]
        self._giving_up = frozenset(path for each in giving_up for path in self._path_and_ancestors(each))
        inert = {node.path for node in known if node.id in _INERT_NODES and not node.children}
        for node in reversed(known):  # children come after their parents
            if node.children and inert.issuperset(node.children):
                inert.add(node.path)
        self._giving_up |= inert
        for path in [path for path in self._open if path not in self._ids]:
            gone = self._open.pop(path)
            self._settle([*gone.taken, *gone.arrived], None, None, "open")

    def begun(self, time: float, paths: Iterable[str]) -> None:
        """Take over the nodes that were running before the first tick."""
        for path in paths:
            self._open.setdefault(path, RunningNode(path, time, "", run=time))

    def take(
        self, time: float, changes: Iterable[TransitionLike], events: Sequence[JournalEvent] = ()
    ) -> tuple[Decision, ...]:
        """Follow one tick and return its decisions.

        `changes` are the starts and ends of nodes, in order.
        """
        self._time = round(time, 9)  # as the log has it
        aside = {event.node for event in events if isinstance(event, event_types.SetAsideEvent)}
        self._track_place(events)
        for change in changes:
            if change.status == "RUNNING":
                self._begin(change)
            else:
                self._end(change, change.path in aside or self._ids.get(change.path) == _SET_ASIDE)
        for event in events:
            if isinstance(event, event_types.RecoveryEvent):
                self._process_announcement(event)
            elif isinstance(event, event_types.ItemDoneEvent):
                self._progress(event.object)
            elif isinstance(event, event_types.FaultEvent) and event.struck:
                item = event.item or ""
                self._waiting.append(InjectedFault(time, event.fault, event.message, item))
        return self._handed_over()

    def finish(self, time: float) -> tuple[Decision, ...]:
        """Return what is open at the end of the run, or of its log, as such."""
        self._time = max(round(time, 9), self._time)
        for node in reversed(list(self._open.values())):
            self._charge(node)
        for number in sorted(self._troubles):
            self._decide(number, "open", "open", None)
        for fault in self._waiting:
            self._decisions.append(_followed(fault, "", None, None))
        self._open, self._waiting = {}, []
        return self._handed_over()

    def _handed_over(self) -> tuple[Decision, ...]:
        decisions, self._decisions = tuple(self._decisions), []
        return decisions

    def copied(self) -> EpisodeTracker:
        """Return an independent copy."""
        made = EpisodeTracker(self.state())
        made._ids, made._parents, made._names, made._time = self._ids, self._parents, self._names, self._time
        made._giving_up, made._leaves = self._giving_up, self._leaves
        return made

    # Nodes begin and end.

    def _begin(self, change: TransitionLike) -> None:
        path = change.path
        if path in self._open:  # it began anew without a word of its end
            self._close(self._open.pop(path), halted=True)
        parent = self._open.get(self._parents.get(path, ""))
        if parent is not None:
            self._process_child_start(parent, path)
        self._open[path] = RunningNode(path, self._time, change.subject, run=self._time)
        if change.subject and not self._only_helps(path):
            for around in self._ancestors(path):
                if self._kind(around) == "choosing" and change.subject not in around.about:
                    around.about.append(change.subject)

    def _process_child_start(self, node: RunningNode, child: str) -> None:
        """Process a start of a child: the next one, the same again, or a cure."""
        if child == node.failed and node.arrived and self._ids.get(node.path) != "ForEach":
            node.again = node.dealing = True
        kind = self._kind(node)
        if kind == "recovering":
            if node.called and child != node.failed:
                self._name_the_cure(node, child)
        elif kind == "retrying" and child == node.failed:
            self._take_up(node, AGAIN, f"{self._names.of(child)} {AGAIN}")
        elif kind == "choosing" and child != node.failed:
            gives_up = child in self._giving_up
            self._take_up(node, _last(child), "" if gives_up else self._names.of(child))
            node.aside = gives_up
        elif kind == "" and self._ids.get(node.path) != "Parallel":
            self._settle(node.arrived, node, node)
        if kind == "choosing" or child == node.failed or not node.failed:
            self._charge(node)
            node.run, node.borne, node.dealing, node.called = self._time, 0.0, False, ""
            node.failed_about = list(dict.fromkeys((*node.failed_about, *node.about)))
            node.about, node.worked = [], []

    def _end(self, change: TransitionLike, aside: bool) -> None:
        node = self._open.pop(change.path, None)
        if node is None:
            return
        if aside and change.status == "SUCCESS":
            self._set_aside(node)
        if change.status == "FAILURE":
            if change.cause:
                key = (change.cause, change.origin, change.message)
                self._source(node, change, key not in node.failed_children.values())
                parent = self._open.get(self._parents.get(node.path, ""))
                if parent is not None:
                    parent.failed_children[node.path] = key
            self._close(node, cause=change.cause)
        elif change.status == "IDLE":
            self._close(node, halted=True)
        else:
            if change.status == "SUCCESS" and change.path in self._leaves and not self._only_helps(node.path):
                for around in self._ancestors(node.path):
                    if node.subject in around.failed_about and node.subject not in around.worked:
                        around.worked.append(node.subject)
            self._succeeded(node)
            self._settle(node.arrived, self._open.get(self._parents.get(node.path, "")), node)
        if change.status == "SKIPPED":
            self._drop_skipped_cure(node)

    def _succeeded(self, node: RunningNode) -> None:
        """Decide the troubles that a node had taken up, after its success."""
        for number in [n for n in node.taken if n in self._troubles]:
            trouble = self._troubles[number]
            if node.instead and trouble.handler == node.instead:
                self._decide(number, "done_instead", "branched", node)
            elif not node.aside and self._has_succeeded(node, trouble):
                self._decide(number, "cured", "branched", node)
            elif not node.aside and (outer := self._handling_around(node.path)) is not None:
                outer.taken.append(number)  # it ends as what `outer` handles meanwhile
            else:
                self._decide(number, "given_up", "branched", node)

    def _has_succeeded(self, node: RunningNode, trouble: OpenEpisode) -> bool:
        """Whether the work that had failed then succeeded.

        After another run of the same branch it did. Another branch counts only when a skill succeeded on an
        item of the failed branch, and the item was not put down elsewhere.
        """
        if self._kind(node) != "choosing":
            return True
        items = [trouble.item] if trouble.item in node.failed_about else node.failed_about
        return not items or any(i in node.worked and i not in self._elsewhere for i in items)

    def _handling_around(self, path: str) -> RunningNode | None:
        """Return the nearest ancestor that runs a cure for another trouble; None without one."""
        for node in self._ancestors(path):
            runs_a_cure = node.dealing or self._kind(node) == "choosing"
            if runs_a_cure and any(number in self._troubles for number in node.taken):
                return node
        return None

    def _only_helps(self, path: str) -> bool:
        """Whether a node names an item and does none of its work, such as a look."""
        return self._ids.get(path) in _HELPER_NODES

    def _track_place(self, events: Iterable[JournalEvent]) -> None:
        """Track the items that the mission has put down outside of bins and holes."""
        for event in events:
            if isinstance(event, event_types.ItemDoneEvent) and not event.into:
                self._elsewhere.add(event.object)
            elif isinstance(event, event_types.ItemDoneEvent) or (
                isinstance(event, event_types.PickEvent) and event.held
            ):
                self._elsewhere.discard(event.object)

    def _source(self, node: RunningNode, change: TransitionLike, by_itself: bool) -> None:
        """Assign the failure of a node to a trouble: a new one, or one that a child has passed up.

        `by_itself`: the failure is not just that of a child.
        """
        failure = [(node.path, self._time)] if by_itself else []
        own = change.origin in ("", node.path)
        same = self._last_of_cause(change.cause, (*node.taken, *node.arrived))
        if same is not None and (not own or self._troubles[same].node == node.path):
            self._troubles[same].failures += failure
            return
        if not own and change.cause in node.settled:
            return
        around = list(self._ancestors(node.path))
        again = self._pending_in_fallback(change.cause, around)
        if again is not None:
            self._troubles[again].times.append(self._time)
            self._troubles[again].failures += failure
            self._troubles[again].planted += self._waiting
            self._waiting = []
            node.arrived.append(again)
            return
        began = self._time if not own or any(other.dealing for other in around) else node.start
        number = self._open_trouble(node, change.cause, change.origin or node.path, self._time - began)
        self._troubles[number].failures = failure
        self._troubles[number].planted, self._waiting = self._waiting, []
        node.arrived.append(number)

    def _open_trouble(self, node: RunningNode, cause: str, origin: str, took: float = 0.0) -> int:
        """Return the number of a new trouble at or below the node."""
        subject = next((n.subject for n in (node, *self._ancestors(node.path)) if n.subject), "")
        self._number += 1
        self._troubles[self._number] = OpenEpisode(cause, origin, subject, [self._time], took)
        return self._number

    def _pending_in_fallback(self, cause: str, around: Iterable[RunningNode]) -> int | None:
        """Return the trouble of this cause for which a Fallback above runs its next branch, or None."""
        for node in around:
            same = self._last_of_cause(cause, node.taken) if self._kind(node) == "choosing" else None
            if same is not None:
                return same
        return None

    def _close(self, node: RunningNode, *, cause: str = "", halted: bool = False) -> None:
        """Pass the undecided troubles of a failed or halted node up to its parent."""
        self._charge(node)
        left = [n for n in dict.fromkeys((*node.taken, *node.arrived)) if n in self._troubles]
        parent = self._open.get(self._parents.get(node.path, ""))
        if parent is None:
            for number in left:
                self._troubles[number].came_up = self._time
            self._settle(left, None, None if halted else node, "open" if halted else "ended")
            return
        handling = self._kind(parent) != ""
        for number in left:
            self._troubles[number].came_up = self._time
            same = self._last_of_cause(self._troubles[number].cause, parent.taken) if handling else None
            number = number if same is None else self._join(number, same)
            if number not in parent.arrived:
                parent.arrived.append(number)
        if halted:
            return
        if not parent.dealing:  # else it was the cure that failed
            failing = self._last_of_cause(cause, parent.arrived)
            parent.failed, parent.dealing = node.path, handling
            parent.failing = parent.failing if failing is None else failing

    def _progress(self, item: str) -> None:
        """Process a finished item: later failures of its branches do not concern it; its time is not lost."""
        for node in self._open.values():
            node.about = [each for each in node.about if each != item]
            if not node.dealing:
                node.run, node.borne = self._time, 0.0

    # What is done about it.

    def _process_announcement(self, event: event_types.RecoveryEvent) -> None:
        """Process the announcement of a handler after a failure of the branch."""
        node = self._open.get(event.node)
        if node is None:
            return
        node.answers = True
        failing = self._last_of_cause(event.cause, node.arrived)
        if failing is None:  # a condition that does not hold
            joined = self._last_of_cause(event.cause, node.taken)
            failing = self._open_trouble(node, event.cause, event.failed)
            failing = failing if joined is None else self._join(failing, joined)
            node.arrived.append(failing)
        node.failing, node.dealing = failing, True
        self._take_up(node, event.handler, event.handler)
        node.called, node.instead = event.handler, event.handler if event.ends else ""

    def _take_up(self, node: RunningNode, handler: str, cure: str) -> None:
        """Take up the troubles from below, in a Fallback those of all its branches. Without a cure the node
        gives up."""
        choosing = self._kind(node) == "choosing"
        node.aside = node.aside and not node.arrived
        for number in dict.fromkeys((*node.taken, *node.arrived) if choosing else node.arrived):
            trouble = self._troubles.get(number)
            if trouble is None:
                continue
            if number not in node.taken:
                node.taken.append(number)
            if not cure:
                trouble.by = node.path
            elif choosing or number == node.failing or not trouble.tried:
                trouble.by, trouble.handler = node.path, handler
                trouble.tried.append(cure)
                trouble.tries += 1
        node.arrived = []

    def _name_the_cure(self, node: RunningNode, child: str) -> None:
        for number in node.taken:
            trouble = self._troubles.get(number)
            if trouble is not None and trouble.by == node.path and trouble.tried[-1] == node.called:
                trouble.tried[-1] = self._names.of(child)
        node.called = ""

    def _drop_skipped_cure(self, skipped: RunningNode) -> None:
        """Take back the cure when the next branch of a Fallback was skipped."""
        parent = self._open.get(self._parents.get(skipped.path, ""))
        if parent is None or self._kind(parent) != "choosing":
            return
        for number in [n for n in parent.taken if n in self._troubles]:
            trouble = self._troubles[number]
            if trouble.by == parent.path and trouble.handler == _last(skipped.path):
                trouble.tried.pop()
                trouble.tries -= 1

    def _set_aside(self, node: RunningNode) -> None:
        """Note that the node which handles a trouble has given the item up."""
        for around in self._ancestors(node.path):
            if around.dealing and any(number in self._troubles for number in around.taken):
                around.aside = not around.instead  # else the item is done with, as the mission asks
                return

    def _join(self, number: int, other: int) -> int:
        """Merge a new failure into the trouble of the same cause at the same node."""
        if number == other:
            return other
        joined, into = self._troubles.pop(number), self._troubles[other]
        into.times = sorted({*into.times, *joined.times})
        into.tried += joined.tried
        into.tries += joined.tries
        into.seconds += joined.seconds
        into.planted += joined.planted
        into.failures += joined.failures
        return other

    def _charge(self, node: RunningNode) -> None:
        """Charge the last failure of a branch with the time since the start of the run, without inner
        troubles."""
        trouble = self._troubles.get(node.failing)
        if not node.dealing or trouble is None or node.failing not in node.taken:
            return
        self._add(trouble, self._time - node.run - node.borne, self._ancestors(node.path))
        node.run, node.borne = self._time, 0.0

    def _add(self, trouble: OpenEpisode, seconds: float, around: Iterable[RunningNode]) -> None:
        seconds = max(0.0, seconds)
        trouble.seconds += seconds
        for other in around:
            other.borne += seconds

    def _settle(
        self,
        numbers: Iterable[int],
        at: RunningNode | None,
        by: RunningNode | None,
        fate: event_types.Fate = "branched",
    ) -> None:
        """Decide troubles that no node takes up any more: `at` continues without them, because of `by`."""
        if by is not None and self._ids.get(by.path) == "ForEach" and fate == "branched":
            fate = "passed_over"
        for number in list(numbers):
            trouble = self._troubles.get(number)
            if trouble is None or (at is not None and number in at.taken):
                continue
            if not trouble.tried:
                self._add(trouble, trouble.took, [] if at is None else [at, *self._ancestors(at.path)])
            if at is not None:
                at.settled = list(dict.fromkeys((*at.settled, trouble.cause)))
            self._decide(number, "given_up" if trouble.tried else "unhandled", fate, by, trouble.came_up)
        if at is not None:
            at.arrived = [n for n in at.arrived if n in self._troubles]

    def _decide(
        self,
        number: int,
        end: event_types.End,
        fate: event_types.Fate,
        by: RunningNode | None,
        time: float | None = None,
    ) -> None:
        t = self._troubles.pop(number)
        ended = self._time if time is None else time
        for path, at in t.failures:
            around = self._path_and_ancestors(by.path) if by is not None else ()
            shared = next((above for above in around if f"{path}/".startswith(f"{above}/")), "")
            if end in ("cured", "done_instead", "open"):  # the failures of an episode end as it does
                own: event_types.Fate = end
            else:
                own = fate if by is None or shared == by.path else "branched"  # decided in another branch
            decided = f"{t.cause} at {at:.2f} s: {own.replace('_', ' ')}"
            self._decisions.append(
                event_types.FailureDecidedEvent(decided, path, cause=t.cause, time=at, fate=own, by=shared)
            )
        episode = event_types.EpisodeEvent(
            "",
            t.node,
            cause=t.cause,
            item=t.item,
            times=tuple(t.times),
            end=end,
            ended=ended,
            by=t.by,
            handler=t.handler,
            tried=tuple(t.tried),
            tries=t.tries,
            seconds=round(t.seconds, 6),
        )
        self._decisions.append(replace(episode, message=_episode_text(episode)))
        for fault in t.planted:
            after = round(min(at for at in t.times if at >= fault.time - 1e-9) - fault.time, 6)
            self._decisions.append(_followed(fault, t.cause, after, end))

    # Looking around.

    def _kind(self, node: RunningNode) -> str:
        kind = _KINDS.get(self._ids.get(node.path, ""), "")
        return "recovering" if node.answers else kind or ("retrying" if node.again else "")

    def _ancestors(self, path: str) -> Iterable[RunningNode]:
        """Return the running ancestors of a node, the nearest first."""
        for above in self._path_and_ancestors(self._parents.get(path, "")):
            if above in self._open:
                yield self._open[above]

    def _path_and_ancestors(self, path: str) -> Iterator[str]:
        """Return the path and those of all ancestors."""
        while path:
            yield path
            path = self._parents.get(path, "")

    def _last_of_cause(self, cause: str, numbers: Iterable[int]) -> int | None:
        """Return the last of these troubles with this cause; None without one."""
        found = [n for n in numbers if n in self._troubles and self._troubles[n].cause == cause]
        return found[-1] if found else None


def _followed(
    fault: InjectedFault, cause: str, after: float | None, end: event_types.End | None
) -> event_types.FaultOutcomeEvent:
    return event_types.FaultOutcomeEvent(
        fault.message, fault=fault.fault, time=fault.time, item=fault.item, cause=cause, after=after, end=end
    )


def _episode_text(episode: event_types.EpisodeEvent) -> str:
    """Return the episode as text: `grasp.slipped: cured by RetreatAndLook, 12.4 s lost`."""
    by = f" by {episode.cure}" if episode.end == "cured" and episode.cure else ""
    lost = f", {episode.seconds:.1f} s lost" if episode.seconds >= 0.05 else ""
    return f"{episode.cause}: {ENDS[episode.end]}{by}{lost}"


ENDS: Mapping[str, str] = {
    "cured": "cured",
    "done_instead": "done instead",
    "given_up": "given up",
    "unhandled": "not handled",
    "open": "open at the end",
}
"""Text for each end of an episode."""
_KINDS = {
    "Recover": "recovering",
    "RecoveryNode": "recovering",
    "RetryUntilSuccessful": "retrying",
    "Fallback": "choosing",
    "ReactiveFallback": "choosing",
    "RoundRobin": "choosing",
}
"""Nodes that may take up a failure, with the kind of evidence for it."""
_SET_ASIDE = "SetAside"
_HELPER_NODES = frozenset({_SET_ASIDE, "Observe", "LookAround", "FreeSpot", "AskForHelp", "Push"})
"""Nodes that may name an item and do none of its work: they look, ask, make room or leave it."""
_INERT_NODES = frozenset({"AlwaysSuccess", "Log", "Script", "SetBlackboard"})
"""Nodes that change nothing in the cell: they cure no failure."""
