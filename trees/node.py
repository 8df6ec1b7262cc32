"""The base of every node of a tree."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, cast

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from ..files.expressions.expression import Expression
from ..world.causes import Cause, Failure, FailureReport, Family, internal, matches, tree, world
from ..world.journal import JournalEvent, Plain
from .declaration import Hand, Kind, NodeDeclaration, Resource, declare
from .flow.default_flow import any_order_outcomes
from .ports import PortDeclaration
from .pre_postconditions import assign_after, settled_before
from .runtime import Runtime, TreeWorld, Wiring, evaluate
from .status import NodeStatus
from .transitions import NodeTransition
from .values.failure_reports import (
    pack,
    plain_evidence,
    portable_trace,
    report_from_plain,
    report_to_plain,
    unpack,
    with_attached,
    without_addresses,
)
from .values.port_types import PortProblem, PortValues, accept_value, plain_copy
from .values.references import Binding, Constant, Reference

if TYPE_CHECKING:
    from .flow import FlowState, NodeOutcomes
    from .flow.flow_walk import FlowAnalysis
    from .mission import NodeSpec

_PY_TREES: Mapping[NodeStatus, Status] = {
    NodeStatus.IDLE: Status.INVALID,
    NodeStatus.RUNNING: Status.RUNNING,
    NodeStatus.SUCCESS: Status.SUCCESS,
    NodeStatus.FAILURE: Status.FAILURE,
    NodeStatus.SKIPPED: Status.INVALID,
}
_ALWAYS_POSSIBLE = (tree.MISSING_INPUT, tree.TIMEOUT, world.UNKNOWN_OBJECT, internal.ERROR)


class Node(Behaviour):
    """A node of a tree. A parent calls `step` for a tick and `halt` to stop it.

    A sub-class writes `on_tick`, and where it needs them `on_start` and `on_halt`. Its status is that of its
    present activation: when a node starts, everything below it goes back to IDLE first; when it ends, what
    still runs below it is halted, and what ended keeps its status and failure until the next start.
    """

    node_id: ClassVar[str] = ""
    """The ID in mission files; the class's name unless given."""
    kind: ClassVar[Kind] = "control"
    causes: ClassVar[tuple[Cause | Family, ...]] = ()
    """What the node itself may fail with; what its children fail with comes on top."""
    uses: ClassVar[tuple[Resource, ...]] = ()
    hand_after: ClassVar[Hand] = "unchanged"
    """What is in the hand after its success, for the linter."""
    shares: ClassVar[tuple[Resource, ...]] = ()
    """Of what it uses that which others may use meanwhile: it takes nothing away from them."""
    played: ClassVar[bool] = True
    """Whether a stand-in takes its place in a rehearsal; not of a leaf that asks and changes the belief only.
    """
    by_turns: ClassVar[bool] = False
    """Whether it runs one child at a time and leaves it alone until it ends, for the linter."""
    gives_up: ClassVar[bool] = False
    """Whether its success takes an item out of what is to be done without having it done, for the linter."""
    steady: ClassVar[bool] = False
    """Whether it takes no time, touches nothing but the blackboard, and answers alike, its children too, as
    long as keys and facts do not change; for the linter."""
    lasting: ClassVar[int] = 0
    """How many facts outlast its end, of those that it remembers: its `flow` has a flag for each."""
    example: ClassVar[str] = ""
    """The node as a mission writes it, for the reference."""
    remembers: ClassVar[tuple[str, ...]] = ()
    """Attributes that change how the node goes on: plain values, FailureReports, tuples of them."""
    positions: ClassVar[tuple[str, ...]] = ()
    """Those of `remembers` that point at children: an index in the list, a tuple of them, a table's label.
    They follow the child when the mission is edited under a run."""
    counted: ClassVar[tuple[NodeStatus, ...]] = ()
    """Statuses of children of which it keeps a count: it begins anew when such a child is edited away."""
    declaration: ClassVar[NodeDeclaration]

    path: str
    ticked: bool
    """Whether it was ticked in the tree's present or last tick."""
    failure: FailureReport | None
    """Why it is in FAILURE; None for a false condition."""
    seconds: float
    """Wall time that its last tick took, children included. For the record only."""

    def __init_subclass__(cls, *, abstract: bool = False) -> None:
        """Declare the node; `abstract=True` for a base of nodes that stands in no file."""
        super().__init_subclass__()
        if not abstract:
            cls.declaration = declare(cls)

    def __init__(self, wiring: Wiring, runtime: Runtime) -> None:
        super().__init__(name=wiring.name)
        self.path = wiring.path
        self.ticked = False
        self.failure = None
        self.seconds = 0.0
        self._wiring = wiring
        self._runtime = runtime
        self._state = NodeStatus.IDLE
        self._slots: dict[str, tuple[tuple[str, Node], ...]] = {}
        self._begun = False
        self._inputs: dict[str, object] = {}
        self._outputs: dict[str, object] = {}

    # What a sub-class writes.

    def on_start(self) -> None:
        """Called before `on_tick` when the node was not RUNNING: forget what was. May raise Failure."""

    def on_tick(self) -> NodeStatus:
        """Do one tick's work and return the status. May raise Failure."""
        raise NotImplementedError(f"{type(self).__name__}.on_tick")

    def on_halt(self) -> None:
        """Called when the node is stopped while RUNNING, before its children are."""

    def on_rewired(self, ports: frozenset[str]) -> None:
        """Called when the node goes on under an edited mission that says something else for these ports."""

    def pass_over(self, elements: Collection[str]) -> None:
        """Called while the node runs when these elements of a list, ids as a rule, need nothing any more."""

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        """What is wrong with what a file gives: rules about several keys, and about values that no bound of
        a port can say. A sentence concerns the node, a Misfit one of its keys."""
        return ()

    # What a sub-class may say of itself for the linter, where the declaration is not the whole truth.

    @classmethod
    def causes_with(cls, ports: Mapping[str, Binding]) -> tuple[Cause | Family, ...]:
        """What it may fail with when its ports are wired so."""
        return cls.causes

    @classmethod
    def hand_with(cls, ports: Mapping[str, Binding]) -> tuple[Hand, tuple[Hand, ...]]:
        """What is in the hand after success when its ports are wired so, and all that may be there else."""
        return cls.hand_after, ("unchanged", cls.hand_after)

    @classmethod
    def empties_with(cls, inputs: Mapping[str, object]) -> str:
        """The bin that is empty after its success with such inputs, for rehearsals; empty text for none."""
        return ""

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        """In which ways it may end when it starts in that state. The most cautious answer unless overridden;
        a class that overrides `on_tick` below one that overrides this gets that answer, too."""
        return any_order_outcomes(cls, spec, entry, walk)

    # What a parent and the runner call.

    @property
    def state(self) -> NodeStatus:
        return self._state

    @property
    def saveable(self) -> bool:
        """Whether its state can be saved while it is RUNNING: a leaf says so where nothing but what it
        `remembers` decides how it goes on."""
        return bool(self.children)

    @property
    def world(self) -> TreeWorld:
        return self._runtime.world

    @property
    def wiring(self) -> Wiring:
        return self._wiring

    @property
    def below(self) -> tuple[Node, ...]:
        """All children, in the order of the slots and of the file."""
        return cast("tuple[Node, ...]", tuple(self.children))

    def step(self) -> NodeStatus:
        """One tick. Never raises for what a node does: a fault of its own code is `internal.error`."""
        began = time.perf_counter()
        self.ticked = True
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
            state = self._postconditions(state)
        self._set(state)
        if state is not NodeStatus.FAILURE:
            self.failure = None
        self.seconds = time.perf_counter() - began
        self._note_end()
        return state

    def halt(self) -> None:
        """Stop what runs here and below; then all of it is IDLE. Never raises."""
        if self._state is NodeStatus.IDLE:
            return
        if self._state is NodeStatus.RUNNING:
            self._guarded_halt()
        for node in self.below:
            node.halt()
        if self._state is NodeStatus.RUNNING:
            for problem in assign_after(self._wiring, self.world, NodeStatus.IDLE):
                self.note("postcondition_failed", problem.message, cause=problem.cause.name)
        self.failure = None
        self.feedback_message = ""
        self._set(NodeStatus.IDLE)
        self._note_end()

    def save(self) -> dict[str, Plain]:
        """What `restore` needs to go on from here, as plain values."""
        remembered: dict[str, Plain] = {name: pack(getattr(self, name)) for name in self.remembers}
        return {
            "id": self._wiring.id,
            "children": [node.path for node in self.below],
            "ports": {
                key: bound.text if isinstance(bound, Constant) else str(bound)
                for key, bound in self._wiring.ports.items()
            },
            "state": self._state.value,
            "failure": report_to_plain(self.failure),
            "message": self.feedback_message,
            "inputs": {
                key: pack(value) for key, value in self._inputs.items() if key not in self._constants()
            },
            "memory": remembered,
        }

    def restore(self, saved: Mapping[str, Plain]) -> None:
        """Go back to what `save` gave."""
        self._set(NodeStatus(str(saved["state"])))
        self._begun = self._state is NodeStatus.RUNNING
        self.failure = report_from_plain(saved["failure"])
        self.feedback_message = str(saved["message"])
        inputs = cast("dict[str, Plain]", saved["inputs"])
        self._inputs = {**self._constants(), **{key: unpack(value) for key, value in inputs.items()}}
        for name, value in cast("dict[str, Plain]", saved["memory"]).items():
            setattr(self, name, unpack(value))

    # What `on_tick` and `on_start` may use.

    def slot(self, key: str) -> tuple[tuple[str, Node], ...]:
        """The children of a slot: (label, node); the label is a table's key, else empty."""
        return self._slots.get(key, ())

    def fill(self, slots: Mapping[str, tuple[tuple[str, Node], ...]]) -> None:
        """Give the node its children; called once, by the builder."""
        self._slots = dict(slots)
        for filled in self._slots.values():
            for _, node in filled:
                node.parent = self
                self.children.append(node)

    def fail_with(self, report: FailureReport | None) -> NodeStatus:
        """FAILURE with that report, which may be a child's: causes travel up unchanged."""
        self.failure = report
        return NodeStatus.FAILURE

    def fail(self, cause: Cause, message: str, *, attached: tuple[FailureReport, ...] = ()) -> NodeStatus:
        """FAILURE of this node's own making, with others' reports attached."""
        return self.fail_with(FailureReport(cause, message, {}, self.path, attached))

    def holds(self, expression: Expression) -> bool:
        """Whether the expression is true now. Raises Failure(tree.missing_input) when it has no value."""
        return bool(evaluate(expression, self._wiring.namespace, self.world))

    def input(self, key: str) -> object:
        """The input as it was when the node started."""
        return self._inputs[key]

    def read_inputs(self) -> None:
        """Read all inputs anew; for control nodes that follow a value while they run. Raises Failure."""
        self._inputs = self._constants()
        for key, wired in self._wiring.ports.items():
            port = self.declaration.port(key)
            if isinstance(wired, Reference) and port is not None and port.direction == "in":
                self._inputs[key] = self._read(port, wired)

    def read_again(self, full_keys: Collection[str]) -> None:
        """Read the inputs anew that come from these keys of the blackboard, while the node runs. Raises
        Failure."""
        for key, wired in self._wiring.ports.items():
            port = self.declaration.port(key)
            if not isinstance(wired, Reference) or port is None or port.direction != "in":
                continue
            if self._wiring.namespace.full_key(wired.key) in full_keys:
                self._inputs[key] = self._read(port, wired)

    def output(self, key: str, value: object) -> None:
        """Write an output. Raises TypeError for a value that is not of the port's type."""
        port = self.declaration.port(key)
        if port is None or port.direction != "out":
            raise TypeError(f"{self.declaration.id} has no output {key!r}")
        try:
            checked = plain_copy(accept_value(value, port.type, port.choices))
        except (TypeError, ValueError) as error:
            raise TypeError(f"output {key!r}: {error}") from None
        self._outputs[key] = checked
        wired = self._wiring.ports.get(key)
        if wired is not None and not isinstance(wired, Constant):
            self._wiring.namespace.write(wired.key, checked, self.path)

    def written(self, key: str) -> object:
        """The output as this activation wrote it last. Raises AttributeError before."""
        if key not in self._outputs:
            raise AttributeError(f"output {key!r} is read before it is written")
        return plain_copy(self._outputs[key])

    def note(self, kind: str, message: str, **data: Plain) -> None:
        """Tell the journal that something happened here."""
        self.world.journal.note(JournalEvent(kind, message, self.path, data))

    # py_trees' own ways in, so that its tools work on our trees.

    def tick(self) -> Iterator[Behaviour]:
        self.step()
        yield from (node for node in self.iterate() if cast("Node", node).ticked)

    def update(self) -> Status:
        return _PY_TREES[self.step()]

    def stop(self, new_status: Status) -> None:
        self.halt()

    # Private.

    def _one_tick(self) -> NodeStatus:
        if self._wiring.preconditions:
            settled = self._precondition()
            if settled is not None:
                return settled
        if self._state is not NodeStatus.RUNNING:
            self._start()
        return self.on_tick()

    def _note_end(self) -> None:
        if self._begun and self._state is not NodeStatus.RUNNING:
            self._begun = False
            self._runtime.transitions.note(self._ending())
            for hook in self._runtime.end_hooks:
                hook(self.path)

    def _ending(self) -> NodeTransition:
        if self.failure is None:
            return NodeTransition(self.path, self._state, message=self.feedback_message)
        report = self.failure
        return NodeTransition(
            self.path,
            self._state,
            cause=report.cause.name,
            origin=report.node,
            message=report.message,
            evidence=report.evidence,
        )

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
            self._runtime.transitions.note(self._beginning())
        self.on_start()

    def _beginning(self) -> NodeTransition:
        wired = self._wiring.ports
        read = {
            key: plain_copy(v) for key, v in self._inputs.items() if isinstance(wired.get(key), Reference)
        }
        of_objects = (port.key for port in self.declaration.inputs if port.type.name == "object")
        subject = next((str(self._inputs[key]) for key in of_objects if self._inputs.get(key)), "")
        return NodeTransition(self.path, self._state, read, subject)

    def _precondition(self) -> NodeStatus | None:
        """The status that a precondition gives in place of a tick. Raises Failure when one has no value."""
        try:
            settled = settled_before(self._wiring, self.world, running=self._state is NodeStatus.RUNNING)
        except Failure:
            self.halt()
            raise
        if settled is not None:
            self.halt()
        return settled

    def _postconditions(self, state: NodeStatus) -> NodeStatus:
        """One that cannot be carried out makes a success a failure, and never hides a failure."""
        problems = assign_after(self._wiring, self.world, state)
        if not problems:
            return state
        if state is NodeStatus.FAILURE and self.failure is not None:
            return self.fail_with(with_attached(self.failure, problems))
        return self.fail_with(with_attached(problems[0], problems[1:]))

    def _read(self, port: PortDeclaration, wired: Reference) -> object:
        where = f"input {port.key!r} of {self._wiring.id}: "
        evidence = {"port": port.key, "reference": str(wired)}
        try:
            value = self._wiring.namespace.read(wired, self.world.scene)
        except KeyError:
            message = f"{where}nothing has written {wired} yet"
            raise Failure(tree.MISSING_INPUT, message, **evidence) from None
        if value is None and not port.type.optional and port.type.name != "any":
            raise Failure(tree.MISSING_INPUT, f"{where}{wired} is empty", **evidence)
        try:
            return accept_value(value, port.type, port.choices, port.within)
        except ValueError as error:
            raise Failure(tree.MISSING_INPUT, f"{where}{wired}: {error}", **evidence) from None

    def _constants(self) -> dict[str, object]:
        """The inputs that no reference feeds."""
        found: dict[str, object] = {}
        for port in self.declaration.inputs:
            wired = self._wiring.ports.get(port.key)
            value = wired.value if isinstance(wired, Constant) else port.default
            if not isinstance(wired, Reference):
                found[port.key] = plain_copy(cast("Plain", value)) if isinstance(value, list) else value
        return found

    def _set(self, state: NodeStatus) -> None:
        self._state = state
        self.status = _PY_TREES[state]

    def _report(self, failure: Failure) -> FailureReport:
        declared = (*self.causes, *_ALWAYS_POSSIBLE)
        if not any(matches(str(cause), failure.cause) for cause in declared):
            message = f"{self._wiring.id} failed with {failure.cause}, which it does not declare"
            self.note("undeclared_cause", message, cause=failure.cause.name)
        return FailureReport(failure.cause, failure.message, plain_evidence(failure.evidence), self.path)

    def _fault(self, error: Exception, doing: str) -> FailureReport:
        trace = portable_trace(error)
        said = without_addresses(str(error))
        message = f"{type(error).__name__} while {self._wiring.id} was {doing}: {said}"
        self.note("internal_error", message, traceback=trace)
        evidence = {"exception": type(error).__name__, "traceback": trace}
        return FailureReport(internal.ERROR, message, evidence, self.path)

    def _guarded_halt(self) -> None:
        try:
            self.on_halt()
        except Exception as error:  # noqa: BLE001 - a fault here must not keep siblings from being halted
            self._fault(error, "halted")


class ControlNode(Node, abstract=True):
    """Base of the nodes that decide which of several children is ticked."""

    kind = "control"
