"""Contact forces on hand and held item, and the reading of the wrist sensor, in the kinematic backend.

Fingers push items aside, tops carry feet. Pushed items follow `world.quasi_static_pushing`, the model that
the planner of push strokes uses too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from picktree.world import GRAVITY, Array, ObjectId, PlanarPushModel, Wrench, planar_geometry
from picktree.world.robot_model import GripperDescription, RobotModel, pose_of, tool_outline

from .bodies import KinematicBodies, KinematicBody, Prism
from .devices import KinematicArm, KinematicGripper, KinematicWrench

MAX_FIRST_CONTACT_DEPTH = 0.005
"""Greatest depth below a top at which that top carries a foot of unknown origin, m."""
MAX_ENTRY_DEPTH = 5e-4
"""Depth below a top up to which a foot came from above, m."""


class KinematicContacts:
    """Supports of each foot: a foot is a finger tip, or the bottom of the held item.

    A body carries a foot that entered it from above, until the foot leaves its outline. A body entered from
    the side, as by fingers that open next to it, moves aside and pushes nothing up.
    """

    def __init__(self) -> None:
        self._height: dict[str, float] = {}
        self._upon: dict[str, frozenset[str]] = {}

    def forget(self, *feet: str) -> None:
        """Forget feet (default: all) that are far from everything, or were placed elsewhere."""
        for foot in feet or tuple(self._height):
            self._height.pop(foot, None)
            self._upon.pop(foot, None)

    def top(self, foot: str, height: float, tops: Iterable[tuple[str, float]]) -> float | None:
        """Return the height of the highest top that carries the foot or is below it; None without one.

        `tops` are names and heights at the foot, m.
        """
        before, upon = self._height.get(foot), self._upon.get(foot, frozenset[str]())
        entered = height + MAX_FIRST_CONTACT_DEPTH if before is None else before + MAX_ENTRY_DEPTH
        carrying = {name: top for name, top in tops if top <= max(height, entered) or name in upon}
        self._height[foot] = height
        self._upon[foot] = frozenset([name for name, top in carrying.items() if top > height])
        return max(carrying.values(), default=None)

    def hover(self, foot: str, height: float) -> None:
        """Note the height of a foot that is above all tops at its place."""
        self._height[foot] = height
        self._upon[foot] = frozenset()


MAX_SUPPORTED_TIP_DEPTH = 0.0015
"""Greatest depth below the top of an item at which that top carries the finger tips, m."""
MIN_DOWNWARD_COSINE = 0.98
"""Least cosine of the tilt of a hand that points down."""
MIN_PUSH_TRAVEL = 1e-7
"""Least travel in a control period with which the hand pushes, m."""


class KinematicPushing:
    """Pushing: moves the items of `bodies` out of the way of the finger pads."""

    def __init__(self, gripper: GripperDescription, bodies: KinematicBodies) -> None:
        self._gripper = gripper
        self._bodies = bodies
        self._high = gripper.pads[0][0].size[2]
        self._before: Array | None = None

    def forget(self) -> None:
        """Forget the last position after the hand was placed elsewhere."""
        self._before = None

    def step(self, rotation: Array, position: Array, width: float, tip: float) -> tuple[float, float]:
        """Push items that the fingers reach, and return the friction force (x, y) of sliding items, in the
        world, N.

        `rotation` (3, 3) and `position` (3,) are the TCP's in the world. The fingers are `width` m open and
        reach `tip` m beyond the TCP.
        """
        before, self._before = self._before, position.copy()
        if before is None or float(rotation[2, 2]) > -MIN_DOWNWARD_COSINE:
            return 0.0, 0.0
        low = float(position[2]) - tip
        dx, dy, dz = (position - before).tolist()
        way = math.hypot(dx, dy)
        if low > self._bodies.highest or way < MIN_PUSH_TRAVEL or way < abs(dz):
            return 0.0, 0.0
        return self._push(rotation, position, width, low, (dx / way, dy / way))

    def _push(
        self, rotation: Array, position: Array, width: float, low: float, along: tuple[float, float]
    ) -> tuple[float, float]:
        here = [
            body
            for body, prism in self._bodies.standing()
            if prism.high[2] > low + MAX_SUPPORTED_TIP_DEPTH
            and prism.low[2] < low + self._high
            and self._bodies.in_hole(body) is None
        ]
        at = planar_geometry.PlanarPose(
            float(position[0]), float(position[1]), math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))
        )
        fingers = [(finger, at) for finger in tool_outline(self._gripper, width)]
        if not any(self._in_reach(body, at, fingers[0][0].reach) for body in here):
            return 0.0, 0.0
        sliding = PlanarPushModel(
            {body.id: self._bodies.outline(body.id) for body in here},
            [
                _static_outline(prism)
                for prism in self._bodies.fixed
                if low < prism.high[2] - MAX_SUPPORTED_TIP_DEPTH
            ],
        )
        pushed = sliding.press(fingers)
        force = 0.0
        for body in here:
            if body.id in pushed:
                there = planar_geometry.moved(body.entry.shape, body.pose, sliding.where(body.id))
                self._bodies.put(body.at(there))
                force += body.friction * body.entry.mass * GRAVITY
        if pushed:
            self._settle(pushed)
        return -force * along[0], -force * along[1]

    def _in_reach(self, body: KinematicBody, at: planar_geometry.PlanarPose, reach: float) -> bool:
        """Return whether the circles around body and fingers meet. The fingers are at `at`."""
        away = math.dist(body.pose.position[:2], (at.x, at.y))
        return away <= reach + self._bodies.outline(body.id)[0].reach + 1e-9

    def _settle(self, pushed: frozenset[str]) -> None:
        """Let items come down that were pushed over an edge, with those on them."""
        for name in sorted(pushed):
            body = self._bodies[ObjectId(name)]
            prism = Prism.of(name, body.entry.shape, body.pose)
            surface = self._bodies.below(prism)
            if surface is None or abs(surface - prism.low[2]) > 1e-6:
                self._bodies.settle()
                return


def _static_outline(prism: Prism) -> tuple[planar_geometry.PlanarOutline, planar_geometry.PlanarPose]:
    """Return a static prism's outline and its pose in the plane."""
    x, y = prism.outline.centre
    return planar_geometry.PlanarOutline(
        np.array(prism.outline.polygon), prism.outline.radius
    ), planar_geometry.PlanarPose(x, y)


