"""Entries of bodies, their holes and cameras in scene files: checks that need several values, and
conversion to values of the scene.
"""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

from picktree.files import Expression, Location, disk_cache, listed
from picktree.files.yaml import DocumentChecker, file_models, file_text
from picktree.world import (
    Array,
    Box,
    ConvexMesh,
    Cylinder,
    ObjectId,
    Pose,
    Shape,
    Sphere,
    Vector3,
    convex_decomposition,
    greatest_length,
    hole_geometry,
    mesh_reader,
)

from .description import (
    ASSORTMENT,
    MIN_TARGET_SIZE,
    NO_UNCERTAINTY,
    Bin,
    CameraDescription,
    CameraSettings,
    CatalogueEntry,
    Fixture,
    Form,
    Hole,
    HoleForm,
    tiles_on,
)
from .destinations import ItemTraits, rule_holds
from .scene_schema import FORMS, CameraFile, CatalogueFile, FixtureFile, HoleFile, PlacedFile, UnknownFile

MAX_MESH_BYTES = 1_000_000
_log = logging.getLogger(__name__)
CONVEX_VOLUME_RATIO = 1.05
"""Greatest ratio of a hull's volume to its mesh's for which the hull replaces the mesh."""


def load_body(path: Path, scale: float) -> ConvexMesh:
    """Return the body of a mesh file, scaled to m, about its centre of mass; in convex parts if it is not
    convex.

    The parts come from the file of parts beside it, if that belongs to this mesh. Raises MeshError.
    """
    try:
        raw = file_text.read_bytes(path, MAX_MESH_BYTES)
    except file_text.Unreadable as error:
        raise mesh_reader.MeshError(f"{path}: {error.message}") from None
    saved_parts = convex_decomposition.read_parts(path, raw, scale)
    makers = (
        Path(__file__),
        mesh_reader,
        convex_decomposition,
        "numpy",
        "scipy",
        "trimesh",
        "pycollada",
        "coacd",
    )
    inputs = (raw, path.suffix, repr(scale), repr([part.tolist() for part in saved_parts or ()]))
    kept = disk_cache.cached_arrays(
        "mesh-body",
        inputs,
        makers,
        lambda: convex_decomposition.as_arrays(_body(raw, path, scale, saved_parts)),
    )
    return convex_decomposition.from_arrays(kept, str(path), scale)


def _body(raw: bytes, path: Path, scale: float, saved_parts: list[Array] | None) -> ConvexMesh:
    """Return the body of a mesh file's content. Raises MeshError.

    `saved_parts`: parts from the file beside it, for a body that is not convex.
    """
    triangles = mesh_reader.parse_mesh(raw, path)
    import trimesh  # slow to import

    mesh = trimesh.Trimesh(triangles.vertices * scale, triangles.faces)
    mesh_reader.hull_corners(mesh.vertices)
    hull = mesh.convex_hull
    volume = float(hull.volume)
    size = np.ptp(np.asarray(hull.vertices, dtype=np.float64), axis=0)
    if volume < 1e-12 or float(size.min()) < 1e-4:
        raise mesh_reader.FlatMesh
    if float(size.max()) > 1.0:
        hint = "is the mesh in millimetres? then add 'scale: 0.001'"
        raise mesh_reader.MeshError(f"the mesh is {float(size.max()):.3g} m large", hint)
    if not mesh.is_watertight:
        hint = f"close the mesh, or replace it by its convex hull, which has {volume * 1e6:.1f} cm³"
        raise mesh_reader.MeshError(
            "the mesh is not closed: some of its edges do not belong to two faces", hint
        )
    mesh.fix_normals()  # pyright: ignore[reportUnknownMemberType]
    solid = float(mesh.volume)
    corners = np.asarray(hull.vertices, np.float64)
    if volume <= CONVEX_VOLUME_RATIO * solid:
        points = convex_decomposition.simplified(corners) - np.asarray(hull.center_mass, np.float64)
        return convex_decomposition.from_arrays({"0": points}, str(path), scale)
    centre = np.asarray(mesh.center_mass, np.float64)
    if saved_parts is None:
        vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
        _log.info("decomposing %s into convex parts …", path.name)
        parts = convex_decomposition.decomposed(mesh_reader.TriangleMesh(vertices, faces, np.empty((0, 3))))
    else:
        parts = [part + centre for part in saved_parts]
    return convex_decomposition.body_of(parts, str(path), scale, corners, centre)


