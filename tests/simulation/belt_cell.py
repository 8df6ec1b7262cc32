"""A belt with items on it, for the tests of belts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from picktree.simulation import BeltDrive, belt_feed
from picktree.simulation.kinematic import KinematicHardware
from picktree.simulation.physics import PhysicsHardware
from picktree.world import Box, Cylinder, ObjectId, Pose, Quaternion, Sphere, Vector3, bottom
from picktree.world.scene import Belt, CatalogueEntry, Fixture, SceneDescription, Spawn

from .simulated_cell import WEDGE, cell
from .test_simulation_physics import SILENT
from .test_simulation_sleeping import standing

BELT = ObjectId("belt")
TOP = 0.05
AT = (0.55, 0.0)
"""The belt's middle; it runs along the world's y."""
UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)
ROLLING: Quaternion = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
"""A cylinder whose axis lies across the belt."""
KINDS = (
    CatalogueEntry("block", "box", Box((0.04, 0.04, 0.04)), 0.1, 0.6),
    CatalogueEntry("can", "cylinder", Cylinder(0.022, 0.075), 0.12, 0.5),
    CatalogueEntry("ball", "sphere", Sphere(0.02), 0.05, 0.6),
    CatalogueEntry("plate", "plate", Box((0.06, 0.04, 0.008)), 0.06, 0.5),
    CatalogueEntry("wedge", "mesh", WEDGE, 0.06, 0.6),
)


def belt_scene(*kinds: str, speed: float = 0.1, eye: float = 0.4, length: float = 1.6) -> SceneDescription:
    """Nothing but a belt, whose items are of these kinds."""
    fixture = Fixture(BELT, Box((length, 0.2, TOP)), Pose.from_rpy((*AT, TOP / 2), (0, 0, math.pi / 2)))
    half = length / 2 - 0.05
    ground = ((AT[0] - 0.05, -half), (AT[0] + 0.05, half))
    entries = tuple(
        replace(next(e for e in KINDS if e.kind == kind), kind=f"{kind}{n}") for n, kind in enumerate(kinds)
    )
    spawn = (Spawn({e.kind: 1 for e in entries}, ("red",), ground),) if entries else ()
    return cell(
        fixtures=(fixture,),
        bins=(),
        destinations=(),
        belts=(Belt(BELT, speed, eye),),
        catalogue=entries,
        spawn=spawn,
        noise=SILENT,
    )


def lying(scene: SceneDescription, along: Sequence[float], turns: Sequence[Quaternion] = ()) -> list[Pose]:
    """Poses of the scene's items on the belt, so far from its middle along its way."""
    turned = [*turns, *(UPRIGHT for _ in along[len(turns) :])]
    shapes = [entry.shape for entry in scene.catalogue]
    return [
        Pose((AT[0], y, TOP - bottom(shape, Pose(orientation=turn))), turn)
        for shape, y, turn in zip(shapes, along, turned, strict=True)
    ]


def on_belt(
    scene: SceneDescription, along: Sequence[float], turns: Sequence[Quaternion] = ()
) -> PhysicsHardware:
    """The scene in physics with its items there, awake and at rest."""
    hardware = standing(scene, *lying(scene, along, turns))
    wait(hardware, 0.5)
    return hardware


Hardware = PhysicsHardware | KinematicHardware


def belt_of(hardware: Hardware) -> BeltDrive:
    return hardware.belts[BELT]


def wait(hardware: Hardware, seconds: float) -> None:
    for _ in range(round(seconds * 240)):
        hardware.step()


def ride(hardware: Hardware, way: float) -> None:
    """Let the belt run so far, and stop."""
    belt = belt_of(hardware)
    brake = belt.belt.speed**2 / 2 / belt_feed.BELT_ACCELERATION
    end = belt.travelled + way - brake
    belt.go()
    while belt.travelled < end:
        hardware.step()
    belt.halt()
    while belt.moving:
        hardware.step()


def positions(hardware: Hardware) -> list[Vector3]:
    return [body.pose.position for body in hardware.truth()]