CONTACT_STIFFNESS = 2.0e4
"""Stiffness of a contact with a support, N/m."""
CONTACT_DAMPING = 60.0
"""Damping of a contact with a support, N·s/m."""
MAX_TIP_DEPTH = 0.03
"""Greatest depth below a top at which it still carries the finger tips, m."""
SUPPORT_HEIGHT = 2e-4
"""Height above a support over which it takes the weight of a held object, m."""
HELD_FOOT = "held"
"""Name of the foot that is the bottom of the held item."""


class KinematicContactForces:
    """Contacts of hand and held item in each control period. They act on the arm and on the wrist sensor."""

    def __init__(
        self,
        model: RobotModel,
        description: GripperDescription,
        arm: KinematicArm,
        gripper: KinematicGripper,
        wrench: KinematicWrench,
        bodies: KinematicBodies,
        period: float,
    ) -> None:
        self._model = model
        self._arm = arm
        self._gripper = gripper
        self._wrench = wrench
        self._bodies = bodies
        self._period = period
        self._tip = description.tip
        self._pad = description.pads[0][0].size[1]
        home = self._model.named("home")
        flange, tcp = self._model.flange(home), self._model.tcp(home)
        self._flange_in_tcp = np.array((tcp.inverse() @ flange).position)
        hand: Array = (tcp.inverse() @ flange).rotation() @ np.array(self._model.hand_com)
        self._hand_in_flange = hand
        self._data = self._model.arm.createData()
        self.on_tcp = np.zeros(6)
        """Wrench of contacts on the TCP in the world's axes, (6,), N and Nm."""
        self._height: float | None = None
        self._in_hole: Array | None = None
        """TCP position in the world in the last period, m; None: no hole held the held item then."""
        self._centre: tuple[Array, Array | None] | None = None
        """Position and velocity of the hand's centre of mass in the last period, m and m/s; None: unknown."""
        self._touching = False
        self._feet = KinematicContacts()
        self._pushing = KinematicPushing(description, self._bodies)

    def forget(self) -> None:
        """Forget the last period after the arm was placed elsewhere."""
        self._height = self._centre = self._in_hole = None
        self._feet.forget()
        self._pushing.forget()

    def sense(self, still: bool = False) -> None:
        """Step the fingers, then compute contacts and the wrist's reading at the arm's configuration.
        `still`: the fingers do not move."""
        arm, data = self._model.arm, self._data
        pin.forwardKinematics(arm, data, self._arm.position)
        placement = pin.updateFramePlacement(arm, data, self._model.tcp_frame)
        rotation, position = placement.rotation, placement.translation
        gripper, bodies = self._gripper, self._bodies
        if not still and (bodies.held is not None or gripper.moves):
            gripper.step(pose_of(placement), self._period)
        weight = self._model.hand_mass * GRAVITY
        offset, lever = rotation.dot(self._flange_in_tcp), rotation.dot(self._hand_in_flange)
        lever_x, lever_y, lever_z = lever.tolist()
        reading = [0.0, 0.0, -weight, -lever_y * weight, lever_x * weight, 0.0]
        accelerated = self._accelerated(position + offset + lever)
        if accelerated is not None:
            carried = 0.0 if bodies.held is None else bodies[bodies.held].entry.mass
            x, y, up = (-(self._model.hand_mass + carried) * accelerated).tolist()
            reading[0], reading[1], reading[2] = x, y, reading[2] + up
            reading[3] += lever_y * up - lever_z * y
            reading[4] += lever_z * x - lever_x * up
            reading[5] += lever_x * y - lever_y * x
        if self._touching:
            self.on_tcp, self._touching = np.zeros(6), False
        z = float(position[2])
        rate = 0.0 if self._height is None else (z - self._height) / self._period
        self._height = z
        if bodies.held is not None or z + float(rotation[2, 2]) * self._tip < bodies.highest + 0.01:
            for point, upward in self._contacts(rotation, position, rate):
                self._touching = True
                arm_x, arm_y, _ = point - position
                self.on_tcp += (0.0, 0.0, upward, arm_y * upward, -arm_x * upward, 0.0)
                arm_x, arm_y, _ = (point - position - offset).tolist()
                reading[2] += upward
                reading[3] += arm_y * upward
                reading[4] -= arm_x * upward
            across = self._walls(position)
            if bodies.held is None and not gripper.moves:
                reach = self._model.fingers.reach(gripper.width)
                across = self._pushing.step(rotation, position, gripper.width, reach)
            if across != (0.0, 0.0):
                self._touching = True
                self.on_tcp[:2] += across
                reading[0] += across[0]
                reading[1] += across[1]
                lever_x, lever_y, lever_z = (-offset).tolist()
                reading[3] -= lever_z * across[1]
                reading[4] += lever_z * across[0]
                reading[5] += lever_x * across[1] - lever_y * across[0]
        else:
            self._feet.forget()
            self._pushing.forget()
        fx, fy, fz, tx, ty, tz = reading
        self._wrench.reading = Wrench((fx, fy, fz), (tx, ty, tz))

    def _accelerated(self, centre: Array) -> Array | None:
        """Return the acceleration (3,), m/s², of the hand's centre of mass, which is at `centre` now.

        None while it is unknown, and under torque control: there the hand is slow and contacts are stiff.
        """
        before, self._centre = self._centre, None
        if self._arm.free:
            return None
        velocity = None if before is None else (centre - before[0]) / self._period
        self._centre = (centre, velocity)
        if before is None or before[1] is None or velocity is None:
            return None
        return (velocity - before[1]) / self._period

    def _walls(self, position: Array) -> tuple[float, float]:
        """Return the force (x, y) of a hole's walls on the held item, in the world, N. The TCP is at
        `position`."""
        held = self._bodies.held
        hole = None if held is None else self._bodies.in_hole(self._bodies[held])
        before, self._in_hole = self._in_hole, None if hole is None else position.copy()
        if held is None or hole is None:
            return 0.0, 0.0
        back = np.subtract(hole.pose.position, self._bodies[held].pose.position)
        if not back.any():
            return 0.0, 0.0
        rate = np.zeros(3) if before is None else (position - before) / self._period
        x, y, _ = (CONTACT_STIFFNESS * back - CONTACT_DAMPING * rate).tolist()
        return x, y

    def _contacts(self, rotation: Array, position: Array, rate: float) -> list[tuple[Array, float]]:
        """Return points (3,) in the world and the vertical force on the hand at each, N: supports push up,
        weight pulls down."""
        found: list[tuple[Array, float]] = []
        aside = self._gripper.width / 2 + self._pad / 2
        reach = self._model.fingers.reach(self._gripper.width)
        for foot, side in (("one tip", aside), ("other tip", -aside)):
            tip = position + rotation.dot(np.array([0.0, side, reach]))
            x, y, z = tip.tolist()
            if z >= self._bodies.highest:
                self._feet.hover(foot, z)
                continue
            above = self._bodies.tops(x, y, (z, z + MAX_TIP_DEPTH))
            if not above:
                self._feet.hover(foot, z)
                continue
            surface = self._feet.top(foot, z, above)
            if surface is not None and surface > z:
                force = CONTACT_STIFFNESS / 2 * (surface - z) - CONTACT_DAMPING / 2 * rate
                found.append((tip, max(0.0, force)))
        held = self._bodies.held
        if held is None:
            self._feet.forget(HELD_FOOT)
            return found
        body = self._bodies[held]
        weight = body.entry.mass * GRAVITY
        upward = -weight
        prism = Prism.of(held, body.entry.shape, body.pose)
        lowest = prism.low[2]
        if lowest < self._bodies.highest + SUPPORT_HEIGHT:
            surface = self._feet.top(HELD_FOOT, lowest, self._bodies.tops_below(prism))
            if surface is not None:
                gap = lowest - surface
                upward += weight * min(max(1.0 - gap / SUPPORT_HEIGHT, 0.0), 1.0)
                if gap < 0.0:
                    upward += max(0.0, -CONTACT_STIFFNESS * gap - CONTACT_DAMPING * rate)
        else:
            self._feet.forget(HELD_FOOT)
        found.append((np.array(body.pose.position), upward))
        return found
