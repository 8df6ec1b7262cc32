"""Behaviour tree in execution: builder, ticks with their reports, transfer of state to an edited
mission, and blackboard entries that an operator changes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

from py_trees.behaviour import Behaviour

from picktree.files import FileError, PicktreeError, expression_syntax, suggest_name
from picktree.files.yaml import read
from picktree.world import Failure, FailureReport, NodeState, Plain, Tick, TreeNode

from .blackboard import Blackboard, Namespace
from .control_flow import NodeStatus
from .decorators import ForEach
from .description import TreeDefinition
from .failure_reports import pack, report_from_plain, unpack
from .mission import Mission, NodeSpec, TreeSpec
from .node import Node
from .port_types import accept_value, convert_literal, plain_copy, show
from .ports import PortDeclaration, child
from .references import Binding, Constant, PortExpression, Reference
from .run_settings import Overrides, read_settings
from .runtime import Runtime, TreeWorld, Wiring, evaluate
from .skill import Skill


@dataclass(frozen=True, slots=True)
class StateTransfer:
    """Result of a state transfer: paths of nodes, parents first."""

    kept: tuple[str, ...]
    """Nodes that continue."""
    fresh: tuple[str, ...]
    """Nodes that restart: new, of another type, or positioned at a child that is gone."""
    gone: tuple[str, ...]


def transfer_state(nodes: Sequence[Node], saved: Mapping[str, Mapping[str, Plain]]) -> StateTransfer:
    """Give each node of a new tree (parents first) the saved state of the node with its path and type.

    Descendants of a node that restarts are halted: they are IDLE, and keep memory that outlasts a halt.
    """
    kept: list[str] = []
    for node in nodes:
        state = saved.get(node.path)
        above = cast("Node | None", node.parent)
        if state is None or state.get("id") != node.wiring.id:
            continue
        if _take_over(node, state, saved, above is None or above.state is not NodeStatus.IDLE):
            kept.append(node.path)
    going_on, now = set(kept), {node.path: None for node in nodes}
    fresh = tuple(path for path in now if path not in going_on)
    return StateTransfer(tuple(kept), fresh, tuple(path for path in saved if path not in now))


def _take_over(
    node: Node, state: Mapping[str, Plain], saved: Mapping[str, Mapping[str, Plain]], active: bool
) -> bool:
    """Take over the state, and halt nodes that cannot continue; False when the node was RUNNING and
    restarts."""
    memory = _memory(node, state)
    try:
        report_from_plain(state["failure"])
        for value in memory.values():
            unpack(value)
    except PicktreeError:  # a cause that the edited plug-in no longer has
        return False
    running = NodeStatus(str(state["state"])) is NodeStatus.RUNNING
    lost = any(name not in memory for name in node.positions) or _counts_missing_child(node, state, saved)
    node.restore_state({**state, "inputs": _inputs(node, state), "memory": memory})
    if not active or (running and (lost or not _rewired(node, state))):
        node.halt()
        return not running
    return True


def _rewired(node: Node, state: Mapping[str, Plain]) -> bool:
    """Pass changed port values to a running node; False when a new value does not exist yet."""
    before = cast("dict[str, Plain]", state["ports"])
    now = cast("dict[str, Plain]", node.save_state()["ports"])
    changed = frozenset(key for key, text in now.items() if key not in before or before[key] != text)
    if any(not isinstance(node.wiring.ports[key], Constant) for key in changed):
        try:
            node.read_inputs()
        except Failure:
            return False
    if changed:
        node.on_rewired(changed)
    return True


def _inputs(node: Node, state: Mapping[str, Plain]) -> dict[str, Plain]:
    """Return the inputs that were read at the node's start and still are."""
    inputs = cast("dict[str, Plain]", state["inputs"])
    constant = (Constant, type(None))
    return {k: v for k, v in inputs.items() if not isinstance(node.wiring.ports.get(k), constant)}


def _memory(node: Node, state: Mapping[str, Plain]) -> dict[str, Plain]:
    """Return the node's memory with positions moved to their children's new places; lost positions are left
    out."""
    memory = cast("dict[str, Plain]", state["memory"])
    found: dict[str, Plain] = {}
    for name in node.remembers:
        if name not in memory:
            continue
        if name not in node.positions:
            found[name] = memory[name]
            continue
        position = _position(node, unpack(memory[name]), cast("list[str]", state["children"]))
        if position is not None:
            found[name] = pack(position)
    return found


