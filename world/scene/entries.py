"""From the entries of a scene file to the values of a scene, with what no single value can be wrong about."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..files.checked import Checker
from ..files.document import Location
from ..shapes import Box, Cylinder, Shape, Sphere
from ..values import Array, ObjectId, Pose, Vector3
from .description import Bin, CameraDescription, CatalogueEntry, Fixture, Form
from .meshes import MeshError, load_convex
from .schema import CameraFile, CatalogueFile, FixtureFile

RESERVED = ("arm", "gripper", "hand", "aside")
"""Names that the belief uses for other things."""
FORMS: tuple[Form, ...] = ("box", "cylinder", "sphere", "plate", "mesh")
FLAT = 1 / 3
"""A plate's height is at most this share of its shorter side."""


def body(check: Checker, name: str, entry: FixtureFile) -> Fixture | Bin | None:
    """A fixture or a bin; None when it has faults."""
    loc: Location = ("fixtures", name)
    which = check.one_of(loc, ("box", "bin"))
    before = len(check.faults)
    if name in RESERVED or (which == "bin" and name == "table"):
        check.fault(
            loc, f"the name {name!r} is taken", f"no body may be called {', '.join(RESERVED)}", key=True
        )
    if entry.rpy is not None and entry.yaw is not None:
        check.fault((*loc, "yaw"), "'rpy' and 'yaw' exclude each other", key=True)
    if which == "bin":
        _check_bin(check, loc, entry)
    elif entry.wall is not None:
        check.fault((*loc, "wall"), "only a bin has walls", key=True)
    if which is None or len(check.faults) > before:
        return None
    pose = Pose.from_rpy(entry.at, entry.rpy or (0.0, 0.0, entry.yaw or 0.0))
    if entry.bin is not None and entry.wall is not None:
        return Bin(ObjectId(name), entry.bin, entry.wall, pose, entry.colour)
    assert entry.box is not None
    return Fixture(ObjectId(name), Box(entry.box), pose, entry.colour)


def _check_bin(check: Checker, loc: Location, entry: FixtureFile) -> None:
    if entry.rpy is not None:
        check.fault((*loc, "rpy"), "a bin stands upright: give its 'yaw'", key=True)
    if entry.wall is None:
        check.fault(loc, "'wall' is missing", "the thickness of the bin's walls, as 5 mm", key=True)
    elif entry.bin is not None:
        x, y, z = entry.bin
        if 2 * entry.wall >= min(x, y) or entry.wall >= z:
            check.fault((*loc, "wall"), f"walls of {entry.wall:g} m leave no room inside")


def camera(check: Checker, name: str, entry: CameraFile) -> CameraDescription | None:
    """A camera with its optical frame; None when it has faults."""
    loc: Location = ("cameras", name)
    before = len(check.faults)
    pose = None
    if np.allclose(entry.at, entry.look_at, atol=1e-6):
        check.fault((*loc, "look_at"), "the camera looks at itself", "'at' and 'look_at' must differ")
    else:
        pose = looking(entry.at, entry.look_at, entry.up)
        if pose is None:
            check.fault((*loc, "up"), "'up' lies along the line of sight", "name what is up in the picture")
    if entry.near >= entry.far:
        at: Location = (*loc, "near") if check.document.get((*loc, "near")) is not None else (*loc, "far")
        check.fault(at, f"'near' ({entry.near:g} m) is not less than 'far' ({entry.far:g} m)")
    if pose is None or len(check.faults) > before:
        return None
    return CameraDescription(
        name=name,
        pose=pose,
        size=entry.size,
        fov=entry.fov,
        depth_noise=entry.depth_noise,
        edge_dropout=entry.edge_dropout,
        near=entry.near,
        far=entry.far,
        error=Pose.from_rpy(entry.error.offset, entry.error.rpy),
    )


def looking(at: Vector3, target: Vector3, up: Vector3 | None) -> Pose | None:
    """The optical frame (x right, y down, z forward) at `at` that looks at `target`.

    None when `up` is along the line of sight. Without `up`, the world's z is up in the picture, or its x
    when the camera looks straight up or down.
    """
    forward = _unit(np.subtract(target, at))
    candidates = (up,) if up is not None else ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    for upward in candidates:
        right = np.cross(forward, np.array(upward))
        if float(np.linalg.norm(right)) > 1e-6 * max(1e-12, float(np.linalg.norm(upward))):
            right = _unit(right)
            return Pose.from_rotation(at, np.column_stack([right, np.cross(forward, right), forward]))
    return None


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)


def kind(check: Checker, name: str, entry: CatalogueFile) -> CatalogueEntry | None:
    """A kind of the catalogue; None when it has faults."""
    loc: Location = ("catalogue", name)
    form = check.one_of(loc, FORMS)
    if name == "unknown":
        check.fault(loc, "the name 'unknown' is taken", "it stands for what fits no kind", key=True)
        return None
    shape = _shape(check, loc, entry) if form is not None else None
    if form is None or shape is None:
        return None
    named: Form = next(f for f in FORMS if f == form)
    return CatalogueEntry(name, named, shape, entry.mass, entry.friction, entry.force_limit)


def _shape(check: Checker, loc: Location, entry: CatalogueFile) -> Shape | None:
    if entry.cylinder is not None:
        return Cylinder(entry.cylinder.radius, entry.cylinder.height)
    if entry.sphere is not None:
        return Sphere(entry.sphere.radius)
    if entry.plate is not None:
        x, y, z = entry.plate
        if z > FLAT * min(x, y):
            hint = "its height, the third number, is at most a third of the shorter side; else it is a box"
            check.fault((*loc, "plate"), "a plate is flat", hint)
            return None
        return Box(entry.plate)
    if entry.mesh is not None:
        at = (*loc, "mesh")
        try:
            # Relative to the file in which it is named, which may be the base of this one.
            return load_convex(Path(check.document.mark(at).file).parent / entry.mesh.file, entry.mesh.scale)
        except MeshError as error:
            check.fault(at, error.message, error.hint)
            return None
    assert entry.box is not None
    return Box(entry.box)
