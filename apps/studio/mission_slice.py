"""Write slice: the tree, faults, edits and rehearsals of a mission's text that is being written."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias, TypeVar

import yaml
from pydantic import Field

from picktree.authoring.editor import NotEditable, changes, node_edits, source_of
from picktree.files import PicktreeError
from picktree.files.yaml import file_text, scalar_text
from picktree.trees import COMMON_KEYS, Node, NodeDeclaration, PortDeclaration

from . import answers
from .answers import PageText, TreeAnswers
from .calls import JsonValue, call
from .context import MissionContext, MissionTexts, library_declarations, own_trees, read_text
from .slice import Slice, Studio
from .worker import Worker


@dataclass(frozen=True, slots=True)
class SetPort:
    do: Literal["set"]
    node: str
    key: str
    value: str
    """Value from a form: quotes are added where YAML needs them. Empty: it is removed."""


@dataclass(frozen=True, slots=True)
class AddNode:
    do: Literal["add"]
    place: node_edits.Target
    identity: str
    include: str = ""
    """File that the mission must include for it; empty: none."""


@dataclass(frozen=True, slots=True)
class MoveNode:
    do: Literal["move"]
    node: str
    place: node_edits.Target


@dataclass(frozen=True, slots=True)
class DropNode:
    """Removal of a node with all below it, or of a node around its only child."""

    do: Literal["remove", "unwrap"]
    node: str


@dataclass(frozen=True, slots=True)
class ExchangeNode:
    """New node around a node, or in its place."""

    do: Literal["wrap", "replace"]
    node: str
    identity: str


@dataclass(frozen=True, slots=True)
class RenameTree:
    do: Literal["rename_tree"]
    tree: str
    name: str


Edit: TypeAlias = SetPort | AddNode | MoveNode | DropNode | ExchangeNode | RenameTree
Trees: TypeAlias = Mapping[str, NodeDeclaration]
"""Trees of a text as nodes that can be called, by name."""


def edited(text: str, edit: Edit, context: MissionContext, own: Trees) -> node_edits.EditedText:
    """Return the text after an edit. Raises PicktreeError when it cannot be done.

    `own`: the text's own trees.
    """
    editor = node_edits.NodeEditor(text, context.known)
    match edit:
        case SetPort(node=node, key=key, value=value):
            if not value.strip():
                return editor.remove_port(node, key)
            declaration = _declared(editor.node(node).identity, context, own)
            port = declaration.port(key) if declaration is not None else None
            return editor.set_port(node, key, written(value, key, port))
        case AddNode(place=place, identity=identity):
            return editor.add(place, node_edits.new_node(*_new(identity, context, own)))
        case MoveNode(node=node, place=place):
            return editor.move(node, place)
        case DropNode(do=do, node=node):
            return editor.remove(node) if do == "remove" else editor.unwrap(node)
        case ExchangeNode(do="wrap", node=node, identity=identity):
            return editor.wrap(node, identity, tuple(node_edits.needed(*_new(identity, context, own))))
        case ExchangeNode(node=node, identity=identity):
            return editor.replace(node, node_edits.new_node(*_new(identity, context, own)))
        case RenameTree(tree=tree, name=name):
            return editor.rename_tree(tree, name)


def needs_trees(edit: Edit, context: MissionContext, text: str) -> bool:
    """Whether an edit needs the declarations of the text's own trees, which take time to read."""
    match edit:
        case SetPort(node=node):
            found = node_edits.NodeEditor(text, context.known).outline.nodes().get(node)
            return found is not None and context.known(found.identity) is None
        case AddNode(identity=identity) | ExchangeNode(identity=identity):
            return context.known(identity) is None
        case _:
            return False


def _declared(identity: str, context: MissionContext, own: Trees) -> NodeDeclaration | None:
    return own.get(identity) or context.known(identity)


def _new(identity: str, context: MissionContext, own: Trees) -> tuple[NodeDeclaration, type[Node] | None]:
    found = _declared(identity, context, own)
    if found is None:
        raise NotEditable(f"there is no node {identity!r}")
    return found, context.registry.find(identity)