def _position(node: Node, position: object, children: Sequence[str]) -> object:
    """Return the new position of the children that a position names; None when one is gone."""
    match position:
        case str():
            keys = [slot.key for slot in node.declaration.slots]
            filled = [(key, *child) for key in keys for child in node.slot(key)]
            labels = {word for key, label, child in filled for word in (label or key, child.name)}
            return position if not position or position in labels else None
        case int():
            return _index(node, position, children)
        case tuple():
            moved = [_index(node, cast("int", one), children) for one in cast("Iterable[object]", position)]
            return None if None in moved else tuple(moved)
        case _:
            return None


def _index(node: Node, index: int, children: Sequence[str]) -> int | None:
    """Return the new list index of the child at an old index; None when it is gone."""
    now = [child.path for child in node.below]
    if index == len(children):  # it has been through all of them
        return len(now)
    if not 0 <= index < len(children):
        return None
    return now.index(children[index]) if children[index] in now else None


def _counts_missing_child(
    node: Node, state: Mapping[str, Plain], saved: Mapping[str, Mapping[str, Plain]]
) -> bool:
    """Return whether a child that the node has counted is gone."""
    now = {child.path for child in node.below}
    gone = (path for path in cast("list[str]", state["children"]) if path not in now)
    return any(NodeStatus(str(saved[path]["state"])) in node.counted for path in gone)


