"""picktree nodes"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from ...trees.declaration import NodeDeclaration
    from ...trees.loading.registry import NodeRegistry


def nodes(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="A node: all about it.")] = None,
    mission: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Also the nodes of this mission's plug-ins, and its sub-trees."),
    ] = None,
    shipped: Annotated[
        bool, typer.Option("--shipped", help="Only the nodes that come with picktree.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print them as one JSON object.")] = False,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the page of the documentation with all of them.")
    ] = False,
    stub: Annotated[
        bool, typer.Option("--stub", help="Print a Python stub of their constructors, for editors.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Write it there instead of to stdout."),
    ] = None,
) -> None:
    """List the nodes that a mission may use; with a NAME its ports, causes and an example."""
    import orjson

    from ...authoring.reference.node_reference import node_entry
    from ...authoring.reference.reference_text import markdown as reference_page
    from ...authoring.reference.reference_text import page, table
    from ..terminal.node_registries import registry
    from ..terminal.output import show

    known = registry(shipped=shipped)
    trees = _sub_trees(mission, known) if mission else ()
    if stub:
        from ...authoring.reference.python_stub import stub as stub_text

        show(stub_text(known.declarations()), output)
        return
    declared = (*known.declarations(), *trees)
    causes = known.causes
    if name is not None:
        declared = (_named(name, declared),)
    entries = tuple(node_entry(node, causes, known.find(node.id)) for node in declared)
    if json:
        listed = {"nodes": [asdict(entry) for entry in entries]}
        text = orjson.dumps(listed, option=orjson.OPT_INDENT_2).decode() + "\n"
    elif markdown:
        text = reference_page(entries, causes)
    else:
        text = table(entries) if name is None else page(entries[0])
    show(text, output)


def _named(name: str, declared: tuple[NodeDeclaration, ...]) -> NodeDeclaration:
    from ...errors import PicktreeError
    from ...files.value_wording import suggest_name

    for node in declared:
        if node.id == name:
            return node
    hint = suggest_name(name, [node.id for node in declared])
    raise PicktreeError(f"there is no node {name!r}" + (f" ({hint})" if hint else ""))


def _sub_trees(path: Path, known: NodeRegistry) -> tuple[NodeDeclaration, ...]:
    """Return the mission's sub-trees as nodes; the nodes of its plug-ins are added to `known`."""
    from ...authoring.schema.mission_context import one_mission
    from ...files.yaml.document import read_document
    from ...trees.declaration import NodeDeclaration
    from ...trees.mission import MAIN

    mission = one_mission(read_document(path, "mission"), known)
    return tuple(
        NodeDeclaration(name, f"A sub-tree of {path.name}.", "subtree", ports)
        for name, ports in mission.trees.items()
        if name != MAIN
    )
