"""The schema of each kind of file beside missions."""

from __future__ import annotations

from typing import Literal, TypeAlias

from ...world.faults.schema import MAY, NEEDS, FaultsFile
from ...world.robot.schema import RobotFile
from ...world.scene.schema import SceneFile
from ..rehearsal.schema import CasesFile
from .conditions import belonging, by_value
from .drafts import schema, schemas
from .models import model_schema
from .parts import Schema
from .patches import patch, patched

FileKind: TypeAlias = Literal["scene", "robot", "faults", "cases"]


def file_schema(kind: FileKind) -> Schema:
    """JSON Schema of that kind of file."""
    match kind:
        case "scene":
            return _scene()
        case "robot":
            return model_schema(kind, RobotFile)
        case "faults":
            return _faults()
        case "cases":
            return model_schema(kind, CasesFile)


def _faults() -> Schema:
    found = model_schema("faults", FaultsFile)
    definitions = schema(found["definitions"])
    rules = {
        "FaultEntry": by_value("fault", NEEDS, MAY),
        "When": belonging(("start", "delay"), "node", "at"),
    }
    for name, more in rules.items():
        definition = schema(definitions[name])
        definitions[name] = definition | {"allOf": [*schemas(definition.get("allOf")), *more]}
    return found | {"definitions": definitions}


def _scene() -> Schema:
    """With a base, a scene says only what is different."""
    full = model_schema("scene", SceneFile)
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