class BehaviourTree:
    """Nodes of a mission with their blackboard. One call of `tick` is one tick."""

    def __init__(self, root: Node, runtime: Runtime) -> None:
        self._root = root
        self._runtime = runtime
        self._nodes = tuple(_parents_first(root))
        self._by_path = {node.path: node for node in self._nodes}
        self._leaves = frozenset(node.path for node in self._nodes if not node.children)
        self._states = {node.path: _state(node) for node in self._nodes}
        self._reported = tuple(self._states.values())
        """States after the last tick. The same tuple is reported again while nothing in it changes."""
        self._tip = ""

    @property
    def root(self) -> Node:
        """Root node, for py_trees' own tools (display, visitors)."""
        return self._root

    @property
    def nodes(self) -> tuple[Node, ...]:
        """All nodes, parents first."""
        return self._nodes

    @property
    def blackboard(self) -> Blackboard:
        return self._runtime.blackboard

    @property
    def on_start(self) -> list[Callable[[str], None]]:
        """Hooks that get the path of each node that starts, before it reads its inputs."""
        return self._runtime.start_hooks

    @property
    def on_end(self) -> list[Callable[[str], None]]:
        """Hooks that get the path of each node that has ended or was halted, after its status is set."""
        return self._runtime.end_hooks

    @property
    def status(self) -> NodeStatus:
        return self._root.state

    @property
    def failure(self) -> FailureReport | None:
        """Failure of the mission; None when it has none."""
        return self._root.failure

    @property
    def leaves(self) -> frozenset[str]:
        """Paths of the nodes without children."""
        return self._leaves

    @property
    def quiescent(self) -> bool:
        """Whether every RUNNING leaf can be saved."""
        return not any(node.state is NodeStatus.RUNNING and not node.saveable for node in self._nodes)

    def tick(self) -> Tick:
        """Tick the root once and report. A tick after the root has ended restarts the mission."""
        self.step()
        return self._report()

    def step(self) -> None:
        """Tick the root once without a report; the writes remain with the blackboard."""
        for node in self._nodes:
            node.ticked = False
            node.seconds = 0.0
        self._root.step()

    def halt(self) -> Tick:
        """Halt all running nodes and report; every node is IDLE afterwards."""
        for node in self._nodes:
            node.ticked = False
        self._root.halt()
        return self._report()

    def find(self, path: str) -> Node:
        """Return the node at a path. Raises PicktreeError for an unknown path."""
        if path not in self._by_path:
            raise PicktreeError(f"the tree has no node {path!r}")
        return self._by_path[path]

    def seconds(self) -> dict[str, float]:
        """Return the wall times of the nodes ticked last, children included, s; not part of the digest."""
        return {node.path: node.seconds for node in self._nodes if node.ticked}

    def structure(self) -> tuple[TreeNode, ...]:
        """Return the structure of the tree, parents first."""
        return tuple(
            TreeNode(
                node.path,
                node.wiring.id,
                node.name,
                cast("Node", node.parent).path if node.parent is not None else "",
                tuple(below.path for below in node.below),
                {key: str(text) for key, text in node.wiring.port_texts.items()},
            )
            for node in self._nodes
        )

    def save(self) -> dict[str, Plain]:
        """Return the state of nodes and blackboard as plain values. Raises PicktreeError while a leaf
        runs."""
        if not self.quiescent:
            raise PicktreeError("a tree cannot be saved while a skill is running")
        nodes: dict[str, Plain] = {node.path: cast("Plain", node.save_state()) for node in self._nodes}
        return {"nodes": nodes, "blackboard": cast("Plain", self.blackboard.save())}

    def restore(self, saved: Mapping[str, Plain]) -> None:
        """Restore a saved state. Raises PicktreeError when it belongs to another mission."""
        nodes = cast("dict[str, dict[str, Plain]]", saved["nodes"])
        if set(nodes) != set(self._by_path):
            strange = sorted(set(nodes) ^ set(self._by_path))
            raise PicktreeError(f"the saved state belongs to another mission: {strange[0]!r} is not in both")
        self._root.halt()
        for path, state in nodes.items():
            self._by_path[path].restore_state(state)
        self.blackboard.restore(cast("dict[str, Plain]", saved["blackboard"]))
        self._runtime.transitions.take()
        self._take_states()

    def adopt(self, saved: Mapping[str, Plain]) -> StateTransfer:
        """Continue from the saved state of another version of the mission. This tree must not have been
        ticked.

        The blackboard is taken over whole. Nodes with the same path and type continue; the others restart.
        """
        self.blackboard.restore(cast("dict[str, Plain]", saved["blackboard"]))
        transfer = transfer_state(self._nodes, cast("dict[str, dict[str, Plain]]", saved["nodes"]))
        self._take_states()
        return transfer

    def read_again(self, full_keys: Collection[str]) -> None:
        """Reread these blackboard keys in running nodes that read them at their start.

        Raises Failure for a value that a node does not accept.
        """
        for node in self._nodes:
            if node.state is NodeStatus.RUNNING:
                node.read_inputs(full_keys)

    def pass_over(self, elements: Collection[str]) -> None:
        """Make running loops skip these elements of their lists, as far as their turn is still to come."""
        for node in self._nodes:
            if isinstance(node, ForEach) and node.state is NodeStatus.RUNNING:
                node.pass_over(elements)

    def acting(self, path: str = "") -> str | None:
        """Return the path of the first running skill at or below `path`; empty when no skill runs.

        None: the node itself does not run.
        """
        if path and (path not in self._by_path or self._by_path[path].state is not NodeStatus.RUNNING):
            return None
        within = (node for node in self._nodes if not path or f"{node.path}/".startswith(f"{path}/"))
        running = (node for node in within if node.state is NodeStatus.RUNNING and isinstance(node, Skill))
        return next((node.path for node in running), "")

    def stand_in(self, path: str, body: Callable[[], Generator[None, None, None]]) -> bool:
        """Replace a skill's body from its next tick on, as if the skill was halted before.

        Return False when the node is no skill.
        """
        if not isinstance(self._by_path.get(path), Skill):
            return False
        self._runtime.stand_ins[path] = body
        return True

    def look(self) -> Tick:
        """Report the present states of the nodes, with writes and transitions since the last tick."""
        return self._report()

    def _report(self) -> Tick:
        for node in self._nodes:
            node.note_update()
        transitions = self._runtime.transitions.take()
        if transitions:
            for each in transitions:
                self._states[each.path] = each.state(self._by_path[each.path].wiring.id)
            self._know_states()
        writes = self.blackboard.take_writes()
        return Tick(self._root.state, self._tip, self._reported, writes, transitions)

    def _take_states(self) -> None:
        """Take over the states of nodes that were restored."""
        self._states = {node.path: _state(node) for node in self._nodes}
        self._know_states()

    def _know_states(self) -> None:
        self._reported = tuple(self._states.values())
        running = [state.path for state in self._reported if state.status == NodeStatus.RUNNING]
        self._tip = max(running, key=lambda path: path.count("/"), default="")


