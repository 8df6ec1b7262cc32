"""Proposals for the joints of an arm: limits, as far as a URDF gives them, accelerations and torques."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...world.robot_model.model import RobotModel
from ...world.robot_model.urdf_tree import UrdfJoint, UrdfTree
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
MIN_VELOCITY = 0.01
"""Least plausible velocity, rad/s; a lower one of the URDF is replaced."""
DEFAULT_VELOCITY = 1.0
"""Velocity of a joint for which the URDF gives none, rad/s."""
ACCELERATION_TORQUE_SHARE = 0.5
"""Share of the torque left by gravity with which an acceleration is estimated."""
MIN_SPEED_UP_TIME = 0.3
"""Least time in which a joint reaches its velocity, s: it bounds the estimated acceleration."""
MIN_ACCELERATION = 0.5
"""Least acceleration that is proposed for a joint, rad/s²."""
CONFIGURATION_COUNT = 300
GRAVITY_RESERVE = 1.5
"""Torque that a guess gives a joint for gravity, as a multiple of what gravity needs at most."""
MIN_TORQUE_GUESS = 1.0
"""Part of a guessed torque for friction and for what inertias leave out, Nm."""
MIN_MASS_SHARE, MASS_SHARE_STEP = 0.3, 0.05
"""Least share of guessed masses, and step of the shares that are tried."""
PLACEHOLDER_TORQUE = 1.0
"""Torque that many URDFs give for lack of another, Nm; so do they with 0."""
MAX_TORQUE, MAX_TORQUE_RATIO = 1000.0, 20.0
"""A torque of at least so many Nm, and so many times a guess, is not believed."""


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
    guess: str = ""
    """Sentence on why the torque is a guess; empty: it is the URDF's."""


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
    elif velocity < MIN_VELOCITY:
        told.append(f"the URDF's {velocity:g} rad/s are not believed: slow")
        velocity = DEFAULT_VELOCITY
    elif velocity > MAX_VELOCITY:
        told.append(f"the URDF's {velocity:g} rad/s are not believed")
        velocity = MAX_VELOCITY
    torque = joint.effort or 0.0
    return ProposedLimits(
        name, round(lower, 5), round(upper, 5), velocity, MIN_ACCELERATION, torque, "; ".join(told)
    )


@dataclass(frozen=True, slots=True)
class JointLoads:
    """Largest loads (n,) of the arm's joints in random configurations: gravity, Nm, and inertia, kg·m²."""

    gravity: Array
    inertia: Array

    @classmethod
    def of(cls, model: RobotModel, seed: int = 0) -> JointLoads:
        generator = np.random.default_rng([seed, 3])
        gravity: Array = np.zeros(model.n)
        inertia: Array = np.full(model.n, 1e-6)
        for _ in range(CONFIGURATION_COUNT):
            q = generator.uniform(model.lower, model.upper)
            gravity = np.maximum(gravity, np.abs(model.gravity(q)))
            inertia = np.maximum(inertia, np.diag(model.mass_matrix(q)))
        return cls(gravity, inertia)

    def torques(self, velocity: Array) -> Array:
        """Return torques (n,) that carry the arm and move it, Nm, for joints of these velocities, rad/s.

        They leave what takes each joint to its velocity in MIN_SPEED_UP_TIME.
        """
        moving = self.inertia * velocity / MIN_SPEED_UP_TIME / ACCELERATION_TORQUE_SHARE
        return GRAVITY_RESERVE * self.gravity + moving + MIN_TORQUE_GUESS


def is_placeholder(effort: float, gravity: float, guess: float) -> bool:
    """Return whether the URDF's effort of a joint, Nm, cannot be its motor's.

    It is 0 or 1, less than 1 and less than gravity needs, or far beyond what the arm needs.
    """
    if effort <= PLACEHOLDER_TORQUE:
        return effort <= 0.0 or effort == PLACEHOLDER_TORQUE or effort < gravity
    return effort >= max(MAX_TORQUE, MAX_TORQUE_RATIO * guess)


def borne_share(
    whole: RobotModel, half: RobotModel, given: tuple[ProposedLimits, ...], seed: int = 0
) -> float:
    """Return the share of the guessed masses that the URDF's torques carry with GRAVITY_RESERVE, 0 … 1.

    1 also when no share of at least MIN_MASS_SHARE is carried. `half`: the model with half of the guesses.
    """
    loads = JointLoads.of(whole, seed)
    guesses = loads.torques(np.array([limit.velocity for limit in given]))
    most: Array = np.array(
        [
            np.inf if is_placeholder(limit.torque, weight, guess) else limit.torque / GRAVITY_RESERVE
            for limit, weight, guess in zip(given, loads.gravity.tolist(), guesses.tolist(), strict=True)
        ]
    )
    generator = np.random.default_rng([seed, 3])
    drawn = [generator.uniform(whole.lower, whole.upper) for _ in range(CONFIGURATION_COUNT)]
    total: Array = np.array([whole.gravity(q) for q in drawn])
    guessed = 2.0 * (total - np.array([half.gravity(q) for q in drawn]))
    for share in np.arange(1.0, MIN_MASS_SHARE - 1e-9, -MASS_SHARE_STEP).tolist():
        if (np.abs(total - (1.0 - share) * guessed) <= most).all():
            return round(share, 2)
    return 1.0


def estimate(
    model: RobotModel, given: tuple[ProposedLimits, ...], seed: int = 0
) -> tuple[ProposedLimits, ...]:
    """Estimate accelerations, and torques where the URDF gives none that can be right.

    An acceleration takes half of the torque that gravity leaves, over the largest inertia that the joint
    sees. No joint reaches its velocity in less than MIN_SPEED_UP_TIME.
    """
    loads = JointLoads.of(model, seed)
    guesses = loads.torques(np.array([limit.velocity for limit in given]))
    found: list[ProposedLimits] = []
    for limit, weight, seen, guess in zip(
        given, loads.gravity.tolist(), loads.inertia.tolist(), guesses.tolist(), strict=True
    ):
        torque, comment, why = limit.torque, limit.comment, ""
        if is_placeholder(torque, weight, guess):
            torque = float(f"{guess:.2g}")
            why = (
                f"{torque:g} Nm are a guess from gravity and inertia, for the URDF's effort of "
                f"{limit.torque:g} Nm: see the data sheet"
            )
            comment += f"; torque: {why}"
        elif torque <= weight:
            comment += f"; gravity alone needs {weight:.1f} Nm"
        acceleration = min(
            ACCELERATION_TORQUE_SHARE * max(torque - weight, 0.0) / seen, limit.velocity / MIN_SPEED_UP_TIME
        )
        acceleration = float(f"{max(acceleration, MIN_ACCELERATION):.2g}")
        found.append(replace(limit, torque=torque, acceleration=acceleration, comment=comment, guess=why))
    return tuple(found)
