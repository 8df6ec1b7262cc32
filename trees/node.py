"""Base classes of all nodes and of control nodes, and their values: inputs, outputs, pre- and
postconditions.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping
from typing import ClassVar, Literal, Self, cast

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from picktree.files import Expression
from picktree.world import (
    Cause,
    Failure,
    FailureReport,
    Family,
    Plain,
    event_types,
    internal,
    matches,
    tree,
    world,
)

from .control_flow import PY_TREES_STATUS, Flow, Hand, NodeStatus
from .declaration import PRECONDITIONS, Kind, Resource, declare, make_descriptors, reserved_names
from .description import DescribedNode, documented
from .failure_reports import (
    internal_error_report,
    pack,
    plain_evidence,
    report_from_plain,
    report_to_plain,
    unpack,
    with_attached,
)
from .port_types import PortProblem, PortValues, accept_value, plain_copy
from .ports import PortDeclaration
from .references import Assignment, Constant, PortExpression, Reference
from .runtime import Runtime, TreeWorld, Wiring, evaluate, start_transition, state_transition


def wired_inputs(
    inputs: tuple[PortDeclaration, ...], wiring: Wiring
) -> Iterator[tuple[PortDeclaration, Reference | PortExpression]]:
    """Yield each input that a reference or an expression feeds, with it, in the order of the wiring."""
    by_key = {port.key: port for port in inputs if port.takes != "key"}
    for key, wired in wiring.ports.items():
        if not isinstance(wired, Constant) and key in by_key:
            yield by_key[key], wired


def reads_key(wired: Reference | PortExpression, wiring: Wiring, full_keys: Collection[str]) -> bool:
    """Return whether the value depends on one of these blackboard keys."""
    names = (wired.key,) if isinstance(wired, Reference) else wired.value.names
    return any(wiring.namespace.full_key(name) in full_keys for name in names)


def constant_inputs(inputs: tuple[PortDeclaration, ...], wiring: Wiring) -> dict[str, object]:
    """Return the values of the inputs that are constant or have their default, by key: copies."""
    found: dict[str, object] = {}
    for port in inputs:
        wired = wiring.ports.get(port.key)
        value = wired.value if isinstance(wired, Constant) else port.default
        if wired is None or isinstance(wired, Constant):
            found[port.key] = plain_copy(cast("Plain", value)) if isinstance(value, list) else value
    return found


def read_input(
    port: PortDeclaration, wired: Reference | PortExpression, wiring: Wiring, world: TreeWorld
) -> object:
    """Read an input through its reference, or evaluate its expression.

    Raises Failure(tree.missing_input) when a key is unwritten or empty, the expression has no value, or the
    value does not fit the port.
    """
    where = f"input {port.key!r} of {wiring.id}: "
    evidence = {"port": port.key, "reference": str(wired)}
    try:
        if isinstance(wired, Reference):
            value: object = wiring.namespace.read(wired, world.scene)
        else:
            value = evaluate(wired.value, wiring.namespace, world, where)
    except KeyError:
        message = f"{where}nothing has written {wired} yet"
        raise Failure(tree.MISSING_INPUT, message, **evidence) from None
    if value is None and not port.type.optional and port.type.name != "any":
        raise Failure(tree.MISSING_INPUT, f"{where}{wired} is empty", **evidence)
    try:
        return accept_value(value, port.type, port.choices, port.within)
    except ValueError as error:
        raise Failure(tree.MISSING_INPUT, f"{where}{wired}: {error}", **evidence) from None


def accept_output(port: PortDeclaration, value: object) -> Plain:
    """Return a plain copy of the value. Raises TypeError when it does not fit the type or choices."""
    try:
        return plain_copy(accept_value(value, port.type, port.choices))
    except (TypeError, ValueError) as error:
        raise TypeError(f"output {port.key!r}: {error}") from None


ON_HALTED = "_onHalted"
_AFTER: Mapping[NodeStatus, tuple[str, ...]] = {
    NodeStatus.SUCCESS: ("_onSuccess", "_post"),
    NodeStatus.FAILURE: ("_onFailure", "_post"),
}
_SETTLED: Mapping[str, NodeStatus] = {
    "_failureIf": NodeStatus.FAILURE,
    "_successIf": NodeStatus.SUCCESS,
    "_skipIf": NodeStatus.SKIPPED,
}


def settled_before(wiring: Wiring, world: TreeWorld, *, running: bool) -> NodeStatus | None:
    """Return the status that a precondition sets instead of a tick; None: the node is ticked.

    Raises Failure when a precondition has no value.
    """
    for name in PRECONDITIONS:
        expression = wiring.preconditions.get(name)
        if expression is None or (running and name != "_while"):
            continue
        true = bool(evaluate(expression, wiring.namespace, world))
        if name == "_while" and not true:
            return NodeStatus.SKIPPED
        if name != "_while" and true:
            return _SETTLED[name]
    return None


def assign_after(wiring: Wiring, world: TreeWorld, state: NodeStatus) -> tuple[FailureReport, ...]:
    """Carry out the assignments for this end (IDLE: a halt); return reports of those that failed."""
    names = (ON_HALTED,) if state is NodeStatus.IDLE else _AFTER.get(state, ())
    problems: list[FailureReport] = []
    for name in names:
        try:
            assign(name, wiring, world)
        except Failure as failure:
            problems.append(FailureReport(failure.cause, f"{name}: {failure.message}", {}, wiring.path))
    return tuple(problems)


def after_postconditions(
    wiring: Wiring, world: TreeWorld, state: NodeStatus, failure: FailureReport | None
) -> tuple[NodeStatus, FailureReport | None]:
    """Carry out the postconditions of a node that has ended; return its status and failure after them.

    A postcondition that fails makes a success a failure, and never hides a failure.
    """
    problems = assign_after(wiring, world, state)
    if not problems:
        return state, failure
    if state is NodeStatus.FAILURE and failure is not None:
        return state, with_attached(failure, problems)
    return NodeStatus.FAILURE, with_attached(problems[0], problems[1:])


def assign(name: str, wiring: Wiring, world: TreeWorld) -> None:
    """Carry out the assignments under a key of the node. Raises Failure(tree.missing_input)."""
    for assignment in wiring.postconditions.get(name, ()):
        _assign(assignment, wiring, world)


def _assign(assignment: Assignment, wiring: Wiring, world: TreeWorld) -> None:
    value = evaluate(assignment.value, wiring.namespace, world)
    if not assignment.new and not wiring.namespace.has(assignment.key):
        message = f"nothing has written {assignment.key!r} yet; ':=' writes it anew"
        raise Failure(tree.MISSING_INPUT, message, key=assignment.key)
    try:
        wiring.namespace.write(assignment.key, value, wiring.path)
    except ValueError as error:
        raise Failure(tree.MISSING_INPUT, str(error), key=assignment.key) from None


_ALWAYS_POSSIBLE = (tree.MISSING_INPUT, tree.TIMEOUT, world.UNKNOWN_OBJECT, internal.ERROR)


class Node(DescribedNode):
    """A node of a tree. A parent calls `step` for a tick and `halt` to stop it.

    A sub-class writes `on_tick`, and where needed `on_start` and `on_halt`. The status is that of the present
    activation. A start resets all descendants to IDLE. An end halts the descendants that still run; those
    that have ended keep status and failure until the next start.
    """

    node_id: ClassVar[str] = ""
    """The ID in mission files. Default: the class's name."""
    kind: ClassVar[Kind] = "control"
    causes: ClassVar[tuple[Cause | Family, ...]] = ()
    """Causes with which the node itself may fail; those of its children are added."""
    uses: ClassVar[tuple[Resource, ...]] = ()
    hand_before: ClassVar[Literal["any", "full"]] = "any"
    """Content of the hand that the node needs at its start."""
    hand_after: ClassVar[Hand] = "unchanged"
    """Content of the hand after the node's success."""
    shares: ClassVar[tuple[Resource, ...]] = ()
    """Resources in `uses` that other nodes may use in the same tick."""
    played: ClassVar[bool] = True
    """Whether a stub replaces the node in a rehearsal. Not leaves that only read or change the belief."""
    flow: ClassVar[Flow | None] = None
    """Ways in which the node may end; None: any. A class that overrides `on_tick` restates it."""
    example: ClassVar[str] = ""
    """The node as a mission writes it, for the reference."""
    remembers: ClassVar[tuple[str, ...]] = ()
    """Attributes of the node's state: plain values, FailureReports, tuples of them. Its behaviour depends on
    them."""
    positions: ClassVar[tuple[str, ...]] = ()
    """Attributes in `remembers` that name children: list index, tuple of indices, or label of a table.
    They follow the child when the mission is edited during a run."""
    counted: ClassVar[tuple[NodeStatus, ...]] = ()
    """Statuses of children that the node counts: it restarts when an edit removes such a child."""

    path: str
    ticked: bool
    """Whether it was ticked in the tree's present or last tick."""
    failure: FailureReport | None
    """Reason for FAILURE; None for a false condition."""
    seconds: float
    """Wall time of the node's last tick, children included, s. For the record only."""

    def __init_subclass__(cls, *, abstract: bool = False) -> None:
        """Declare the node; `abstract=True` marks a base class that no file may name."""
        super().__init_subclass__()
        if abstract:
            make_descriptors(cls, cls.__name__, reserved_names(Node))
        else:
            cls.declaration = declare(cls, cls, reserved_names(Node))
            cls.__doc__ = documented(cls.declaration)

    @classmethod
    def bound(cls, wiring: Wiring, runtime: Runtime) -> Self:
        """Return a node of a running tree; called by the builder."""
        node = cls.__new__(cls)
        node.bind(wiring, runtime)
        return node

    def bind(self, wiring: Wiring, runtime: Runtime) -> None:
        """Give the node its place in a running tree. A sub-class that extends it calls it first."""
        Behaviour.__init__(self, name=wiring.name)
        self.path = wiring.path
        self.ticked = False
        self.failure = None
        self.seconds = 0.0
        self._wiring = wiring
        self._runtime = runtime
        self._state = NodeStatus.IDLE
        self._slots: dict[str, tuple[tuple[str, Node], ...]] = {}
        self._begun = self._kept = False
        self._inputs: dict[str, object] = {}
        self._outputs: dict[str, object] = {}
        self._noted = self._visible_state
        """State that the last transition led to."""

    # Written by sub-classes.

    def on_start(self) -> None:
        """Reset the node; called before `on_tick` when it was not RUNNING. May raise Failure."""

    def on_tick(self) -> NodeStatus:
        """Do one tick's work and return the status. May raise Failure."""
        raise NotImplementedError(f"{type(self).__name__}.on_tick")

    def on_halt(self) -> None:
        """Clean up; called when the node is halted while RUNNING, before its children are."""

    def on_rewired(self, ports: frozenset[str]) -> None:
        """Adapt to an edited mission that changes these ports; called while the node continues."""

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        """Return the errors in a file's values: rules over several keys, or beyond the bounds of a port.

        A str concerns the whole node, a PortProblem one of its keys.
        """
        return ()

    # Called by the parent and the runner.

    @property
    def state(self) -> NodeStatus:
        return self._state

    @property
    def saveable(self) -> bool:
        """Whether the state can be saved while RUNNING: for leaves, only if `remembers` holds all of it."""
        return bool(self.children)

    @property
    def world(self) -> TreeWorld:
        return self._runtime.world

    @property
    def wiring(self) -> Wiring:
        return self._wiring

    @property
    def below(self) -> tuple[Node, ...]:
        """Children in the order of the slots and of the file."""
        return cast("tuple[Node, ...]", tuple(self.children))

    def step(self, *, kept: bool = False) -> NodeStatus:
        """Run one tick. An exception in the node's code becomes the failure `internal.error`.

        kept: the parent has not reset the node, so preconditions of a node that has ended are not evaluated.
        """
        began = time.perf_counter()
        self.ticked = True
        self._kept = kept and self._state in (NodeStatus.SUCCESS, NodeStatus.FAILURE)
        try:
            state = self._one_tick()
        except Failure as failure:
            state = self.fail_with(self._report(failure))
        except Exception as error:  # noqa: BLE001 - the border of this floor
            state = self.fail_with(self._fault(error, "ticked"))
        if state is not NodeStatus.RUNNING:
            for node in self.below:
                if node.state is NodeStatus.RUNNING:
                    node.halt()
        if self._wiring.postconditions:
            state, self.failure = after_postconditions(self._wiring, self.world, state, self.failure)
        self._set(state)
        if state is not NodeStatus.FAILURE:
            self.failure = None
        self.seconds = time.perf_counter() - began
        self._note_end()
        return state

    def halt(self) -> None:
        """Stop the node and its descendants; afterwards all are IDLE. Never raises."""
        if self._state is NodeStatus.IDLE:
            return
        if self._state is NodeStatus.RUNNING:
            self._guarded_halt()
        for node in self.below:
            node.halt()
        if self._state is NodeStatus.RUNNING:
            for problem in assign_after(self._wiring, self.world, NodeStatus.IDLE):
                event = event_types.PostconditionFailedEvent(
                    problem.message, self.path, cause=problem.cause.name
                )
                self.world.journal.note(event)
        self.failure = None
        self.feedback_message = ""
        self._set(NodeStatus.IDLE)
        self._note_end()

    def note_update(self) -> None:
        """Note a change of the state since the last transition, if there is one; called after a tick, too."""
        if self._visible_state != self._noted:
            self._note_state(update=True)

    def save_state(self) -> dict[str, Plain]:
        """Return the state for `restore_state` as plain values."""
        remembered: dict[str, Plain] = {name: pack(getattr(self, name)) for name in self.remembers}
        return {
            "id": self._wiring.id,
            "children": [node.path for node in self.below],
            "ports": dict(self._wiring.port_texts),
            "state": self._state.value,
            "ticked": self.ticked,
            "failure": report_to_plain(self.failure),
            "message": self.feedback_message,
            "inputs": {
                key: pack(value) for key, value in self._inputs.items() if key not in self._constants()
            },
            "memory": remembered,
        }

    def restore_state(self, saved: Mapping[str, Plain]) -> None:
        """Restore a state that `save_state` returned."""
        self._set(NodeStatus(str(saved["state"])))
        self._begun = self._state is NodeStatus.RUNNING
        self.ticked = bool(saved.get("ticked", False))
        self.failure = report_from_plain(saved["failure"])
        self.feedback_message = str(saved["message"])
        inputs = cast("dict[str, Plain]", saved["inputs"])
        self._inputs = {**self._constants(), **{key: unpack(value) for key, value in inputs.items()}}
        for name, value in cast("dict[str, Plain]", saved["memory"]).items():
            setattr(self, name, unpack(value))
        self._noted = self._visible_state

    # For use in `on_tick` and `on_start`.

    def slot(self, key: str) -> tuple[tuple[str, Node], ...]:
        """Return the children of a slot as (label, node); the label is a table's key, else empty."""
        return self._slots.get(key, ())

    def fill(self, slots: Mapping[str, tuple[tuple[str, Node], ...]]) -> None:
        """Give the node its children; called once, by the builder."""
        self._slots = dict(slots)
        for filled in self._slots.values():
            for _, node in filled:
                node.parent = self
                self.children.append(node)

    def fail_with(self, report: FailureReport | None) -> NodeStatus:
        """Set the failure report and return FAILURE. A child's report travels up unchanged."""
        self.failure = report
        return NodeStatus.FAILURE

    def fail(self, cause: Cause, message: str, *, attached: tuple[FailureReport, ...] = ()) -> NodeStatus:
        """Fail with a cause of this node, with other reports attached; return FAILURE."""
        return self.fail_with(FailureReport(cause, message, {}, self.path, attached))

    def holds(self, expression: Expression) -> bool:
        """Whether the expression is true now. Raises Failure(tree.missing_input) when it has no value."""
        return bool(evaluate(expression, self._wiring.namespace, self.world))

    def input(self, key: str) -> object:
        """Return the input's value as read at the node's start."""
        return self._inputs[key]

    def read_inputs(self, full_keys: Collection[str] | None = None) -> None:
        """Read the inputs that come from these blackboard keys; None: all inputs. Raises Failure.

        Control nodes that follow a value call it while they run.
        """
        if full_keys is None:
            self._inputs = self._constants()
        for port, wired in wired_inputs(self.declaration.inputs, self._wiring):
            if full_keys is None or reads_key(wired, self._wiring, full_keys):
                self._inputs[port.key] = read_input(port, wired, self._wiring, self.world)

    def output(self, key: str, value: object) -> None:
        """Write an output. Raises TypeError for a value that is not of the port's type."""
        port = self.declaration.port(key)
        if port is None or port.direction != "out":
            raise TypeError(f"{self.declaration.id} has no output {key!r}")
        self._outputs[key] = checked = accept_output(port, value)
        wired = self._wiring.ports.get(key)
        if isinstance(wired, Reference):
            self._wiring.namespace.write(wired.key, checked, self.path)

    def written(self, key: str) -> object:
        """Return the output that this activation wrote last. Raises AttributeError before the first."""
        if key not in self._outputs:
            raise AttributeError(f"output {key!r} is read before it is written")
        return plain_copy(self._outputs[key])

    def note(self, kind: str, message: str, **data: Plain) -> None:
        """Add an event of this node to the journal; a kind of one's own, or one that is declared."""
        self.world.journal.note(event_types.event_of(kind, message, self.path, data))

    # Entry points of py_trees, so that its tools work on these trees.

    def tick(self) -> Iterator[Behaviour]:
        self.step()
        yield from (node for node in self.iterate() if cast("Node", node).ticked)

    def update(self) -> Status:
        return PY_TREES_STATUS[self.step()]

    def stop(self, new_status: Status) -> None:
        self.halt()

    # Private.
    def _one_tick(self) -> NodeStatus:
        if self._wiring.preconditions and not self._kept:
            try:
                settled = settled_before(self._wiring, self.world, running=self._state is NodeStatus.RUNNING)
            except Failure:
                self.halt()
                raise
            if settled is not None:
                self.halt()
                return settled
        if self._state is not NodeStatus.RUNNING:
            self._start()
        return self.on_tick()

    def _note_end(self) -> None:
        if self._begun and self._state is not NodeStatus.RUNNING:
            self._begun = False
            self._note_state(update=False)
            for hook in self._runtime.end_hooks:
                hook(self.path)
        else:
            self.note_update()

    def _note_state(self, *, update: bool) -> None:
        self._noted = self._visible_state
        self._runtime.transitions.note(
            state_transition(
                self.path,
                self._state,
                self.failure,
                self.feedback_message,
                ticked=self.ticked,
                update=update,
            )
        )

    @property
    def _visible_state(self) -> tuple[object, ...]:
        return self._state, self.ticked, self.feedback_message, self.failure

    def _start(self) -> None:
        for node in self.below:
            node.halt()
        self.failure = None
        self.feedback_message = ""
        self._outputs = {}
        self._set(NodeStatus.RUNNING)
        self._begun = True
        for hook in self._runtime.start_hooks:
            hook(self.path)
        try:
            self.read_inputs()
        finally:
            self._noted = self._visible_state
            self._runtime.transitions.note(
                start_transition(self.path, self._wiring.ports, self.declaration.inputs, self._inputs)
            )
        self.on_start()

    def _constants(self) -> dict[str, object]:
        return constant_inputs(self.declaration.inputs, self._wiring)

    def _set(self, state: NodeStatus) -> None:
        self._state = state
        self.status = PY_TREES_STATUS[state]

    def _report(self, failure: Failure) -> FailureReport:
        declared = (*self.causes, *_ALWAYS_POSSIBLE)
        if not any(matches(str(cause), failure.cause) for cause in declared):
            message = f"{self._wiring.id} failed with {failure.cause}, which it does not declare"
            event = event_types.UndeclaredCauseEvent(message, self.path, cause=failure.cause.name)
            self.world.journal.note(event)
        return FailureReport(failure.cause, failure.message, plain_evidence(failure.evidence), self.path)

    def _fault(self, error: Exception, doing: str) -> FailureReport:
        report = internal_error_report(error, f"{self._wiring.id} was {doing}", self.path)
        traceback = str(report.evidence["traceback"])
        self.world.journal.note(
            event_types.InternalErrorEvent(report.message, self.path, traceback=traceback)
        )
        return report

    def _guarded_halt(self) -> None:
        try:
            self.on_halt()
        except Exception as error:  # noqa: BLE001 - a fault here must not keep siblings from being halted
            self._fault(error, "halted")


class ControlNode(Node, abstract=True):
    """Base class of the nodes that decide which of several children is ticked."""

    kind = "control"

    def result_of(self, part: Node) -> NodeStatus:
        """Tick a child; return its status and take over its failure."""
        state = part.step()
        return self.fail_with(part.failure) if state is NodeStatus.FAILURE else state
