"""Record of a run: bodies, counts of items, and the tree: its nodes, their states, transitions and writes.

The tree fills these values, a log writes and reads them, and the analysis works on them. Times are simulated
seconds. The classes have no slots, because orjson writes those eight times as slowly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from .shapes import Shape
from .values import ObjectId, Pose

Values: TypeAlias = Mapping[str, object]
"""Plain JSON values by name."""


@dataclass(frozen=True)
class Body:
    """Movable body: detected, believed or true."""

    kind: str
    """Kind of the catalogue, or `unknown`."""
    form: str
    """`box`, `cylinder`, `sphere`, `plate`, `mesh`, or `unknown`."""
    shape: Shape
    colour: str
    pose: Pose
    """Pose in the world."""
    id: ObjectId = field(default=ObjectId(""), kw_only=True)
    """Empty while it is only detected."""


@dataclass(frozen=True, slots=True)
class FormCount:
    """Number of items of one form (box, cylinder, …)."""

    total: int
    sorted: int


@dataclass(frozen=True, slots=True)
class ItemCount:
    """Number of items by place, as the scorer found them. `total` = `sorted` + `misplaced` + `left`."""

    total: int
    sorted: int
    misplaced: int
    left: int
    by_form: Mapping[str, FormCount]
    without_destination: int = 0
    """Number of items that belong into no bin and lie in none; they are not in `total`."""
    elsewhere: int = 0
    """Number of items that the mission put down outside of bins and holes, as the robot believes."""
    set_aside: int = 0
    """Number of items that the mission gave up at their place, as the robot believes."""

    def to_text(self) -> str:
        """Return a line: `4 of 6 sorted, 0 misplaced, 2 left; 2 set aside, 1 without a destination`."""
        counts = f"{self.sorted} of {self.total} sorted, {self.misplaced} misplaced, {self.left} left"
        others = (
            (self.elsewhere, "put elsewhere"),
            (self.set_aside, "set aside"),
            (self.without_destination, "without a destination"),
        )
        listed = ", ".join(f"{number} {words}" for number, words in others if number)
        return f"{counts}; {listed}" if listed else counts


@dataclass(frozen=True)
class TreeNode:
    """Node of the loaded tree. `parent` is empty for the root."""

    path: str
    id: str
    """Registered name, such as `Grasp`."""
    name: str
    parent: str
    children: tuple[str, ...] = ()
    """Paths of the children, in order."""
    ports: Mapping[str, str] = field(default_factory=dict[str, str])
    """Values of the ports, as written in the mission."""


@dataclass(frozen=True)
class Tree:
    """Tree: all nodes, parents before their children."""

    nodes: tuple[TreeNode, ...]


@dataclass(frozen=True)
class NodeState:
    """State of a node after a tick."""

    path: str
    id: str
    status: str
    """IDLE, RUNNING, SUCCESS, FAILURE or SKIPPED."""
    ticked: bool
    """Whether this tick reached the node."""
    message: str = ""
    cause: str = ""
    """Cause of a failure; empty for a false condition."""
    evidence: Values = field(default_factory=dict[str, object])


@dataclass(frozen=True)
class BlackboardWrite:
    """Write to the blackboard: full key, value, and path of the writing node."""

    key: str
    value: Any
    node: str


@dataclass(frozen=True)
class Transition:
    """Change of a node's status, `ticked`, message or cause, with the state that it leads to.

    A start leads to RUNNING; an end to SUCCESS, FAILURE, SKIPPED, or to IDLE when the node was halted. Any
    other change is an `update`: the reset of a node that had ended, another message, or that a tick did not
    reach the node.
    """

    path: str
    status: str
    inputs: Values = field(default_factory=dict[str, object])
    """Values that a starting node has read through references, by port; else empty."""
    subject: str = ""
    """Object at the first port of type `object` of a starting node; empty without one."""
    cause: str = ""
    origin: str = ""
    """Path of the node from which a failure came; empty without a failure."""
    message: str = ""
    evidence: Values = field(default_factory=dict[str, object])
    ticked: bool = True
    update: bool = False

    @property
    def starts(self) -> bool:
        return self.status == "RUNNING" and not self.update

    @property
    def ends(self) -> bool:
        return self.status != "RUNNING" and not self.update

    def state(self, id: str) -> NodeState:
        """Return the state that the change leads to; `id` is the node's registered name."""
        return NodeState(self.path, id, self.status, self.ticked, self.message, self.cause, self.evidence)


@dataclass(frozen=True)
class Tick:
    """One tick of a tree. `tip` is the path of the deepest running node."""

    root_status: str
    tip: str
    nodes: tuple[NodeState, ...]
    """State of all nodes after the tick, parents first. The same tuple as before while nothing changes."""
    writes: tuple[BlackboardWrite, ...] = ()
    transitions: tuple[Transition, ...] = ()
    """All changes of nodes in this tick, in order."""

    @property
    def edges(self) -> tuple[Transition, ...]:
        """Starts and ends of nodes, in order."""
        return tuple(each for each in self.transitions if not each.update)
