"""Schemas of all kinds of files except missions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Literal, TypeAlias

from ...authoring.schema.schema_parts import Schema, belonging, by_value, schema, schemas
from ...files.marks import Diagnostic, FileError
from ...files.yaml.document import Document, read_document
from ...robots.loading import check_robot, robot_names
from ...world.causes import OUR_PREFIXES, Cause, all_causes
from ...world.scene.loading.scene_loading import check_scene, scene_names

if TYPE_CHECKING:
    from ...files.diagnostics.file_checks import Check


def check_cell(document: Document) -> tuple[Diagnostic, ...]:
    """Check a document of kind `scene`, and the robot file that it names."""
    scene = check_scene(document)
    if scene.robot is None:
        return scene.faults
    try:
        return (*scene.faults, *check_robot(read_document(scene.robot, "robot")).faults)
    except FileError as error:
        return (*scene.faults, *error.faults)


def _mission(document: Document) -> Iterable[Diagnostic]:
    from ...authoring.check import check_mission

    return check_mission(document).faults


def _robot(document: Document) -> Iterable[Diagnostic]:
    return check_robot(document).faults


def _check_faults(document: Document) -> Iterable[Diagnostic]:
    from ...simulation.fault_files.fault_loading import check_faults

    return check_faults(document).faults


def _check_cases(document: Document) -> Iterable[Diagnostic]:
    from ...authoring.rehearsal.checking.case_checks import check_cases

    return check_cases(document)


def _plan(document: Document) -> Iterable[Diagnostic]:
    from ...batch.plan_loading import check_plan

    return check_plan(document).faults


CHECKS: Mapping[str, Check] = {
    "mission": _mission,
    "scene": check_cell,
    "robot": _robot,
    "faults": _check_faults,
    "cases": _check_cases,
    "plan": _plan,
}


FileKind: TypeAlias = Literal["scene", "robot", "faults", "cases"]


def file_schema(kind: FileKind) -> Schema:
    """Return the JSON Schema of a kind of file."""
    from ...authoring.schema.pydantic_schema import model_schema
    from ...robots.robot_schema import RobotFile

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
    from ...authoring.schema.pydantic_schema import model_schema
    from ...simulation.fault_files.fault_schema import ALLOWED_KEYS, REQUIRED_KEYS, FaultsFile

    found = model_schema("faults", FaultsFile)
    definitions = schema(found["definitions"])
    rules = {
        "FaultEntry": by_value("fault", REQUIRED_KEYS, ALLOWED_KEYS),
        "When": [
            *belonging(("start", "delay", "each"), "node", "at"),
            *belonging(("every",), "at", "node"),
        ],
    }
    for name, more in rules.items():
        definition = schema(definitions[name])
        definitions[name] = definition | {"allOf": [*schemas(definition.get("allOf")), *more]}
    _propose(found, "scene", scene_names())
    return found | {"definitions": definitions}


def _propose(found: Schema, key: str, names: tuple[str, ...]) -> None:
    """Add names that a key may have, among others."""
    properties = schema(found["properties"])
    properties[key] = schema(properties[key]) | {"examples": list(names)}
    found["properties"] = properties


def _cases() -> Schema:
    from ...authoring.rehearsal.cases.cases_schema import CasesFile
    from ...authoring.schema.pydantic_schema import model_schema

    found = model_schema("cases", CasesFile)
    definitions = schema(found["definitions"])
    for name in definitions:
        definition = schema(definitions[name])
        properties = schema(definition.get("properties"))
        if "cause" in properties:
            # As snippets, not as examples: editors show all examples when the pointer is over the key.
            snippets = [{"label": cause.name, "body": cause.name} for cause in _our_causes()]
            properties["cause"] = schema(properties["cause"]) | {"defaultSnippets": snippets}
            definitions[name] = definition | {"properties": properties}
    return found | {"definitions": definitions}


def _our_causes() -> list[Cause]:
    """Return the causes without those of plug-ins, of which any may have been imported."""
    return [cause for cause in all_causes() if cause.name.split(".")[0] in OUR_PREFIXES]


def _scene() -> Schema:
    """Return the schema of scenes; a scene with a base contains only its differences."""
    from ...authoring.schema.mission_context import patch, patched
    from ...authoring.schema.pydantic_schema import model_schema
    from ...world.scene.scene_schema import SceneFile

    full = model_schema("scene", SceneFile)
    _propose(full, "robot", robot_names())
    _propose(full, "base", scene_names())
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
