"""Write slice: the tree, faults, edits and rehearsals of a mission's text that is being written."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

from pydantic import Field
from starlette.routing import BaseRoute

from ...authoring.editor.text_changes import TextChange, changes
from ...files.errors import PicktreeError
from ...files.yaml.file_text import MAX_BYTES
from . import checks, text_answers
from .answers import Places, TreeAnswers, change_values
from .calls import JsonValue, call
from .context import MissionTexts, library_declarations, own_trees, read_text
from .edits import AddNode, Edit, edited, needs_trees
from .slice import Studio
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
        self._texts = MissionTexts()
        self._trees = TreeAnswers()
        # One thread: answers come in the order of the edits, and registries are used by one at a time.
        self._thread = ThreadPoolExecutor(1, "missions")
        # Processes of their own, so that no edit waits for what may come later.
        self._helper, self._worker = Worker(), Worker()

    def routes(self) -> Sequence[BaseRoute]:
        return ()

    async def close(self) -> None:
        self._thread.shutdown(wait=False, cancel_futures=True)
        await self._helper.close()
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
        return await self._helper.run(text_answers.palette, self._place(path, text), text)

    @call("mission.form")
    async def form(self, path: str, text: str, node: str) -> JsonValue:
        """Return the ports of a node with their values, choices, names of the scene, and keys to refer to."""
        return await self._helper.run(text_answers.form, self._place(path, text), text, node)

    @call("mission.complete")
    async def complete(self, path: str, text: str, line: int, character: int) -> JsonValue:
        """Return what may be written at a place; line and character count from 0, in UTF-16 units."""
        place = self._place(path, text)
        return await self._helper.run(text_answers.completion, place, text, line, character)

    @call("mission.hover")
    async def hover(self, path: str, text: str, line: int, character: int) -> JsonValue:
        """Return the documentation of what stands at a place as Markdown; none for nothing."""
        place = self._place(path, text)
        return await self._helper.run(text_answers.documentation, place, text, line, character)

    @call("mission.prepare")
    async def prepare(self) -> None:
        """Start the processes of answers, which takes seconds, before somebody types."""
        file = self._workspace.root / "prepared.yaml"
        await asyncio.gather(
            self._helper.run(text_answers.palette, file, _SMALLEST),
            self._worker.run(checks.faults, file, _SMALLEST),
        )

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
        context = self._texts.context(path, reading)
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
        context, _ = self._texts.read(path, text)
        include = edit.include if isinstance(edit, AddNode) else ""
        own = {tree.id: tree for tree in own_trees(path, text)} if needs_trees(edit, context, text) else {}
        if include:
            own |= {name: tree for name, (tree, file) in library_declarations().items() if file == include}
        result = edited(text, edit, context, own)
        new = result.text
        if include:
            more = self._texts.file(path, new).include_edit(include)
            if more is not None:
                start, end = (
                    checks.LineStarts(new).place(place) for place in (more.span.start, more.span.end)
                )
                new = f"{new[:start]}{more.text}{new[end:]}"
        found: list[TextChange] = changes(text, new)
        return {
            "changes": change_values(found, Places(text)),
            "selected": result.selected,
            "tree": self._tree(path, new, known),
        }
