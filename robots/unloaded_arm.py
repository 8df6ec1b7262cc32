"""The arm without what hangs on its wrist sensor: the sensor feels the rest."""

from __future__ import annotations

import pinocchio as pin

from .model import RobotModel


def bare_arm(model: RobotModel) -> pin.Model:
    """The arm's dynamics with nothing beyond the flange joint, whose frame is kept.

    What the wrist sensor reads, turned around, is then all that acts on it: hand, load and contacts alike,
    whatever they weigh and however they are accelerated.
    """
    full, joint = model.full, model.description.flange_joint
    data = full.createData()
    pin.framesForwardKinematics(full, data, pin.neutral(full))
    flange = full.frames[full.getFrameId(joint)]
    beyond = {full.getFrameId(joint)}
    hand = pin.Inertia.Zero()
    for index, frame in enumerate(full.frames):
        if index not in beyond:
            if frame.parentFrame not in beyond:
                continue
            beyond.add(index)
        moves = frame.parentJoint != flange.parentJoint
        if moves and frame.type == pin.JOINT:
            # A moving joint's inertia already holds what is fixed to it.
            hand = hand + data.oMi[frame.parentJoint].act(full.inertias[frame.parentJoint])
        elif not moves:
            hand = hand + data.oMf[index].act(frame.inertia)
    arm = model.arm.copy()
    last = arm.frames[arm.getFrameId(joint)].parentJoint
    carried = data.oMi[flange.parentJoint].inverse().act(hand)
    arm.inertias[last] = arm.inertias[last] - carried
    return arm
