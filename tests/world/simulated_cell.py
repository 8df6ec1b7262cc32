"""A small sorting cell and a Panda, built by hand for the tests of the simulation."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pybullet_data

from picktree.world.robot.description import GripperDescription, JointLimits, PadContact, RobotDescription
from picktree.world.scene.description import (
    Bin,
    CameraDescription,
    CatalogueEntry,
    Destination,
    Fixture,
    SceneDescription,
    Spawn,
)
from picktree.world.shapes import Box, ConvexMesh, Cylinder, Sphere
from picktree.world.values import ObjectId, Pose

ROOF = ((-0.02, -0.015, -0.01), (0.02, -0.015, -0.01), (-0.02, 0.015, -0.01), (0.02, 0.015, -0.01))
WEDGE = ConvexMesh((*ROOF, (-0.02, 0.0, 0.02), (0.02, 0.0, 0.02)), "wedge")
CATALOGUE = (
    CatalogueEntry("block", "box", Box((0.04, 0.04, 0.04)), 0.1, 0.6),
    CatalogueEntry("can", "cylinder", Cylinder(0.02, 0.08), 0.12, 0.5),
    CatalogueEntry("ball", "sphere", Sphere(0.02), 0.05, 0.6),
    CatalogueEntry("plate", "plate", Box((0.06, 0.04, 0.006)), 0.05, 0.6),
    CatalogueEntry("wedge", "mesh", WEDGE, 0.06, 0.6),
)


def looking_down(x: float, y: float, z: float) -> Pose:
    """An optical frame above (x, y) whose image has +x of the world upwards."""
    return Pose((x, y, z), (math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0))


def cell(**changes: object) -> SceneDescription:
    """Table, two bins, one camera, ten items of all shapes."""
    scene = SceneDescription(
        name="cell",
        robot="panda",
        fixtures=(Fixture(ObjectId("table"), Box((1.2, 1.6, 0.04)), Pose((0.5, 0.0, -0.02)), "light_grey"),),
        bins=(
            Bin(ObjectId("red_bin"), (0.25, 0.2, 0.1), 0.005, Pose((0.35, 0.55, 0.0))),
            Bin(ObjectId("blue_bin"), (0.25, 0.2, 0.1), 0.005, Pose((0.35, -0.55, 0.0))),
        ),
        cameras=(CameraDescription("overhead", looking_down(0.5, 0.0, 0.75), (320, 240), math.radians(60)),),
        catalogue=CATALOGUE,
        spawn=(
            Spawn(
                counts=(("block", 3), ("can", 3), ("ball", 1), ("plate", 2), ("wedge", 1)),
                colours=("red", "blue"),
                area=((0.35, -0.25), (0.65, 0.25)),
                lying=0.4,
            ),
        ),
        destinations=(
            Destination("colour == 'red'", ObjectId("red_bin")),
            Destination("colour == 'blue'", ObjectId("blue_bin")),
        ),
    )
    return replace(scene, **changes)  # type: ignore[arg-type]


def panda() -> RobotDescription:
    """pybullet_data's Panda with the numbers of its data sheet."""
    speeds = (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)
    lower = (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973)
    upper = (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973)
    accelerations = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
    torques = (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)
    limits = zip(lower, upper, speeds, accelerations, torques, strict=True)
    pad = Box((0.02, 0.008, 0.018))
    return RobotDescription(
        name="panda",
        urdf=str(Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf"),
        base_in_world=Pose(),
        joints=tuple(f"panda_joint{k}" for k in range(1, 8)),
        limits=tuple(JointLimits(*limit) for limit in limits),
        named={"home": (0.0, -0.6, 0.0, -2.4, 0.0, 1.8, 0.785)},
        tcp_link="panda_grasptarget",
        tcp_in_link=Pose(),
        flange_joint="panda_hand_joint",
        gripper=GripperDescription(
            joints=("panda_finger_joint1", "panda_finger_joint2"),
            fingers=("panda_leftfinger", "panda_rightfinger"),
            max_width=0.08,
            max_force=70.0,
            speed=0.1,
            pads=(
                (pad, Pose((0.0, 0.004, 0.0447))),
                (pad, Pose((0.0, -0.004, 0.0447))),
            ),
            pad_contact=PadContact(),
            gear=-1.0,
            tip=0.0072,
            palm=0.039,
            hand=((Box((0.06, 0.204, 0.07)), Pose((0.0, 0.0, -0.074))),),
            finger_boxes=(Box((0.022, 0.02, 0.05)), Pose((0.0, 0.01, -0.016))),
        ),
        disabled_pairs=(),
    )
