"""Runtime data of a tree: parts that all nodes share, wiring, transitions, evaluation of expressions."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal, Protocol

from picktree.files import Expression, expression_syntax
from picktree.world import Failure, FailureReport, Transition, tree

from .blackboard import Blackboard, Namespace
from .control_flow import NodeStatus
from .port_types import plain_copy
from .ports import PortDeclaration
from .references import Assignment, Binding, Constant, Reference, attribute

if TYPE_CHECKING:
    from picktree.world import Clock, Journal, Plain, PlanningScene


TIME_TOLERANCE: Final = 1e-9
"""Tolerance of nodes that wait, for the rounding of summed ticks, s."""


def start_transition(
    path: str,
    wired: Mapping[str, Binding],
    ports: tuple[PortDeclaration, ...],
    inputs: Mapping[str, object],
) -> Transition:
    """Describe the start of a node with these input ports and values."""
    constant = (Constant, type(None))
    read = {
        key: plain_copy(value) for key, value in inputs.items() if not isinstance(wired.get(key), constant)
    }
    of_objects = (port.key for port in ports if port.type.name == "object")
    subject = next((str(inputs[key]) for key in of_objects if inputs.get(key)), "")
    return Transition(path, NodeStatus.RUNNING, read, subject)


def state_transition(
    path: str,
    status: NodeStatus,
    failure: FailureReport | None,
    message: str,
    *,
    ticked: bool,
    update: bool = False,
) -> Transition:
    """Describe the end of a node, or an update; `message` is its feedback where it has not failed with a
    report."""
    if failure is None:
        return Transition(path, status, message=message, ticked=ticked, update=update)
    return Transition(
        path,
        status,
        cause=failure.cause.name,
        origin=failure.node,
        message=failure.message,
        evidence=dict(failure.evidence),
        ticked=ticked,
        update=update,
    )


class TransitionCollector:
    """Collector of node transitions while a tree is ticked."""

    def __init__(self) -> None:
        self._noted: list[Transition] = []

    def note(self, transition: Transition) -> None:
        self._noted.append(transition)

    def take(self) -> tuple[Transition, ...]:
        """Return and clear the transitions since the last call."""
        noted = tuple(self._noted)
        self._noted.clear()
        return noted


class TreeWorld(Protocol):
    """Part of the world that control nodes use; skills get the whole `World`."""

    @property
    def clock(self) -> Clock: ...
    @property
    def scene(self) -> PlanningScene: ...
    @property
    def journal(self) -> Journal: ...
    def facts(self) -> Mapping[str, bool | int | float | str]: ...


@dataclass(frozen=True, slots=True)
class Runtime:
    """State shared by all nodes of a tree."""

    world: TreeWorld
    blackboard: Blackboard = field(default_factory=Blackboard)
    start_hooks: list[Callable[[str], None]] = field(default_factory=list[Callable[[str], None]])
    """Hooks called with a node's path at its start, before it reads its inputs."""
    end_hooks: list[Callable[[str], None]] = field(default_factory=list[Callable[[str], None]])
    """Hooks called with a node's path after it has ended or was halted, with status and failure set."""
    transitions: TransitionCollector = field(default_factory=TransitionCollector)
    stand_ins: dict[str, Callable[[], Generator[None, None, None]]] = field(
        default_factory=dict[str, "Callable[[], Generator[None, None, None]]"]
    )
    """Bodies that replace those of skills in their next tick, by path, for injected program faults. The
    replaced body ends as after a halt."""


@dataclass(frozen=True, slots=True)
class Wiring:
    """Identity of one node, and the connections of its ports."""

    id: str
    name: str
    path: str
    namespace: Namespace
    ports: Mapping[str, Binding]
    preconditions: Mapping[str, Expression] = field(default_factory=dict[str, Expression])
    postconditions: Mapping[str, tuple[Assignment, ...]] = field(
        default_factory=dict[str, "tuple[Assignment, ...]"]
    )
    breakpoint: Literal["before", "after"] | None = None

    @property
    def port_texts(self) -> Mapping[str, Plain]:
        """Constant or reference of each port, as the file has it."""
        return {
            key: bound.text if isinstance(bound, Constant) else str(bound)
            for key, bound in self.ports.items()
        }


class Scope(Mapping[str, object]):
    """Names in an expression: keys of the namespace, then facts of the world."""

    def __init__(self, namespace: Namespace, world: TreeWorld) -> None:
        self._namespace, self._world = namespace, world
        self._facts: Mapping[str, object] | None = None

    def __getitem__(self, name: str) -> object:
        if self._namespace.has(name):
            return self._namespace.read(Reference(name), self._world.scene)
        return self._known_facts()[name]

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and (self._namespace.has(name) or name in self._known_facts())

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys((*self._namespace.names(), *self._known_facts())))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _known_facts(self) -> Mapping[str, object]:
        if self._facts is None:
            self._facts = self._world.facts()
        return self._facts


def evaluate(expression: Expression, namespace: Namespace, world: TreeWorld, where: str = "") -> object:
    """Evaluate the expression now. Raises Failure(tree.missing_input), which begins with `where`, when it has
    no value."""

    def attribute_of(owner: object, name: str) -> object:
        return attribute(world.scene, owner, name)

    try:
        return expression.evaluate(Scope(namespace, world), attribute_of)
    except expression_syntax.ExpressionError as error:
        raise Failure(
            tree.MISSING_INPUT, f"{where}the expression '{expression}': {error}", expression=expression.text
        ) from None
