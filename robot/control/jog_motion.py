"""Jog of the tool: twists in, joint set-points out on the stiff joint servo, from the first command to rest.

The same functions as MoveIt Servo (`moveit_servo` of MoveIt 2). Damped inverse kinematics; slowing down near
singularities, joint limits, the edge of the workspace and obstacles; a stop when commands stay away.

Damping: Nakamura and Hanafusa, "Inverse kinematic solutions with singularity robustness for robot manipulator
control", Journal of Dynamic Systems, Measurement, and Control 108 (1986).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias, cast

import numpy as np
import pinocchio as pin

from picktree.files import PicktreeError
from picktree.world import (
    Array,
    Bounds,
    Cause,
    Failure,
    JointState,
    Pose,
    Vector3,
    control,
    planning,
    safety,
    world,
)
from picktree.world.robot_model import RobotModel

from .commands import MAX_TWIST_ANGULAR_SPEED, MAX_TWIST_SPEED, Controller, Doing, JointCommand, Twist
from .control_loop import ControlLoop
from .motion_lease import ForceGuard, Lease, above_limit
from .soft_limits import SOFT_LIMIT_MARGIN, distance_to_workspace_edge

MAX_TWIST_GROWTH, MAX_TWIST_DECREASE = (1.0, 4.0), (2.0, 8.0)
"""Greatest growth and greatest decrease of a twist, each m/s² and rad/s²."""
JOG_JOINT_SPEED_SHARE = 0.8
"""Greatest joint speeds, as a share of their limits."""
JOG_STOPPING_SHARE = 0.5
"""Share of the joints' acceleration limits that is available to stop before a limit."""
MIN_EDGE_APPROACH_TIME = 0.25
"""Least time in which a joint uses up the distance to its limit, and the tool that to the workspace's edge,
s."""
SLOW_SINGULAR_VALUE, STOP_SINGULAR_VALUE = 0.08, 0.02
"""Smallest singular values of the Jacobian (m and rad mixed) below which a jog slows down, and stops."""
DAMPED_SINGULAR_VALUE, MAX_INVERSE_DAMPING = 0.05, 0.04
"""Smallest singular value below which the inverse is damped, and its greatest damping."""
COMMAND_TIME = 0.15
"""Longest time without a new command before a jog brakes, s."""


@dataclass(slots=True, eq=False)
class JogState:
    """Set-point of a jog: joints (n,) rad and (n,) rad/s, the followed twist (6,) in the world, remaining TCP
    travel, m."""

    q: Array
    v: Array
    twist: Array
    left: float = math.inf

    def copy(self) -> JogState:
        return JogState(self.q.copy(), self.v.copy(), self.twist.copy(), self.left)


