"""Entries of scene files: checks that need several values, and conversion to values of the scene."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from ...files.disk_cache import cached_arrays
from ...files.marks import Location
from ...files.yaml.document_checker import DocumentChecker
from ...files.yaml.file_text import Unreadable, read_bytes
from ...files.yaml.named_files import path_of
from .. import convex_parts, mesh_reader
from ..convex_parts import as_arrays, body_of, decomposed, from_arrays, read_parts, simplified
from ..mesh_reader import FlatMesh, MeshError, TriangleMesh, hull_corners, parse_mesh
from ..shapes import Box, ConvexMesh, Cylinder, Shape, Sphere
from ..values import Array, ObjectId, Pose, Vector3
from .body_schema import FORMS, CatalogueFile, FixtureFile, UnknownFile
from .calibration_results import MIN_TARGET_SIZE, tiles_on
from .description import ASSORTMENT, Bin, CameraDescription, CatalogueEntry, Fixture, Form
from .hole_loading import check_holes, holes, uncertainty
from .scene_schema import CameraFile

MAX_MESH_BYTES = 1_000_000
_log = logging.getLogger(__name__)
CONVEX_VOLUME_RATIO = 1.05
"""Ratio of a hull's volume to its mesh's up to which the hull stands for it."""


def load_body(path: Path, scale: float) -> ConvexMesh:
    """The body of a mesh file, scaled to m, about its centre of mass; in convex parts if it is not convex.

    The file of parts beside it is taken for them, if it is of this mesh. Raises MeshError.
    """
    try:
        raw = read_bytes(path, MAX_MESH_BYTES)
    except Unreadable as error:
        raise MeshError(f"{path}: {error.message}") from None
    told = read_parts(path, raw, scale)
    makers = (Path(__file__), mesh_reader, convex_parts, "numpy", "scipy", "trimesh", "pycollada", "coacd")
    inputs = (raw, path.suffix, repr(scale), repr([part.tolist() for part in told or ()]))
    kept = cached_arrays("mesh-body", inputs, makers, lambda: as_arrays(_body(raw, path, scale, told)))
    return from_arrays(kept, str(path), scale)


def _body(raw: bytes, path: Path, scale: float, told: list[Array] | None) -> ConvexMesh:
    """The body of a mesh file's content, of the parts that are `told` if it is not convex. Raises
    MeshError."""
    triangles = parse_mesh(raw, path)
    import trimesh  # slow to import

    mesh = trimesh.Trimesh(triangles.vertices * scale, triangles.faces)
    hull_corners(mesh.vertices)
    hull = mesh.convex_hull
    volume = float(hull.volume)
    size = np.ptp(np.asarray(hull.vertices, dtype=np.float64), axis=0)
    if volume < 1e-12 or float(size.min()) < 1e-4:
        raise FlatMesh
    if float(size.max()) > 1.0:
        hint = "is it in millimetres? then 'scale: 0.001'"
        raise MeshError(f"the mesh is {float(size.max()):.3g} m large", hint)
    if not mesh.is_watertight:
        hint = f"close it; its hull, which could stand for it, has {volume * 1e6:.1f} cm³"
        raise MeshError("the mesh is not closed: some of its edges do not belong to two faces", hint)
    mesh.fix_normals()  # pyright: ignore[reportUnknownMemberType]
    solid = float(mesh.volume)
    corners = np.asarray(hull.vertices, np.float64)
    if volume <= CONVEX_VOLUME_RATIO * solid:
        points = simplified(corners) - np.asarray(hull.center_mass, np.float64)
        return from_arrays({"0": points}, str(path), scale)
    centre = np.asarray(mesh.center_mass, np.float64)
    if told is None:
        vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
        _log.info("decomposing %s into convex parts …", path.name)
        parts = decomposed(TriangleMesh(vertices, faces, np.empty((0, 3))))
    else:
        parts = [part + centre for part in told]
    return body_of(parts, str(path), scale, corners, centre)


RESERVED_NAMES = ("arm", "gripper", "hand", "aside")
"""Names that the belief uses for other things."""
RESERVED_KINDS = {
    "unknown": "it stands for what fits no kind",
    ASSORTMENT: "it stands for things of the assortment",
}
"""Names that no kind may have, with the reason."""
CONTAINERS = ("bin", "tote")
MAX_PLATE_HEIGHT_RATIO = 1 / 3
"""A plate's height is at most this share of its shorter side."""


