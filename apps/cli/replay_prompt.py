"""Prompt of `picktree replay`: moves to a tick, and views of it as lines of text."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TextIO, TypeAlias

from picktree.analysis import Cursor, CursorChanges, Edge
from picktree.files import PicktreeError, find_node, find_nodes, short_names
from picktree.logs import Stamped, log_records, node_visits
from picktree.trees import show
from picktree.world import Plan, known_causes, remedy_of

from .command_prompt import Command, CommandPrompt
from .state_text import (
    STYLED_STATUS_MARKS,
    NodeState,
    belief_lines,
    blackboard_lines,
    failure_lines,
    status_text,
    tree_lines,
    tree_rows,
    where_lines,
)

_MAX_NAMED_OBJECTS = 4
"""Maximum number of objects named in one change of the belief."""
_MAX_NAMED_CANDIDATES = 5
"""Maximum number of candidates named for a choice."""


def change_lines(cursor: Cursor, changes: CursorChanges, most: int | None = None) -> Iterator[str]:
    """Yield the changes in the order of time; only the last `most` of them."""
    since = cursor.run.ticks.times[changes.since] if changes.since >= 0 else None
    alone = changes.to - changes.since == 1
    happened = [(time, text) for time, text in _timed_changes(cursor, changes)]
    if not happened:
        yield "nothing changed in this tick" if alone else f"nothing changed since {since or 0.0:.2f} s"
        return
    yield "in this tick:" if alone or since is None else f"since {since:.2f} s:"
    if most is not None and len(happened) > most:
        yield f"  … {len(happened) - most} before these; `changes` shows all"
        happened = happened[-most:]
    for time, text in happened:
        yield f"  {text}" if alone else f"  {time:7.2f} s  {text}"


def _timed_changes(cursor: Cursor, changes: CursorChanges) -> list[tuple[float, str]]:
    """Return the changes with their simulated times, s; those of one tick in a fixed order."""
    names = short_names(node.path for node in cursor.run.nodes)
    told = [(move.time, _move(move.transition, names)) for move in changes.moves]
    told += [
        (one.time, f"blackboard {one.write.key} = {show(one.write.value)}" + _by(one.write.node, names))
        for one in changes.writes
    ]
    believed: dict[tuple[float, str], list[str]] = {}
    for at in changes.belief:
        believed.setdefault((at.time, at.record.reason), []).append(at.record.object)
    told += [(time, f"belief: {_objects(ones)}: {reason}") for (time, reason), ones in believed.items()]
    told += [(at.time, f"{at.record.kind}: {at.record.message}") for at in changes.events]
    told += [(at.time, _plan(at)) for at in changes.plans]
    return sorted(told, key=lambda one: one[0])


def _objects(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= _MAX_NAMED_OBJECTS else f"{names[0]} and {len(names) - 1} others"


def _by(path: str, names: Mapping[str, str]) -> str:
    return f", by {names.get(path, path)}" if path else ""


def _move(transition: log_records.TransitionRecord, names: Mapping[str, str]) -> str:
    mark, name = STYLED_STATUS_MARKS[transition.status][0], names.get(transition.path, transition.path)
    if transition.status == "RUNNING":
        read = ", ".join(f"{port} {show(value)}" for port, value in transition.inputs.items())
        return f"{mark} {name} begins" + (f" with {read}" if read else "")
    if transition.status == "IDLE":
        return f"{mark} {name} is halted"
    said = ": ".join(part for part in (transition.cause, transition.message) if part)
    return f"{mark} {name} ends in {transition.status}" + (f": {said}" if said else "")


def _plan(at: Stamped[Plan]) -> str:
    plan = at.record
    said = f": {plan.message}" if plan.message else ""
    found = f", {plan.duration:.2f} s of motion" if plan.path else ""
    return f"plan {plan.request}: {plan.outcome} by {plan.planner}, {plan.checks} checks{found}{said}"


def failure_list(cursor: Cursor) -> Iterator[str]:
    """Yield a line for each failure of the run; the last one up to the cursor is marked."""
    if not cursor.failures:
        yield "no node failed by itself"
    here = cursor.failure
    for number, visit in enumerate(cursor.failures):
        mark = "→" if here is not None and visit.number == here.number else " "
        failed = f"{visit.path}{visit.about}: {visit.cause}: {visit.message}"
        yield f"{mark} {number}: {visit.end:.2f} s, {failed}"


def evidence_lines(cursor: Cursor) -> Iterator[str]:
    """Yield all evidence in the log on the last failure up to the cursor."""
    visit = cursor.failure
    if visit is None:
        yield "no node has failed by itself yet"
        return
    yield f"{visit.end:.2f} s, tick {visit.last}: {visit.path}{visit.about} failed: {visit.cause}"
    yield f"  said: {visit.message}"
    cause = known_causes().get(visit.cause)
    if cause is not None:
        yield f"  means: {cause.sentence}"
        yield f"  remedy: {remedy_of(cause, visit.evidence)}"
    yield f"  began at {visit.start:.2f} s"
    yield from (f"  read {port} = {show(value)}" for port, value in visit.inputs.items())
    for name, value in visit.evidence.items():
        if isinstance(value, str) and "\n" in value:
            yield f"  evidence {name}:"
            yield from (f"    {line}" for line in value.splitlines())
        else:
            yield f"  evidence {name}: {show(value)}"
    yield from _choices(cursor, visit)
    names = short_names(node.path for node in cursor.run.nodes)
    visits = cursor.run.account.visits
    ended = [
        other
        for other in visits
        if other.origin == visit.path and other.number != visit.number and other.last == visit.last
    ]
    for other in sorted(ended, key=lambda one: -one.path.count("/")):
        yield f"  with it ended {names.get(other.path, other.path)}"
    following = next((o for o in visits[visit.number + 1 :] if o.start >= visit.end), None)
    if following is None:
        yield "  then nothing more began"
    else:
        ended_so = "was halted" if following.outcome == node_visits.HALTED else following.outcome
        yield f"  then began {following.path} at {following.start:.2f} s: {ended_so}"


def _choices(cursor: Cursor, visit: node_visits.Visit) -> Iterator[str]:
    """Yield the candidates of choices during a visit."""
    for at in cursor.run.candidates:
        if not visit.start - 1e-6 <= at.time <= visit.end + 1e-6:
            continue
        choice = at.record
        stages = ", ".join(f"{stage.count} {stage.name}" for stage in choice.stages)
        yield f"  at {at.time:.2f} s chose for {choice.object}: {stages}"
        for tried in choice.tried[:_MAX_NAMED_CANDIDATES]:
            there = f", {tried.place}" if tried.place else ""
            more = f" ({tried.count} places)" if tried.count > 1 else ""
            yield f"    {tried.name}{there}: {tried.verdict}{more}"
        if len(choice.tried) > _MAX_NAMED_CANDIDATES:
            yield f"    … {len(choice.tried) - _MAX_NAMED_CANDIDATES} more"


def place(cursor: Cursor) -> str:
    """Return the cursor's place in a line."""
    tick = cursor.tick.record
    status = {node.path: node for node in tick.nodes}
    where = status.get(deepest(cursor)) or (tick.nodes[0] if tick.nodes else None)
    doing = "" if where is None else f"; {where.path} is {where.status}"
    return f"{cursor.time:.2f} s, tick {cursor.number} of 0 … {len(cursor) - 1}{doing}"


