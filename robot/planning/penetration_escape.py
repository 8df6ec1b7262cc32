"""Escape paths: out of believed penetration and narrow places, by the gradients of the whole arm's
distances."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from picktree.world import Array
from picktree.world.robot_model import RobotModel

from .collision_checker import CollisionChecker, Separation
from .requests import Direction

ESCAPE_STEP = 0.005
"""Greatest travel of the tool in a step, m."""
MAX_ESCAPE_TURN = 0.04
"""Greatest turn of a joint in a step, rad."""
WATCHED_DISTANCE = 0.02
"""Distance beyond its margin up to which a pair is watched in a step, m."""
CLEARANCE_BEYOND_MARGIN = 0.0005
"""Distance beyond its margin at which a pair counts as out, m."""
STEP_SHARES = (1.0, 0.4, 0.15)
"""Shares of a step, tried in this order while it would bring something closer."""
MIN_ESCAPE_STEP = 2e-4
"""Least change of the joints that counts as a step, rad."""
APPROACH_SLACK = 0.0005
"""Greatest further approach of a pair that is too close already, m: escape happens in steps."""
MAX_ESCAPE_STEPS = 120
ESCAPE_DAMPING = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class EscapePath:
    """Escape path in one direction: configurations (m, n) from its start, and how it ended."""

    direction: str
    path: Array
    free: bool
    """Whether all margins are kept at its end."""
    length: float
    """Travel of the tool, m."""
    depth: float
    """Greatest remaining violation of a margin at its end, m."""
    ended_by: str
    """Reason in words why it ended before it was free; "" where it got as far as requested."""


@dataclass(frozen=True, slots=True, eq=False)
class StepConstraints:
    """Linear constraints G x ≥ h on a step x (n,) of the joints."""

    g: Array
    h: Array


class EscapeSearch:
    """Search for escape paths from one configuration, in the belief that `collision` has taken over last.

    A step is the least change of the joints towards the requested direction under two constraints. Every pair
    that is too close comes no closer, and every other keeps its margin. This is least distance programming
    (Lawson and Hanson, "Solving least squares problems", 1974, chapter 23). Each step is measured, not only
    its gradient: pairs that are too close may not come closer, and nothing else may be touched. The answer
    follows from belief and start.
    """

    def __init__(self, model: RobotModel, collision: CollisionChecker, start: Array) -> None:
        self._model = model
        self._collision = collision
        self._start = start
        self._lower = np.minimum(model.planned_lower, start)
        self._upper = np.maximum(model.planned_upper, start)
        self._room = collision.room_at(start)
        """Box in which the tool stays, m: from outside of the workspace it goes no further out."""

    def way(self, direction: Direction, reach: float, *, until_free: bool = True) -> EscapePath:
        """Search in that direction until the arm is free, or, without `until_free`, for `reach` m of the
        tool.

        The travel is at most `reach` m in either case.
        """
        model, q = self._model, self._start
        path, length = [q], 0.0
        near = self._collision.separations(q, WATCHED_DISTANCE)
        allowed = _closest_by_key(near)
        ended_by = ""
        for _ in range(MAX_ESCAPE_STEPS):
            if (until_free and not _violated(near) and self._free(q)) or length >= reach - 1e-6:
                break
            behind, ended_by = q, _blocking_words(near)
            for step in self._steps(q, near, direction):
                tried = np.clip(q + step, self._lower, self._upper)
                if float(np.abs(tried - q).max()) < MIN_ESCAPE_STEP:
                    continue
                if self._room is not None and not self._room.holds(np.array(model.tcp(tried).position)):
                    ended_by = "the tool would leave the workspace"
                    continue
                after = self._collision.separations(tried, WATCHED_DISTANCE)
                worse = _pair_too_close(after, allowed)
                if worse is None:
                    behind, near, ended_by = tried, after, ""
                    break
                ended_by = f"{worse.a} would come closer to {worse.b}"
            if ended_by:
                break
            way = model.tcp(q).distance(model.tcp(behind))
            for key, closest in _closest_by_key(near).items():
                allowed[key] = max(allowed.get(key, closest), closest)
            q = behind
            length += way
            path.append(q)
        violated = _violated(near)
        depth = max((s.margin - s.distance for s in violated), default=0.0)
        free = not violated and self._free(q)
        if not free and not ended_by and until_free:
            ended_by = f"not free after {length * 1000:.0f} mm"
        return EscapePath(direction, np.array(path), free, length, depth, ended_by)

    def along(self, name: str, path: Array) -> EscapePath:
        """Follow configurations (m, n) from the first one, as long as no pair comes closer than it may.

        `name` is the direction's name in the result.
        """
        near = self._collision.separations(path[0], WATCHED_DISTANCE)
        allowed = _closest_by_key(near)
        length, ended_by, end = 0.0, "", 1
        for k in range(1, len(path)):
            after = self._collision.separations(path[k], WATCHED_DISTANCE)
            worse = _pair_too_close(after, allowed)
            if worse is not None:
                ended_by = f"{worse.a} would come closer to {worse.b}"
                break
            near, end = after, k + 1
            for key, closest in _closest_by_key(near).items():
                allowed[key] = max(allowed.get(key, closest), closest)
            length += self._model.tcp(path[k - 1]).distance(self._model.tcp(path[k]))
        depth = max((s.margin - s.distance for s in _violated(near)), default=0.0)
        free = depth == 0.0 and self._free(path[end - 1])
        return EscapePath(name, path[:end], free, length, depth, ended_by)

    def heading(self, direction: Direction) -> Array:
        """Return the unit vector (3,) in the world along which the tool moves in that direction; zero for
        `out`."""
        return np.zeros(3) if direction == "out" else self._along(self._start, direction)

    def _free(self, q: Array) -> bool:
        return self._collision.free(q, self._room)

    def _steps(self, q: Array, near: tuple[Separation, ...], direction: Direction) -> Iterator[Array]:
        """Yield the steps to try: the wanted one, then smaller ones.

        For `out` steps along the gradient of all depths, and of the deepest alone, follow.
        """
        steps = [self._step(q, near, direction)]
        if direction == "out":
            violated = sorted(_violated(near), key=lambda s: s.distance - s.margin)
            steps += [_separating_step(violated), _separating_step(violated[:1])]
        for step in steps:
            if step is None or not step.any():
                continue
            size = min(1.0, ESCAPE_STEP / self._moves(q, step), MAX_ESCAPE_TURN / float(np.abs(step).max()))
            for share in STEP_SHARES:
                yield step * (size * share)

    def _step(self, q: Array, near: tuple[Separation, ...], direction: Direction) -> Array | None:
        wanted = self._joint_step(q, direction)
        rows, least = [np.eye(len(q)), -np.eye(len(q))], [self._lower - q, q - self._upper]
        for s in near:
            room = s.distance - s.margin - CLEARANCE_BEYOND_MARGIN
            rows.append(s.gradient[None])
            if room >= 0.0:
                least.append(np.array([-room]))
            else:
                least.append(np.array([min(-room, ESCAPE_STEP) if direction == "out" else 0.0]))
        bounds = StepConstraints(np.concatenate(rows), np.concatenate(least))
        return least_distance(bounds, wanted)

    def _joint_step(self, q: Array, direction: Direction) -> Array:
        """Return the change (n,) of the joints for a step in that direction; zero for `out`, which the depths
        alone lead.

        The tool keeps its orientation where that costs little.
        """
        if direction == "out":
            return np.zeros(len(q))
        model = self._model
        twist: Array = np.zeros(6)
        twist[:3] = ESCAPE_STEP * self._along(q, direction)
        jacobian = model.jacobian(q)
        square: Array = jacobian @ jacobian.T
        square[np.diag_indices(6)] += ESCAPE_DAMPING
        return jacobian.T @ np.asarray(np.linalg.solve(square, twist), np.float64)

    def _along(self, q: Array, direction: Direction) -> Array:
        """Return the direction as a unit vector (3,) in the world."""
        tcp = self._model.tcp(q)
        base = np.array(self._model.description.base_in_world.position)
        outwards = np.array(tcp.position) - base
        outwards[2] = 0.0
        outwards /= max(float(np.linalg.norm(outwards)), 1e-6)
        match direction:
            case "back":
                return -tcp.rotation()[:, 2]
            case "inwards":
                return -outwards
            case "outwards":
                return outwards
            case "left":
                return np.array([-outwards[1], outwards[0], 0.0])
            case "right":
                return np.array([outwards[1], -outwards[0], 0.0])
            case "down":
                return np.array([0.0, 0.0, -1.0])
            case _:
                return np.array([0.0, 0.0, 1.0])

    def _moves(self, q: Array, step: Array) -> float:
        """Return how far the tool moves by a step, with its turn at a hand's length, m."""
        six = self._model.jacobian(q) @ step
        return max(float(np.linalg.norm(six[:3])) + 0.1 * float(np.linalg.norm(six[3:])), 1e-9)


