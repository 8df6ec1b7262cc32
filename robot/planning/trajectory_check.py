"""Collision checks of motions: edges in joint space, the start of a plan, and timed trajectories.

A trajectory is checked again before it counts as a plan, and when the belief has changed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from functools import lru_cache
from typing import Protocol

import numpy as np

from picktree.world import Array, Trajectory
from picktree.world.robot_model import RobotModel

from .collision_checker import CollisionChecker
from .collision_model import MarginChecker
from .limits import StartExcess, start_excess
from .motion_plans import ContactPair

EDGE_RESOLUTION = 0.03
"""Greatest step along an edge, rad (Euclidean over the joints)."""
MAX_EDGE_SWEEP = 0.1
"""Greatest travel of any point of the arm in a step of `EdgeSteps`, m, by an upper bound. The hand really
travels about half of that.

A path is checked far more finely after timing. One in thirty then grazes and is searched again in smaller
steps, which costs less than smaller steps for all.
"""
MAX_EDGE_TURN = 0.2
"""Greatest step of `EdgeSteps` in joint space, rad (Euclidean)."""
REACH_BEYOND_TCP = 0.1
"""Reach of hand and held object beyond the tool centre point, m."""

Free = Callable[[Array], bool]
CountFree = Callable[[Array], int]
"""Number of configurations (m, n) before the first that is not free."""


class EdgeSteps:
    """Edges in steps that are equally fine for every point of the arm: the wrist may turn further than the
    shoulder."""

    def __init__(self, model: RobotModel) -> None:
        self._levers: Array = joint_levers(model) / MAX_EDGE_SWEEP
        self._turns = 1.0 / MAX_EDGE_TURN

    def scaled(self, share: float) -> EdgeSteps:
        """Return edges in steps of that share of the length."""
        if share == 1.0:
            return self
        finer = copy(self)
        finer._levers, finer._turns = self._levers / share, self._turns / share
        return finer

    def count(self, along: Array) -> int:
        """Return the number of steps into which an edge along (n,) is cut."""
        turned = math.sqrt(float(along @ along)) * self._turns
        return max(1, math.ceil(max(turned, float(np.abs(along) @ self._levers))))

    def free(self, count_free: CountFree, a: Array, b: Array, *, ends_free: bool = False) -> bool:
        """Whether all steps from a (exclusive) to b (n,) are free. With `ends_free` b is known to be free."""
        # Most edges of a search fail at their end, so that comes before their steps are made.
        if not ends_free and not count_free(b[None]):
            return False
        along = b - a
        count = self.count(along)
        return count == 1 or count_free(a + along * _inner_shares(count)) == count - 1


def joint_levers(model: RobotModel) -> Array:
    """Return upper bounds (n,) of the travel of any point of the arm by each joint, m/rad; m/m for a
    slider."""
    arm = model.arm
    tool = float(np.linalg.norm(arm.frames[model.tcp_frame].placement.translation)) + REACH_BEYOND_TCP
    lengths = [float(np.linalg.norm(arm.jointPlacements[k].translation)) for k in range(2, model.n + 1)]
    reach: Array = np.cumsum([tool, *reversed(lengths)])[::-1].copy()
    slides = [arm.joints[k].shortname().startswith("JointModelP") for k in range(1, model.n + 1)]
    return np.where(slides, 1.0, reach)


def edge_free(free: Free, a: Array, b: Array, resolution: float = EDGE_RESOLUTION) -> bool:
    """Whether all steps from a (exclusive) to b (inclusive), both (n,), are free."""
    along = b - a
    count = max(1, int(np.ceil(float(np.linalg.norm(along)) / resolution)))
    return all(free(a + along * share) for share in _shares(count))


@lru_cache(maxsize=512)
def bisection_order(count: int) -> tuple[int, ...]:
    """Return `count`, then the numbers below as halves, quarters, …: collisions come in stretches."""
    order, spans = [count], [(0, count)]
    for low, high in spans:
        if high - low > 1:
            middle = (low + high) // 2
            order.append(middle)
            spans += [(low, middle), (middle, high)]
    return tuple(order)


@lru_cache(maxsize=512)
def _shares(count: int) -> tuple[float, ...]:
    """Return 1/count … 1 in the order of `bisection_order`."""
    return tuple(k / count for k in bisection_order(count))


@lru_cache(maxsize=512)
def _inner_shares(count: int) -> Array:
    """Return the shares of `_shares` but for the end's as a column (count - 1, 1)."""
    column: Array = np.array(bisection_order(count)[1:])[:, None] / count
    return column