def node_lines(cursor: Cursor, text: str) -> Iterator[str]:
    """Yield the state of one node, its inputs at the start, and its end."""
    node = find_node(text or deepest(cursor), cursor.tree.nodes)
    one = _by_path(cursor)[node.path]
    yield f"{node.path}: {node.id}, {one.status}"
    visit = cursor.last_visit(node.path)
    read: log_records.Values = {} if visit is None else visit.inputs
    for port in dict.fromkeys((*node.ports, *read)):
        said = (node.ports.get(port, ""), show(read[port]) if port in read else "")
        yield f"  {port} = {' '.join(part for part in said if part)}"
    if visit is None:
        yield "  it has not begun yet"
        return
    yield f"  {_span(cursor, visit)}"
    if visit.last <= cursor.number and visit.cause:
        yield from failure_lines(visit.origin, visit.cause, visit.message, visit.evidence)
    elif one.message:
        yield f"  says: {one.message}"


def _span(cursor: Cursor, visit: node_visits.Visit) -> str:
    about = f" for {visit.item}" if visit.item else ""
    times = f", attempt {visit.attempt}{about}" if visit.attempt > 1 else about
    if visit.outcome == "RUNNING" or visit.last > cursor.number:
        return f"began at {visit.start:.2f} s{times}"
    return f"began at {visit.start:.2f} s{times}, ended at {visit.end:.2f} s: {visit.outcome}"


