"""TouchTarget: touch a calibration target with the closed fingers from all sides."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from picktree.robot.calibration import calibration_targets, observations
from picktree.robot.planning import PoseGoal, Request
from picktree.trees import ARM, GRIPPER, Doing, In, Skill, Steps, port
from picktree.world import Failure, control, event_types, grasp, planning, safety
from picktree.world import world as world_causes

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.world import Pose

APPROACH_DISTANCE = 0.03
"""Distance of the fingers from a face before the touch, m: more than the uncertainty of the target's pose."""
MAX_SEARCH_DEPTH = 0.02
"""Depth behind the expected face at which the search ends, m."""
EXTRA_CLEARANCE = 0.01
"""Clearance of free motions beyond the usual margins, m: the poses of target and tool are uncertain."""
TOUCH_SPEED = 0.02
"""Speed of a touch, m/s."""
RIGID_TOUCH_SPEED = 0.005
"""Speed of a touch by an arm that takes positions only, m/s: it presses before its wrist feels a contact."""
TOUCH_FORCES = (3.0, 6.0)
"""Contact forces used in turn, N: two different ones show the compliance of fingers and target."""
CLOSING_FORCE = 10.0
"""Force that keeps the fingers closed, N."""
MIN_TOUCHES = 8
"""Minimum number of touches that determine the tip."""


class TouchTarget(Skill):
    """Touch the faces of a target with the tips of the closed fingers, upright, turned and leaning.

    Each touch is recorded with the tool's pose by the encoders and the force. Faces out of reach are skipped.
    The skill corrects nothing: `picktree calibrate` estimates the tool's centre point and the target's pose
    from the touches.
    """

    example = """
    TouchTarget: {target: target}
    """

    target: In[str] = port("the fixture with `marker`", default="target", names="fixture")
    causes = (
        grasp.NO_CANDIDATE,
        planning.ANY,
        control.ANY,
        safety.ANY,
        world_causes.UNKNOWN_OBJECT,
        world_causes.DISTURBED,
    )
    hand_after = "empty"
    uses = (ARM, GRIPPER)
    limit = 1800.0

    def run(self, world: World) -> Steps:
        target = calibration_targets.target_named(world.scene.fixtures.values(), self.target)
        if world.scene.held is not None:
            raise Failure(grasp.NO_CANDIDATE, f"the hand is not free: it holds {world.scene.held.id}")
        width = yield from world.gripper.close(CLOSING_FORCE)
        at_tips = calibration_targets.fingertip_corners(world.robot, max(0.0, width))
        ways = [
            calibration_targets.touch_points(target.pose, target.size, at_tips, turned)
            for turned in (0.0, math.pi / 2)
        ]
        wanted = max(ways, key=lambda way: self._room(world, way))
        found = 0
        for number, contact in enumerate(wanted):
            touch = yield from self._touch(world, contact, TOUCH_FORCES[number % len(TOUCH_FORCES)])
            if touch is None:
                continue
            found += 1
            message = f"{self.target}, {contact.name}: touched with {touch.force:.1f} N"
            world.journal.note(touch.to_event(message, self.path))
        yield from world.gripper.open()
        if found < MIN_TOUCHES:
            raise Failure(
                planning.NO_PATH,
                f"{found} of {len(wanted)} touches of {self.target} are within reach; {MIN_TOUCHES} are "
                "needed",
                touched=found,
            )

    def _room(self, world: World, way: tuple[calibration_targets.TouchPoint, ...]) -> float:
        """Return the least distance of the joints from their limits in touches that turn the hand by half a
        turn, rad."""
        room = math.inf
        for contact in way:
            q = world.plan.reachable(_before(contact)[0]) if len(contact.tcp) == 1 else None
            if q is not None:
                room = min(room, float(np.minimum(q - world.robot.lower, world.robot.upper - q).min()))
            elif len(contact.tcp) == 1:
                room = min(room, 0.0)
        return room

    def _touch(
        self, world: World, contact: calibration_targets.TouchPoint, force: float
    ) -> Doing[observations.TargetTouch | None]:
        """Move to the face, touch it and move back; None when that is impossible here."""
        away = np.array(contact.normal) * APPROACH_DISTANCE
        try:
            goal = PoseGoal(_before(contact))
            request = Request(goal, scaling=world.handling.scaling(1.0), clearance=EXTRA_CLEARANCE)
            plan = yield from world.plan.solve(request, node=self.path)
        except Failure as failure:
            if not failure.cause.name.startswith("planning."):
                raise
            self._skip(world, contact, failure.message)
            return None
        yield from world.move.along(plan.trajectory, guard=world.handling.guard, node=self.path)
        yield from world.control.settle()
        world.control.tare()
        why = "there is nothing to be felt"
        touch: observations.TargetTouch | None = None
        soft = world.control.takes_torque
        speed, zero = TOUCH_SPEED if soft else RIGID_TOUCH_SPEED, None
        with world.scene.allow(("gripper", self.target)):
            try:
                felt = yield from world.move.guarded(
                    -away,
                    APPROACH_DISTANCE + MAX_SEARCH_DEPTH,
                    force=force,
                    speed=speed,
                    press=force,
                    node=self.path,
                )
                # By positions, the arm goes where the felt force is zero: that must be the free one.
                zero = None if soft else felt.zero
                yield from world.control.settle()
                touch = self._touch_record(world, contact) if felt.contact else None
            except Failure as failure:
                if world.control.monitor.stopped is not None:
                    raise
                why = failure.message
            # The arm stays compliant: near a face a stiff servo turns tenths of a millimetre into force.
            yield from world.move.guarded(
                away,
                APPROACH_DISTANCE,
                force=world.handling.guard,
                speed=2 * TOUCH_SPEED,
                node=self.path,
                zero=zero,
            )
        if touch is None:
            self._skip(world, contact, why)
        return touch

    def _touch_record(
        self, world: World, contact: calibration_targets.TouchPoint
    ) -> observations.TargetTouch:
        pushed = world.control.wrench_external().force
        against = float(np.dot(pushed, contact.normal))
        return observations.TargetTouch(contact.face, world.control.tcp, max(0.0, against), contact.name)

    def _skip(self, world: World, contact: calibration_targets.TouchPoint, why: str) -> None:
        message = f"{self.target}, {contact.name}: {why}"
        world.journal.note(event_types.CalibrationSkippedEvent(message, self.path))


def _before(contact: calibration_targets.TouchPoint) -> tuple[Pose, ...]:
    """Return the poses of the tool before a touch."""
    away = np.array(contact.normal) * APPROACH_DISTANCE
    return tuple(pose.shifted(away) for pose in contact.tcp)
