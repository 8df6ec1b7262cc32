"""Joint limits of an arm, as far as a URDF gives them, with estimates for the rest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...robots.model import RobotModel
from ...robots.urdf_tree import UrdfJoint, UrdfTree
from ...world.values import Array

LIMIT_RESERVE = math.radians(2.0)
"""Distance kept from a joint's limits where the URDF has no soft limits, rad; never more than
RESERVE_SHARE."""
RESERVE_SHARE = 0.01
"""Greatest distance kept from a joint's limits, as a share of its range."""
CONTINUOUS_RANGE = 2 * math.pi
"""Range to either side of a joint without limits, rad: cables do not turn without end."""
MAX_VELOCITY = math.pi
"""Greatest plausible velocity, rad/s; a higher one of the URDF is replaced."""
DEFAULT_VELOCITY = 1.0
"""Velocity of a joint for which the URDF gives none, rad/s."""
ACCELERATION_TORQUE_SHARE = 0.5
"""Share of the torque left by gravity with which an acceleration is estimated."""
MIN_SPEED_UP_TIME = 0.3
"""Least time in which a joint reaches its velocity, s: it bounds the estimated acceleration."""
MIN_ACCELERATION = 0.5
"""Least acceleration that is proposed for a joint, rad/s²."""
CONFIGURATION_COUNT = 300


@dataclass(frozen=True, slots=True)
class ProposedLimits:
    """Proposed limits of one joint, rad, rad/s, rad/s², Nm; `comment` gives the origin of the values."""

    name: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    torque: float
    comment: str


def propose_limits(skeleton: UrdfTree, joints: tuple[str, ...]) -> tuple[ProposedLimits, ...]:
    """Propose limits from the URDF alone; accelerations and missing torques are estimated later."""
    return tuple(_proposed(name, skeleton.joints[name]) for name in joints)


def _proposed(name: str, joint: UrdfJoint) -> ProposedLimits:
    told: list[str] = []
    if joint.soft_lower is not None and joint.soft_upper is not None and joint.soft_lower < joint.soft_upper:
        lower, upper = joint.soft_lower, joint.soft_upper
        told.append("soft limits of the URDF")
    elif joint.type == "continuous" or joint.lower is None or joint.upper is None:
        lower, upper = -CONTINUOUS_RANGE, CONTINUOUS_RANGE
        told.append("turns without end: one turn to either side, for the cables")
    else:
        reserve = min(LIMIT_RESERVE, RESERVE_SHARE * (joint.upper - joint.lower))
        lower, upper = joint.lower + reserve, joint.upper - reserve
        told.append(f"the URDF's limits less {math.degrees(reserve):.1f} deg")
    if lower < -CONTINUOUS_RANGE or upper > CONTINUOUS_RANGE:
        lower, upper = max(lower, -CONTINUOUS_RANGE), min(upper, CONTINUOUS_RANGE)
        told.append("at most one turn to either side")
    velocity = joint.velocity or 0.0
    if velocity <= 0.0:
        velocity = DEFAULT_VELOCITY
        told.append("no velocity in the URDF: slow")
    elif velocity > MAX_VELOCITY:
        told.append(f"the URDF's {velocity:g} rad/s are not believed")
        velocity = MAX_VELOCITY
    torque = joint.effort or 0.0
    if torque <= 0.0:
        told.append("no torque in the URDF: three times what gravity needs")
        torque = 0.0
    return ProposedLimits(
        name, round(lower, 5), round(upper, 5), velocity, MIN_ACCELERATION, torque, "; ".join(told)
    )


def estimate(
    model: RobotModel, given: tuple[ProposedLimits, ...], seed: int = 0
) -> tuple[ProposedLimits, ...]:
    """Estimate accelerations: half of the torque that gravity leaves, over the largest inertia that the joint
    sees.

    Gravity torque and inertia are the largest of random configurations. No joint reaches its velocity in less
    than MIN_SPEED_UP_TIME.
    """
    generator = np.random.default_rng([seed, 3])
    gravity: Array = np.zeros(model.n)
    inertia: Array = np.full(model.n, 1e-6)
    for _ in range(CONFIGURATION_COUNT):
        q = generator.uniform(model.lower, model.upper)
        gravity = np.maximum(gravity, np.abs(model.gravity(q)))
        inertia = np.maximum(inertia, np.diag(model.mass_matrix(q)))
    found: list[ProposedLimits] = []
    for limit, weight, seen in zip(given, gravity.tolist(), inertia.tolist(), strict=True):
        torque = limit.torque if limit.torque > 0.0 else round(3.0 * weight + 1.0, 1)
        comment = limit.comment
        if torque <= weight:
            comment += f"; gravity alone needs {weight:.1f} Nm"
        acceleration = min(
            ACCELERATION_TORQUE_SHARE * max(torque - weight, 0.0) / seen, limit.velocity / MIN_SPEED_UP_TIME
        )
        acceleration = float(f"{max(acceleration, MIN_ACCELERATION):.2g}")
        found.append(replace(limit, torque=torque, acceleration=acceleration, comment=comment))
    return tuple(found)