RESERVED_NAMES = ("arm", "gripper", "hand", "aside")
"""Names that the belief uses for other things."""
RESERVED_KINDS = {
    "unknown": "the word means an item that fits no kind",
    ASSORTMENT: "the word means things of the assortment",
}
"""Names that no kind may have, with the reason."""
CONTAINERS = ("bin", "tote")
MAX_PLATE_HEIGHT_RATIO = 1 / 3
"""A plate's height is at most this share of its shorter side."""


def check_body(check: DocumentChecker, name: str, entry: FixtureFile) -> None:
    """Check a fixture, a bin or a tote."""
    loc: Location = ("fixtures", name)
    which = check.one_of(loc, FixtureFile.one_of)
    if name in RESERVED_NAMES or (which in CONTAINERS and name == "table"):
        hint = (
            f"no body may be called {', '.join(RESERVED_NAMES)}"
            if name in RESERVED_NAMES
            else f"the table is no {which}"
        )
        check.fault(loc, f"the name {name!r} is taken", hint, code="P403", key=True)
    _check_turn(check, loc, entry)
    with check.readable():
        if which in CONTAINERS and entry.rpy is not None:
            check.fault((*loc, "rpy"), f"a {which} is always upright: give its 'yaw'", code="P405", key=True)
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
    """Return a fixture, bin or tote without faults. A belt is a fixture, too."""
    pose, loose = entry.pose(), entry.uncertainty or NO_UNCERTAINTY
    outside = entry.bin or entry.tote
    if outside is not None and entry.wall is not None:
        return Bin(ObjectId(name), outside, entry.wall, pose, entry.colour, entry.tote is not None)
    if entry.belt is not None:
        return Fixture(
            ObjectId(name), Box(entry.belt), pose.shifted((0.0, 0.0, entry.belt[2] / 2)), entry.colour
        )
    if entry.marker is not None:
        tiles = tiles_on(entry.marker)
        return Fixture(ObjectId(name), Box(entry.marker), pose, entry.colour, (), loose, tiles)
    assert entry.box is not None
    bored = holes(name, entry)
    return Fixture(ObjectId(name), Box(entry.box), pose, entry.colour, bored, loose)


def check_unknown(check: DocumentChecker, loc: Location, entry: UnknownFile) -> None:
    """Check an unknown body."""
    check.one_of(loc, UnknownFile.one_of)
    _check_turn(check, loc, entry)


def _check_turn(check: DocumentChecker, loc: Location, entry: PlacedFile) -> None:
    with check.readable():
        if entry.rpy is not None and entry.yaw is not None:
            message = "'rpy' and 'yaw' exclude each other"
            check.fault((*loc, "yaw"), message, "give one of them", code="P112", key=True)


def hidden_body(name: str, entry: UnknownFile) -> Fixture:
    """Return an unknown body without faults."""
    shape = _primitive(entry)
    assert shape is not None
    return Fixture(ObjectId(name), shape, entry.pose(), entry.colour)


def _primitive(entry: UnknownFile | CatalogueFile) -> Shape | None:
    """Return the cylinder, sphere or box of an entry; None when it has another form."""
    if entry.cylinder is not None:
        return Cylinder(entry.cylinder.radius, entry.cylinder.height)
    if entry.sphere is not None:
        return Sphere(entry.sphere.radius)
    return Box(entry.box) if entry.box is not None else None


def check_camera(check: DocumentChecker, name: str, entry: CameraFile) -> None:
    """Check a camera."""
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
    """Return a camera without faults, with its optical frame."""
    pose = look_at_frame(entry.at, entry.look_at, entry.up)
    assert pose is not None
    settings = {each.name: getattr(entry, each.name) for each in fields(CameraSettings)}
    return CameraDescription(**settings, name=name, pose=pose)