def least_distance(bounds: StepConstraints, wanted: Array) -> Array | None:
    """Return the x nearest to `wanted` (n,) with G x ≥ h; None without any such x."""
    from scipy.optimize import nnls  # slow to import

    h = bounds.h - bounds.g @ wanted
    if float(h.max(initial=0.0)) <= 1e-12:
        return wanted
    scale = float(np.abs(h).max())
    e = np.vstack([bounds.g.T, (h / scale)[None]])
    f = np.zeros(len(wanted) + 1)
    f[-1] = 1.0
    u, _ = nnls(e, f)
    residual = e @ u - f
    if float(np.linalg.norm(residual)) < 1e-9 or abs(float(residual[-1])) < 1e-9:
        return None
    x = -residual[:-1] / residual[-1] * scale
    return wanted + x


def _separating_step(pairs: Sequence[Separation]) -> Array | None:
    """Return a step along the gradient of the sum of these distances, for pairs that cannot all come apart at
    once."""
    if not pairs:
        return None
    total: Array = np.sum([s.gradient for s in pairs], axis=0)
    size = float(np.linalg.norm(total))
    return total * (MAX_ESCAPE_TURN / size) if size > 1e-6 else None


def _violated(near: tuple[Separation, ...]) -> list[Separation]:
    return [s for s in near if s.distance < s.margin]


def _closest_by_key(near: tuple[Separation, ...]) -> dict[tuple[int, str], float]:
    """Return the least distance of each part of the robot to each body, m; at most the margin."""
    closest: dict[tuple[int, str], float] = {}
    for s in near:
        closest[s.key] = min(closest.get(s.key, s.margin), s.distance)
    return closest


def _pair_too_close(near: tuple[Separation, ...], allowed: dict[tuple[int, str], float]) -> Separation | None:
    """Return a pair that has come closer than it may; None without one."""
    for s in near:
        if s.distance < allowed.get(s.key, s.margin) - APPROACH_SLACK:
            return s
    return None


def _blocking_words(near: tuple[Separation, ...]) -> str:
    """Describe the pairs that leave no room."""
    names = dict.fromkeys(f"{s.a} at {s.b}" for s in sorted(near, key=lambda s: s.distance - s.margin))
    return "no room: " + ", ".join(list(names)[:3]) if names else "a joint is at its limit"