def deepest(cursor: Cursor) -> str:
    """Return the path of the node that failed in this tick; else of the deepest one that runs, or the
    root."""
    failed = cursor.failure
    if failed is not None and failed.last == cursor.number:
        return failed.path
    return cursor.tick.record.tip or cursor.tree.nodes[0].path


def believed_lines(cursor: Cursor, part: str) -> Iterator[str]:
    """Yield the believed objects at the cursor whose id contains `part`."""
    scene = cursor.belief
    return belief_lines(scene.bodies if scene else (), part, cursor.time)


def joint_lines(cursor: Cursor) -> Iterator[str]:
    """Yield the joints with the servo's remaining error, and the gripper."""
    joints, control = cursor.joints, cursor.control
    if joints is None:
        yield "the log has no joints here"
        return
    errors = control.error if control is not None else ()
    width = max(map(len, joints.names), default=0)
    yield f"{'':<{width}}  rad, m   per s    Nm, N    to go"
    for k, name in enumerate(joints.names):
        to_go = f"{errors[k]:+.4f}" if k < len(errors) else ""
        position, velocity, effort = joints.position[k], joints.velocity[k], joints.effort[k]
        yield f"{name:<{width}}  {position:+.4f}  {velocity:+.4f}  {effort:+7.2f}  {to_go}".rstrip()
    opening = [joints.position[joints.names.index(n)] for n in cursor.run.joint_names[1]]
    if opening:
        yield f"gripper opening {1000 * sum(opening):.1f} mm"
    if control is not None:
        yield f"commanded by {control.controller}"


def wrench_line(cursor: Cursor) -> str:
    wrench = cursor.wrench
    if wrench is None:
        return "the log has no wrench here"
    f, t = wrench.force, wrench.torque
    return (
        f"force ({f.x:+.2f}, {f.y:+.2f}, {f.z:+.2f}) N, {wrench.magnitude:.2f} N in all; "
        f"torque ({t.x:+.2f}, {t.y:+.2f}, {t.z:+.2f}) Nm"
    )


def changed_paths(cursor: Cursor) -> frozenset[str]:
    """Return the paths of the nodes that started or ended at the cursor."""
    return frozenset(move.transition.path for move in cursor.changes().moves)


def statuses(cursor: Cursor) -> Sequence[log_records.NodeStatusRecord]:
    """Return the statuses of all nodes of the tree; idle where the tick has none."""
    known = {node.path: node for node in cursor.tick.record.nodes}
    return [known.get(node.path) or _idle(node) for node in cursor.tree.nodes]


def node_states(cursor: Cursor) -> list[NodeState]:
    """Return the nodes of the tree with their statuses at the cursor."""
    status = _by_path(cursor)
    return [
        NodeState(node.path, node.name, node.id, one.status, status_text(one.cause, one.message))
        for node in cursor.tree.nodes
        for one in (status[node.path],)
    ]


def _by_path(cursor: Cursor) -> Mapping[str, log_records.NodeStatusRecord]:
    return {node.path: node for node in statuses(cursor)}


def _idle(node: log_records.TreeNode) -> log_records.NodeStatusRecord:
    return log_records.NodeStatusRecord(node.path, node.id, "IDLE", ticked=False)


MAX_TREE_LINES = 18
"""Maximum number of tree lines shown after a move."""
MAX_CHANGE_LINES = 12
"""Maximum number of change lines shown after a move."""
TO = (
    "12.5, #250, start, end: that time in seconds, that tick; PATH, ITEM: its next start; PATH after: its "
    "next end; with back: the one before"
)
When: TypeAlias = Literal["before", "after"]


@dataclass(frozen=True, slots=True)
class ReplayBreakpoint:
    """Breakpoint of `continue`: at the start of a node, or at its end."""

    path: str
    when: When


