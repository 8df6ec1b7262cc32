"""Values of rigid-body mechanics that cross borders: poses, wrenches, joint states, timed trajectories.
SI units, xyzw.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NewType, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Array of float64; each use states its shape and unit."""
Vector3: TypeAlias = tuple[float, float, float]
"""Three numbers along x, y, z; each use states the unit."""
Quaternion: TypeAlias = tuple[float, float, float, float]
"""Unit quaternion x, y, z, w."""
ObjectId = NewType("ObjectId", str)
"""Name of an object in the belief, as `block_3`."""
GRAVITY = 9.81
"""Acceleration of free fall in simulation and models, m/s²."""


def vector3(numbers: Iterable[float]) -> Vector3:
    """Return three numbers as a tuple of Python's floats."""
    x, y, z = numbers.tolist() if isinstance(numbers, np.ndarray) else map(float, numbers)
    return x, y, z


@dataclass(frozen=True, slots=True)
class Pose:
    """A rigid transform, or a frame given in another: `a_in_b`. Position in m, unit quaternion xyzw."""

    position: Vector3 = (0.0, 0.0, 0.0)
    orientation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    @classmethod
    def from_rotation(cls, position: Array | Vector3, rotation: Array) -> Pose:
        """Return the pose of a position (3,) and a rotation matrix (3, 3)."""
        return cls(vector3(position), quaternion_from_rotation(rotation))

    @classmethod
    def from_rpy(cls, position: Vector3, rpy: Vector3) -> Pose:
        """Return the pose of a position and roll, pitch, yaw about the fixed x, y, z axes (URDF's
        convention), rad."""
        (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in rpy)
        return cls(
            position,
            (
                sr * cp * cy - cr * sp * sy,
                cr * sp * cy + sr * cp * sy,
                cr * cp * sy - sr * sp * cy,
                cr * cp * cy + sr * sp * sy,
            ),
        )

    def rotation(self) -> Array:
        """Rotation matrix (3, 3)."""
        x, y, z, w = self.orientation
        row_1 = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
        row_2 = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
        row_3 = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
        # numpy takes four times as long for a list of lists.
        return np.array((*row_1, *row_2, *row_3)).reshape(3, 3)

    def rpy(self) -> Vector3:
        """Roll, pitch and yaw about the fixed x, y, z axes, rad: the inverse of `from_rpy`."""
        r = self.rotation()
        pitch = math.atan2(-float(r[2, 0]), math.hypot(float(r[0, 0]), float(r[1, 0])))
        if math.cos(pitch) < 1e-9:
            return math.atan2(-float(r[1, 2]), float(r[1, 1])), pitch, 0.0
        roll, yaw = math.atan2(float(r[2, 1]), float(r[2, 2])), math.atan2(float(r[1, 0]), float(r[0, 0]))
        return roll, pitch, yaw

    def matrix(self) -> Array:
        """Homogeneous matrix (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation()
        matrix[:3, 3] = self.position
        return matrix

    def __matmul__(self, other: Pose) -> Pose:
        """Composition: `a_in_c = b_in_c @ a_in_b`."""
        position = vector3(self.apply(np.array(other.position)))
        return Pose(position, quaternion_product(self.orientation, other.orientation))

    def inverse(self) -> Pose:
        x, y, z, w = self.orientation
        return Pose(vector3(-(self.rotation().T @ np.array(self.position))), (-x, -y, -z, w))

    def apply(self, points: Array) -> Array:
        """Points of this frame, (3,) or (n, 3), given in the parent frame."""
        return points @ self.rotation().T + np.array(self.position)

    def shifted(self, offset: Vector3 | Array) -> Pose:
        """Moved by `offset` (3,), which is given in the parent frame."""
        moved = (p + o for p, o in zip(self.position, offset, strict=True))
        return Pose(vector3(moved), self.orientation)

    def distance(self, other: Pose) -> float:
        """Distance of the two origins, m."""
        return math.dist(self.position, other.position)

    def angle(self, other: Pose) -> float:
        """Smallest rotation between the two, rad in [0, π]."""
        dot = abs(sum(a * b for a, b in zip(self.orientation, other.orientation, strict=True)))
        return 2.0 * math.acos(min(1.0, dot))


def rotated(turn: Quaternion, vector: Vector3) -> Vector3:
    """Return a vector rotated by a unit quaternion, in plain numbers, for code that runs in every step."""
    (qx, qy, qz, qw), (x, y, z) = turn, vector
    tx, ty, tz = 2.0 * (qy * z - qz * y), 2.0 * (qz * x - qx * z), 2.0 * (qx * y - qy * x)
    return (
        x + qw * tx + qy * tz - qz * ty,
        y + qw * ty + qz * tx - qx * tz,
        z + qw * tz + qx * ty - qy * tx,
    )


def cross(a: Array, b: Array) -> Array:
    """Return the cross product of two vectors (3,). numpy's takes ten times as long for two."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))