MAX_TCP_STEP = 0.005
"""Greatest travel of the TCP between two checked configurations, m."""
MAX_JOINT_STEP = 0.03
"""Greatest distance in joint space between them, rad (Euclidean): the elbow may move while the TCP does
not."""
LIMIT_ROUNDING = 1e-6
"""Greatest excess over the joints' limits on a trajectory, rad."""


class ConfigurationCheck(Protocol):
    """Collision check of configurations: a `StartTolerance`, or a `CollisionChecker`, which excuses nothing
    at the start."""

    @property
    def model(self) -> RobotModel: ...

    def count_free(self, configurations: Array) -> int: ...

    def nearly_free(self, q: Array) -> bool: ...


def is_trajectory_free(kept: ConfigurationCheck, trajectory: Trajectory) -> bool:
    """Whether a timed trajectory keeps the joints' limits and, at every step, at least half of the margins.

    Corners were cut, and its steps are elsewhere than those of the path that it was made from.
    """
    return first_collision(kept, trajectory) is None


def first_collision(kept: ConfigurationCheck, trajectory: Trajectory) -> Array | None:
    """Return a configuration (n,) of the trajectory that is not free or beyond a limit; None: there is
    none."""
    model, q = kept.model, trajectory.position
    # The start or end may be given beyond a limit. It may be left or reached, but not exceeded.
    lower = np.minimum(model.lower, np.minimum(q[0], q[-1])) - LIMIT_ROUNDING
    upper = np.maximum(model.upper, np.maximum(q[0], q[-1])) + LIMIT_ROUNDING
    outside = np.flatnonzero(((q < lower) | (q > upper)).any(axis=1))
    if outside.size:
        return q[int(outside[0])].copy()
    samples = sampled_configurations(model, trajectory)
    # The start, the end, then halves, quarters, …: collisions come in stretches.
    samples = samples[[0, *bisection_order(len(samples) - 1)]]
    done = kept.count_free(samples)
    while done < len(samples):
        # The half-margin check runs only for the few configurations that fail the full margins.
        if not kept.nearly_free(samples[done]):
            return samples[done]
        done += 1 + kept.count_free(samples[done + 1 :])
    return None


def sampled_configurations(model: RobotModel, trajectory: Trajectory) -> Array:
    """Sample configurations (m, n) along a trajectory, start and end included.

    They are at most MAX_TCP_STEP and MAX_JOINT_STEP apart.
    """
    q = trajectory.position
    tool = model.tcp_positions(q)
    moved: Array = np.linalg.norm(np.diff(tool, axis=0), axis=1) / MAX_TCP_STEP
    turned: Array = np.linalg.norm(np.diff(q, axis=0), axis=1) / MAX_JOINT_STEP
    along: Array = np.concatenate([[0.0], np.cumsum(np.maximum(moved, turned))])
    count = max(1, int(np.ceil(along[-1])))
    marks: Array = np.linspace(0.0, float(along[-1]), count + 1)
    joints: list[Array] = [np.interp(marks, along, joint) for joint in q.T]
    return np.stack(joints, axis=1)


BELIEF_PENETRATION = 0.001
"""Penetration at the start that is put down to errors of the belief, for all bodies, m."""
POSITION_SIGMAS = 3.0
"""Standard deviations of an object's believed place that are put down to errors of the belief, too.

The object cannot be where the arm is.
"""
MAX_BELIEF_PENETRATION = 0.006
"""Greatest penetration that is put down to errors of the belief, m."""
START_ZONE = 0.1
"""Size of the zone around the start in which excused pairs may come no closer, rad in each joint."""
START_ZONE_OF_OBJECTS = 0.3
"""Size of that zone for objects that are not held, rad: the hand rises next to them before it comes clear."""
APPROACH_SLACK = 0.0005
"""Greatest further approach of an excused pair in the zone, m."""


