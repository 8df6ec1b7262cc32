"""Arm, wrist sensor and clock of the kinematic backend."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from picktree.simulation import DeviceFaults
from picktree.world import (
    GRAVITY,
    Array,
    CompoundMesh,
    GripperCommand,
    GripperState,
    JointState,
    ObjectId,
    Pose,
    Quaternion,
    Wrench,
    extents,
    pad_contacts,
)
from picktree.world.robot_model import GripperDescription, RobotModel

from .bodies import KinematicBodies, KinematicBody

MIN_FINGER_STEP = 1e-9
"""Change of the opening in a control period below which the fingers are at rest, m."""
MIN_GRASP_OVERLAP = 0.001
"""Least overlap of an item with the pads for a grasp, m."""


class KinematicGripper:
    """`protocols.Gripper` of the kinematic backend. Holding needs friction: 2μF must carry the weight."""

    def __init__(
        self, description: GripperDescription, bodies: KinematicBodies, faults: DeviceFaults | None = None
    ) -> None:
        self._description = description
        self._faults = faults or DeviceFaults(())
        self._bodies = bodies
        pad = description.pads[0][0].size
        self._reach_x = pad[0] / 2
        self._lowest, self._highest = description.tip - pad[2], description.tip
        self.width = description.max_width
        self.target = description.max_width
        self.force = 0.0
        self.speed = 0.0
        self.most_speed = description.speed
        """Greatest speed of each finger, m/s."""
        self.item_in_tcp: Pose | None = None
        self.gripped = 0.0
        """Width of the held item, m."""

    def read(self) -> GripperState:
        force = self._drive.force if self._faults.any else self.force
        return GripperState(self.width, self.speed, force if self.speed == 0.0 else 0.0)

    @property
    def moves(self) -> bool:
        """Whether the fingers have not reached their target."""
        if not self._faults.any:
            return self.width != self.target
        return self.width != self._drive.width

    @property
    def _drive(self) -> GripperCommand:
        """Command that the drives carry out: the received one, unless a fault changes it."""
        faults = self._faults
        if faults.jam is not None:
            return GripperCommand(self.width, faults.jam.force)
        return GripperCommand(self.target, self.force * faults.grip_share)

    def command(self, command: GripperCommand) -> None:
        self.target, self.force = command.width, command.force
        self.most_speed = command.speed or self._description.speed

    def step(self, tcp: Pose, period: float) -> None:
        """Advance by one control period with the TCP at `tcp` in the world."""
        bodies = self._bodies
        held, drive = bodies.held, self._drive
        # An item as wide as the full opening is released by fingers that open fully.
        wide = min(self.gripped + 5e-4, self._description.max_width - 1e-9)
        opens = self._faults.jam is None and self.target > wide
        if held is not None:
            assert self.item_in_tcp is not None
            if opens or not self._carries(bodies[held], drive.force):
                bodies.carry(tcp @ self.item_in_tcp)
                bodies.let_go()
            else:
                bodies.carry(tcp @ self.item_in_tcp)
                self.speed = 0.0
                return
        most = 2.0 * self.most_speed * period
        before = self.width
        width = before + min(max(drive.width - before, -most), most)
        if width < before and (caught := self._caught(tcp, before, width)) is not None:
            item, pose, self.gripped = caught
            width = self.gripped
            bodies.take(item, tcp @ pose)
            self.item_in_tcp = pose
        self.width = width
        # An item that is too heavy for the force is caught again in each period, at the same width but for
        # rounding: the fingers are at rest.
        self.speed = 0.0 if abs(width - before) < MIN_FINGER_STEP else (width - before) / period

    def _carries(self, body: KinematicBody, force: float) -> bool:
        friction = body.friction * self._description.pad_contact.friction
        return 2.0 * friction * force >= body.entry.mass * GRAVITY

    def _caught(self, tcp: Pose, before: float, width: float) -> tuple[ObjectId, Pose, float] | None:
        """Return the item that stops the fingers between two openings, its centred pose in the TCP frame, and
        its width, m; None: no item."""
        world_in_tcp: Pose | None = None
        reach = self._description.max_width
        for body in self._bodies.present:
            if body.pose.distance(tcp) > reach + max(self._reach_x, 0.1):
                continue
            world_in_tcp = world_in_tcp or tcp.inverse()
            pose = world_in_tcp @ body.pose
            low, high = extents(body.entry.shape, pose.rotation())
            if isinstance(shape := body.entry.shape, CompoundMesh):
                pads = pad_contacts(shape, pose, before, self._reach_x, (self._lowest, self._highest))
                if pads is None or width > pads.width:
                    continue
                return body.id, pose.shifted((0.0, -(pads.left + pads.right) / 2, 0.0)), pads.width
            x, y, z = pose.position
            inside_x = min(x + float(high[0]), self._reach_x) - max(x + float(low[0]), -self._reach_x)
            inside_z = min(z + float(high[2]), self._highest) - max(z + float(low[2]), self._lowest)
            if min(inside_x, inside_z) < MIN_GRASP_OVERLAP:
                continue
            left, right = y + float(low[1]), y + float(high[1])
            size = right - left
            # The finger that touches first pushes the item along until the other one is there, too.
            if abs(left + right) > before or width > size:
                continue
            return body.id, pose.shifted((0.0, -(left + right) / 2, 0.0)), size
        return None


WEAK_JOINT_FREQUENCY = 60.0
"""Natural frequency of the critically damped servo of a joint that cannot follow exactly, rad/s."""


class WeakJoints:
    """Arm with weak joints: weak joints move as torque, gravity and coupling let them, all others follow
    exactly."""

    def __init__(self, model: RobotModel, period: float) -> None:
        self._model = model
        self._period = period

    def limited(self, torque: Array, shares: Mapping[str, float]) -> Array:
        """Return the torque (n,), Nm, limited to the joints' remaining shares."""
        most = self._model.torque_limit * self._shares(shares)
        return torque.clip(-most, most)

    def follow(
        self, q: Array, v: Array, aim: Array, rate: Array, shares: Mapping[str, float]
    ) -> tuple[Array, Array, Array]:
        """Return position and velocity (n,), rad and rad/s, one period later, and the efforts, Nm.

        The arm is at (q, v), and the command for that time is `aim` with `rate`.
        """
        model, dt = self._model, self._period
        share = self._shares(shares)
        weak, strong = share < 1.0, share >= 1.0
        inertia, bias = model.mass_matrix(q), model.bias(q, v)
        others = (rate - v)[strong] / dt
        load = inertia[np.ix_(weak, strong)] @ others + bias[weak]
        own, most = inertia[np.ix_(weak, weak)], (model.torque_limit * share)[weak]
        error, behind = (aim - q)[weak], (rate - v)[weak]
        at_once = own @ ((error / dt - v[weak]) / dt) + load
        effort = model.gravity(q)
        if np.all(np.abs(at_once) <= most):
            effort[weak] = at_once
            return aim, rate, effort
        wanted = own @ (WEAK_JOINT_FREQUENCY**2 * error + 2.0 * WEAK_JOINT_FREQUENCY * behind) + load
        effort[weak] = wanted.clip(-most, most)
        gained = np.linalg.solve(own, effort[weak] - load)
        velocity, position = rate.copy(), aim.copy()
        velocity[weak] = v[weak] + gained * dt
        position[weak] = q[weak] + velocity[weak] * dt
        inside = np.minimum(np.maximum(position, model.lower), model.upper)
        velocity[inside != position] = 0.0
        return inside, velocity, effort

    def _shares(self, shares: Mapping[str, float]) -> Array:
        return np.array([shares.get(name, 1.0) for name in self._model.description.joints])