def quaternion_product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product of two xyzw quaternions, renormalised."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    w = aw * bw - ax * bx - ay * by - az * bz
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    return (x / norm, y / norm, z / norm, w / norm)


def quaternion_from_rotation(rotation: Array) -> Quaternion:
    """Unit quaternion xyzw with w ≥ 0 of a rotation matrix (3, 3). Shepperd's method (1978)."""
    m = rotation
    trace = float(m[0, 0] + m[1, 1] + m[2, 2])
    squares = (1 + 2 * float(m[0, 0]) - trace, 1 + 2 * float(m[1, 1]) - trace, 1 + 2 * float(m[2, 2]) - trace)
    if trace >= max(float(m[0, 0]), float(m[1, 1]), float(m[2, 2])):
        q = (m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1 + trace)
    elif squares[0] >= squares[1] and squares[0] >= squares[2]:
        q = (squares[0], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2])
    elif squares[1] >= squares[2]:
        q = (m[0, 1] + m[1, 0], squares[1], m[1, 2] + m[2, 1], m[0, 2] - m[2, 0])
    else:
        q = (m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], squares[2], m[1, 0] - m[0, 1])
    norm = math.copysign(math.sqrt(sum(float(c) ** 2 for c in q)), float(q[3]))
    x, y, z, w = (float(c) / norm for c in q)
    return (x, y, z, w)


@dataclass(frozen=True, slots=True)
class Wrench:
    """Force (N) and torque (Nm) on a body, in the frame that the giver names."""

    force: Vector3 = (0.0, 0.0, 0.0)
    torque: Vector3 = (0.0, 0.0, 0.0)

    def magnitude(self) -> float:
        """Length of the force, N."""
        return math.hypot(*self.force)


@dataclass(frozen=True, slots=True, eq=False)
class JointState:
    """Encoder readings of the arm: arrays of shape (n,), rad, rad/s, Nm."""

    position: Array
    velocity: Array
    effort: Array


