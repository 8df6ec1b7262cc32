"""Kinds of files: their checks, and the schemas of all but missions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Literal, TypeAlias

from ...authoring import file_kinds
from ...authoring.schema.schema_parts import Schema
from ...files.errors import Diagnostic
from ...files.yaml.document import Document

if TYPE_CHECKING:
    from ...files.file_checks import Check


def _plan(document: Document) -> Iterable[Diagnostic]:
    from ..batch.plan import check_plan

    return check_plan(document).faults


CHECKS: Mapping[str, Check] = {**file_kinds.CHECKS, "plan": _plan}

FileKind: TypeAlias = Literal["plan"] | file_kinds.SchemaKind


def file_schema(kind: FileKind) -> Schema:
    """Return the JSON Schema of a kind of file."""
    if kind == "plan":
        from ..batch.plan import plan_schema

        return plan_schema()
    return file_kinds.file_schema(kind)