def check_body(check: DocumentChecker, name: str, entry: FixtureFile) -> None:
    """Faults of a fixture, a bin or a tote."""
    loc: Location = ("fixtures", name)
    which = check.one_of(loc, FixtureFile.one_of)
    if name in RESERVED_NAMES or (which in CONTAINERS and name == "table"):
        hint = (
            f"no body may be called {', '.join(RESERVED_NAMES)}"
            if name in RESERVED_NAMES
            else f"the table is no {which}"
        )
        check.fault(loc, f"the name {name!r} is taken", hint, code="P403", key=True)
    with check.readable():
        if entry.rpy is not None and entry.yaw is not None:
            message = "'rpy' and 'yaw' exclude each other"
            check.fault((*loc, "yaw"), message, "give one of them", code="P112", key=True)
    with check.readable():
        if which in CONTAINERS and entry.rpy is not None:
            check.fault((*loc, "rpy"), f"a {which} stands upright: give its 'yaw'", code="P405", key=True)
        if which == "belt" and entry.rpy is not None:
            check.fault((*loc, "rpy"), "a belt lies level: give its 'yaw'", code="P405", key=True)
    with check.readable():
        _check_walls(check, loc, entry, which)
    with check.readable():
        _check_drive(check, loc, entry, which)
    with check.readable():
        _check_marker(check, loc, entry)
    check_holes(check, loc, entry, which)


def _check_marker(check: DocumentChecker, loc: Location, entry: FixtureFile) -> None:
    if entry.marker is not None and any(a < b for a, b in zip(entry.marker, MIN_TARGET_SIZE, strict=True)):
        least = ", ".join(f"{1000 * size:.0f} mm" for size in MIN_TARGET_SIZE)
        message, hint = "a target this small cannot be seen and touched well enough", f"at least [{least}]"
        check.fault((*loc, "marker"), message, hint, code="P440")


def _check_walls(check: DocumentChecker, loc: Location, entry: FixtureFile, which: str | None) -> None:
    if which not in (None, *CONTAINERS) and entry.wall is not None:
        check.fault((*loc, "wall"), "only a bin or tote has walls", code="P112", key=True)
    if which in CONTAINERS and entry.wall is None:
        hint = f"the thickness of the {which}'s walls, as 5 mm"
        check.fault(loc, "'wall' is missing", hint, code="P105", key=True)
    outside = entry.bin or entry.tote
    if which in CONTAINERS and entry.wall is not None and outside is not None:
        x, y, z = outside
        if 2 * entry.wall >= min(x, y) or entry.wall >= z:
            message = f"walls of {check.written((*loc, 'wall'), entry.wall, 'm')} leave no room inside"
            check.fault((*loc, "wall"), message, f"{which!r} is the outside", code="P404")


def _check_drive(check: DocumentChecker, loc: Location, entry: FixtureFile, which: str | None) -> None:
    for key, value, hint in (
        ("speed", entry.speed, "how fast the belt runs, as 80 mm/s"),
        ("eye", entry.eye, "where the light barrier crosses the belt, from its middle, as 0.4 m"),
    ):
        if which == "belt" and value is None:
            check.fault(loc, f"{key!r} is missing", hint, code="P105", key=True)
        if which not in (None, "belt") and value is not None:
            check.fault((*loc, key), f"only a belt has {key!r}", code="P112", key=True)
    if which == "belt" and entry.belt is not None and entry.eye is not None:
        half = entry.belt[0] / 2
        if abs(entry.eye) >= half:
            message = f"{check.written((*loc, 'eye'), entry.eye, 'm')} from its middle is not on the belt"
            hint = f"it reaches from {-half:g} m to {half:g} m"
            check.fault((*loc, "eye"), message, hint, code="P421")


def body(name: str, entry: FixtureFile) -> Fixture | Bin:
    """A fixture, bin or tote without faults. A belt is a fixture, too."""
    pose = Pose.from_rpy(entry.at, entry.rpy or (0.0, 0.0, entry.yaw or 0.0))
    outside = entry.bin or entry.tote
    if outside is not None and entry.wall is not None:
        return Bin(ObjectId(name), outside, entry.wall, pose, entry.colour, entry.tote is not None)
    if entry.belt is not None:
        return Fixture(
            ObjectId(name), Box(entry.belt), pose.shifted((0.0, 0.0, entry.belt[2] / 2)), entry.colour
        )
    if entry.marker is not None:
        tiles = tiles_on(entry.marker)
        loose = uncertainty(entry)
        return Fixture(ObjectId(name), Box(entry.marker), pose, entry.colour, (), loose, tiles)
    assert entry.box is not None
    bored = holes(name, entry)
    return Fixture(ObjectId(name), Box(entry.box), pose, entry.colour, bored, uncertainty(entry))


