"""Write slice: the tree, faults, edits and rehearsals of a mission's text that is being written."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

from pydantic import Field
from starlette.routing import BaseRoute

from ...authoring.editing.text_changes import TextChange, changes
from ...authoring.editor.completion import Proposal
from ...authoring.editor.cursor import Place as CursorPlace
from ...authoring.editor.cursor import Span
from ...authoring.editor.open_file import OpenFile
from ...authoring.file_kinds import file_schema
from ...authoring.reference.port_wording import default_words
from ...authoring.schema.schema_parts import Schema
from ...errors import PicktreeError
from ...files.yaml.document import read_document
from ...files.yaml.file_text import MAX_BYTES
from ...trees.declaration import NodeDeclaration
from ...trees.loading.loader import load_surroundings
from ...trees.loading.registry import NodeRegistry
from ...trees.mission import MAIN
from ..calls import JsonValue, call
from ..slice import Studio
from . import checks
from .answers import Places, TreeAnswers, change_values, common_entries, palette_values
from .context import (
    MissionContext,
    MissionContexts,
    ReadText,
    library_declarations,
    read_text,
    tree_declarations,
)
from .edits import AddNode, Edit, edited, needs_trees
from .worker import Worker

T = TypeVar("T")

_SMALLEST: Final = """
picktree: 1
kind: mission
name: smallest
scene: three_bins
trees: {Main: {GoTo: {pose: home}}}
"""


class MissionSlice:
    """Calls on the text of one mission, which the page sends along; nothing of it is kept here."""

    def __init__(self, studio: Studio) -> None:
        self._workspace = studio.workspace
        self._contexts = MissionContexts()
        self._trees = TreeAnswers()
        self._registry = NodeRegistry()
        # One thread: answers come in the order of the edits, and registries are used by one at a time.
        self._thread = ThreadPoolExecutor(1, "missions")
        self._worker = Worker()

    def routes(self) -> Sequence[BaseRoute]:
        return ()

    async def close(self) -> None:
        self._thread.shutdown(wait=False, cancel_futures=True)
        await self._worker.close()

    async def _quickly(self, function: Callable[..., T], *args: object) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._thread, function, *args)

    @call("mission.tree")
    async def tree(self, path: str, text: str, known: tuple[str, ...] = ()) -> JsonValue:
        """Return the trees of a text as a picture shows them, as far as the text can be read.

        `known`: contents of trees that the page has. Of these trees the place is returned only.
        """
        return await self._quickly(self._tree, self._place(path, text), text, known)

    @call("mission.edit")
    async def edit(
        self,
        path: str,
        text: str,
        edit: Annotated[Edit, Field(discriminator="do")],
        known: tuple[str, ...] = (),
    ) -> JsonValue:
        """Return the replacements of an edit by the picture, and the trees after it as `tree` does."""
        return await self._quickly(self._edit, self._place(path, text), text, edit, known)

    @call("mission.palette")
    async def palette(self, path: str, text: str) -> JsonValue:
        """Return the nodes and sub-trees that may be added, and the keys that each node may have."""
        return await self._quickly(self._palette, self._place(path, text), text)

    @call("mission.form")
    async def form(self, path: str, text: str, node: str) -> JsonValue:
        """Return the ports of a node with their values, choices, names of the scene, and keys to refer to."""
        return await self._quickly(self._form, self._place(path, text), text, node)

    @call("mission.complete")
    async def complete(self, path: str, text: str, line: int, character: int) -> JsonValue:
        """Return what may be written at a place; line and character count from 0, in UTF-16 units."""
        return await self._quickly(self._complete, self._place(path, text), text, line, character)

    @call("mission.hover")
    async def hover(self, path: str, text: str, line: int, character: int) -> JsonValue:
        """Return the documentation of what stands at a place as Markdown; none for nothing."""
        return await self._quickly(self._hover, self._place(path, text), text, line, character)

    @call("mission.prepare")
    async def prepare(self) -> None:
        """Start what checks texts, which takes seconds, before somebody types."""
        await self._worker.run(checks.faults, self._workspace.root / "prepared.yaml", _SMALLEST)

    @call("mission.faults")
    async def faults(self, path: str, text: str) -> JsonValue:
        """Return the faults of a text with their places and quick fixes, as `picktree check` finds them."""
        return await self._worker.run(checks.faults, self._place(path, text), text)

    @call("mission.rehearse")
    async def rehearse(self, path: str, text: str, cases: str = "", names: tuple[str, ...] = ()) -> JsonValue:
        """Rehearse a text with its cases, by default those of its name in `cases` beside it."""
        file = self._workspace.resolve(cases) if cases else None
        return await self._worker.run(checks.rehearsal, self._place(path, text), text, file, names)

    def _place(self, path: str, text: str) -> Path:
        if len(text) > MAX_BYTES:
            raise PicktreeError(f"the text is larger than {MAX_BYTES // 1_000_000} MB")
        return self._workspace.resolve(path)

    # In the thread.

    def _tree(self, path: Path, text: str, known: tuple[str, ...] = ()) -> dict[str, Any]:
        reading = read_text(text, str(path))
        if reading is None:
            return {"readable": False, "whole": False, "name": "", "scene": "", "left_out": "", "trees": []}
        context = self._contexts.of(path, reading.source)
        found = context.outline(reading.source)
        return {
            "readable": True,
            "whole": reading.whole,
            "name": found.name,
            "scene": found.scene,
            "left_out": context.left_out,
            "trees": self._trees.of(text, found.trees, context, frozenset(known)),
        }

    def _edit(self, path: Path, text: str, edit: Edit, known: tuple[str, ...]) -> dict[str, Any]:
        context, _ = self._read(path, text)
        include = edit.include if isinstance(edit, AddNode) else ""
        own = {tree.id: tree for tree in self._own(path, text)} if needs_trees(edit, context, text) else {}
        if include:
            own |= {name: tree for name, (tree, file) in library_declarations().items() if file == include}
        result = edited(text, edit, context, own)
        new = result.text
        if include:
            more = self._file(path, new).include_edit(include)
            if more is not None:
                start, end = (self._index(new, place) for place in (more.span.start, more.span.end))
                new = f"{new[:start]}{more.text}{new[end:]}"
        found: list[TextChange] = changes(text, new)
        return {
            "changes": change_values(found, Places(text)),
            "selected": result.selected,
            "tree": self._tree(path, new, known),
        }

    def _palette(self, path: Path, text: str) -> dict[str, Any]:
        context, _ = self._read(path, text)
        own = self._own(path, text)
        return {
            "nodes": palette_values(context, own, library_declarations().values()),
            "common": common_entries(),
        }

    def _form(self, path: Path, text: str, node: str) -> dict[str, Any]:
        context, reading = self._read(path, text)
        found = context.outline(reading.source)
        shown = found.nodes().get(node)
        if shown is None:
            raise PicktreeError(f"the mission has no node {node!r}")
        own = {tree.id: tree for tree in self._own(path, text)}
        declaration = own.get(shown.identity) or context.known(shown.identity)
        names = self._scene_names(found.scene, path)
        return {
            "ports": [
                {
                    "key": port.key,
                    "names": list(names.get(port.names, ())) if port.names else [],
                    "default": default_words(port),
                }
                for port in (declaration.ports if declaration is not None else ())
            ],
            "keys": self._keys(path, text, node.partition("/")[0]),
        }

    def _keys(self, path: Path, text: str, tree: str) -> list[str]:
        """Return the keys of the blackboard of one tree."""
        return self._file(path, text).keys_of(tree)

    def _scene_names(self, scene: str, path: Path) -> dict[Any, tuple[str, ...]]:
        if not scene:
            return {}
        try:
            return dict(load_surroundings(scene, path.parent).names)
        except PicktreeError:
            return {}

    def _complete(self, path: Path, text: str, line: int, character: int) -> dict[str, Any] | None:
        file, place = self._file(path, text), self._cursor(text, line, character)
        found = file.complete(place)
        if found is None:
            return None
        span, proposals = found
        includes = {each.include: file.include_edit(each.include) for each in proposals if each.include}
        places = Places(text)
        values: list[dict[str, Any]] = []
        for each in proposals:
            value = _proposal(each)
            more = includes.get(each.include)
            if more is not None:
                at = places.units(self._index(text, more.span.start))
                value["also"] = {"from": at, "to": at, "insert": more.text}
            values.append(value)
        return {**self._range(text, span), "options": values}

    def _hover(self, path: Path, text: str, line: int, character: int) -> dict[str, Any] | None:
        found = self._file(path, text).hover(self._cursor(text, line, character))
        return None if found is None else {**self._range(text, found[0]), "text": found[1]}

    # Texts.

    def _read(self, path: Path, text: str) -> tuple[MissionContext, ReadText]:
        reading = read_text(text, str(path))
        if reading is None:
            raise PicktreeError("the text cannot be read: mend its faults of form first")
        return self._contexts.of(path, reading.source), reading

    def _own(self, path: Path, text: str) -> list[NodeDeclaration]:
        """Return the trees of a text itself as nodes that can be called."""
        try:
            document = read_document(path, "mission", text)
        except PicktreeError:
            return []
        return [tree for tree in tree_declarations(document) if tree.id != MAIN]

    def _file(self, path: Path, text: str) -> OpenFile:
        return OpenFile(path, text, self._registry, _schema_of)

    def _cursor(self, text: str, line: int, character: int) -> CursorPlace:
        lines = text.split("\n")
        if not 0 <= line < len(lines):
            raise PicktreeError(f"the text has no line {line + 1}")
        return CursorPlace(line, Places(lines[line]).points(character))

    def _index(self, text: str, place: CursorPlace) -> int:
        return checks.LineStarts(text).place(place)

    def _range(self, text: str, span: Span) -> dict[str, Any]:
        places = Places(text)
        return {
            "from": places.units(self._index(text, span.start)),
            "to": places.units(self._index(text, span.end)),
        }


def _proposal(proposal: Proposal) -> dict[str, Any]:
    return {
        "label": proposal.label,
        "kind": proposal.kind,
        "snippet": proposal.snippet,
        "doc": proposal.doc,
        "include": proposal.include,
    }


def _schema_of(kind: str) -> Schema:
    match kind:
        case "scene" | "robot" | "faults" | "cases":
            return file_schema(kind)
        case _:
            return {}