class JogSetpointGenerator:
    """Generator of the jog's set-points. Every limit only slows the twist down and keeps its direction."""

    def __init__(self, model: RobotModel, workspace: Bounds) -> None:
        self._model = model
        self._workspace = workspace
        self._data = model.arm.createData()
        self._lower: Array = model.lower + SOFT_LIMIT_MARGIN
        self._upper: Array = model.upper - SOFT_LIMIT_MARGIN
        self.held_by = ""
        """Reason why the last step was slower than commanded: `joint_limit panda_joint1`, `singularity`,
        `workspace`, or empty."""

    def step(self, state: JogState, wanted: Twist, dt: float) -> None:
        """Move `state` on by `dt` s."""
        q = state.q
        # The Jacobian halfway through the step keeps the tool on its line.
        jacobian, rotation, tool = self._kinematics(q + (0.5 * dt) * state.v)
        least = _least(jacobian)
        self.held_by = ""
        target = np.array([*wanted.linear, *wanted.angular])
        if wanted.frame == "tool":
            target = np.concatenate([rotation @ target[:3], rotation @ target[3:]])
        speed = float(np.linalg.norm(target[:3]))
        if speed > 0.0 and state.left < math.inf:
            # The steps brake a little late, so braking before the end counts on less than the remaining
            # travel.
            target = target * min(1.0, math.sqrt(1.6 * MAX_TWIST_DECREASE[0] * max(state.left, 0.0)) / speed)
        target = target * self._singular(q, jacobian, least, target)
        target = target * self._inside(tool, target)
        twist = _ramped(state.twist, target, dt)
        v = _inverse(jacobian, least) @ twist
        share = self._share(q, v)
        twist, v = twist * share, v * share
        change = v - state.v
        most = self._model.acceleration_limit * dt
        v = state.v + change * min(1.0, float((most / np.maximum(np.abs(change), 1e-12)).min()))
        state.left -= float(np.linalg.norm(jacobian[:3] @ v)) * dt
        state.q = np.clip(q + (0.5 * dt) * (state.v + v), *self._span(q))
        state.v, state.twist = v, twist

    def tool_speed(self, state: JogState) -> tuple[float, float]:
        """Return the speed of the set-point's TCP, m/s, and its angular speed, rad/s."""
        twist = self._kinematics(state.q)[0] @ state.v
        return float(np.linalg.norm(twist[:3])), float(np.linalg.norm(twist[3:]))

    def _kinematics(self, q: Array) -> tuple[Array, Array, Vector3]:
        model, data = self._model, self._data
        pin.computeJointJacobians(model.arm, data, q)
        jacobian = pin.getFrameJacobian(model.arm, data, model.tcp_frame, pin.LOCAL_WORLD_ALIGNED)
        placement = pin.updateFramePlacement(model.arm, data, model.tcp_frame)
        x, y, z = placement.translation.tolist()
        return jacobian.copy(), placement.rotation.copy(), (x, y, z)

    def _singular(self, q: Array, jacobian: Array, least: float, target: Array) -> float:
        if least >= SLOW_SINGULAR_VALUE or not target.any():
            return 1.0
        v = _inverse(jacobian, least) @ target
        ahead = q + v * (0.02 / max(float(np.abs(v).max()), 1e-9))  # rad of joint travel
        if _least(self._kinematics(ahead)[0]) >= least:
            return 1.0
        self.held_by = "singularity"
        return max(0.0, (least - STOP_SINGULAR_VALUE) / (SLOW_SINGULAR_VALUE - STOP_SINGULAR_VALUE))

    def _inside(self, tool: Vector3, target: Array) -> float:
        speed = float(np.linalg.norm(target[:3]))
        if speed < 1e-9:
            return 1.0
        room = distance_to_workspace_edge(self._workspace, tool, target[:3] / speed)
        most = min(math.sqrt(1.6 * MAX_TWIST_DECREASE[0] * room), room / MIN_EDGE_APPROACH_TIME)
        if most >= speed:
            return 1.0
        self.held_by = "workspace"
        return most / speed

    def _share(self, q: Array, v: Array) -> float:
        """Return the share of the joints' speeds that their limits allow, 0 … 1."""
        room = np.maximum(np.where(v > 0.0, self._upper - q, q - self._lower), 0.0)
        stopping = np.sqrt(2.0 * JOG_STOPPING_SHARE * self._model.acceleration_limit * room)
        near = np.minimum(stopping, room / MIN_EDGE_APPROACH_TIME)
        fast = JOG_JOINT_SPEED_SHARE * self._model.velocity_limit
        shares = np.minimum(near, fast) / np.maximum(np.abs(v), 1e-9)
        k = int(shares.argmin())
        share = float(shares[k])
        if share < 1.0 and near[k] < fast[k]:
            self.held_by = f"joint_limit {self._model.description.joints[k]}"
        return min(1.0, share)

    def _span(self, q: Array) -> tuple[Array, Array]:
        """Return the joint ranges. A joint that begins beyond its limit may stay there, and not go
        further."""
        return np.minimum(self._model.lower, q), np.maximum(self._model.upper, q)


class JogController:
    """Controller that follows twist commands and brakes when they stay away."""

    name: ClassVar[str] = "Jog"

    def __init__(
        self, model: RobotModel, period: float, workspace: Bounds, distance: float = math.inf
    ) -> None:
        """`distance`: TCP travel after which the jog stops, m."""
        self.law = JogSetpointGenerator(model, workspace)
        self.done = False
        self._period = period
        self._distance = distance
        self._wanted = Twist()
        self._until = -math.inf
        self._braking = False
        self.late = False
        """Whether the jog brakes because no command came in time."""

    def start(self, now: float, state: JointState, setpoint: JointCommand) -> None:
        self._now = now
        self._until = now + COMMAND_TIME
        self.state = JogState(setpoint.position.copy(), setpoint.velocity.copy(), np.zeros(6), self._distance)

    def command(self, wanted: Twist) -> None:
        """Follow the twist `wanted` for `COMMAND_TIME`."""
        self._wanted = wanted
        self._until = self._now + COMMAND_TIME

    def update(self, now: float, state: JointState) -> JointCommand:
        self._now = now
        if now > self._until and not self._braking:
            self._braking = self.late = True
        self.law.step(self.state, Twist() if self._braking else self._wanted, self._period)
        at = self.state
        if self._braking and float(np.abs(at.v).max()) < 1e-4:
            at.v = np.zeros_like(at.v)
            self.done = True
        return JointCommand(at.q.copy(), at.v.copy())

    def brake(self) -> Controller:
        self._braking = True
        return self

    def ahead(self, wanted: Twist, time: float, step: float) -> Array:
        """Return configurations (k, n), one each `step` s, for `time` s of a twist and braking after it."""
        state = self.state.copy()
        held_by = self.law.held_by
        path = [state.q]
        for k in range(120):
            self.law.step(state, wanted if k * step < time else Twist(), step)
            path.append(state.q)
            if k * step >= time and float(np.abs(state.v).max()) < 1e-3:
                break
        self.law.held_by = held_by
        return np.array(path)