def check_unknown(check: DocumentChecker, loc: Location, entry: UnknownFile) -> None:
    """Faults of a body that the robot is not told of."""
    check.one_of(loc, UnknownFile.one_of)
    with check.readable():
        if entry.rpy is not None and entry.yaw is not None:
            message = "'rpy' and 'yaw' exclude each other"
            check.fault((*loc, "yaw"), message, "give one of them", code="P112", key=True)


def hidden_body(name: str, entry: UnknownFile) -> Fixture:
    """Such a body without faults."""
    pose = Pose.from_rpy(entry.at, entry.rpy or (0.0, 0.0, entry.yaw or 0.0))
    shape: Shape
    if entry.cylinder is not None:
        shape = Cylinder(entry.cylinder.radius, entry.cylinder.height)
    elif entry.sphere is not None:
        shape = Sphere(entry.sphere.radius)
    else:
        assert entry.box is not None
        shape = Box(entry.box)
    return Fixture(ObjectId(name), shape, pose, entry.colour)


def check_camera(check: DocumentChecker, name: str, entry: CameraFile) -> None:
    """Faults of a camera."""
    loc: Location = ("cameras", name)
    with check.readable():
        if np.allclose(entry.at, entry.look_at, atol=1e-6):
            hint = "'at' and 'look_at' must differ"
            check.fault((*loc, "look_at"), "the camera looks at itself", hint, code="P406")
        elif look_at_frame(entry.at, entry.look_at, entry.up) is None:
            hint = "name what is up in the picture"
            check.fault((*loc, "up"), "'up' lies along the line of sight", hint, code="P406")
    with check.readable():
        if entry.near >= entry.far:
            at: Location = (*loc, "near") if check.document.get((*loc, "near")) is not None else (*loc, "far")
            message = f"'near' ({entry.near:g} m) is not less than 'far' ({entry.far:g} m)"
            check.fault(at, message, code="P407")


def camera(name: str, entry: CameraFile) -> CameraDescription:
    """A camera without faults, with its optical frame."""
    pose = look_at_frame(entry.at, entry.look_at, entry.up)
    assert pose is not None
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
        on=entry.on,
    )


def look_at_frame(at: Vector3, target: Vector3, up: Vector3 | None) -> Pose | None:
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


def kind(check: DocumentChecker, name: str, entry: CatalogueFile) -> CatalogueEntry | None:
    """A kind of the catalogue; None when it has faults."""
    loc: Location = ("catalogue", name)
    form = check.one_of(loc, CatalogueFile.one_of)
    if name in RESERVED_KINDS:
        check.fault(loc, f"the name {name!r} is taken", RESERVED_KINDS[name], code="P403", key=True)
    named: Form | None = next((f for f in FORMS if f == form), None)
    with check.readable():
        shape = _shape(check, loc, entry)
        if named is not None and shape is not None:
            return CatalogueEntry(name, named, shape, entry.mass, entry.friction, entry.force_limit)
    return None


def _shape(check: DocumentChecker, loc: Location, entry: CatalogueFile) -> Shape | None:
    if entry.cylinder is not None:
        return Cylinder(entry.cylinder.radius, entry.cylinder.height)
    if entry.sphere is not None:
        return Sphere(entry.sphere.radius)
    if entry.plate is not None:
        x, y, z = entry.plate
        if z > MAX_PLATE_HEIGHT_RATIO * min(x, y):
            hint = "its height, the third number, is at most a third of the shorter side; else it is a box"
            check.fault((*loc, "plate"), "a plate is flat", hint, code="P408")
            return None
        return Box(entry.plate)
    if entry.mesh is not None:
        at = (*loc, "mesh")
        try:
            file = path_of(check.document, (*at, "file"), entry.mesh.file)
            return load_body(file, entry.mesh.scale)
        except MeshError as error:
            check.fault(at, error.message, error.hint, code="P409")
            return None
    return Box(entry.box) if entry.box is not None else None
