"""Document: the content of one YAML file, as plain values with the place of each."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from picktree.files import Diagnostic, FileError, Location, Mark, Severity, describe, suggest_name, where

from .file_text import read_text
from .reader import Value, YamlNode, read

FORMAT = 1
KINDS = ("mission", "scene", "robot", "faults", "cases", "plan")


@dataclass(frozen=True, slots=True)
class Document:
    """A file that was read. `data` is the whole mapping, `picktree` and `kind` included.

    `faults` are those of its form that leave it readable; checks add their faults to them.
    """

    path: Path
    text: str
    kind: str
    data: dict[str, Value]
    root: YamlNode
    faults: tuple[Diagnostic, ...] = ()
    layers: tuple[Document, ...] = ()
    """The documents of which this one was laid together."""

    def mark(self, loc: Location) -> Mark:
        """Return the place of the value; for a missing value the place of its nearest parent."""
        node = self.root
        for part in loc:
            child = node.child(part)
            if child is None:
                break
            node = child
        return node.mark

    def key_mark(self, loc: Location) -> Mark:
        """Return the place of the key of the value."""
        parent: YamlNode | None = self.root
        for part in loc[:-1]:
            parent = parent.child(part) if parent else None
        if parent and loc and isinstance(loc[-1], str) and loc[-1] in parent.keys:
            return parent.keys[loc[-1]]
        return self.mark(loc)

    def character_mark(self, loc: Location, character: int) -> Mark:
        """Return the place of a character (from 0) of a text; its start when quotes or escapes shift its
        characters."""
        start, value = self.mark(loc), self.get(loc)
        text = next((d.text for d in (*self.layers, self) if str(d.path) == start.file), None)
        if text is None or not isinstance(value, str) or "\n" in value:
            return start
        line = re.split(r"\r?\n", text)[start.line - 1][start.column - 1 :]
        quote = line[:1] if line[:1] in ("'", '"') else ""
        verbatim = line.startswith(f"{quote}{value}{quote}")
        return Mark(start.file, start.line, start.column + len(quote) + character) if verbatim else start

    def get(self, loc: Location) -> Value:
        """Return the value at that location; None for a missing value."""
        node: YamlNode | None = self.root
        for part in loc:
            node = node.child(part) if node else None
        return node.value if node else None

    def fault(
        self,
        loc: Location,
        message: str,
        hint: str = "",
        *,
        code: str,
        key: bool = False,
        character: int | None = None,
        severity: Severity = "error",
    ) -> Diagnostic:
        """Return a fault of the value there, or (`key`) of its key, or of one of its characters (from 0)."""
        if character is not None:
            mark = self.character_mark(loc, character)
        else:
            mark = self.key_mark(loc) if key else self.mark(loc)
        return Diagnostic(mark, where(loc), message, hint, code, severity)


def merge_patch(base: Document, over: Document) -> Document:
    """`over` laid on `base` as a merge patch (RFC 7396): mappings merge, the rest replaces, null removes.

    Every value keeps its place in the file that it came from.
    """
    root = _merged(base.root, over.root)
    data = cast("dict[str, Value]", root.value)
    layers = (*(base.layers or (base,)), over)
    return Document(over.path, over.text, over.kind, data, root, (*base.faults, *over.faults), layers)


def _merged(base: YamlNode, over: YamlNode) -> YamlNode:
    merged: dict[str, YamlNode] = dict(base.entries)
    keys = dict(base.keys)
    for name, node in over.entries.items():
        below = merged.get(name)
        both = below is not None and isinstance(below.value, dict) and isinstance(node.value, dict)
        if node.value is None:
            merged.pop(name, None)
        else:
            merged[name] = _merged(below, node) if below is not None and both else node
        keys[name] = over.keys[name]
    value: Value = {name: node.value for name, node in merged.items()}
    return YamlNode(value, over.mark, entries=merged, keys=keys)


def read_document(path: Path, kind: str | None = None, text: str | None = None) -> Document:
    """Read a file of that kind, or of any. `text`: the file's content, where it was read already.

    Raises FileError with every fault of its form that keeps it from being read. Other faults of form are in
    `Document.faults`: a check of its content adds to them.
    """
    text = read_text(path) if text is None else text
    reading = read(text, str(path))
    data = reading.root.value
    if not isinstance(data, dict):
        message = "a file is a mapping that begins with 'picktree: 1'"
        raise FileError([*reading.faults, Diagnostic(reading.root.mark, "", message, code="P119")])
    faults = [*reading.faults, *_format_faults(reading.root)]
    other = list(_kind_faults(reading.root, kind))
    if other or any(fault.code == "P102" and fault.where for fault in faults):
        # Documents of another kind or format cannot be checked.
        raise FileError([*faults, *other])
    return Document(path, text, str(data["kind"]), data, reading.root, tuple(faults))


def _format_faults(root: YamlNode) -> Iterable[Diagnostic]:
    version = root.entries.get("picktree")
    if version is None:
        message = f"'picktree: {FORMAT}' is missing"
        yield Diagnostic(Mark(root.mark.file, 1, 1), "", message, "every file begins with it", "P102")
    elif type(version.value) is not int or version.value < 1:
        message, hint = "the format is a whole number", f"this is format {FORMAT}"
        yield Diagnostic(version.mark, "picktree", message, hint, "P102")
    elif version.value > FORMAT:
        message = f"format {version.value} is newer than {FORMAT}, which this picktree reads"
        yield Diagnostic(version.mark, "picktree", message, "upgrade picktree", "P102")


def _kind_faults(root: YamlNode, kind: str | None) -> Iterable[Diagnostic]:
    given = root.entries.get("kind")
    if given is None:
        hint = f"one of {', '.join(KINDS)}"
        yield Diagnostic(Mark(root.mark.file, 1, 1), "", "'kind:' is missing", hint, "P103")
    elif not isinstance(given.value, str):
        message = f"the kind is a word, not {describe(given.value)}"
        yield Diagnostic(given.mark, "kind", message, f"one of {', '.join(KINDS)}", "P103")
    elif given.value not in KINDS:
        message = f"unknown kind {describe(given.value)}"
        yield Diagnostic(given.mark, "kind", message, suggest_name(given.value, KINDS), "P103")
    elif kind is not None and given.value != kind:
        message = f"this is a {given.value} file; a {kind} file is wanted here"
        yield Diagnostic(given.mark, "kind", message, code="P103")