class StartTolerance:
    """Collision check of one plan's configurations (n,), rad. Contacts that exist at its `start` are excused
    near it.

    Excused pairs may not come closer near the start, and must have come apart further away. `stuck` has the
    pairs that penetrate by more than the belief may be wrong: from there no plan may start. A tool that
    starts outside of the workspace may stay as far outside as at the start.
    """

    def __init__(self, collision: CollisionChecker, start: Array) -> None:
        self.model = collision.model
        self._collision = collision
        self._start = start
        self.excused: tuple[ContactPair, ...] = ()
        self.excess: StartExcess | None = start_excess(self.model, collision.workspace, start)
        """Excess of the start over soft limits and workspace; None: it is within both."""
        self._zones: list[tuple[float, MarginChecker]] = []
        model = self.model
        beyond = (start < model.lower) | (start > model.upper)
        self.lower: Array = np.where(beyond, model.planned_lower, np.minimum(model.planned_lower, start))
        """Lower limits (n,) within which a return path ends, rad."""
        self.upper: Array = np.where(beyond, model.planned_upper, np.maximum(model.planned_upper, start))
        outside = self.excess is not None and self.excess.tool is not None
        self._widened = collision.room_at(start) if outside else None
        if not collision.free(start):
            self.excused = collision.contacts(start)
            self._zones.append((START_ZONE, collision.excusing(self.excused, APPROACH_SLACK)))
            loose = tuple(c for c in self.excused if self._loose(c))
            if loose:
                self._zones.append((START_ZONE_OF_OBJECTS, collision.excusing(loose, APPROACH_SLACK)))
        self.stuck = tuple(c for c in self.excused if collision.penetrates(c, self._tolerated(c)))

    def free(self, q: Array) -> bool:
        """Whether q keeps the full margins."""
        checker = self._near_start(q) if self._zones else None
        if checker is not None:
            return self._collision.check_with(checker, q, self._widened or self._collision.room)
        return self._collision.free(q, self._widened)

    def count_free(self, configurations: Array) -> int:
        """Return the number of configurations (m, n) before the first that is not free."""
        if not self._zones:
            return self._collision.count_free(configurations)
        return next((k for k, q in enumerate(configurations) if not self.free(q)), len(configurations))

    def count_blocked(self, configurations: Array) -> int:
        """Return the number of configurations (m, n) before the first that is free."""
        if not self._zones:
            return self._collision.count_blocked(configurations)
        return next((k for k, q in enumerate(configurations) if self.free(q)), len(configurations))

    def nearly_free(self, q: Array) -> bool:
        """Whether q keeps halved margins: for samples between configurations that were found free."""
        checker = self._near_start(q) if self._zones else None
        if checker is not None:
            return self._collision.check_with(checker, q, self._widened or self._collision.room)
        return self._collision.nearly_free(q, self._widened)

    def excess_at(self, q: Array) -> Array:
        """Return the excess of each joint over `lower` and `upper`, rad, and of the tool over its room, m:
        (n + 1,)."""
        joints = np.maximum(np.maximum(self.lower - q, q - self.upper), 0.0)
        room = self._collision.room
        return np.append(joints, 0.0 if room is None else room.excess(np.array(self.model.tcp(q).position)))

    def _near_start(self, q: Array) -> MarginChecker | None:
        away = float(np.abs(q - self._start).max())
        return next((checker for zone, checker in self._zones if away <= zone), None)

    def _loose(self, contact: ContactPair) -> bool:
        """Whether one of the two is an object that is not held."""
        objects = (self._collision.believed(contact.a), self._collision.believed(contact.b))
        return any(o is not None and not o.attached for o in objects)

    def _tolerated(self, contact: ContactPair) -> float:
        """Return the depth at the start that may be an error of the belief, m."""
        objects = (self._collision.believed(contact.a), self._collision.believed(contact.b))
        sigma = sum(o.sigma_position for o in objects if o is not None)
        return min(BELIEF_PENETRATION + POSITION_SIGMAS * sigma, MAX_BELIEF_PENETRATION)
