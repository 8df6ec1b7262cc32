"""Schemas of all kinds of files except missions."""

from __future__ import annotations

from typing import Literal, TypeAlias

from ...authoring.rehearsal.cases.cases_schema import CasesFile
from ...authoring.schema.patch_schema import patch, patched
from ...authoring.schema.pydantic_schema import model_schema
from ...authoring.schema.schema_parts import Schema, belonging, by_value, schema, schemas
from ...robots.loading import robot_names
from ...robots.robot_schema import RobotFile
from ...simulation.fault_files.fault_schema import ALLOWED_KEYS, REQUIRED_KEYS, FaultsFile
from ...world.causes import OUR_PREFIXES, Cause, all_causes
from ...world.scene.loading.scene_loading import scene_names
from ...world.scene.scene_schema import SceneFile

FileKind: TypeAlias = Literal["scene", "robot", "faults", "cases"]


def file_schema(kind: FileKind) -> Schema:
    """Return the JSON Schema of a kind of file."""
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