def look_at_frame(at: Vector3, target: Vector3, up: Vector3 | None) -> Pose | None:
    """Return the optical frame (x right, y down, z forward) at `at` that looks at `target`.

    None when `up` is along the line of sight. Without `up`, the world's z is up in the picture, or its x when
    the camera looks straight up or down.
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
    """Return a kind in the scene's catalogue; None when it has faults."""
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
            file = file_models.path_of(check.document, (*at, "file"), entry.mesh.file)
            return load_body(file, entry.mesh.scale)
        except mesh_reader.MeshError as error:
            check.fault(at, error.message, error.hint, code="P409")
            return None
    return _primitive(entry)


def check_holes(check: DocumentChecker, loc: Location, entry: FixtureFile, which: str | None) -> None:
    """Check the holes of a fixture, and the uncertainty of its pose."""
    with check.readable():
        if which not in (None, "box", "marker") and entry.uncertainty is not None:
            message = "only a box may have an uncertain pose"
            check.fault((*loc, "uncertainty"), message, code="P112", key=True)
    with check.readable():
        if entry.holes is None:
            return
        if which not in (None, "box"):
            check.fault((*loc, "holes"), "only a box has holes", code="P112", key=True)
            return
        if not entry.holes:
            check.fault((*loc, "holes"), "there is no hole", "leave out 'holes'", code="P105", key=True)
        for name, hole in entry.holes.items():
            _check_form(check, (*loc, "holes", name), hole)
        with check.readable():
            if entry.rpy is not None and any(abs(math.sin(angle)) > 1e-9 for angle in entry.rpy[:2]):
                message = "a fixture with holes lies level: give its 'yaw'"
                check.fault((*loc, "rpy"), message, code="P405", key=True)
        if entry.box is not None:
            _check_places(check, (*loc, "holes"), entry.box, _readable(check, entry.holes, entry.box[2]))


def _check_form(check: DocumentChecker, loc: Location, entry: HoleFile) -> None:
    which = check.one_of(loc, HoleFile.one_of)
    with check.readable():
        if which == "round" and entry.yaw is not None:
            check.fault((*loc, "yaw"), "a round hole has no 'yaw'", code="P112", key=True)
    with check.readable():
        if entry.slot is not None and entry.slot[0] < entry.slot[1]:
            hint = "the length comes first, and runs along the hole's x; 'yaw' turns it"
            check.fault((*loc, "slot"), "the slot is wider than it is long", hint, code="P430")


def _readable(check: DocumentChecker, entries: Mapping[str, HoleFile], height: float) -> dict[str, Hole]:
    """Return the readable entries by name."""
    found: dict[str, Hole] = {}
    for name, entry in entries.items():
        with check.readable():
            hole = _hole(ObjectId(name), entry, height)
            if hole is not None:
                found[name] = hole
    return found


def _check_places(
    check: DocumentChecker, loc: Location, box: tuple[float, float, float], found: Mapping[str, Hole]
) -> None:
    x, y, z = box
    good: dict[str, Hole] = {}
    for name, hole in found.items():
        at: Location = (*loc, name)
        faults = len(check.faults)
        if hole.depth > z + 1e-9:
            message = f"{check.written((*at, 'depth'), hole.depth, 'm')} is deeper than the box is high"
            check.fault((*at, "depth"), message, f"{1000 * z:g} mm", code="P431")
        if hole.chamfer >= hole.depth:
            message = (
                f"a chamfer of {check.written((*at, 'chamfer'), hole.chamfer, 'm')} leaves no straight wall"
            )
            hint = f"the hole is {1000 * hole.depth:g} mm deep"
            check.fault((*at, "chamfer"), message, hint, code="P432")
        if not _inside(hole_geometry.outline(hole), x, y):
            hint = f"the top face reaches {500 * x:g} mm along x and {500 * y:g} mm along y from its middle"
            check.fault((*at, "at"), "the hole is not inside its box", hint, code="P433")
        elif not _inside(hole_geometry.outline(hole, hole.chamfer), x, y):
            message = "the chamfer reaches beyond the box"
            check.fault((*at, "chamfer"), message, "a chamfer widens the mouth on every side", code="P432")
        if len(check.faults) == faults:
            good[name] = hole
    clashes = [
        (one, other)
        for one, other in itertools.combinations(good, 2)
        if hole_geometry.wall_thickness(good[one], good[other]) < hole_geometry.MIN_WALL - 1e-9
    ]
    for one, other in clashes:
        message = f"{one!r} and {other!r} leave no wall between them"
        hint = f"{1000 * hole_geometry.MIN_WALL:g} mm at least, beside their chamfers"
        check.fault((*loc, other), message, hint, code="P434", key=True)
    if not clashes and isinstance(
        cut := hole_geometry.partition_top(Box(box), tuple(good.values())), hole_geometry.InterlockedHoles
    ):
        names = listed(repr(str(hole.id)) for hole in cut.holes)
        hint = "move or turn one of them"
        check.fault(loc, f"no straight line parts the holes {names}", hint, code="P434", key=True)


