"""A small sorting cell and a Panda, for the tests of the simulation."""

from __future__ import annotations

import math
from dataclasses import replace

from picktree.world import Box, ConvexMesh, Cylinder, ObjectId, Pose, Sphere
from picktree.world.robot_model import RobotDescription, load_robot
from picktree.world.scene import Bin, CameraDescription, CatalogueEntry, Fixture, SceneDescription, Spawn
from picktree.world.scene.description import Destination

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
        cameras=(
            CameraDescription(
                "overhead", looking_down(0.5, 0.0, 0.75), size=(320, 240), fov=math.radians(60)
            ),
        ),
        catalogue=CATALOGUE,
        spawn=(
            Spawn(
                counts={"block": 3, "can": 3, "ball": 1, "plate": 2, "wedge": 1},
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
    return load_robot("panda")