def _ramped(now: Array, target: Array, dt: float) -> Array:
    """Return the twist (6,) after `dt` s on its way to another."""
    change = target - now
    share = 1.0
    for part, k in ((slice(0, 3), 0), (slice(3, 6), 1)):
        slower = float(np.linalg.norm(target[part])) < float(np.linalg.norm(now[part]))
        most = (MAX_TWIST_DECREASE if slower else MAX_TWIST_GROWTH)[k] * dt
        size = float(np.linalg.norm(change[part]))
        share = min(share, most / size) if size > most else share
    return now + change * share


def _least(jacobian: Array) -> float:
    return float(np.linalg.svd(jacobian, compute_uv=False)[-1])


def _inverse(jacobian: Array, least: float) -> Array:
    """Return the inverse (n, 6) of the Jacobian, damped near singularities."""
    damping = (
        0.0
        if least >= DAMPED_SINGULAR_VALUE
        else (1.0 - (least / DAMPED_SINGULAR_VALUE) ** 2) * MAX_INVERSE_DAMPING**2
    )
    square: Array = jacobian @ jacobian.T
    square[np.diag_indices(6)] += damping + 1e-12
    return jacobian.T @ np.asarray(np.linalg.inv(square), np.float64)


StoppedBy: TypeAlias = Literal["done", "contact", "collision", "joint_limit", "singularity", "workspace"]
Lookout: TypeAlias = Callable[[Array], tuple[str, ...]]
"""Collision query of the look-ahead: pairs that touch on configurations (k, n), rad, as `panda_hand at
table`. Empty: free."""
TWIST_SHARES = (1.0, 0.7, 0.5, 0.35, 0.2, 0.1, 0.05)
"""Shares of the commanded twist, tried in this order until the path to a stop is free."""
LOOKAHEAD_STEP = 1 / 60
"""Time between two configurations of the look-ahead, s."""
STANDING_SPEED_SHARE = 0.02
"""Share of the commanded speed below which a jog stands."""
STANDING_TICKS = 4
"""Ticks at a standstill before a jog counts as stopped: it needs time to get going."""


@dataclass(frozen=True, slots=True)
class JogFeedback:
    """Feedback to the source of the twists, given before each twist."""

    elapsed: float
    """Time since the start of the jog, s."""
    tcp: Pose
    travelled: float
    """Path length of the TCP so far, m."""
    force: float
    """External force on the hand beyond the reading at the start, N."""
    share: float
    """Share of the last twist that the arm follows, 0 … 1."""
    held_by: str
    """Reason for a slower motion: `collision PART at BODY`, `joint_limit NAME`, `singularity`, `workspace`,
    or empty."""


Twists: TypeAlias = "Twist | Callable[[JogFeedback], Twist | None]"
"""One constant twist, or a callable that returns the twist of each tick. None ends the jog."""


@dataclass(frozen=True, slots=True)
class JogResult:
    """Result of a jog, at rest."""

    stopped_by: StoppedBy
    detail: str
    """Pairs that would touch, or the joint, that stopped the jog."""
    travelled: float
    """Path length of the TCP, m."""
    elapsed: float
    """Duration of the jog, s."""
    force: float
    """Contact force that ended the jog, N; 0 without a contact."""
    pose: Pose
    """TCP pose in the world."""
    limit: float
    """Force limit of the scene, N."""

    def failure(self) -> Failure | None:
        """Return the failure that describes why the jog stopped. None: it ended by itself."""
        if self.stopped_by == "done":
            return None
        cause, what = _STOP_SENTENCES[self.stopped_by]
        after = f"after {self.travelled * 1000:.0f} mm"
        text = what.format(detail=self.detail, force=self.force, above=above_limit(self.force, self.limit))
        evidence: dict[str, str | float] = {"stopped_by": self.stopped_by, "travelled": self.travelled}
        return Failure(cause, f"{text} {after} of a jog", detail=self.detail, **evidence)


_STOP_SENTENCES: dict[str, tuple[Cause, str]] = {
    "contact": (world.DISTURBED, "touched something at {force:.0f} N{above}"),
    "collision": (planning.BLOCKED, "stopped before a collision ({detail})"),
    "joint_limit": (safety.JOINT_LIMIT, "{detail} came to its limit"),
    "singularity": (safety.SINGULARITY, "the arm came to a singular configuration"),
    "workspace": (safety.WORKSPACE, "the tool came to the edge of the workspace"),
}