def _state(node: Node) -> NodeState:
    failure = node.failure
    return NodeState(
        node.path,
        node.wiring.id,
        node.state,
        node.ticked,
        failure.message if failure else node.feedback_message,
        failure.cause.name if failure else "",
        dict(failure.evidence) if failure else {},
    )


def _parents_first(node: Node) -> Iterator[Node]:
    yield node
    for below in node.below:
        yield from _parents_first(below)


class SubTree(Node):
    """Node that ticks its one child in a separate namespace.

    A port wired to a key of the caller is an alias of that key. Literals, defaults and the values of
    expressions are written when the sub-tree starts. A literal counts as an update for nodes that watch the
    key only the first time, as in BehaviorTree.CPP, which writes it once.
    """

    node_id = "SubTree"
    kind = "subtree"
    body = child("the root of the sub-tree")

    inside: Namespace
    """Namespace of the sub-tree's nodes."""
    interface: tuple[PortDeclaration, ...]
    """Ports that the tree declares."""

    def __init__(self, tree: TreeDefinition, **ports: Any) -> None:
        """Describe a call of a tree that was defined in Python."""
        Behaviour.__init__(self, name=tree.name)
        self.description = tree.describe_call(SubTree, ports)

    def on_start(self) -> None:
        self._write_inputs(frozenset(self.wiring.ports), starts=True)

    def on_rewired(self, ports: frozenset[str]) -> None:
        self._write_inputs(ports, starts=False)

    def _write_inputs(self, ports: frozenset[str], *, starts: bool) -> None:
        for key, wired in self.wiring.ports.items():
            if key in ports and isinstance(wired, Constant):
                again = starts and self.inside.has(key)
                self.inside.write(key, wired.value, self.path, update=not again)
            elif key in ports and isinstance(wired, PortExpression):
                where = f"input {key!r} of {self.wiring.id}: "
                value = evaluate(wired.value, self.wiring.namespace, self.world, where)
                self.inside.write(key, value, self.path)

    def on_tick(self) -> NodeStatus:
        state = self.body.step()
        if state is NodeStatus.FAILURE:
            return self.fail_with(self.body.failure)
        return state


def build(mission: Mission, world: TreeWorld, parameters: Mapping[str, Plain] | None = None) -> BehaviourTree:
    """Build the mission's tree. `parameters`: settings for this run, as `read_settings` takes them.

    Raises PicktreeError for a setting that is unknown, missing or of the wrong type.
    """
    runtime = Runtime(world)
    main = mission.main
    settings = read_settings(mission, parameters or {})
    caller = Namespace(runtime.blackboard, "")
    start = NodeSpec(main.name, main.name, main.mark, None, settings.parameters)
    root = _Builder(mission, runtime, settings.overrides).tree(main, start, main.name, caller)
    return BehaviourTree(root, runtime)


class _Builder:
    def __init__(self, mission: Mission, runtime: Runtime, overrides: Overrides) -> None:
        self._mission = mission
        self._runtime = runtime
        self._overrides = overrides

    def tree(self, tree: TreeSpec, call: NodeSpec, path: str, outer: Namespace) -> SubTree:
        """Build an instance of a tree. Its ports are wired to the caller's namespace or hold constants."""
        inside = Namespace(self._runtime.blackboard, path)
        bindings: dict[str, Binding] = {}
        for port in tree.ports:
            bound = call.ports.get(port.key)
            if isinstance(bound, Reference):
                inside.wire(port.key, outer, bound)
                bindings[port.key] = bound
            elif bound is not None:
                bindings[port.key] = bound
            elif port.direction == "in" and not port.remapped:
                bindings[port.key] = Constant(port.default, _plain(port.default))
        node = SubTree.bound(_wiring(call, path, outer, bindings), self._runtime)
        node.inside, node.interface = inside, tree.ports
        node.fill({"do": (("", self.node(tree.root, path, inside)),)})
        return node

    def node(self, spec: NodeSpec, above: str, namespace: Namespace) -> Node:
        path = f"{above}/{spec.name}"
        if path in self._overrides:
            spec = replace(spec, ports={**spec.ports, **self._overrides[path]})
        if spec.node is None:
            return self.tree(self._mission.trees[spec.id], spec, path, namespace)
        node = spec.node.bound(_wiring(spec, path, namespace, spec.ports), self._runtime)
        node.fill(
            {
                key: tuple((label, self.node(child, path, namespace)) for label, child in filled)
                for key, filled in spec.slots.items()
            }
        )
        return node


