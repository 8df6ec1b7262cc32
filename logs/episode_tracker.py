"""Follows the episodes of a run, one tick at a time: the same while it runs and from its log."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import deepcopy

from ..world.journal import JournalEvent
from ..world.run_events import FaultEvent, RecoveryEvent
from ..world.skill_events import ItemDoneEvent, PickEvent, SetAsideEvent
from .episode import (
    AGAIN,
    CureNames,
    DecidedFailure,
    End,
    Episode,
    EpisodeTrackerState,
    Fate,
    NodeLike,
    OpenEpisode,
    Planted,
    RunningNode,
    TransitionLike,
)


class EpisodeTracker:
    """Turns ticks into episodes; `on_end` receives each when it is decided, `on_planted` each fault.

    `on_failure` receives each failure of an episode with its own outcome.
    """

    def __init__(
        self,
        on_end: Callable[[Episode], None],
        on_planted: Callable[[Planted], None] = lambda _: None,
        state: EpisodeTrackerState | None = None,
        on_failure: Callable[[DecidedFailure], None] = lambda _: None,
    ) -> None:
        state = deepcopy(state) if state is not None else EpisodeTrackerState()
        self._on_end, self._on_planted, self._on_failure = on_end, on_planted, on_failure
        self._open = {node.path: node for node in state.nodes}
        self._troubles = dict(state.troubles)
        self._waiting = list(state.planted)
        """Faults after which nothing has failed yet."""
        self._number = state.number
        self._elsewhere = set(state.elsewhere)
        """Items that were put down outside of bins and holes, and not held since."""
        self._leaves: frozenset[str] = frozenset()
        self._ids: Mapping[str, str] = {}
        self._parents: Mapping[str, str] = {}
        self._names = CureNames(())
        self._giving_up: frozenset[str] = frozenset()
        """Branches that may set an item aside, and those that do nothing."""
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
        self._giving_up = frozenset(path for each in giving_up for path in self._upwards(each))
        inert = {node.path for node in known if node.id in _INERT and not node.children}
        for node in reversed(known):  # children come after their parents
            if node.children and inert.issuperset(node.children):
                inert.add(node.path)
        self._giving_up |= inert
        for path in [path for path in self._open if path not in self._ids]:
            gone = self._open.pop(path)
            self._settle([*gone.taken, *gone.arrived], None, None, "open")

    def begun(self, time: float, paths: Iterable[str]) -> None:
        """These were under way already before the first tick."""
        for path in paths:
            self._open.setdefault(path, RunningNode(path, time, "", run=time))

    def take(
        self, time: float, changes: Iterable[TransitionLike], events: Sequence[JournalEvent] = ()
    ) -> None:
        """One tick: which nodes began and ended, in their order, and what was told in it."""
        self._time = round(time, 9)  # as the log has it
        aside = {event.node for event in events if isinstance(event, SetAsideEvent)}
        self._notice(events)
        for change in changes:
            if change.status == "RUNNING":
                self._begin(change)
            else:
                self._end(change, change.path in aside or self._ids.get(change.path) == _SET_ASIDE)
        for event in events:
            if isinstance(event, RecoveryEvent):
                self._told(event)
            elif isinstance(event, ItemDoneEvent):
                self._progress(event.object)
            elif isinstance(event, FaultEvent) and event.struck:
                item = event.item or ""
                self._waiting.append(Planted(time, event.fault, event.message, item, "", None, None))

    def finish(self, time: float) -> None:
        """The run, or its log, has ended: what is open is told as such."""
        self._time = max(time, self._time)
        for node in reversed(list(self._open.values())):
            self._bear(node)
        for number in sorted(self._troubles):
            self._decide(number, "open", "open", None)
        for fault in self._waiting:
            self._on_planted(fault)
        self._open, self._waiting = {}, []

    def copied(
        self, on_end: Callable[[Episode], None], on_planted: Callable[[Planted], None]
    ) -> EpisodeTracker:
        """One that goes on by itself."""
        made = EpisodeTracker(on_end, on_planted, self.state())
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
            self._goes_on(parent, path)
        self._open[path] = RunningNode(path, self._time, change.subject, run=self._time)
        if change.subject and not self._only_helps(path):
            for around in self._around(path):
                if self._kind(around) == "choosing" and change.subject not in around.about:
                    around.about.append(change.subject)

    def _goes_on(self, node: RunningNode, child: str) -> None:
        """A node runs a child: the next one, the same again, or a cure."""
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
            self._bear(node)
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
                self._source(node, change)
            self._close(node, cause=change.cause)
        elif change.status == "IDLE":
            self._close(node, halted=True)
        else:
            if change.status == "SUCCESS" and change.path in self._leaves and not self._only_helps(node.path):
                for around in self._around(node.path):
                    if node.subject in around.failed_about and node.subject not in around.worked:
                        around.worked.append(node.subject)
            self._succeeded(node)
            self._settle(node.arrived, self._open.get(self._parents.get(node.path, "")), node)
        if change.status == "SKIPPED":
            self._was_no_cure(node)

    def _succeeded(self, node: RunningNode) -> None:
        """A node has succeeded: decide what it had taken up."""
        for number in [n for n in node.taken if n in self._troubles]:
            trouble = self._troubles[number]
            if node.instead and trouble.handler == node.instead:
                self._decide(number, "done_instead", "branched", node)
            elif not node.aside and self._got_on(node, trouble):
                self._decide(number, "cured", "branched", node)
            elif not node.aside and (outer := self._handling_around(node.path)) is not None:
                outer.taken.append(number)  # it ends as what `outer` handles meanwhile
            else:
                self._decide(number, "given_up", "branched", node)

    def _got_on(self, node: RunningNode, trouble: OpenEpisode) -> bool:
        """Whether the work that had failed then succeeded.

        The same branch did. Another one stands in for it only when a skill succeeded on an item of the branch
        that failed, and the item was not put down elsewhere.
        """
        if self._kind(node) != "choosing":
            return True
        items = [trouble.item] if trouble.item in node.failed_about else node.failed_about
        return not items or any(i in node.worked and i not in self._elsewhere for i in items)

    def _handling_around(self, path: str) -> RunningNode | None:
        """The nearest node around that runs a cure for something else."""
        for node in self._around(path):
            runs_a_cure = node.dealing or self._kind(node) == "choosing"
            if runs_a_cure and any(number in self._troubles for number in node.taken):
                return node
        return None

    def _only_helps(self, path: str) -> bool:
        """Whether a node names an item and does none of its work, such as a look."""
        return self._ids.get(path) in _HELPING

    def _notice(self, events: Iterable[JournalEvent]) -> None:
        """Follow which items lie where a mission has put them down outside of bins and holes."""
        for event in events:
            if isinstance(event, ItemDoneEvent) and not event.into:
                self._elsewhere.add(event.object)
            elif isinstance(event, ItemDoneEvent) or (isinstance(event, PickEvent) and event.held):
                self._elsewhere.discard(event.object)

    def _source(self, node: RunningNode, change: TransitionLike) -> None:
        """A node has failed: with something new, or with what has come up from below."""
        own = change.origin in ("", node.path)
        same = self._with(change.cause, (*node.taken, *node.arrived))
        if same is not None and (not own or self._troubles[same].node == node.path):
            self._troubles[same].failures.append((node.path, self._time))
            return
        if not own and change.cause in node.settled:
            return
        around = list(self._around(node.path))
        again = self._answered(change.cause, around)
        if again is not None:
            self._troubles[again].times.append(self._time)
            self._troubles[again].failures.append((node.path, self._time))
            node.arrived.append(again)
            return
        began = self._time if not own or any(other.dealing for other in around) else node.start
        number = self._arise(node, change.cause, change.origin or node.path, self._time - began)
        self._troubles[number].failures = [(node.path, self._time)]
        self._troubles[number].planted, self._waiting = self._waiting, []
        node.arrived.append(number)

    def _arise(self, node: RunningNode, cause: str, origin: str, took: float = 0.0) -> int:
        """Return the number of a new trouble at or below the node."""
        subject = next((n.subject for n in (node, *self._around(node.path)) if n.subject), "")
        self._number += 1
        self._troubles[self._number] = OpenEpisode(cause, origin, subject, [self._time], took)
        return self._number

    def _answered(self, cause: str, around: Iterable[RunningNode]) -> int | None:
        """The trouble of this cause that a Fallback around is just going another way for."""
        for node in around:
            same = self._with(cause, node.taken) if self._kind(node) == "choosing" else None
            if same is not None:
                return same
        return None

    def _close(self, node: RunningNode, *, cause: str = "", halted: bool = False) -> None:
        """A node has failed or was halted: what it leaves undecided goes up."""
        self._bear(node)
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
            same = self._with(self._troubles[number].cause, parent.taken) if handling else None
            number = number if same is None else self._join(number, same)
            if number not in parent.arrived:
                parent.arrived.append(number)
        if halted:
            return
        if not parent.dealing:  # else it was the cure that failed
            failing = self._with(cause, parent.arrived)
            parent.failed, parent.dealing = node.path, handling
            parent.failing = parent.failing if failing is None else failing

    def _progress(self, item: str) -> None:
        """An item is done: what fails later in the same branches is not about it, nor was the time lost."""
        for node in self._open.values():
            node.about = [each for each in node.about if each != item]
            if not node.dealing:
                node.run, node.borne = self._time, 0.0

    # What is done about it.

    def _told(self, event: RecoveryEvent) -> None:
        """A node says what it tries; the branch has just failed."""
        node = self._open.get(event.node)
        if node is None:
            return
        node.answers = True
        failing = self._with(event.cause, node.arrived)
        if failing is None:  # a condition that does not hold
            joined = self._with(event.cause, node.taken)
            failing = self._arise(node, event.cause, event.failed)
            failing = failing if joined is None else self._join(failing, joined)
            node.arrived.append(failing)
        node.failing, node.dealing = failing, True
        self._take_up(node, event.handler, event.handler)
        node.called, node.instead = event.handler, event.handler if event.ends else ""

    def _take_up(self, node: RunningNode, handler: str, cure: str) -> None:
        """Take up what has come up, in a Fallback all that came up so far; no cure: the node gives up."""
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

    def _was_no_cure(self, skipped: RunningNode) -> None:
        """The branch that a Fallback went on with had nothing to do."""
        parent = self._open.get(self._parents.get(skipped.path, ""))
        if parent is None or self._kind(parent) != "choosing":
            return
        for number in [n for n in parent.taken if n in self._troubles]:
            trouble = self._troubles[number]
            if trouble.by == parent.path and trouble.handler == _last(skipped.path):
                trouble.tried.pop()
                trouble.tries -= 1

    def _set_aside(self, node: RunningNode) -> None:
        """Note that the node which deals with a trouble has given the item up."""
        for around in self._around(node.path):
            if around.dealing and any(number in self._troubles for number in around.taken):
                around.aside = not around.instead  # else the item is done with, as the mission asks
                return

    def _join(self, number: int, other: int) -> int:
        """The same cause at the same node is the same trouble."""
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

    def _bear(self, node: RunningNode) -> None:
        """The last failure of a branch bears the time since that run began, but what others bear."""
        trouble = self._troubles.get(node.failing)
        if not node.dealing or trouble is None or node.failing not in node.taken:
            return
        self._add(trouble, self._time - node.run - node.borne, self._around(node.path))
        node.run, node.borne = self._time, 0.0

    def _add(self, trouble: OpenEpisode, seconds: float, around: Iterable[RunningNode]) -> None:
        seconds = max(0.0, seconds)
        trouble.seconds += seconds
        for other in around:
            other.borne += seconds

    def _settle(
        self, numbers: Iterable[int], at: RunningNode | None, by: RunningNode | None, fate: Fate = "branched"
    ) -> None:
        """Decide troubles that no node takes up any more: `at` goes on without them, because of `by`."""
        if by is not None and self._ids.get(by.path) == "ForEach" and fate == "branched":
            fate = "passed_over"
        for number in list(numbers):
            trouble = self._troubles.get(number)
            if trouble is None or (at is not None and number in at.taken):
                continue
            if not trouble.tried:
                self._add(trouble, trouble.took, [] if at is None else [at, *self._around(at.path)])
            if at is not None:
                at.settled = list(dict.fromkeys((*at.settled, trouble.cause)))
            self._decide(number, "given_up" if trouble.tried else "unhandled", fate, by, trouble.came_up)
        if at is not None:
            at.arrived = [n for n in at.arrived if n in self._troubles]

    def _decide(
        self, number: int, end: End, fate: Fate, by: RunningNode | None, time: float | None = None
    ) -> None:
        t = self._troubles.pop(number)
        ended = self._time if time is None else time
        self._on_end(
            Episode(
                t.cause, t.node, t.item, tuple(t.times), end, ended, t.by, t.handler, tuple(t.tried), t.tries,
                round(t.seconds, 6),
            )
        )  # fmt: skip
        for f in t.planted:
            after = round(min(at for at in t.times if at >= f.time - 1e-9) - f.time, 6)
            self._on_planted(Planted(f.time, f.fault, f.message, f.item, t.cause, after, end))
        for path, at in t.failures:
            around = self._upwards(by.path) if by is not None else ()
            shared = next((above for above in around if f"{path}/".startswith(f"{above}/")), "")
            if end in ("cured", "done_instead", "open"):  # the failures of an episode end as it does
                own: Fate = end
            else:
                own = fate if by is None or shared == by.path else "branched"  # decided in another branch
            self._on_failure(DecidedFailure(path, at, t.cause, own, shared))

    # Looking around.

    def _kind(self, node: RunningNode) -> str:
        kind = _KINDS.get(self._ids.get(node.path, ""), "")
        return "recovering" if node.answers else kind or ("retrying" if node.again else "")

    def _around(self, path: str) -> Iterable[RunningNode]:
        """The nodes around one that are under way, the nearest first."""
        for above in self._upwards(self._parents.get(path, "")):
            if above in self._open:
                yield self._open[above]

    def _upwards(self, path: str) -> Iterator[str]:
        """The path, and those of all nodes around."""
        while path:
            yield path
            path = self._parents.get(path, "")

    def _with(self, cause: str, numbers: Iterable[int]) -> int | None:
        """The last of these troubles that is of this cause."""
        found = [n for n in numbers if n in self._troubles and self._troubles[n].cause == cause]
        return found[-1] if found else None


_KINDS = {
    "Recover": "recovering",
    "RecoveryNode": "recovering",
    "RetryUntilSuccessful": "retrying",
    "Fallback": "choosing",
    "ReactiveFallback": "choosing",
    "RoundRobin": "choosing",
}
"""Nodes that may take a failure up, by how they show it."""
_SET_ASIDE = "SetAside"
_HELPING = frozenset({_SET_ASIDE, "Observe", "LookAround", "FreeSpot", "AskForHelp", "Push"})
"""Nodes that may name an item and do none of its work: they look, ask, make room or leave it."""
_INERT = frozenset({"AlwaysSuccess", "Log", "Script", "SetBlackboard"})
"""Nodes that change nothing in the cell: they cure no failure."""


def _last(path: str) -> str:
    return path.rsplit("/", 1)[-1]