def _inside(corners: Array, x: float, y: float) -> bool:
    room = hole_geometry.MIN_WALL - 1e-9
    return bool((abs(corners[:, 0]) <= x / 2 - room).all() and (abs(corners[:, 1]) <= y / 2 - room).all())


def check_fits(
    check: DocumentChecker,
    rules: Sequence[tuple[Expression, str]],
    coming: Iterable[tuple[str, str]],
    catalogue: Mapping[str, CatalogueEntry | None],
    bored: Mapping[str, tuple[Hole, ...]],
) -> None:
    """Check that each kind, in each of its colours, fits a hole of its destination.

    `rules` are those of the destinations with their targets; `bored` are the holes by the names of fixtures
    and by their own.
    """
    reported: set[tuple[int, str]] = set()
    for kind, colour in coming:
        entry = catalogue.get(kind)
        if entry is None:
            continue
        item = ItemTraits(colour, entry.form, kind, entry.mass, greatest_length(entry.shape))
        n = next((n for n, (rule, _) in enumerate(rules) if rule_holds(rule, item)), None)
        if n is None or rules[n][1] not in bored or (n, kind) in reported:
            continue
        reported.add((n, kind))
        to = rules[n][1]
        if hole_geometry.tightest_hole(bored[to], entry.shape) is None:
            misses = f"does not fit the hole {to!r}" if "/" in to else f"fits no hole of {to!r}"
            hint = _hole_hint(entry.shape)
            check.fault(("destinations", n, "to"), f"a {kind} {misses}", hint, code="P435")


def _hole_hint(shape: Shape) -> str:
    match shape:
        case Cylinder(radius, _) | Sphere(radius):
            return f"it needs a round hole wider than {2000 * radius:g} mm"
        case Box((x, y, _)):
            size = f"{1000 * max(x, y):g} mm × {1000 * min(x, y):g} mm"
            return f"it needs a square hole or a slot larger than {size}"
        case _:
            return "a mesh fits no hole: its section is not known"


def holes(name: str, entry: FixtureFile) -> tuple[Hole, ...]:
    """Return the holes of a box."""
    assert entry.box is not None
    made = [_hole(ObjectId(f"{name}/{key}"), hole, entry.box[2]) for key, hole in (entry.holes or {}).items()]
    return tuple(hole for hole in made if hole is not None)


def _hole(hole_id: ObjectId, entry: HoleFile, height: float) -> Hole | None:
    """Return the hole of an entry; None for an entry without a form."""
    form: HoleForm
    if entry.round is not None:
        form, size = "round", (entry.round, entry.round)
    elif entry.square is not None:
        form, size = "square", (entry.square, entry.square)
    elif entry.slot is not None:
        form, size = "slot", entry.slot
    else:
        return None
    pose = Pose.from_rpy((*entry.at, height / 2), (0.0, 0.0, entry.yaw or 0.0))
    return Hole(hole_id, form, size, entry.depth, entry.chamfer, pose)
