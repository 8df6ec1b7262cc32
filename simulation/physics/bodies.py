"""Items in pybullet, with their contact parameters."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

import numpy as np

from picktree.files import PicktreeError, disk_cache
from picktree.simulation import SpawnedItem, floor_height, support_height
from picktree.world import (
    COLOURS,
    Array,
    Box,
    CompoundMesh,
    ConvexMesh,
    Cylinder,
    ObjectId,
    Pose,
    Shape,
    Sphere,
    Vector3,
    convex_decomposition,
    convex_hull,
    convex_parts,
    hole_geometry,
    mesh_reader,
)
from picktree.world.scene import TILE_HEIGHT, Bin, Fixture, SceneDescription, tile_body

from .engine import pb

MeshLists: TypeAlias = tuple[list[list[float]], list[int], list[list[float]]]
"""Corners, order and normals of triangles, as pybullet takes them."""


def add_holed_fixture(fixture: Fixture, client: int) -> tuple[int, ...]:
    """Add the fixture's convex pieces for collisions, invisible to cameras; return pybullet's body
    numbers."""
    numbers: list[int] = []
    for piece, piece_in_fixture in hole_geometry.convex_pieces(fixture):
        pose = fixture.pose @ piece_in_fixture
        shape = pb.createCollisionShape(pb.GEOM_MESH, vertices=piece.vertices, physicsClientId=client)
        number = pb.createMultiBody(
            0.0, shape, -1, pose.position, pose.orientation, useMaximalCoordinates=1, physicsClientId=client
        )
        # pybullet enlarges hulls by 1 mm all round, which would take 2 mm from every hole.
        pb.changeDynamics(number, -1, collisionMargin=0.0, physicsClientId=client)
        numbers.append(number)
    return tuple(numbers)


def holed_visual(fixture: Fixture, rgba: tuple[float, float, float, float], client: int) -> int:
    """Create a visual shape of the fixture in its own frame, with the insides of its holes."""
    return _mesh_visual(_lists(fixture), rgba, client)


def _mesh_visual(lists: MeshLists, rgba: tuple[float, float, float, float], client: int) -> int:
    corners, order, normals = lists
    return pb.createVisualShape(
        pb.GEOM_MESH,
        vertices=corners,
        indices=order,
        normals=normals,
        rgbaColor=rgba,
        physicsClientId=client,
    )


@cache
def _lists(fixture: Fixture) -> MeshLists:
    """Return corners, indices and normals of the fixture's surface. They are made once: pybullet never frees
    the lists."""
    assert isinstance(fixture.shape, Box)
    seen = hole_geometry.surface(fixture.shape, fixture.holes)
    return seen.corners.tolist(), list(range(len(seen.corners))), seen.normals.tolist()


STATIC_BODY_FRICTION = 1.0
"""Friction of static bodies. pybullet multiplies the two bodies' coefficients: an item's own is then the
pair's."""


ROLLING_FRICTION = 1e-3
"""Rolling and spinning friction of round items, m. With less, a lying cylinder gains energy from the solver
and rolls away. Flat items have four contacts instead, and would make each step three times as expensive."""


ROUND_FORMS = ("cylinder", "sphere", "mesh")


MAX_COLLISION_PARTS = 16
"""Greatest number of parts of a collision shape; `createCollisionShapeArray` silently drops the rest."""


MOVING_BODY_GROUP, ALL_GROUPS_MASK = 1, -1
"""Collision group of moving bodies, and the mask of the groups with which they collide."""
FLOOR_ID = ObjectId("floor")


def add_fixed(scene: SceneDescription, base_in_world: Pose, client: int) -> dict[int, str]:
    """Add floor, fixtures and bins for collisions, invisible to cameras; return their names by pybullet's
    body number."""
    height = floor_height(scene.fixtures, base_in_world.position[2])
    floor = Fixture(FLOOR_ID, Box((10.0, 10.0, 0.1)), Pose((0.0, 0.0, height - 0.05)))
    bodies: dict[int, str] = {}
    for fixture in (floor, *scene.fixtures):
        check_body(fixture.id, fixture.shape, fixture.pose)
        if fixture.holes:
            bodies |= dict.fromkeys(add_holed_fixture(fixture, client), str(fixture.id))
            continue
        shape = _collision(fixture.shape, client)
        bodies[_fixed(shape, -1, fixture.pose, client)] = fixture.id
    for each in scene.bins:
        bodies[_fixed(_bin_collision(each, scene, client), -1, each.pose, client)] = each.id
    for body in bodies:
        pb.changeDynamics(
            body, -1, lateralFriction=STATIC_BODY_FRICTION, restitution=0.0, physicsClientId=client
        )
        # A body without a visual shape would show its collision shape.
        pb.changeVisualShape(body, -1, rgbaColor=(1.0, 1.0, 1.0, 0.0), physicsClientId=client)
    return bodies