class JogMotion:
    """Jogging of a loop's arm. `lookout` checks the path to a stop in each tick."""

    def __init__(self, loop: ControlLoop, model: RobotModel, lookout: Lookout | None, tick: float) -> None:
        self._loop = loop
        self._model = model
        self._lookout = lookout
        self._tick = tick

    def run(
        self,
        lease: Lease,
        twists: Twists,
        guard: ForceGuard,
        duration: float,
        distance: float,
        check: Callable[[Lease], None],
        until_rest: Callable[[Lease], Doing[None]],
    ) -> Doing[JogResult]:
        """Jog the arm from rest to rest.

        A constant twist ends where something stops it. A callable receives the reason as feedback and decides
        itself.
        """
        loop = self._loop
        jog = JogController(self._model, loop.period, loop.monitor.limits.workspace, distance)
        lease.run(jog, guard)
        stays = isinstance(twists, Twist)
        begun, at, travelled = loop.now, loop.tcp, 0.0
        share, standing, blocked = 1.0, 0, tuple[str, ...]()
        stopped_by: StoppedBy = "done"
        while True:
            held_by = f"collision {', '.join(blocked)}" if blocked else jog.law.held_by
            elapsed = loop.now - begun
            if stays:
                wanted: Twist | None = twists if elapsed < duration - 1e-9 else None
            else:
                status = JogFeedback(
                    elapsed, loop.tcp, travelled, guard.size(loop.wrist.force), share, held_by
                )
                wanted = twists(status) if elapsed < duration - 1e-9 else None
            if wanted is None or jog.state.left < 1e-4:  # m: the travel is done
                break
            wanted = _checked_twist(wanted)
            share, blocked = self._share(jog, wanted, share)
            jog.command(wanted.scaled(share))
            yield
            check(lease)
            travelled += loop.tcp.distance(at)
            at = loop.tcp
            if guard.contact is not None:
                stopped_by = "contact"
                break
            if jog.late:
                yield from until_rest(lease)
                raise Failure(control.TIMEOUT, "a jog has had no command in time, and has stopped")
            standing = standing + 1 if _stands(jog, wanted) else 0
            if stays and standing >= STANDING_TICKS and (blocked or jog.law.held_by):
                held_by = f"collision {', '.join(blocked)}" if blocked else jog.law.held_by
                stopped_by = cast(StoppedBy, held_by.partition(" ")[0])
                break
        detail = held_by.partition(" ")[2] if stopped_by not in ("done", "contact") else ""
        jog.brake()
        yield from until_rest(lease)
        check(lease)
        travelled += loop.tcp.distance(at)
        if guard.contact is not None:
            stopped_by = "contact"
        force = 0.0 if guard.contact is None else math.hypot(*guard.contact)
        limit = loop.monitor.limits.force
        return JogResult(stopped_by, detail, travelled, loop.now - begun, force, loop.tcp, limit)

    def _share(self, jog: JogController, wanted: Twist, before: float) -> tuple[float, tuple[str, ...]]:
        """Return the largest share of a twist from which the arm stops before a collision, and the bodies it
        would touch.

        The look-ahead covers the tick until the next call, and one more for the reaction.
        """
        if self._lookout is None:
            return 1.0, ()
        blocked: tuple[str, ...] = ()
        nearest = max(k for k, share in enumerate((*TWIST_SHARES, 0.0)) if share >= before)
        for share in TWIST_SHARES[max(0, nearest - 1) :]:
            hit = self._lookout(jog.ahead(wanted.scaled(share), 2 * self._tick, LOOKAHEAD_STEP))
            if not hit:
                return share, blocked
            blocked = hit
        return 0.0, blocked


def _stands(jog: JogController, wanted: Twist) -> bool:
    linear, angular = jog.law.tool_speed(jog.state)
    return (
        linear <= STANDING_SPEED_SHARE * wanted.speed + 1e-6
        and angular <= STANDING_SPEED_SHARE * math.hypot(*wanted.angular) + 1e-4
    )


def _checked_twist(wanted: Twist) -> Twist:
    numbers = (*wanted.linear, *wanted.angular)
    if len(numbers) != 6 or not all(math.isfinite(number) for number in numbers):
        raise PicktreeError(f"a twist needs three m/s and three rad/s, not {numbers}")
    speed, turn = wanted.speed, math.hypot(*wanted.angular)
    if speed > MAX_TWIST_SPEED * (1.0 + 1e-9) or turn > MAX_TWIST_ANGULAR_SPEED * (1.0 + 1e-9):
        raise PicktreeError(
            f"a jog goes at most {MAX_TWIST_SPEED:g} m/s and turns at most {MAX_TWIST_ANGULAR_SPEED:g} "
            "rad/s, "
            f"not {speed:.3g} m/s and {turn:.3g} rad/s"
        )
    return wanted