@dataclass(frozen=True, slots=True)
class GripperState:
    """Opening between the fingers, m; its rate, m/s; the force with which each finger is driven, N."""

    width: float
    speed: float
    force: float
    busy: bool = False
    """Whether the gripper says that it still executes a command, also before its fingers move."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """An axis-aligned box: corners in m."""

    min: Vector3
    max: Vector3

    def contains(self, point: Vector3 | Array, margin: float = 0.0) -> bool:
        return all(
            lo + margin <= float(p) <= hi - margin
            for lo, p, hi in zip(self.min, point, self.max, strict=True)
        )


@dataclass(frozen=True, slots=True)
class WorkspaceExcess:
    """Excess of a point over a workspace.

    A negative excess: the point is within the workspace, but nearer to its edge than the margin.
    """

    axis: str
    """Axis of the world: `x`, `y` or `z`."""
    by: float
    """Excess over the workspace along the axis, m."""
    at: Vector3
    """The point in the world, m."""
    limit: float
    """Edge of the workspace along the axis, m."""
    upper: bool
    """Whether the edge is the greatest value along the axis."""

    @property
    def side(self) -> str:
        """Position and edge in words, as `x = 883 mm, at most 800 mm`."""
        at, bound = self.at["xyz".index(self.axis)], "at most" if self.upper else "at least"
        return f"{self.axis} = {at * 1000:.0f} mm, {bound} {self.limit * 1000:.0f} mm"


def workspace_excess(workspace: Bounds, point: Vector3, margin: float = 0.0) -> WorkspaceExcess | None:
    """Return the excess of a point over the workspace narrowed by `margin` m, along its worst axis; None: it
    is inside."""
    worst: WorkspaceExcess | None = None
    for axis, low, at, high in zip("xyz", workspace.min, point, workspace.max, strict=True):
        for by, limit, upper in ((low - at, low, False), (at - high, high, True)):
            if by + margin > 0.0 and (worst is None or by > worst.by):
                worst = WorkspaceExcess(axis, by, point, limit, upper)
    return worst


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Trajectory:
    """Samples of a joint motion on an even or uneven time grid, starting and ending at rest.

    times (m,) s, ascending from 0; position, velocity, acceleration (m, n) in rad, rad/s, rad/s².
    """

    times: Array
    position: Array
    velocity: Array
    acceleration: Array

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.times[-1])

    @property
    def start(self) -> Array:
        return self.position[0]

    @property
    def end(self) -> Array:
        return self.position[-1]

    def sample(self, time: float) -> tuple[Array, Array]:
        """Position and velocity (n,), (n,) at `time`, clipped; between samples see `polynomials`."""
        t = min(max(time, 0.0), self.duration)
        k = min(int(np.searchsorted(self.times, t, side="right")) - 1, len(self.times) - 2)
        if k < 0:
            return self.position[0].copy(), self.velocity[0].copy()
        h = float(self.times[k + 1] - self.times[k])
        p, v, a = self.position, self.velocity, self.acceleration
        c = quintic(p[k], v[k], a[k], p[k + 1], v[k + 1], a[k + 1], h)
        u = t - float(self.times[k])
        position = c[0] + u * (c[1] + u * (c[2] + u * (c[3] + u * (c[4] + u * c[5]))))
        velocity = c[1] + u * (2 * c[2] + u * (3 * c[3] + u * (4 * c[4] + u * 5 * c[5])))
        return position, velocity

    def polynomials(self) -> Array:
        """Return the coefficients (m - 1, 6, n) of the motion between samples, in powers of the time since
        the earlier one. The fifth degree keeps position, velocity and acceleration continuous."""
        p, v, a = self.position, self.velocity, self.acceleration
        if len(p) < 2:
            return np.concatenate([p[:, None], np.zeros((len(p), 5, p.shape[1]))], axis=1)
        h = np.diff(self.times)[:, None]
        return quintic(p[:-1], v[:-1], a[:-1], p[1:], v[1:], a[1:], h).transpose(1, 0, 2)


def quintic(p0: Array, v0: Array, a0: Array, p1: Array, v1: Array, a1: Array, span: Array | float) -> Array:
    """Coefficients (6, …) of the polynomial over [0, span] with these values and two derivatives at its
    ends. Arrays of one shape; `span` a number, or an array that goes with them."""
    h = span
    d = p1 - p0 - v0 * h - 0.5 * a0 * h**2
    e = (v1 - v0 - a0 * h) * h
    f = (a1 - a0) * h**2
    return np.array(
        [
            p0,
            v0,
            0.5 * a0,
            (10 * d - 4 * e + 0.5 * f) / h**3,
            (-15 * d + 7 * e - f) / h**4,
            (6 * d - 3 * e + 0.5 * f) / h**5,
        ]
    )
