"""Cell file: a scene with its spawned items and its robot as one JSON object, for a robot process that knows
nothing of picktree.

Poses are `at` (x, y, z) and `xyzw`; lengths in m, angles in rad. The key `picktree_cell` is the version. The
reader is the package `picktree_cell`; docs/drivers.md describes the keys.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from picktree.files import PicktreeError
from picktree.simulation.physics import patched_urdf
from picktree.world import (
    COLOURS,
    Box,
    CompoundMesh,
    ConvexMesh,
    Cylinder,
    Pose,
    Shape,
    Sphere,
    hole_geometry,
)
from picktree.world.robot_model import GripperDescription, RobotDescription, SliderPair, fingers_of
from picktree.world.scene import (
    TILE_HEIGHT,
    CameraDescription,
    Fixture,
    SceneDescription,
    destinations,
    tile_body,
)

from .feeder import has_feeder
from .footprints import floor_height
from .spawn import SpawnedItem, displace_fixtures, spawn_items
from .truth import TrueBody

CELL_FILE_VERSION: Final = 1
_OPENING_SAMPLES: Final = 33
"""Number of openings at which the positions of the finger joints are written."""


def cell_file(scene: SceneDescription, robot: RobotDescription, seed: int) -> dict[str, Any]:
    """Return the cell as plain values: robot, fixtures, items at their spawned poses, cameras and places.

    Items and true fixtures are those of a simulation with this seed. Raises PicktreeError for a scene with a
    feed, belts or heaps: the cell has only what lies there at the beginning.
    """
    if has_feeder(scene) or scene.heaped or scene.belts:
        raise PicktreeError(
            f"{scene.source or scene.name}: a cell file has items that lie on fixtures from the "
            "beginning; this scene has a feed, a belt or a heap"
        )
    real = displace_fixtures(scene, seed)
    rule = destinations.destination_rule(scene.destinations)
    items = spawn_items(scene, seed)
    return {
        "picktree_cell": CELL_FILE_VERSION,
        "scene": scene.name,
        "seed": seed,
        "robot": _robot(replace(robot, tool=scene.tool_error)),
        "workspace": [*scene.limits.workspace.min, *scene.limits.workspace.max],
        "force": scene.limits.force,
        "floor": floor_height(scene.fixtures, robot.base_in_world.position[2]),
        "fixtures": [part for fixture in (*real.fixtures, *scene.unknown) for part in _fixture(fixture)]
        + [
            {"id": f"{each.id}/{n}", "colour": _colour(each.colour), **_pose(pose), **_shape(box)}
            for each in scene.bins
            for n, (box, pose) in enumerate(each.parts())
        ],
        "items": [
            _item(item, rule(TrueBody.of(item.id, item.entry, item.colour, item.pose))) for item in items
        ],
        "places": [*_bins(scene), *_holes(real.fixtures)],
        "cameras": [_camera(camera) for camera in scene.cameras],
    }


def _robot(robot: RobotDescription) -> dict[str, Any]:
    with TemporaryDirectory(prefix="picktree-") as folder:
        urdf = patched_urdf(robot, Path(folder)).replace(f"{folder}/", "")
        meshes = {
            file.name: base64.b64encode(file.read_bytes()).decode("ascii")
            for file in sorted(Path(folder).iterdir())
        }
    return {
        "name": robot.name,
        "urdf": urdf,
        "meshes": meshes,
        "base": _pose(robot.base_in_world),
        "joints": [
            {
                "name": name,
                "lower": limit.lower,
                "upper": limit.upper,
                "velocity": limit.velocity,
                "acceleration": limit.acceleration,
                "torque": limit.torque,
            }
            for name, limit in zip(robot.joints, robot.limits, strict=True)
        ],
        "home": list(robot.named["home"]),
        "flange_joint": robot.flange_joint,
        "tcp": {"link": robot.tcp_link, **_pose(robot.tcp_in_link)},
        "excluded": [list(pair) for pair in robot.disabled_pairs],
        "gripper": _gripper(robot.gripper),
    }


def _gripper(gripper: GripperDescription) -> dict[str, Any]:
    """Return the gripper, with the positions of all finger joints over the opening."""
    fingers = fingers_of(gripper)
    low, high = gripper.min_width, gripper.max_width
    widths = [low + (high - low) * k / (_OPENING_SAMPLES - 1) for k in range(_OPENING_SAMPLES)]
    return {
        "joints": list(gripper.joints),
        "sliders": isinstance(fingers, SliderPair),
        "links": list(gripper.fingers),
        "widths": widths,
        "positions": [list(fingers.positions(width)) for width in widths],
        "max_width": high,
        "max_force": gripper.max_force,
        "speed": gripper.speed,
        "friction": gripper.pad_contact.friction,
    }


def _fixture(fixture: Fixture) -> Iterator[dict[str, Any]]:
    """Yield the convex bodies of a fixture: one without holes, and the squares of a target."""
    colour = _colour(fixture.colour)
    for n, tile in enumerate(fixture.tiles):
        box, inner = tile_body(tile, 2 * TILE_HEIGHT)
        pose = _pose(fixture.pose @ inner)
        yield {"id": f"{fixture.id}/tile_{n}", "colour": _colour(tile.colour), **pose, **_shape(box)}
    if not fixture.holes:
        yield {"id": str(fixture.id), "colour": colour, **_pose(fixture.pose), **_shape(fixture.shape)}
        return
    for n, (piece, pose) in enumerate(hole_geometry.convex_pieces(fixture)):
        yield {"id": f"{fixture.id}/{n}", "colour": colour, **_pose(fixture.pose @ pose), **_shape(piece)}


def _item(item: SpawnedItem, destination: str | None) -> dict[str, Any]:
    entry, shape = item.entry, item.entry.shape
    parts = [ConvexMesh(part, "") for part in shape.parts] if isinstance(shape, CompoundMesh) else [shape]
    return {
        "id": str(item.id),
        "kind": entry.kind,
        "form": entry.form,
        "colour": _colour(item.colour),
        "colour_name": item.colour,
        "mass": entry.mass,
        "friction": entry.friction,
        "destination": destination,
        "parts": [_shape(part) for part in parts],
        **_pose(item.pose),
    }


def _bins(scene: SceneDescription) -> Iterator[dict[str, Any]]:
    for each in scene.bins:
        low, high = each.inside()
        yield {"id": str(each.id), "low": list(low), "high": list(high), **_pose(each.pose)}


def _holes(fixtures: tuple[Fixture, ...]) -> Iterator[dict[str, Any]]:
    """Yield the holes as places: an item is in one when it reaches down to four fifths of its depth."""
    for fixture in fixtures:
        for hole in fixture.holes:
            x, y = (size / 2 for size in hole.size)
            yield {
                "id": str(hole.id),
                "low": [-x, -y, -1.1 * hole.depth],
                "high": [x, y, -0.8 * hole.depth],
                "fixture": str(fixture.id),
                **_pose(fixture.pose @ hole.pose),
            }


def _camera(camera: CameraDescription) -> dict[str, Any]:
    """Return a camera with its true pose: in the world, or in the TCP's frame on the hand."""
    return {
        "name": camera.name,
        "on": camera.on,
        "size": list(camera.size),
        "fov": camera.fov,
        "near": camera.near,
        "far": camera.far,
        "depth_noise": camera.depth_noise,
        "edge_dropout": camera.edge_dropout,
        **_pose(camera.pose @ camera.error),
    }


def _shape(shape: Shape) -> dict[str, Any]:
    match shape:
        case Box(size):
            return {"shape": "box", "size": list(size)}
        case Cylinder(radius, height):
            return {"shape": "cylinder", "radius": radius, "height": height}
        case Sphere(radius):
            return {"shape": "sphere", "radius": radius}
        case ConvexMesh():
            return {"shape": "mesh", "vertices": [list(vertex) for vertex in shape.vertices]}


def _pose(pose: Pose) -> dict[str, Any]:
    return {"at": list(pose.position), "xyzw": list(pose.orientation)}


def _colour(name: str) -> list[float]:
    return list(COLOURS[name])