class KinematicArm:
    """`protocols.Arm`: follows commands exactly, or integrates the rigid-body dynamics under torques."""

    def __init__(self, model: RobotModel, period: float, faults: DeviceFaults | None = None) -> None:
        self._model = model
        self._period = period
        self._faults = faults or DeviceFaults(())
        self._weak = WeakJoints(model, period)
        self._torque: Array | None = None
        self.set(model.named("home"), np.zeros(model.n))

    def set(self, position: Array, velocity: Array) -> None:
        self.position, self.velocity = position, velocity
        self._aim = (position, np.zeros_like(velocity))
        self._torque = None
        self._state = JointState(position, velocity, self._model.gravity(position))

    def read(self) -> JointState:
        return self._state

    @property
    def free(self) -> bool:
        """Whether torques move the arm, instead of a servo."""
        return self._torque is not None

    def follow(self, position: Array, velocity: Array, ahead: tuple[Array, ...] = ()) -> None:
        if self._faults.stalled:
            return
        self._aim = (position.copy(), velocity.copy())
        self._torque = None

    def apply_torque(self, torque: Array) -> None:
        if self._faults.stalled:
            return
        self._torque = torque.copy()

    def hold(self) -> None:
        """Hold the present configuration until the next command."""
        self._aim = (self.position.copy(), np.zeros_like(self.velocity))
        self._torque = None

    def step(self, wrench_at_tcp: Array) -> None:
        """Advance by one control period under a wrench (6,) on the TCP, N and Nm, in the world's axes."""
        shares = self._faults.torque_shares
        if self._torque is None and shares:
            self.position, self.velocity, effort = self._weak.follow(
                self.position, self.velocity, *self._aim, shares
            )
            self._state = JointState(self.position, self.velocity, effort)
            return
        if self._torque is None:
            self.position, self.velocity = self._aim
            self._state = JointState(self.position, self.velocity, self._model.gravity(self.position))
            return
        torque = self._weak.limited(self._torque, shares) if shares else self._torque
        acceleration = self._model.forward_dynamics(self.position, self.velocity, torque, wrench_at_tcp)
        velocity = self.velocity + acceleration * self._period
        position = self.position + velocity * self._period
        inside = np.minimum(np.maximum(position, self._model.lower), self._model.upper)
        self.velocity = np.where(inside == position, velocity, 0.0)
        self.position = inside
        self._state = JointState(self.position, self.velocity, torque)


class KinematicWrench:
    """`protocols.WrenchSensor` without noise."""

    def __init__(self, faults: DeviceFaults, turn: Callable[[], Quaternion]) -> None:
        """`turn` returns the sensor's orientation in the world."""
        self.reading = Wrench()
        self._faults = faults
        self._turn = turn

    def read(self) -> Wrench:
        faults, reading = self._faults, self.reading
        if faults.silence is not None:
            return faults.silence.wrench
        if not faults.biased:
            return reading
        x, y, z, a, b, c = faults.wrench_bias(self._turn())
        (fx, fy, fz), (tx, ty, tz) = reading.force, reading.torque
        return Wrench((fx + x, fy + y, fz + z), (tx + a, ty + b, tz + c))


class KinematicClock:
    """`protocols.Clock` that counts control periods."""

    def __init__(self, period: float) -> None:
        self._period = period
        self.periods = 0

    @property
    def now(self) -> float:
        return self.periods * self._period
