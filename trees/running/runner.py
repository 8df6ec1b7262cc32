"""Behaviour tree in execution, and reports of its ticks."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from dataclasses import dataclass
from typing import cast

from ...errors import PicktreeError
from ...world.causes import Evidence, FailureReport
from ...world.journal import Plain
from ..blackboard import Blackboard, BlackboardWrite
from ..controls.loops import ForEach
from ..node import Node
from ..runtime import NodeTransition, Runtime
from ..skill import Skill
from ..status import NodeStatus
from ..values.references import Constant
from .tree_adoption import StateTransfer, transfer_state


@dataclass(frozen=True, slots=True)
class NodeReport:
    """State of one node at the end of a tick. `cause` and `evidence` are set for a FAILURE with a report."""

    path: str
    id: str
    status: NodeStatus
    ticked: bool
    message: str
    cause: str | None
    evidence: Evidence | None


@dataclass(frozen=True, slots=True)
class TickReport:
    """Report of one tick: all nodes, parents first; blackboard writes and node transitions in order."""

    nodes: tuple[NodeReport, ...]
    writes: tuple[BlackboardWrite, ...]
    transitions: tuple[NodeTransition, ...] = ()


@dataclass(frozen=True, slots=True)
class NodeInfo:
    """Constant properties of a node, recorded once."""

    path: str
    id: str
    name: str
    kind: str
    parent: str | None
    children: tuple[str, ...]
    ports: Mapping[str, Plain]
    """Port values as in the mission file."""


class BehaviourTree:
    """Nodes of a mission with their blackboard. One call of `tick` is one tick."""

    def __init__(self, root: Node, runtime: Runtime) -> None:
        self._root = root
        self._runtime = runtime
        self._nodes = tuple(_parents_first(root))
        self._by_path = {node.path: node for node in self._nodes}
        self._leaves = frozenset(node.path for node in self._nodes if not node.children)
        self._reported: tuple[NodeReport | None, ...] = (None,) * len(self._nodes)

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

    def tick(self) -> TickReport:
        """Tick the root once and report. A tick after the root has ended restarts the mission."""
        self.step()
        return self._report()

    def step(self) -> None:
        """Tick the root once without a report; the writes remain with the blackboard."""
        for node in self._nodes:
            node.ticked = False
            node.seconds = 0.0
        self._root.step()

    def halt(self) -> TickReport:
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

    def structure(self) -> tuple[NodeInfo, ...]:
        """Return the structure of the tree, parents first."""
        return tuple(
            NodeInfo(
                node.path,
                node.wiring.id,
                node.name,
                node.kind,
                cast("Node", node.parent).path if node.parent is not None else None,
                tuple(below.path for below in node.below),
                {
                    key: bound.text if isinstance(bound, Constant) else str(bound)
                    for key, bound in node.wiring.ports.items()
                },
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
            self._by_path[path].ticked = False
        self.blackboard.restore(cast("dict[str, Plain]", saved["blackboard"]))
        self._runtime.transitions.take()

    def adopt(self, saved: Mapping[str, Plain]) -> StateTransfer:
        """Continue from the saved state of another version of the mission. This tree must not have been
        ticked.

        The blackboard is taken over whole. Nodes with the same path and type continue; the others restart.
        """
        self.blackboard.restore(cast("dict[str, Plain]", saved["blackboard"]))
        return transfer_state(self._nodes, cast("dict[str, dict[str, Plain]]", saved["nodes"]))

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
        """Return the path of the first running skill at or below `path`; empty when there is none.

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

    def look(self) -> TickReport:
        """Report the nodes as they are, with writes and transitions since the last tick."""
        return self._report()

    def _report(self) -> TickReport:
        # A node without a failure that has not changed keeps its report.
        self._reported = nodes = tuple(
            [
                before
                if before is not None
                and before.ticked is node.ticked
                and before.status is node.state
                and before.message == node.feedback_message
                and before.cause is None
                and node.failure is None
                else _report(node)
                for node, before in zip(self._nodes, self._reported, strict=True)
            ]
        )
        return TickReport(nodes, self.blackboard.take_writes(), self._runtime.transitions.take())


def _report(node: Node) -> NodeReport:
    failure = node.failure
    return NodeReport(
        node.path,
        node.wiring.id,
        node.state,
        node.ticked,
        failure.message if failure else node.feedback_message,
        failure.cause.name if failure else None,
        failure.evidence if failure else None,
    )


def _parents_first(node: Node) -> Iterator[Node]:
    yield node
    for below in node.below:
        yield from _parents_first(below)
