"""Slowed trajectory: the same path, slower where a part of the arm would be fast or hit hard.

The effective mass of a point in the direction u of its motion is 1 / (uᵀ J M⁻¹ Jᵀ u). Khatib, "Inertial
properties in robotic manipulation: an object-level framework", International Journal of Robotics Research 14
(1995). Times the point's speed it is the impulse with which a rigid obstacle stops the point.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ...world.robot_model.model import RobotModel
from ...world.trajectory import Trajectory
from ...world.values import Array

MAX_IMPULSE = 0.75
"""Greatest impulse of any part of the arm on a rigid obstacle, Ns.

It comes before the arm can give way. As a mean over the 37.5 ms of the safety monitor it is 20 N.
"""
HOUSING_RADIUS = 0.05
"""Radius of the housing around a joint, m. An obstacle meets the surface, no point inside of it."""
SMOOTHING_SAMPLES = 3
"""Number of samples, on either side, over which the slowdown begins and ends."""


def slowed_trajectory(model: RobotModel, trajectory: Trajectory, speed: float) -> Trajectory:
    """Return the trajectory on the same path, slowed down where a part of the arm would be too fast.

    Neither tool nor joints exceed `speed` m/s or `MAX_IMPULSE`; where they do not, the speed is kept.
    """
    share = _allowed_share(model, trajectory, speed)
    if bool((share >= 1.0).all()):
        return trajectory
    # The squared rate is linear in time between samples; its derivative is the rate's acceleration, doubled.
    squared = _smoothed(share**2)
    rate = np.sqrt(squared)
    change = np.gradient(squared, trajectory.times) / 2.0
    steps = 2.0 * np.diff(trajectory.times) / (rate[1:] + rate[:-1])
    acceleration = trajectory.acceleration * squared[:, None] + trajectory.velocity * change[:, None]
    stretch = max(1.0, float(np.sqrt((np.abs(acceleration) / model.acceleration_limit).max())))
    return Trajectory(
        np.concatenate([[0.0], np.cumsum(steps)]) * stretch,
        trajectory.position,
        trajectory.velocity * rate[:, None] / stretch,
        acceleration / stretch**2,
    )


def _allowed_share(model: RobotModel, trajectory: Trajectory, speed: float) -> Array:
    """Return the share (m,) of its speed at which each sample keeps both limits, at most 1.

    The impulse of a link that turns about an axis grows without limit towards the axis. A joint whose centre
    is that near counts with the impulse at the radius of its housing.
    """
    arm = model.arm
    data = arm.createData()
    excess = np.ones(len(trajectory.times))
    for k, (q, v) in enumerate(zip(trajectory.position, trajectory.velocity, strict=True)):
        if not v.any():
            continue
        pin.computeJointJacobians(arm, data, q)
        mass = model.mass_matrix(q)
        points = [pin.getJointJacobian(arm, data, j, pin.LOCAL_WORLD_ALIGNED) for j in range(1, model.n + 1)]
        points.append(pin.getFrameJacobian(arm, data, model.tcp_frame, pin.LOCAL_WORLD_ALIGNED))
        linear = np.array(points)[:, :3]
        # The centre of a joint is a point of the link before it; the TCP is a point at the surface.
        turning = np.zeros(len(points))
        turning[1:-1] = np.linalg.norm(np.array(points[:-2])[:, 3:] @ v, axis=1)
        motions: Array = linear @ v
        # With w = Jᵀ u |v|, speed times effective mass is |v|³ / (wᵀ M⁻¹ w).
        pulls: Array = np.einsum("pxn,px->pn", linear, motions)
        speeds = np.linalg.norm(motions, axis=1)
        mobility = np.einsum("pn,pn->p", pulls, np.linalg.solve(mass, pulls.T).T)
        impulses = np.divide(speeds**3, mobility, out=np.zeros_like(speeds), where=mobility > 0.0)
        impulses *= speeds / np.maximum(np.maximum(speeds, HOUSING_RADIUS * turning), 1e-12)
        excess[k] = max(1.0, float(speeds.max()) / speed, float(impulses.max()) / MAX_IMPULSE)
    return 1.0 / excess


def _smoothed(limit: Array) -> Array:
    """Return values (m,) that change smoothly and are nowhere above `limit` (m,)."""
    n = SMOOTHING_SAMPLES
    windows = np.lib.stride_tricks.sliding_window_view
    lowest = windows(np.pad(limit, 2 * n, mode="edge"), 2 * n + 1).min(axis=1)
    mean = windows(lowest, n + 1).mean(axis=1)
    return windows(mean, n + 1).mean(axis=1)
