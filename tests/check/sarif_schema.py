"""JSON Schema of the part of SARIF 2.1.0 that picktree writes, after section 3 of the standard."""

from __future__ import annotations

from typing import Any, Final


def _object(required: tuple[str, ...], **properties: Any) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": list(required),
        "additionalProperties": False,
    }


def _list(items: dict[str, Any], least: int = 0) -> dict[str, Any]:
    return {"type": "array", "items": items, "minItems": least}


_TEXT: Final = {"type": "string", "minLength": 1}
_COUNT: Final = {"type": "integer", "minimum": 1}
_MESSAGE: Final = _object(("text",), text=_TEXT, markdown=_TEXT)
_ADDRESS: Final = _object(("uri",), uri={"type": "string", "format": "uri-reference"}, uriBaseId=_TEXT)
_REGION: Final = _object(("startLine", "startColumn"), startLine=_COUNT, startColumn=_COUNT)
_LOCATION: Final = _object(
    ("physicalLocation",),
    physicalLocation=_object(("artifactLocation",), artifactLocation=_ADDRESS, region=_REGION),
    logicalLocations=_list(_object((), fullyQualifiedName=_TEXT)),
)
_RULE: Final = _object(("id",), id=_TEXT, shortDescription=_MESSAGE, fullDescription=_MESSAGE, help=_MESSAGE)
_RESULT: Final = _object(
    ("ruleId", "level", "message", "locations"),
    ruleId=_TEXT,
    ruleIndex={"type": "integer", "minimum": 0},
    level={"enum": ["none", "note", "warning", "error"]},
    message=_MESSAGE,
    locations=_list(_LOCATION, least=1),
)
_RUN: Final = _object(
    ("tool", "results"),
    tool=_object(("driver",), driver=_object(("name",), name=_TEXT, version=_TEXT, rules=_list(_RULE))),
    columnKind={"enum": ["utf16CodeUnits", "unicodeCodePoints"]},
    originalUriBaseIds={
        "type": "object",
        "additionalProperties": _object(("uri",), uri={"type": "string", "pattern": "/$"}),
    },
    artifacts=_list(_object(("location",), location=_ADDRESS)),
    results=_list(_RESULT),
)
SARIF: Final[dict[str, Any]] = {
    "$schema": "http://json-schema.org/draft-07/schema#",
    **_object(
        ("version", "runs"),
        **{
            "$schema": {"type": "string", "format": "uri"},
            "version": {"const": "2.1.0"},
            "runs": _list(_RUN, 1),
        },
    ),
}
