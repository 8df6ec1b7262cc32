"""picktree schema"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class Kind(StrEnum):
    """Kinds of files that people write by hand."""

    MISSION = "mission"
    SCENE = "scene"
    ROBOT = "robot"
    FAULTS = "faults"
    CASES = "cases"
    PLAN = "plan"


def schema(
    kind: Annotated[Kind, typer.Argument(help="The kind of file.")],
    mission: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Of this mission: with its sub-trees, its plug-ins' nodes and its scene's names.",
        ),
    ] = None,
    shipped: Annotated[
        bool,
        typer.Option("--shipped", help="Only the nodes that come with picktree, none of installed plug-ins."),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Write it there instead of to stdout."),
    ] = None,
) -> None:
    """Print the JSON Schema of a kind of file, by which editors complete, explain and underline."""
    from ...authoring.schema.schema_parts import to_text
    from ...batch.plan.plan_schema import plan_schema
    from ...errors import PicktreeError
    from ..terminal.node_registries import registry
    from ..terminal.output import show
    from .file_schemas import file_schema

    if kind is not Kind.MISSION:
        if mission is not None:
            raise PicktreeError(f"--mission is for the schema of missions, not of {kind.value}")
        found = plan_schema() if kind is Kind.PLAN else file_schema(kind.value)
    else:
        from ...authoring.schema.mission_context import any_mission, one_mission
        from ...authoring.schema.mission_schema import mission_schema
        from ...files.yaml.document import read_document

        nodes = registry(shipped=shipped)
        particular = any_mission()
        if mission is not None:
            particular = one_mission(read_document(mission, "mission"), nodes)
        found = mission_schema(nodes, particular)
    show(to_text(found), output)
