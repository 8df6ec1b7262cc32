"""Shadow of a robot: a mission runs on a predicted arm, by the pictures of the real one, and nothing is sent.

The predicted arm is exactly at each set-point, and its fingers meet nothing. So the shadow ends where the
prediction ends: where the fingers close on something, or where a picture shows another configuration than
the predicted one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from picktree.world import GRAVITY, Array, NoImage
from picktree.world.robot_model import RobotDescription, RobotModel
from picktree.world.scene import SceneDescription

from . import protocol
from .external_hardware import ExternalHardware
from .measurement import RobotMeasurement

MAX_PICTURE_DISTANCE: Final = 0.02
"""Greatest distance of a joint from its prediction at which a picture belongs to the prediction, rad."""
CLOSED_OPENING: Final = 2e-3
"""Commanded opening below which the fingers close on something, m."""
SPEED_ALLOWANCE: Final = 0.02
"""Excess of a set-point's speed over the robot's limit that counts as rounding, rad/s."""


@dataclass(frozen=True, slots=True, eq=False)
class ShadowStep:
    """Set-point of one control period, and the distance of the robot from its prediction."""

    time: float
    """Time since the run began, s."""
    position: Array
    """Set-point (n,) that would be sent, rad."""
    joints: float
    """Greatest distance of a measured joint from the predicted one, rad."""
    tcp: float
    """Distance of the TCP, m."""
    force: float
    """Difference of the forces at the wrist, flange axes, N."""
    torque: float
    """Difference of the torques at the wrist, flange axes, Nm."""
    opening: float
    """Difference of the gripper's openings, m."""


