"""What the engine's wrist sensor does not feel of the gear between two fingers that slide."""

from __future__ import annotations

from ....world.values import Pose, Quaternion, Vector3, rotated
from ..engine.pybullet_import import pb

MISSED = 0.86
"""Share of the gear's reaction on the hand that the engine leaves out of the joint feedback: with a contact
at one finger it gives 12 to 17 % of what the arm's joints hold, and of the fingers' own weight as little. The
torque is right without it."""


class GearReaction:
    """Two sliders that a gear makes mirror images of each other: what pushes one of them along its slide
    comes to the hand by the gear alone, and is to be added at the wrist."""

    def __init__(self, gear: int, body: int, slider: int, flange: int, client: int) -> None:
        """`gear`: the constraint; `slider`: the joint of its first finger; `flange`: that of the sensor."""
        self._gear = gear
        self._client = client
        hand = pb.getLinkState(body, flange, 0, 1, client)
        finger = pb.getLinkState(body, slider, 0, 1, client)
        finger_in_hand = Pose(hand[4], hand[5]).inverse() @ Pose(finger[4], finger[5])
        self._axis: Vector3 = rotated(finger_in_hand.orientation, pb.getJointInfo(body, slider, client)[13])

    def read(self, turn: Quaternion) -> Vector3:
        """Force on the wrist in the world's axes, N, the hand being turned like that."""
        force = -2.0 * MISSED * pb.getConstraintState(self._gear, self._client)[0]
        x, y, z = rotated(turn, self._axis)
        return (force * x, force * y, force * z)
