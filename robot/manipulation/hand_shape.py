"""Hand as boxes in the view along its approach, with dimensions from the robot's model, and what its pads
meet."""

from __future__ import annotations

from dataclasses import dataclass

from ...world.pad_contacts import PadContacts, pad_contacts
from ...world.robot_model.description import GripperDescription
from ...world.shapes import CompoundMesh
from ...world.values import Pose


@dataclass(frozen=True, slots=True)
class Block:
    """Box of the hand in the view along its approach. x lies across the pads, y along their motion, m."""

    half_x: float
    inner: float
    outer: float
    """Sides along y, beyond the pad's face for a finger, or from the middle of the hand."""
    above: float
    """Height of its underside above the finger tips."""


@dataclass(frozen=True, slots=True)
class HandShape:
    """Hand in the view along its approach."""

    tip: float
    """Reach of the finger tips beyond the TCP, m."""
    max_width: float
    fingers: tuple[Block, ...]
    """Parts of one finger, from the pad's face outwards."""
    palm: tuple[Block, ...]

    @classmethod
    def of(cls, gripper: GripperDescription) -> HandShape:
        pad, pad_in_link = gripper.pads[0]
        fingers = [Block(pad.size[0] / 2, 0.0, pad.size[1], 0.0)]
        face = abs(pad_in_link.position[1]) - pad.size[1] / 2
        for box, in_link in gripper.bodies_of(0):
            middle = abs(in_link.position[1]) - face
            end = pad_in_link.position[2] + pad.size[2] / 2
            above = end - in_link.position[2] - box.size[2] / 2
            half = box.size[1] / 2
            fingers.append(Block(box.size[0] / 2, middle - half, middle + half, max(0.0, above)))
        palm = [
            Block(
                box.size[0] / 2 + abs(pose.position[0]),
                0.0,
                box.size[1] / 2 + abs(pose.position[1]),
                gripper.tip - pose.position[2] - box.size[2] / 2,
            )
            for box, pose in gripper.hand
        ]
        return cls(gripper.tip, gripper.max_width, tuple(fingers), tuple(palm))


def contacts_at(
    mesh: CompoundMesh, mesh_in_tcp: Pose, gripper: GripperDescription, opening: float
) -> PadContacts | None:
    """Return where the gripper's pads that close from an opening, m, meet a body; None: nothing is between
    them."""
    width, _, height = gripper.pads[0][0].size
    return pad_contacts(mesh, mesh_in_tcp, opening, width / 2, (gripper.tip - height, gripper.tip))
