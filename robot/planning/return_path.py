"""Return paths: from a start beyond soft limits or workspace back in, with an excess that never grows.

A tree grows from the start alone. On its edges no joint goes further beyond its limit, and the tool no
further outside. So the whole path has that property, up to the first configuration within limits and
workspace. Motions that lead straight in are tried first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from picktree.world import Array, Pose
from picktree.world.robot_model import RobotModel

from .collision_checker import CollisionChecker
from .inverse_kinematics import InverseKinematics
from .path_curves import polyline_length
from .trajectory_check import MAX_JOINT_STEP, MAX_TCP_STEP, StartTolerance

RETURN_BUDGET = 8000
"""Collision checks that a search may spend."""
MAX_ATTEMPTS = 1000
"""Greatest number of extensions of the tree."""
NEAR_DEVIATION = 0.3
"""Standard deviation of the targets near the start, rad."""
EXCESS_TOLERANCE = 1e-7
"""Growth of an excess that counts as none, rad or m."""
INSIDE_RESERVE = 0.01
"""Distance of the tool to the edge of its room at which straight motions aim, m."""
INWARD_DAMPING = 1e-3
INWARD_STEP = 0.05
"""Travel of the tool in an extension straight inwards, m."""
INWARD_NOISE = 0.05
"""Standard deviation of the other motion in such an extension, rad."""


class ReturnSearch:
    """Search for return paths from the start of `way`. The answer follows from belief, start and seed."""

    def __init__(
        self,
        model: RobotModel,
        collision: CollisionChecker,
        ik: InverseKinematics,
        way: StartTolerance,
        start: Array,
        holds: Callable[[Array], bool],
    ) -> None:
        """`holds`: whether the path constraints hold at a configuration (n,)."""
        self._model = model
        self._collision = collision
        self._ik = ik
        self._way = way
        self._start = start
        self._holds = holds

    def straight(self, towards: Sequence[Array]) -> list[Array] | None:
        """Return the ends of a straight motion in joint space to the first configuration (n,) that is inside;
        None: none leads in.

        `towards`: configurations that are tried, too.
        """
        for target in (*self._straight_in(), *towards):
            reached = self._extend(self._start, target)
            if reached is not None and not self._way.excess_at(reached).any():
                return [self._start, reached]
        return None

    def around(self, seed: int, checks: int) -> list[Array] | None:
        """Return the configurations (n,) of a path from the start to the first that is inside; None: none was
        found within `checks` collision checks."""
        end = self._collision.checks + min(checks, RETURN_BUDGET)
        rng = np.random.default_rng(seed)
        tree, parents = [self._start], [-1]
        for target, near in self._samples(tree, rng):
            if self._collision.checks >= end:
                return None
            reached = self._extend(tree[near], target)
            if reached is None:
                continue
            tree.append(reached)
            parents.append(near)
            if not self._way.excess_at(reached).any():
                return self._shortened(_back(tree, parents))
        return None

    def _straight_in(self) -> Iterator[Array]:
        """Yield configurations inside that are near the start."""
        inner = np.clip(self._start, self._way.lower, self._way.upper)
        yield inner
        room = self._collision.room
        if room is None:
            return
        tool = self._model.tcp(inner)
        low, high = np.array(room.low) + INSIDE_RESERVE, np.array(room.high) - INSIDE_RESERVE
        x, y, z = np.clip(np.array(tool.position), low, np.maximum(low, high)).tolist()
        q = self._ik.descend(Pose((x, y, z), tool.orientation), inner)
        if q is not None:
            yield q

    def _samples(self, tree: list[Array], rng: np.random.Generator) -> Iterator[tuple[Array, int]]:
        """Yield targets of extensions, and the node that each begins at."""
        for attempt in range(MAX_ATTEMPTS):
            if attempt % 2:
                left = [float(self._way.excess_at(q).sum()) for q in tree[-20:]]
                near = max(0, len(tree) - 20) + int(np.argmin(left))
                yield self._inwards(tree[near], rng), near
                continue
            target = (
                rng.uniform(self._way.lower, self._way.upper)
                if attempt % 4
                else self._start + rng.normal(0.0, NEAR_DEVIATION, len(self._start))
            )
            yield target, int(np.argmin([float(np.linalg.norm(q - target)) for q in tree]))

    def _inwards(self, q: Array, rng: np.random.Generator) -> Array:
        """Return a configuration straight inwards of q, and a little aside in the other directions."""
        step = np.clip(q, self._way.lower, self._way.upper) - q + rng.normal(0.0, INWARD_NOISE, len(q))
        room = self._collision.room
        if room is None:
            return q + step
        tool = np.array(self._model.tcp(q).position)
        inside = np.clip(tool, room.low, room.high) - tool
        size = float(np.linalg.norm(inside))
        if size > 0.0:
            jacobian = self._model.jacobian(q)[:3]
            square = jacobian @ jacobian.T + INWARD_DAMPING * np.eye(3)
            wanted = inside * (INWARD_STEP / size) - jacobian @ step
            step = step + jacobian.T @ np.asarray(np.linalg.solve(square, wanted), np.float64)
        return q + step

    def _extend(self, q: Array, target: Array) -> Array | None:
        """Return the furthest allowed configuration on the straight motion to a target, at most the first one
        inside. None: the motion cannot begin."""
        along, reached = target - q, None
        before = self._way.excess_at(q)
        count = self._steps(q, target)
        for k in range(1, count + 1):
            at = q + along * (k / count)
            now = self._way.excess_at(at)
            if (now > before + EXCESS_TOLERANCE).any() or not self._holds(at) or not self._way.free(at):
                break
            reached, before = at, now
            if not now.any():
                break
        return reached

    def _steps(self, a: Array, b: Array) -> int:
        moved = polyline_length(self._model.tcp_positions(np.linspace(a, b, 9)))
        turned = float(np.linalg.norm(b - a))
        return max(1, int(np.ceil(max(moved / MAX_TCP_STEP, turned / MAX_JOINT_STEP))))

    def _shortened(self, path: list[Array]) -> list[Array]:
        """Return the path without the corners that straight motions can skip."""
        short, k = [path[0]], 0
        while k < len(path) - 1:
            end = len(path) - 1
            while end > k + 1 and not self._joins(path[k], path[end]):
                end -= 1
            k = end
            short.append(path[k])
        return short

    def _joins(self, a: Array, b: Array) -> bool:
        reached = self._extend(a, b)
        return reached is not None and float(np.abs(reached - b).max()) < EXCESS_TOLERANCE


def _back(tree: Sequence[Array], parents: Sequence[int]) -> list[Array]:
    """Return the path from the root to the last node."""
    path, k = list[Array](), len(tree) - 1
    while k >= 0:
        path.append(tree[k])
        k = parents[k]
    return path[::-1]