class ShadowHardware(ExternalHardware):
    """`protocols.Hardware` that reads a robot in another process and sends it nothing."""

    observes = True

    def __init__(
        self,
        scene: SceneDescription,
        robot: RobotDescription,
        address: str,
        speed: float = 1.0,
        measured: RobotMeasurement | None = None,
        perception_at: str = "",
    ) -> None:
        """Connect as a client that only reads; see `ExternalHardware`."""
        self.steps: list[ShadowStep] = []
        self.ended = ""
        """Reason for which the prediction has ended; empty: it has not."""
        self.refused = ""
        """First set-point that the robot's own side would have refused; empty: there was none."""
        self._predicted: protocol.State | None = None
        self._goal: protocol.GripCommand | None = None
        self._model = RobotModel(replace(robot, tool=scene.tool))
        self._finger_speed = robot.gripper.speed
        super().__init__(scene, robot, address, speed, measured, perception_at)

    @property
    def takes_torque(self) -> bool:
        return False

    @property
    def latency(self) -> float:
        return 0.0

    def settings(self) -> Mapping[str, str]:
        return {**super().settings(), "shadow": "the robot was only read"}

    def picture_time(self, stamp: float) -> float:
        """Return the present time of the prediction. Raises NoImage when the picture is not the predicted
        one."""
        off = float(np.abs(self.joints.position - np.array(self.actual.position)).max())
        if off > MAX_PICTURE_DISTANCE:
            self.ended = self.ended or (
                f"the robot is {off:.2f} rad away from its prediction: its pictures do not show that"
            )
            raise NoImage(self.ended)
        return self.clock.now

    def _exchange(self, advance: float) -> protocol.State:
        """Read the robot's state, and return the predicted one after `advance` s."""
        before = self._predicted
        now = 0.0 if before is None else before.time + advance
        self.actual = self.link.state(protocol.Observe(now))
        if before is None:
            self._bias = np.array(self.actual.wrench) - self._hand_wrench(np.array(self.actual.position))
            self._predicted = replace(self.actual, velocity=(0.0,) * len(self.actual.position))
        elif advance > 0.0:
            self._predicted = self._predict(before, now, advance)
            self._compare(before, self._predicted, advance)
        assert self._predicted is not None
        return self._predicted

    def _predict(self, before: protocol.State, now: float, advance: float) -> protocol.State:
        mode, numbers, velocity, _ = self.command
        moves = mode is protocol.Mode.POSITION
        position = tuple(numbers.tolist()) if moves else before.position
        self._sequence += 1
        if self.grip is not None:
            self._goal = self.grip
            if self.grip.width < min(CLOSED_OPENING, before.gripper[0]):
                self.ended = self.ended or "the fingers would close: what they would hold is not predicted"
        opening, rate = before.gripper[0], 0.0
        if self._goal is not None:
            most = 2.0 * min(self._goal.speed or self._finger_speed, self._finger_speed) * advance
            step = min(max(self._goal.width - opening, -most), most)
            opening, rate = opening + step, step / advance
        return replace(
            before,
            sequence=self._sequence,
            command=self._sequence,
            time=now,
            position=position,
            velocity=tuple(velocity.tolist()) if moves else (0.0,) * len(position),
            gripper=(opening, rate, 0.0),
            wrench=tuple((self._hand_wrench(np.array(position)) + self._bias).tolist()),
            stamps=(now,) * 3,
            busy=rate != 0.0,
            stop=protocol.Stop.NONE,
        )

    def _hand_wrench(self, q: Array) -> Array:
        """Return the wrench (6,) of the hand's weight on the wrist, flange axes, N and Nm."""
        turn = self._model.flange(q).rotation()
        force = turn.T @ np.array([0.0, 0.0, -GRAVITY * self._model.hand_mass])
        return np.concatenate([force, np.cross(np.array(self._model.hand_com), force)])

    def _compare(self, before: protocol.State, predicted: protocol.State, period: float) -> None:
        """Record how far the robot is from the prediction, and judge the set-point by the robot's limits."""
        q, measured = np.array(predicted.position), np.array(self.actual.position)
        tcp = self._model.tcp(q)
        wrench = np.array(self.actual.wrench) - np.array(predicted.wrench)
        time = predicted.time - self.began
        self.steps.append(
            ShadowStep(
                time,
                q,
                float(np.abs(q - measured).max()),
                tcp.distance(self._model.tcp(measured)),
                float(np.linalg.norm(wrench[:3])),
                float(np.linalg.norm(wrench[3:])),
                abs(predicted.gripper[0] - self.actual.gripper[0]),
            )
        )
        if not self.refused and (why := self._refusal(q, np.array(before.position), tcp.position, period)):
            self.refused = f"at {time:.3f} s {why}"

    def _refusal(self, q: Array, before: Array, tcp: tuple[float, ...], period: float) -> str:
        """Return why the robot's own side would refuse a set-point; empty: it would not."""
        told = self.link.robot
        for joint, at, last in zip(told.joints, q.tolist(), before.tolist(), strict=True):
            if not joint.lower <= at <= joint.upper:
                return f"{joint.name} is beyond its limit: {at:.3f} rad"
            rate = abs(at - last) / period
            fastest = told.speed * joint.velocity
            if rate > fastest + SPEED_ALLOWANCE:
                return f"{joint.name} is too fast: {rate:.3f} rad/s, its limit is {fastest:g} rad/s"
        low, high = told.workspace[:3], told.workspace[3:]
        if any(not a <= c <= b for a, c, b in zip(low, tcp, high, strict=True)):
            return f"the tool leaves the workspace: x {tcp[0]:.3f}, y {tcp[1]:.3f}, z {tcp[2]:.3f} m"
        return ""


def shadow_summary(shadow: ShadowHardware) -> str:
    """Return the greatest and median distances of the robot from its prediction, as lines of text."""
    steps = shadow.steps
    if not steps:
        return "shadow      no set-point"
    rows = (
        ("joints", [each.joints for each in steps], "rad", 1.0),
        ("tcp", [each.tcp for each in steps], "mm", 1000.0),
        ("force", [each.force for each in steps], "N", 1.0),
        ("torque", [each.torque for each in steps], "Nm", 1.0),
        ("opening", [each.opening for each in steps], "mm", 1000.0),
    )
    lines = [f"shadow      {len(steps)} set-points in {steps[-1].time:.2f} s, none of them sent"]
    lines += [
        f"  {name:<9} {scale * max(values):.3f} {unit} away from the prediction at most, "
        f"{scale * float(np.median(values)):.3f} {unit} in the median"
        for name, values, unit, scale in rows
    ]
    lines.append(f"refused     {shadow.refused or 'nothing, by limits of joints, speeds and workspace'}")
    return "\n".join(lines)
