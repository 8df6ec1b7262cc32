"""Kinds of files without plans of batches: their checks, and the schemas of all except missions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, cast

from picktree.authoring.schema import Schema, belonging, ref, schema, schemas
from picktree.files import Diagnostic, FileError, Location, PicktreeError, disk_cache, file_system
from picktree.files.yaml import Document, read_document
from picktree.world import OUR_PREFIXES, all_causes
from picktree.world.robot_model import RobotDescription, robot_file, urdf_parser
from picktree.world.scene import MAX_HIDDEN_SHARE, SceneDescription, load_scene, scene_loading

if TYPE_CHECKING:
    from picktree.files import file_checks
    from picktree.trees import MissionFiles
    from picktree.world import Array

TEST_SCENE = "self_test"
"""Scene of a robot's self-test, with which a robot file is checked."""


def check_cell(document: Document) -> tuple[Diagnostic, ...]:
    """Check a document of kind `scene`, and the robot file that it names."""
    scene = scene_loading.check_scene(document)
    if scene.robot is None:
        return scene.faults
    try:
        robot = robot_file.check_robot(read_document(scene.robot, "robot"))
    except FileError as error:
        return (*scene.faults, *error.faults)
    faults = (*scene.faults, *robot.faults)
    if scene.value is None or robot.value is None:
        return faults
    parts = ("robot", "cameras", "spawn", "feed")
    own: Location = next(((part,) for part in parts if document.get((part,)) is not None), ())
    return (*faults, *_hidden_items(document, own, scene.value, robot.value))


def mission_faults(document: Document, files: MissionFiles | None = None) -> Iterable[Diagnostic]:
    """Check a mission; in a scene of one's own also whether the arm hides the items.

    `files`: source of the included files, by default the disk.
    """
    from .check import check_mission

    found = check_mission(document, files=files)
    scene = found.mission.scene if found.mission is not None else None
    if (
        scene is None
        or scene in scene_loading.scene_names()
        or any(fault.severity == "error" for fault in found.faults)
    ):
        return found.faults
    cell = check_cell(
        read_document(file_system.find_file(scene, scene_loading.SHIPPED, document.path, "scene"), "scene")
    )
    return (*found.faults, *(fault for fault in cell if fault.code == HIDDEN_ITEMS))


def _robot(document: Document) -> Iterable[Diagnostic]:
    """Check a robot, and one without errors also in the scene of its self-test."""
    found = robot_file.check_robot(document)
    if found.value is None:
        return found.faults
    return (*found.faults, *_hidden_items(document, ("poses", "home"), load_scene(TEST_SCENE), found.value))


HIDDEN_ITEMS = "P514"


def _hidden_items(
    document: Document, loc: Location, scene: SceneDescription, robot: RobotDescription
) -> Iterator[Diagnostic]:
    """Warn of an arm that at `home` hides the items from all fixed cameras, as in its self-test.

    Shipped robots in shipped scenes are taken as tested.
    """
    if Path(scene.source).parent == scene_loading.SHIPPED and Path(robot.source).parent == robot_file.SHIPPED:
        return
    try:
        shares = _hidden_shares(scene, robot)
    except (PicktreeError, ValueError, OSError):
        return  # a model of which no run can be made: `picktree robot test` says why
    if min(shares.values(), default=0.0) <= MAX_HIDDEN_SHARE:
        return
    shares_text = ", ".join(f"{100 * share:.0f} % from {camera}" for camera, share in shares.items())
    of = f" of the scene {scene.name!r}" if document.kind == "robot" else ""
    message = f"the arm of {robot.name!r} at 'home' hides where the items{of} are: {shares_text}"
    hint = (
        f"choose another 'home' under 'poses:' in {Path(robot.source).name}, or move the camera; at most "
        f"{100 * MAX_HIDDEN_SHARE:.0f} % may be hidden"
    )
    yield document.fault(loc, message, hint, code=HIDDEN_ITEMS, severity="warning")


def _hidden_shares(scene: SceneDescription, robot: RobotDescription) -> dict[str, float]:
    """Return the share of the items' areas that the arm hides at `home`, by fixed camera; cached."""

    def compute() -> dict[str, Array]:
        # They are slow to import, and needed for files that have changed.
        import numpy as np

        from picktree.robot.perception import hidden_shares
        from picktree.world.robot_model import RobotModel

        model = RobotModel(robot)
        shares = hidden_shares(model, scene, model.named("home"))
        return {name: np.array(share) for name, share in shares.items()}

    meshes = map(Path, urdf_parser.mesh_paths(robot.urdf, "collision"))
    areas = repr([load.rectangle for load in scene.loads])
    inputs = (robot.text, Path(robot.urdf), repr(scene.cameras), areas, *meshes)
    kept = disk_cache.cached_arrays("hidden-items", inputs, (*_VIEW_SOURCES, "numpy", "pinocchio"), compute)
    return {name: float(share) for name, share in kept.items()}


