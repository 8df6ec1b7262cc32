"""Kinds of files: their checks, and the schemas of all but missions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Literal, TypeAlias

from picktree.authoring import file_kinds
from picktree.authoring.schema import Schema
from picktree.files import Diagnostic
from picktree.files.yaml import Document

if TYPE_CHECKING:
    from picktree.files import file_checks


def _plan(document: Document) -> Iterable[Diagnostic]:
    from picktree.apps.batch import check_plan

    return check_plan(document).faults


CHECKS: Mapping[str, file_checks.Check] = {**file_kinds.CHECKS, "plan": _plan}

FileKind: TypeAlias = Literal["plan"] | file_kinds.SchemaKind


def file_schema(kind: FileKind) -> Schema:
    if kind == "plan":
        from picktree.apps.batch import plan_schema

        return plan_schema()
    return file_kinds.file_schema(kind)
