"""Prompt of `picktree replay`: moves to a tick, and views of it as lines of text."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TextIO

from picktree.analysis import Cursor, CursorChanges, Edge
from picktree.files import PicktreeError, find_node, find_nodes, short_names
from picktree.logs import Stamped, node_visits
from picktree.session import Breakpoint, When
from picktree.trees import show
from picktree.world import NodeState, Plan, Transition, Values, known_causes, remedy_of

from .command_prompt import (
    NO_BREAKPOINTS,
    Command,
    CommandPrompt,
    breakpoint_lines,
    breakpoint_numbers,
    breakpoint_place,
    tick_count,
)
from .state_text import (
    STYLED_STATUS_MARKS,
    NodeRow,
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
    happened = _timed_changes(cursor, changes)
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
    told = [(move.time, _transition(move.transition, names)) for move in changes.moves]
    for at in changes.writes:
        by = f", by {names.get(at.write.node, at.write.node)}" if at.write.node else ""
        told.append((at.time, f"blackboard {at.write.key} = {show(at.write.value)}{by}"))
    believed: dict[tuple[float, str], list[str]] = {}
    for at in changes.belief:
        believed.setdefault((at.time, at.record.reason), []).append(at.record.object)
    told += [(time, f"belief: {_objects(ones)}: {reason}") for (time, reason), ones in believed.items()]
    told += [(at.time, f"{at.record.kind}: {at.record.message}") for at in changes.events]
    told += [(at.time, _plan(at)) for at in changes.plans]
    return sorted(told, key=lambda one: one[0])


def _objects(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= _MAX_NAMED_OBJECTS else f"{names[0]} and {len(names) - 1} others"


def _transition(transition: Transition, names: Mapping[str, str]) -> str:
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
    one = _statuses(cursor)[node.path]
    yield f"{node.path}: {node.id}, {one.status}"
    visit = cursor.last_visit(node.path)
    read: Values = {} if visit is None else visit.inputs
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
    """Return the path of the node that failed in this tick; else of the deepest that runs, or the root."""
    failed = cursor.failure
    if failed is not None and failed.last == cursor.number:
        return failed.path
    return cursor.tick.record.tip or cursor.tree.nodes[0].path


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


def wrench_lines(cursor: Cursor) -> Iterator[str]:
    wrench = cursor.wrench
    if wrench is None:
        yield "the log has no wrench here"
        return
    f, t = wrench.force, wrench.torque
    yield (
        f"force ({f.x:+.2f}, {f.y:+.2f}, {f.z:+.2f}) N, {wrench.magnitude:.2f} N in all; "
        f"torque ({t.x:+.2f}, {t.y:+.2f}, {t.z:+.2f}) Nm"
    )


def _statuses(cursor: Cursor) -> Mapping[str, NodeState]:
    """Return the statuses of all nodes of the tree by path; idle where the tick has none."""
    known = {node.path: node for node in cursor.tick.record.nodes}
    return {
        node.path: known.get(node.path) or NodeState(node.path, node.id, "IDLE", ticked=False)
        for node in cursor.tree.nodes
    }


def _node_states(cursor: Cursor) -> list[NodeRow]:
    """Return the nodes of the tree with their statuses at the cursor."""
    return [
        NodeRow(node.path, node.name, node.id, one.status, status_text(one.cause, one.message))
        for node, one in zip(cursor.tree.nodes, _statuses(cursor).values(), strict=True)
    ]


_MAX_TREE_LINES = 18
"""Maximum number of tree lines shown after a move."""
_MAX_CHANGE_LINES = 12
"""Maximum number of change lines shown after a move."""
_TO_HELP = (
    "12.5, #250, start, end: that time in seconds, that tick; PATH, ITEM: its next start; PATH after: its "
    "next end; with back: the one before"
)


class ReplayPrompt(CommandPrompt):
    """Prompt with commands on a cursor."""

    def __init__(self, cursor: Cursor, read: Callable[[str], str], out: TextIO) -> None:
        super().__init__(read, out)
        self.cursor = cursor
        self._since: int | None = None
        """Tick that was shown before."""
        self._breakpoints: dict[int, Breakpoint] = {}
        self._breakpoint_count = 0
        self.offer(
            Command("step [N]", "a tick on, or N", lambda n: self._move(cursor.step, tick_count(n))),
            Command("back [N]", "a tick back, or N", lambda n: self._move(cursor.step, -tick_count(n))),
            Command("next", "to the next start or end of a node",
                    lambda _: self._move(cursor.next_change), "n"),
            Command("previous", "to the one before",
                    lambda _: self._move(cursor.next_change, back=True), "p"),
            Command("failure [back|N]", "to the next failure, the last, or number N", self._failure, "f"),
            Command("to WHERE", _TO_HELP, self._to),
            Command("continue [back]", "to the next breakpoint, or the one before", self._continue, "c"),
            Command("break [PATH [before|after]]", "stop there; without PATH: list", self._break, "b"),
            Command("delete [NUMBER]", "a breakpoint, or all", self._delete),
            Command("show", "the tick at the cursor again, with the belief", self._show_all),
            Command("tree [PATH]", "all nodes with their statuses; PATH: those below it", self._show_tree),
            Command("where", "the nodes from the root to the one that runs",
                    lambda _: self._show(where_lines(_node_states(cursor), deepest(cursor)))),
            Command("node [PATH]", "a node: its ports, what it read, how it ended",
                    lambda path: self._show(node_lines(cursor, path))),
            Command("changes", "all that changed since the tick that was shown before",
                    lambda _: self._show(change_lines(cursor, cursor.changes(self._since)))),
            Command("failures", "all failures of the run, with their numbers",
                    lambda _: self._show(failure_list(cursor))),
            Command("evidence", "all that is known of the last failure",
                    lambda _: self._show(evidence_lines(cursor))),
            Command("blackboard [KEY]", "the keys that contain KEY, and values",
                    lambda key: self._show(blackboard_lines(cursor.blackboard, key))),
            Command("belief [ID]", "the objects that the robot believed in", self._show_belief),
            Command("joints", "the arm's joints and the fingers", lambda _: self._show(joint_lines(cursor))),
            Command("wrench", "the force and torque at the wrist",
                    lambda _: self._show(wrench_lines(cursor))),
            Command("quit", "end the replay", lambda _: True),
            Command("help [COMMAND]", "this", self.show_help),
        )  # fmt: skip

    def show_here(self) -> bool:
        """Show the cursor's place, the running nodes, and the changes."""
        cursor = self.cursor
        self._say(place(cursor))
        changed = {move.transition.path for move in cursor.changes().moves}
        rows = tree_rows(_node_states(cursor), _MAX_TREE_LINES, changed)
        self._show(f"  {row.plain}" for row in rows)
        return self._show(change_lines(cursor, cursor.changes(self._since), _MAX_CHANGE_LINES))

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

    def _move(self, move: Callable[..., object], *arguments: object, **options: object) -> bool:
        before = self.cursor.number
        move(*arguments, **options)
        self._since = before
        return self.show_here()

    def _failure(self, which: str) -> bool:
        cursor = self.cursor
        if which.isdecimal():
            if int(which) >= len(cursor.failures):
                raise PicktreeError(f"there is no failure {which}; `failures` lists them")
            return self._move(cursor.to_tick, cursor.failures[int(which)].last)
        if which not in ("", "back"):
            raise PicktreeError(f"failure {which}: write `failure`, `failure back`, or its number")
        return self._move(cursor.next_failure, back=bool(which))

    def _to(self, text: str) -> bool:
        cursor = self.cursor
        if not text:
            raise PicktreeError("to what? A time in seconds, #TICK, a node, an item, `start` or `end`")
        if text in ("start", "end"):
            return self._move(cursor.to_tick, 0 if text == "start" else len(cursor) - 1)
        if tick := re.fullmatch(r"#(\d+)", text):
            return self._move(cursor.to_tick, int(tick[1]))
        if time := re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+) ?s?", text):
            return self._move(cursor.to_time, float(time[1]))
        back = text.endswith(" back")
        name, when = breakpoint_place(text.removesuffix(" back"))
        if any(visit.item == name for visit in cursor.run.account.visits):
            return self._move(cursor.next_item, name, back=back)
        return self._move(cursor.next_of, name, _EDGES[when], back=back)

    def _continue(self, way: str) -> bool:
        if way not in ("", "back"):
            raise PicktreeError(f"continue {way}: write `continue` or `continue back`")
        if not self._breakpoints:
            raise PicktreeError(NO_BREAKPOINTS)
        stops = {(b.path, _EDGES[b.when]) for b in self._breakpoints.values()}
        return self._move(self.cursor.next_stop, stops, back=bool(way))

    # Breakpoints.

    def _break(self, text: str) -> bool:
        if not text:
            return self._show(breakpoint_lines(self._breakpoints))
        name, when = breakpoint_place(text)
        for node in find_nodes(name, self.cursor.run.nodes):
            self._breakpoint_count += 1
            self._breakpoints[self._breakpoint_count] = Breakpoint(node.path, when)
            self._say(f"{self._breakpoint_count}: {when} {node.path}")
        return False

    def _delete(self, number: str) -> bool:
        for one in breakpoint_numbers(number, self._breakpoints):
            del self._breakpoints[one]
        return False

    # Views.

    def _show_all(self, _: str) -> bool:
        self.show_here()
        return self._show_belief("")

    def _show_tree(self, path: str) -> bool:
        top = find_node(path, self.cursor.tree.nodes).path if path else ""
        return self._show(tree_lines(_node_states(self.cursor), top))

    def _show_belief(self, identity: str) -> bool:
        scene = self.cursor.belief
        return self._show(belief_lines(scene.bodies if scene else (), identity, self.cursor.time))


_EDGES: Mapping[When, Edge] = {"before": "begin", "after": "end"}