def _wiring(spec: NodeSpec, path: str, namespace: Namespace, ports: Mapping[str, Binding]) -> Wiring:
    return Wiring(
        spec.id,
        spec.name,
        path,
        namespace,
        ports,
        spec.preconditions,
        spec.postconditions,
        spec.breakpoint,
    )


def _plain(value: object) -> Plain:
    return value if isinstance(value, str | int | float | bool) else str(value)


def entry_key(tree: BehaviourTree, name: str, here: Node) -> str:
    """Return the full key that a name means: a full key, a key of the tree of `here`, or the end of a key.

    Raises PicktreeError for an unknown key, and for a name that fits several keys.
    """
    known = sorted({*tree.blackboard, *(key for key, _ in _wired_keys(tree))})
    if name in known:
        return name
    here_means = here.wiring.namespace.full_key(name)
    if here_means in known:
        return here_means
    fitting = [key for key in known if key.endswith(f"/{name}")]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise PicktreeError(f"{len(fitting)} keys fit {name!r}: {', '.join(fitting)}")
    raise PicktreeError(f"the blackboard has no key {name!r} ({suggest_name(name, known) or 'it is empty'})")


def entry_value(tree: BehaviourTree, key: str, text: str, here: Node) -> Plain:
    """Return the value of a text for a key: YAML, as in a mission file, or an expression `{= rounds + 1}`.

    `here` is the node at which expressions are evaluated. Raises PicktreeError for a text that has no value,
    and for a value that a port wired to the key does not accept.
    """
    value: object
    try:
        expression = PortExpression.parse(text)
        if expression is not None:
            value = evaluate(expression.value, here.wiring.namespace, here.world)
        else:
            value = read(text, "value").root.value
            for port in _ports_at(tree, key):
                value = convert_literal(value, port.type, port.unit, port.choices, port.within)
    except expression_syntax.ExpressionError as error:
        raise PicktreeError(f"{error}, at character {error.offset + 1} of {text!r}") from None
    except Failure as failure:
        raise PicktreeError(failure.message) from None
    except FileError as error:
        raise PicktreeError(f"{text!r} has no value: {error.faults[0].message}") from None
    except ValueError as error:
        raise PicktreeError(f"{key}: {error}") from None
    return checked_value(tree, key, value)


def checked_value(tree: BehaviourTree, key: str, value: object) -> Plain:
    """Return the value as the key's ports have it. Raises PicktreeError for one that a port does not
    accept."""
    try:
        for port in _ports_at(tree, key):
            value = accept_value(value, port.type, port.choices, port.within)
        return plain_copy(value)
    except (ValueError, TypeError) as error:
        raise PicktreeError(f"{key} cannot be {show(value)}: {error}") from None


def _ports_at(tree: BehaviourTree, key: str) -> list[PortDeclaration]:
    """Return the ports that are wired to a key, without untyped ones."""
    untyped = ("any", "expression")
    return [port for wired, port in _wired_keys(tree) if wired == key and port.type.name not in untyped]


def _wired_keys(tree: BehaviourTree) -> Iterator[tuple[str, PortDeclaration]]:
    """Yield each port that reads or writes a key as a whole, with the full key."""
    for node in tree.nodes:
        if isinstance(node, SubTree):
            for port in node.interface:
                wired = node.wiring.ports.get(port.key)
                if not (isinstance(wired, Reference) and wired.attributes):
                    yield node.inside.full_key(port.key), port
            continue
        for port in node.declaration.ports:
            wired = node.wiring.ports.get(port.key)
            if isinstance(wired, Reference) and not wired.attributes and port.takes in ("value", "template"):
                yield node.wiring.namespace.full_key(wired.key), port
