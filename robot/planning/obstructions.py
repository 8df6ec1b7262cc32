"""Obstructions: why no path was found, and why a configuration that reaches the goal is no goal.

The bodies in between, whether start or goal is enclosed; contacts, workspace and constraints at a goal.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...world.robot_model.model import RobotModel
from ...world.values import Array, Bounds, Vector3, WorkspaceExcess, workspace_excess
from .collision_checker import CollisionChecker
from .path_constraints import ConstraintViolation, PathConstraints
from .requests import ContactPair
from .tool_room import WORKSPACE_MARGIN
from .trajectory_check import EDGE_RESOLUTION, StartTolerance

MAX_EXTENSIONS = 240
"""Number of extensions of a local search."""
MAX_EXTENSION = 0.3
"""Greatest extension of a local search, rad."""
EXTENSION_STEP = 0.06
"""Step between two configurations of an extension, rad."""
ESCAPED_DISTANCE = 1.0
"""Distance from its root at which a local search counts as having left, rad."""
SEARCH_CHECK_BUDGET = 2500
"""Collision checks that a local search may spend."""
CONSTRAINT_NAME = "the constraint"
"""Name among the blocking bodies for configurations that a constraint forbids."""
MAX_EXAMINED = 40
"""Greatest number of blocked configurations that are examined."""


@dataclass(frozen=True, slots=True)
class BlockingBodies:
    """Bodies by how often they were in the way, the most frequent first; links of the robot among them."""

    by: tuple[str, ...] = ()
    pairs: tuple[str, ...] = ()
    """Each of these bodies with the part that touches it most often, as `panda_hand at wall`."""
    share: float = 0.0
    """Share of the examined configurations that the first body blocks, 0 … 1."""


@dataclass(frozen=True, slots=True)
class Enclosure:
    """Local search from `where` (`start` or `goal`) that never came farther than `radius` rad."""

    where: str
    radius: float
    blocked: BlockingBodies


class ObstructionSearch:
    """Obstructions of one request that found no path. Deterministic; its checks count as others do."""

    def __init__(
        self,
        model: RobotModel,
        collision: CollisionChecker,
        way: StartTolerance,
        constraints: PathConstraints,
    ) -> None:
        """Use `way` and `constraints` of the search that failed."""
        self._model = model
        self._collision = collision
        self._way = way
        self._constraints = constraints

    def between(self, start: Array, goals: Sequence[Array]) -> BlockingBodies:
        """Return the bodies that block the straight edges in joint space from start to the goals (the first
        three)."""
        hit: list[Array] = []
        for goal in goals[:3]:
            count = max(2, int(np.ceil(float(np.linalg.norm(goal - start)) / (2 * EDGE_RESOLUTION))))
            way = [start + (goal - start) * (k / count) for k in range(1, count)]
            hit += [q for q in way if not self._free(q)]
        return self._blocked(hit)

    def enclosure(self, where: str, root: Array) -> Enclosure | None:
        """Return the enclosure of a configuration; None: a search from it leaves, or its checks are spent too
        early to tell.

        The search grows a tree towards random configurations.
        """
        rng = np.random.default_rng(0)
        lower = np.minimum(self._model.planned_lower, root)
        upper = np.maximum(self._model.planned_upper, root)
        tree = [root]
        hit: list[Array] = []
        end = self._collision.checks + SEARCH_CHECK_BUDGET
        for attempt in range(MAX_EXTENSIONS):
            if self._collision.checks >= end:
                return None
            # Paths out of narrow places begin with small moves: every second target is near.
            if attempt % 2:
                target = np.clip(root + rng.normal(0.0, MAX_EXTENSION, len(root)), lower, upper)
            else:
                target = rng.uniform(lower, upper)
            near = tree[int(np.argmin([float(np.linalg.norm(q - target)) for q in tree]))]
            along = target - near
            if not along.any():
                continue
            along = along * min(1.0, MAX_EXTENSION / float(np.linalg.norm(along)))
            steps = max(1, int(np.ceil(float(np.linalg.norm(along)) / EXTENSION_STEP)))
            reached = near
            for k in range(1, steps + 1):
                straight = near + along * (k / steps)
                q = self._constraints.project(straight, lower, upper)
                if q is None or float(np.abs(q - reached).max()) > MAX_EXTENSION or not self._free(q):
                    hit.append(straight if q is None else q)
                    break
                reached = q
            if reached is not near:
                tree.append(reached)
                if float(np.linalg.norm(reached - root)) > ESCAPED_DISTANCE:
                    return None
        radius = max(float(np.linalg.norm(q - root)) for q in tree)
        return Enclosure(where, radius, self._blocked(hit))

    def _free(self, q: Array) -> bool:
        return self._constraints.hold(q) and self._way.free(q)

    def _blocked(self, hit: Sequence[Array]) -> BlockingBodies:
        """Count the deepest contact of each of some of these configurations."""
        if not hit:
            return BlockingBodies()
        picked = np.unique(np.linspace(0, len(hit) - 1, min(len(hit), MAX_EXAMINED)).astype(int))
        names: Counter[str] = Counter()
        touching: dict[str, Counter[str]] = {}
        for k in picked:
            contacts = self._collision.contacts(hit[int(k)])
            if contacts:
                names.update((contacts[0].b,))
                touching.setdefault(contacts[0].b, Counter()).update((contacts[0].a,))
            elif not self._constraints.hold(hit[int(k)]):
                names.update((CONSTRAINT_NAME,))
        if not names:
            return BlockingBodies()
        by = tuple(name for name, _ in names.most_common())
        pairs = tuple(
            f"{touching[name].most_common(1)[0][0]} at {name}" if name in touching else name for name in by
        )
        return BlockingBodies(by, pairs, names.most_common(1)[0][1] / len(picked))


@dataclass(frozen=True, slots=True, eq=False)
class GoalRejection:
    """Reasons against one configuration. All empty: it is at the very edge of a margin, where it may not come
    nearer."""

    q: Array
    """Configuration (n,), rad."""
    contacts: tuple[ContactPair, ...] = ()
    """Pairs that are closer than their margin, the deepest first."""
    outside: WorkspaceExcess | None = None
    broken: tuple[ConstraintViolation, ...] = ()


class GoalInspection:
    """Reasons why configurations are not free. Slow: for explanations."""

    def __init__(
        self,
        model: RobotModel,
        collision: CollisionChecker,
        constraints: PathConstraints,
        workspace: Bounds | None,
    ) -> None:
        self._model = model
        self._collision = collision
        self._constraints = constraints
        self._workspace = workspace

    def rejection(self, q: Array) -> GoalRejection:
        """Return the reasons against q (n,)."""
        tool = self._model.tcp(q).position
        return GoalRejection(q, self._collision.contacts(q), self.outside(tool), self._constraints.broken(q))

    def outside(self, tool: Vector3) -> WorkspaceExcess | None:
        """Return how far a point in the world is outside the planned workspace; None: it is inside."""
        return None if self._workspace is None else workspace_excess(self._workspace, tool, WORKSPACE_MARGIN)