_ROOT = Path(__file__).parents[1]
_VIEW_SOURCES = (
    _ROOT / "robot" / "perception" / "robot_mask.py",
    _ROOT / "robot" / "perception" / "camera_geometry.py",
    _ROOT / "world" / "robot_model" / "model.py",
    _ROOT / "world" / "scene" / "description.py",
)
"""Code that the hidden shares depend on."""


def _check_faults(document: Document) -> Iterable[Diagnostic]:
    from picktree.simulation import check_faults

    return check_faults(document).faults


def _check_cases(document: Document) -> Iterable[Diagnostic]:
    from picktree.authoring.rehearsal import check_cases

    return check_cases(document)


def _check_xml(document: Document) -> Iterable[Diagnostic]:
    from picktree.authoring.xml import check_xml

    return check_xml(document.text, document.path)


CHECKS: Mapping[str, file_checks.Check] = {
    "xml": _check_xml,
    "mission": mission_faults,
    "scene": check_cell,
    "robot": _robot,
    "faults": _check_faults,
    "cases": _check_cases,
}
SchemaKind: TypeAlias = Literal["scene", "robot", "faults", "cases"]


def file_schema(kind: SchemaKind) -> Schema:
    from picktree.authoring.schema import model_schema
    from picktree.world.robot_model import RobotFile

    match kind:
        case "scene":
            return _scene()
        case "robot":
            return model_schema(kind, RobotFile)
        case "faults":
            return _faults()
        case "cases":
            return _cases()


def _faults() -> Schema:
    """Return the schema of faults; `fault` decides which other keys an entry has."""
    from picktree.authoring.schema import model_schema
    from picktree.simulation import fault_entries

    found = model_schema("faults", fault_entries.FaultsFile)
    definitions = schema(found["definitions"])
    entries = schema(schema(found["properties"])["faults"])
    doc = "Kind of the fault; docs/faults.md says what each kind does."
    names = list(fault_entries.KINDS)
    choice: Schema = {"enum": names, "description": doc, "markdownDescription": f"{doc}\n\n*required*"}
    cases: list[Schema] = []
    for name, kind in fault_entries.KINDS.items():
        own = schema(definitions[kind.__name__])
        required = ["fault", *(str(key) for key in cast("list[object]", own.get("required", [])))]
        own |= {"properties": {"fault": choice | {"enum": [name]}} | schema(own["properties"])}
        definitions[kind.__name__] = own | {"required": required}
        chosen: Schema = {"properties": {"fault": {"const": name}}, "required": ["fault"]}
        cases.append({"if": chosen, "then": ref(kind.__name__)})
    definitions["FaultEntry"] = {
        "type": "object",
        "title": "FaultEntry",
        "description": " ".join((fault_entries.Fault.__doc__ or "").split()),
        "properties": {"fault": choice},
        "required": ["fault"],
        "allOf": cases,
    }
    found["properties"] = schema(found["properties"]) | {"faults": entries | {"items": ref("FaultEntry")}}
    when = schema(definitions["When"])
    more = [
        *belonging(("start", "delay", "each"), "node", "at"),
        *belonging(("every",), "at", "node"),
    ]
    definitions["When"] = when | {"allOf": [*schemas(when.get("allOf")), *more]}
    _propose(found, "scene", scene_loading.scene_names())
    return found | {"definitions": definitions}


def _propose(found: Schema, key: str, names: tuple[str, ...]) -> None:
    """Add proposed names for a key; others are allowed."""
    properties = schema(found["properties"])
    properties[key] = schema(properties[key]) | {"examples": list(names)}
    found["properties"] = properties


def _cases() -> Schema:
    from picktree.authoring.rehearsal import CasesFile
    from picktree.authoring.schema import model_schema

    found = model_schema("cases", CasesFile)
    definitions = schema(found["definitions"])
    for name in definitions:
        definition = schema(definitions[name])
        properties = schema(definition.get("properties"))
        if "cause" in properties:
            # As snippets, not as examples: editors show all examples when the pointer is over the key.
            # Those of plug-ins are left out: any may have been imported.
            names = (c.name for c in all_causes() if c.name.partition(".")[0] in OUR_PREFIXES)
            snippets = [{"label": name, "body": name} for name in names]
            properties["cause"] = schema(properties["cause"]) | {"defaultSnippets": snippets}
            definitions[name] = definition | {"properties": properties}
    return found | {"definitions": definitions}


def _scene() -> Schema:
    """Return the schema of scenes; a scene with a base contains only its differences."""
    from picktree.authoring.schema import model_schema, patch, patched
    from picktree.world.scene import SceneFile

    full = model_schema("scene", SceneFile)
    _propose(full, "robot", robot_file.robot_names())
    _propose(full, "base", scene_loading.scene_names())
    definitions = schema(full.pop("definitions"))
    root = {key: full.pop(key) for key in ("$schema", "title", "description", "type")}
    partial = patch({key: value for key, value in full.items() if key != "allOf"})
    on_base: Schema = {"properties": {"base": {"type": "string"}}, "required": ["base"]}
    partial |= {"required": ["picktree", "kind"]}
    return root | {
        "if": on_base,
        "then": partial,
        "else": full,
        "definitions": definitions | {patched(name): patch(schema(d)) for name, d in definitions.items()},
    }