def add_obstacle(body: Fixture, client: int) -> int:
    """Add a static body, for collisions and cameras; return pybullet's body number."""
    check_body(body.id, body.shape, body.pose)
    number = _fixed(
        _collision(body.shape, client), _visual(body.shape, body.colour, client), body.pose, client
    )
    pb.changeDynamics(
        number, -1, lateralFriction=STATIC_BODY_FRICTION, restitution=0.0, physicsClientId=client
    )
    return number


def add_scenery(fixtures: Iterable[Fixture], bins: Iterable[Bin], client: int) -> None:
    """Add fixtures and bins for cameras only, without collisions."""
    for fixture in fixtures:
        if fixture.holes:
            visual = holed_visual(fixture, _rgba(fixture.colour), client)
        else:
            visual = _visual(fixture.shape, fixture.colour, client)
        _fixed(-1, visual, fixture.pose, client)
        for tile in fixture.tiles:
            box, inner = tile_body(tile, 2 * TILE_HEIGHT)
            _fixed(-1, _visual(box, tile.colour, client), fixture.pose @ inner, client)
    for each in bins:
        for box, pose in each.parts():
            _fixed(-1, _visual(box, each.colour, client), pose, client)


def _fixed(collision: int, visual: int, pose: Pose, client: int) -> int:
    return pb.createMultiBody(
        0.0,
        collision,
        visual,
        pose.position,
        pose.orientation,
        useMaximalCoordinates=1,
        physicsClientId=client,
    )


ItemShapes: TypeAlias = dict[tuple[Shape, str], tuple[int, int]]
"""pybullet's numbers of collision and visual shapes, by shape and colour."""


def add_item(item: SpawnedItem, pose: Pose, client: int, known: ItemShapes) -> int:
    """Add an item at `pose`; return pybullet's body number.

    known: shapes of the simulation so far; the item's are added. pybullet never frees a shape, and a feed
    brings thousands of items.
    Raises PicktreeError for an invalid body or mass.
    """
    check_body(item.id, item.entry.shape, pose)
    if not (math.isfinite(item.entry.mass) and item.entry.mass > 0):
        raise PicktreeError(f"{item.id}: mass {item.entry.mass} kg; it must be positive")
    shape = item.entry.shape
    if (shape, item.colour) not in known:
        known[shape, item.colour] = _collision(shape, client), _visual(shape, item.colour, client)
    body = pb.createMultiBody(
        item.entry.mass,
        *known[shape, item.colour],
        pose.position,
        pose.orientation,
        useMaximalCoordinates=1,
        physicsClientId=client,
    )
    set_friction(body, item.entry.friction, client)
    rolling = ROLLING_FRICTION if item.entry.form in ROUND_FORMS and not item.rolls else 0.0
    pb.changeDynamics(
        body,
        -1,
        rollingFriction=rolling,
        spinningFriction=rolling,
        restitution=0.0,
        physicsClientId=client,
    )
    if isinstance(shape, ConvexMesh):
        pb.changeDynamics(body, -1, collisionMargin=0.0, physicsClientId=client)
        set_mass(body, shape, item.entry.mass, client)
    return body


def set_friction(body: int, friction: float, client: int) -> None:
    if not (math.isfinite(friction) and friction >= 0):
        raise PicktreeError(f"friction {friction}; it must be 0 or more")
    pb.changeDynamics(body, -1, lateralFriction=friction, physicsClientId=client)


def forget_contacts(body: int, client: int) -> None:
    """Restart the contacts of a body: a contact keeps the friction with which it began."""
    pb.setCollisionFilterGroupMask(body, -1, MOVING_BODY_GROUP, ALL_GROUPS_MASK, physicsClientId=client)


