"""Runtime data of a tree: the parts that all nodes share, each node's wiring, and evaluation of
expressions."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol

from ..files.expressions.expression import Expression, ExpressionError
from ..world.causes import Failure, tree
from .blackboard import Blackboard, Namespace
from .transitions import TransitionCollector
from .values.references import Binding, Constant, Reference, attribute

if TYPE_CHECKING:
    from ..world.belief.planning_scene import PlanningScene
    from ..world.journal import Journal, Plain
    from ..world.protocols import Clock
    from .mission import Assignment


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


def evaluate(expression: Expression, namespace: Namespace, world: TreeWorld) -> object:
    """Evaluate the expression now. Raises Failure(tree.missing_input) when it has no value."""

    def attribute_of(owner: object, name: str) -> object:
        return attribute(world.scene, owner, name)

    try:
        return expression.evaluate(Scope(namespace, world), attribute_of)
    except ExpressionError as error:
        raise Failure(
            tree.MISSING_INPUT, f"the expression '{expression}': {error}", expression=expression.text
        ) from None