class ReplayPrompt(CommandPrompt):
    """Prompt with commands on a cursor. `since` is the tick that was shown before."""

    def __init__(self, cursor: Cursor, read: Callable[[str], str], out: TextIO) -> None:
        super().__init__(read, out)
        self.cursor = cursor
        self.since: int | None = None
        self._breakpoints: dict[int, ReplayBreakpoint] = {}
        self._made = 0
        self.offer(
            Command("step [N]", "a tick on, or N", lambda n: self._step(n, 1)),
            Command("back [N]", "a tick back, or N", lambda n: self._step(n, -1)),
            Command("next", "to the next start or end of a node", lambda _: self._go_change(back=False), "n"),
            Command("previous", "to the one before", lambda _: self._go_change(back=True), "p"),
            Command("failure [back|N]", "to the next failure, the last, or number N", self._failure, "f"),
            Command("to WHERE", TO, self._to),
            Command("continue [back]", "to the next breakpoint, or the one before", self._continue, "c"),
            Command("break [PATH [before|after]]", "stop there; without PATH: list", self._break, "b"),
            Command("delete [NUMBER]", "a breakpoint, or all", self._delete),
            Command("show", "the tick at the cursor again, with the belief", self._show_all),
            Command("tree [PATH]", "all nodes with their statuses; PATH: those below it", self._show_tree),
            Command("where", "the nodes from the root to the one that runs", self._show_where),
            Command("node [PATH]", "a node: its ports, what it read, how it ended", self._show_node),
            Command("changes", "all that changed since the tick that was shown before", self._show_changes),
            Command("failures", "all failures of the run, with their numbers", self._show_failures),
            Command("evidence", "all that is known of the last failure", self._show_evidence),
            Command("blackboard [KEY]", "the keys that contain KEY, and values", self._show_blackboard),
            Command("belief [ID]", "the objects that the robot believed in", self._show_belief),
            Command("joints", "the arm's joints and the fingers", self._show_joints),
            Command("wrench", "the force and torque at the wrist", self._show_wrench),
            Command("quit", "end the replay", lambda _: True),
            Command("help [COMMAND]", "this", self.show_help),
        )  # fmt: skip

    def show_here(self, rows: int = MAX_TREE_LINES, news: int = MAX_CHANGE_LINES) -> None:
        """Show the cursor's place, the running nodes, and the changes."""
        cursor = self.cursor
        self._say(place(cursor))
        shown = tree_rows(cursor.tree.nodes, statuses(cursor), rows, changed_paths(cursor))
        self._show(f"  {row.plain}" for row in shown)
        self._show(change_lines(cursor, cursor.changes(self.since), news))

    def arguments(self, command: str) -> Iterable[str]:
        match command:
            case "tree" | "node" | "break":
                return self._nodes()
            case "to":
                items = {visit.item for visit in self.cursor.run.account.visits if visit.item}
                return ["start", "end", *items, *self._nodes()]
            case "blackboard":
                return self.cursor.blackboard
            case "belief":
                scene = self.cursor.belief
                return [body.id for body in scene.bodies] if scene else ()
            case "delete":
                return map(str, self._breakpoints)
            case "failure":
                return ["back", *map(str, range(len(self.cursor.failures)))]
            case _:
                return super().arguments(command)

    def _nodes(self) -> list[str]:
        """Return all names of nodes: their paths, and unique ends of these."""
        names = short_names(node.path for node in self.cursor.run.nodes)
        return list(dict.fromkeys((*names, *names.values())))

    # Moves.

    def _moved(self, move: Callable[[], object]) -> bool:
        before = self.cursor.number
        move()
        self.since = before
        self.show_here()
        return False

    def _step(self, count: str, way: int) -> bool:
        if count and not (count.isdecimal() and int(count) > 0):
            raise PicktreeError(f"{count!r} is no number of ticks")
        return self._moved(lambda: self.cursor.step(way * int(count or 1)))

    def _go_change(self, *, back: bool) -> bool:
        return self._moved(lambda: self.cursor.next_change(back=back))

    def _failure(self, which: str) -> bool:
        if which.isdecimal():
            known = self.cursor.failures
            if int(which) >= len(known):
                raise PicktreeError(f"there is no failure {which}; `failures` lists them")
            return self._moved(lambda: self.cursor.to_tick(known[int(which)].last))
        if which not in ("", "back"):
            raise PicktreeError(f"failure {which}: write `failure`, `failure back`, or its number")
        return self._moved(lambda: self.cursor.next_failure(back=bool(which)))

    def _to(self, text: str) -> bool:
        cursor = self.cursor
        if not text:
            raise PicktreeError("to what? A time in seconds, #TICK, a node, an item, `start` or `end`")
        if text in ("start", "end"):
            return self._moved(lambda: cursor.to_tick(0 if text == "start" else len(cursor) - 1))
        if tick := re.fullmatch(r"#(\d+)", text):
            return self._moved(lambda: cursor.to_tick(int(tick[1])))
        if time := re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+) ?s?", text):
            return self._moved(lambda: cursor.to_time(float(time[1])))
        name, back = _without(text, "back")
        name, after = _without(name, "after")
        name, _ = _without(name, "before")
        if any(visit.item == name for visit in cursor.run.account.visits):
            return self._moved(lambda: cursor.next_item(name, back=back))
        edge: Edge = "end" if after else "begin"
        return self._moved(lambda: cursor.next_of(name, edge, back=back))

    def _continue(self, way: str) -> bool:
        if way not in ("", "back"):
            raise PicktreeError(f"continue {way}: write `continue` or `continue back`")
        if not self._breakpoints:
            raise PicktreeError("no breakpoints; `break PATH` sets one")
        return self._moved(lambda: self.cursor.next_stop(self._stops(), back=bool(way)))

    def _stops(self) -> frozenset[tuple[str, Edge]]:
        return frozenset(
            (b.path, "end" if b.when == "after" else "begin") for b in self._breakpoints.values()
        )

    # Breakpoints.

    def _break(self, text: str) -> bool:
        if not text:
            if not self._breakpoints:
                self._say("no breakpoints; `break PATH` sets one")
            return self._show(f"{n}: {b.when} {b.path}" for n, b in self._breakpoints.items())
        name, after = _without(text, "after")
        name, _ = _without(name, "before")
        when: When = "after" if after else "before"
        for node in find_nodes(name, self.cursor.run.nodes):
            self._made += 1
            self._breakpoints[self._made] = ReplayBreakpoint(node.path, when)
            self._say(f"{self._made}: {when} {node.path}")
        return False

    def _delete(self, number: str) -> bool:
        if number and not (number.isdecimal() and int(number) in self._breakpoints):
            raise PicktreeError(f"there is no breakpoint {number}; `break` lists them")
        for one in [int(number)] if number else list(self._breakpoints):
            del self._breakpoints[one]
        return False

    # Views.

    def _show_all(self, _: str) -> bool:
        self.show_here()
        return self._show(believed_lines(self.cursor, ""))

    def _show_tree(self, path: str) -> bool:
        return self._show(
            tree_lines(
                node_states(self.cursor),
                find_node(path, self.cursor.tree.nodes).path if path else "",
            )
        )

    def _show_where(self, _: str) -> bool:
        return self._show(where_lines(node_states(self.cursor), deepest(self.cursor)))

    def _show_node(self, path: str) -> bool:
        return self._show(node_lines(self.cursor, path))

    def _show_changes(self, _: str) -> bool:
        return self._show(change_lines(self.cursor, self.cursor.changes(self.since)))

    def _show_failures(self, _: str) -> bool:
        return self._show(failure_list(self.cursor))

    def _show_evidence(self, _: str) -> bool:
        return self._show(evidence_lines(self.cursor))

    def _show_blackboard(self, key: str) -> bool:
        return self._show(blackboard_lines(self.cursor.blackboard, key))

    def _show_belief(self, identity: str) -> bool:
        return self._show(believed_lines(self.cursor, identity))

    def _show_joints(self, _: str) -> bool:
        return self._show(joint_lines(self.cursor))

    def _show_wrench(self, _: str) -> bool:
        self._say(wrench_line(self.cursor))
        return False


def _without(text: str, word: str) -> tuple[str, bool]:
    """Return the text without that word at its end, and whether it had it."""
    name, space, last = text.rpartition(" ")
    return (name, True) if space and last == word else (text, False)