def set_mass(body: int, shape: Shape, mass: float, client: int) -> None:
    """Set a body's mass, kg, and the inertia of its shape with that mass. Raises PicktreeError when the mass
    is not positive."""
    if not (math.isfinite(mass) and mass > 0):
        raise PicktreeError(f"mass {mass} kg; it must be positive")
    pb.changeDynamics(body, -1, mass=mass, localInertiaDiagonal=inertia(shape, mass), physicsClientId=client)


def inertia(shape: Shape, mass: float) -> Vector3:
    """Return the moments about the shape's own axes, kg·m²; a mesh's products of inertia are neglected."""
    match shape:
        case Box((x, y, z)):
            return mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12
        case Cylinder(radius, height):
            across = mass * (3 * radius * radius + height * height) / 12
            return across, across, mass * radius * radius / 2
        case Sphere(radius):
            moment = 0.4 * mass * radius * radius
            return moment, moment, moment
        case CompoundMesh(parts=parts):
            _, spread = convex_decomposition.centre_and_spread(list(map(np.array, parts)))
            ixx, iyy, izz = (float(m) for m in mass * (np.trace(spread) - np.diag(spread)))
            return ixx, iyy, izz
        case ConvexMesh():
            hull = _hull(shape.vertices)
            ixx, iyy, izz = (float(m) for m in np.diag(hull["inertia"]) * mass / float(hull["volume"]))
            return ixx, iyy, izz


def check_body(name: str, shape: Shape, pose: Pose) -> None:
    """Raise PicktreeError for values that pybullet accepts silently: NaN, a size that is not positive, no
    unit quaternion."""
    match shape:
        case Box(size):
            sizes: Iterable[float] = size
        case Cylinder(radius, height):
            sizes = (radius, height)
        case Sphere(radius):
            sizes = (radius,)
        case ConvexMesh():
            sizes = np.ptp(np.array(shape.vertices), axis=0).tolist()
    if not all(math.isfinite(s) and s > 0 for s in sizes):
        raise PicktreeError(f"{name}: size {tuple(sizes)}; every size must be positive")
    if not all(map(math.isfinite, pose.position)):
        raise PicktreeError(f"{name}: position {pose.position}; it must be finite")
    if not math.isclose(math.hypot(*pose.orientation), 1.0, abs_tol=1e-6):
        raise PicktreeError(f"{name}: orientation {pose.orientation}; it must be a unit quaternion")


MAX_FLOOR_DEPTH = 0.05
"""Greatest depth to which a bin's floor collides below its underside, m."""


def _bin_collision(each: Bin, scene: SceneDescription, client: int) -> int:
    """Create the collision shape of a bin.

    Its floor reaches into its support: a thin item that falls from 12 cm passes half of a floor of 5 mm in
    one step, and would be pushed out below."""
    (floor, floor_pose), *walls = each.parts()
    x, y, z = each.pose.position
    stands = support_height(scene.fixtures, x, y)
    below = MAX_FLOOR_DEPTH if stands is not None and abs(stands - z) < 1e-3 else 0.0
    deeper = Box((floor.size[0], floor.size[1], floor.size[2] + below))
    parts = [(deeper, floor_pose.shifted((0.0, 0.0, -below / 2))), *walls]
    if len(parts) > MAX_COLLISION_PARTS:
        raise PicktreeError(f"{each.id}: {len(parts)} parts; pybullet takes {MAX_COLLISION_PARTS}")
    for box, _ in parts:
        check_body(each.id, box, each.pose)
    to_bin = each.pose.inverse()
    local = [to_bin @ pose for _, pose in parts]
    return pb.createCollisionShapeArray(
        [pb.GEOM_BOX] * len(parts),
        halfExtents=[_halves(box.size) for box, _ in parts],
        collisionFramePositions=[pose.position for pose in local],
        collisionFrameOrientations=[pose.orientation for pose in local],
        physicsClientId=client,
    )


def _collision(shape: Shape, client: int) -> int:
    match shape:
        case Box(size):
            return pb.createCollisionShape(pb.GEOM_BOX, halfExtents=_halves(size), physicsClientId=client)
        case Cylinder(radius, height):
            return pb.createCollisionShape(
                pb.GEOM_CYLINDER, radius=radius, height=height, physicsClientId=client
            )
        case Sphere(radius):
            return pb.createCollisionShape(pb.GEOM_SPHERE, radius=radius, physicsClientId=client)
        case CompoundMesh(parts=parts):
            file = _parts_file(parts, ENGINE_MARGIN)
            return pb.createCollisionShape(pb.GEOM_MESH, fileName=file, physicsClientId=client)
        case ConvexMesh():
            return pb.createCollisionShape(pb.GEOM_MESH, vertices=shape.vertices, physicsClientId=client)