def written(value: str, key: str, port: PortDeclaration | None) -> str:
    """Return a value that was typed in a form as YAML in one line.

    A text stays a text where the port takes texts; elsewhere a number is a number and a list a list.
    """
    text = " ".join(value.split())
    if text[:1] in ('"', "'") and _reads(text):
        return text
    if text.startswith("{") or key in COMMON_KEYS:
        return scalar_text(text)
    textual = port is not None and port.type.name in _TEXTS and not port.type.many
    return text if not textual and _reads(text) else scalar_text(text)


_TEXTS = ("string", "object", "expression")
"""Types of ports whose values are texts."""


def _reads(text: str) -> bool:
    """Whether YAML reads it as one value in a line."""
    try:
        node = source_of(f"[{text}]").root
    except yaml.YAMLError:
        return False
    return node.kind == "list" and len(node.items) == 1 and node.items[0].kind != "mapping"


T = TypeVar("T")
_SMALLEST: Final = """
picktree: 1
kind: mission
name: smallest
scene: three_bins
trees: {Main: {GoTo: {pose: home}}}
"""


class MissionSlice(Slice):
    """Calls on the text of one mission, which each call of the page contains; no text is kept here."""

    def __init__(self, studio: Studio) -> None:
        self._workspace = studio.workspace
        self._texts = MissionTexts()
        self._trees = TreeAnswers()
        # One thread: answers come in the order of the edits, and registries are used by one at a time.
        self._thread = ThreadPoolExecutor(1, "missions")
        # Processes of their own, so that no edit waits for what may come later.
        self._helper, self._worker = Worker(), Worker()

    async def close(self) -> None:
        self._thread.shutdown(wait=False, cancel_futures=True)
        await self._helper.close()
        await self._worker.close()

    async def _quickly(self, function: Callable[..., T], *args: object) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._thread, function, *args)

    @call("mission.tree")
    async def tree(self, path: str, text: str, known: tuple[str, ...] = ()) -> JsonValue:
        """Return the trees of a text for the picture, as far as the text can be read.

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
        return await self._helper.run(answers.palette, self._place(path, text), text)

    @call("mission.form")
    async def form(self, path: str, text: str, node: str) -> JsonValue:
        """Return the ports of a node with their values, choices, names of the scene, and keys to refer to."""
        return await self._helper.run(answers.form, self._place(path, text), text, node)

    @call("mission.complete")
    async def complete(self, path: str, text: str, line: int, character: int) -> JsonValue:
        """Return the proposals at a place; line and character count from 0, in UTF-16 units."""
        place = self._place(path, text)
        return await self._helper.run(answers.completion, place, text, line, character)

    @call("mission.hover")
    async def hover(self, path: str, text: str, line: int, character: int) -> JsonValue:
        """Return the documentation of the word at a place as Markdown; none without any."""
        place = self._place(path, text)
        return await self._helper.run(answers.documentation, place, text, line, character)

    @call("mission.prepare")
    async def prepare(self) -> None:
        """Start the processes of answers before the first request, which takes seconds."""
        file = self._workspace.root / "prepared.yaml"
        await asyncio.gather(
            self._helper.run(answers.palette, file, _SMALLEST),
            self._worker.run(answers.faults, file, _SMALLEST),
        )

    @call("mission.faults")
    async def faults(self, path: str, text: str) -> JsonValue:
        """Return the faults of a text with their places and quick fixes, as `picktree check` finds them."""
        return await self._worker.run(answers.faults, self._place(path, text), text)

    @call("mission.rehearse")
    async def rehearse(self, path: str, text: str, cases: str = "", names: tuple[str, ...] = ()) -> JsonValue:
        """Rehearse a text with its cases, by default those of its name in `cases` beside it."""
        file = self._workspace.resolve(cases) if cases else None
        return await self._worker.run(answers.rehearsal, self._place(path, text), text, file, names)

    def _place(self, path: str, text: str) -> Path:
        if len(text) > file_text.MAX_BYTES:
            raise PicktreeError(f"the text is larger than {file_text.MAX_BYTES // 1_000_000} MB")
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
        if include and (more := self._texts.file(path, new).include_edit(include)) is not None:
            start, end = map(PageText(new).place, (more.span.start, more.span.end))
            new = f"{new[:start]}{more.text}{new[end:]}"
        return {
            "changes": PageText(text).changes(changes(text, new)),
            "selected": result.selected,
            "tree": self._tree(path, new, known),
        }