def _visual(shape: Shape, colour: str, client: int) -> int:
    rgba = _rgba(colour)
    match shape:
        case Box(size):
            return pb.createVisualShape(
                pb.GEOM_BOX, halfExtents=_halves(size), rgbaColor=rgba, physicsClientId=client
            )
        case Cylinder(radius, height):
            return pb.createVisualShape(
                pb.GEOM_CYLINDER, radius=radius, length=height, rgbaColor=rgba, physicsClientId=client
            )
        case Sphere(radius):
            return pb.createVisualShape(pb.GEOM_SPHERE, radius=radius, rgbaColor=rgba, physicsClientId=client)
        case ConvexMesh():
            return _mesh_visual(_faces(shape), rgba, client)


@cache
def _faces(mesh: ConvexMesh) -> MeshLists:
    """Return corners, order and normals of the triangles of its parts. They are made once: pybullet never
    frees the lists."""
    hulls = [_hull(part.vertices) for part in convex_parts(mesh)]
    corners: Array = np.concatenate([hull["triangles"].reshape(-1, 3) for hull in hulls])
    normals: Array = np.concatenate([np.repeat(hull["normals"], 3, axis=0) for hull in hulls])
    return corners.tolist(), list(range(len(corners))), normals.tolist()


ENGINE_MARGIN = 0.001
"""Distance by which the engine enlarges each part of a body of several, m; it takes none for that body."""


MAX_MARGIN_SHARE = 0.6
"""Share of the distance from a part's middle to its faces that the engine's margin may make up."""


@cache
def _parts_file(parts: tuple[tuple[Vector3, ...], ...], margin: float) -> str:
    """Write convex parts, each smaller by `margin` all round, as an OBJ file of this process; return its
    path."""
    text = mesh_reader.hulls_text([_shrunk(np.array(part), margin) for part in parts])
    # The engine keeps a file's shape under its name, and forked processes share the folder.
    file = Path(_folder().name) / f"{hashlib.sha256(text.encode()).hexdigest()}.obj"
    beside = file.with_suffix(f".{os.getpid()}")
    beside.write_text(text, encoding="ascii")
    beside.rename(file)
    return str(file)


@cache
def _folder() -> TemporaryDirectory[str]:
    return TemporaryDirectory(prefix="picktree-parts-")


def _shrunk(corners: Array, margin: float) -> Array:
    """Return the corners of the body whose distance from the outside of a hull is the margin.

    A part that is thinner than that keeps some of its thickness.
    """
    middle = corners.mean(axis=0)
    faces = np.unique(np.round(convex_hull(corners - middle).equations, 9), axis=0)
    room = float((-faces[:, 3]).min())
    faces[:, 3] += min(margin, MAX_MARGIN_SHARE * room)
    # A face at distance d with unit normal n is the point n / d of the polar body.
    polar = convex_hull(-faces[:, :3] / faces[:, 3:])
    planes = np.unique(np.round(polar.equations, 9), axis=0)
    return middle - planes[:, :3] / planes[:, 3:]


def _hull(vertices: tuple[Vector3, ...]) -> dict[str, Array]:
    """Return the triangles (m, 3, 3) of a hull, their normals (m, 3), its volume and its moment of inertia.

    Hulls that were made before come from the disk cache.
    """

    def compute() -> dict[str, Array]:
        from trimesh import Trimesh  # slow to import

        hull = Trimesh(np.array(vertices)).convex_hull
        values = (hull.triangles, hull.face_normals, hull.volume, hull.moment_inertia)
        names = ("triangles", "normals", "volume", "inertia")
        return {name: np.asarray(v, dtype=np.float64) for name, v in zip(names, values, strict=True)}

    makers = (Path(__file__), "numpy", "scipy", "trimesh")
    return disk_cache.cached_arrays("body-hull", (repr(vertices),), makers, compute)


def _halves(size: Vector3) -> Sequence[float]:
    return [s / 2 for s in size]


def _rgba(colour: str) -> tuple[float, float, float, float]:
    try:
        return (*COLOURS[colour], 1.0)
    except KeyError:
        raise PicktreeError(f"unknown colour {colour!r}; known: {', '.join(COLOURS)}") from None
