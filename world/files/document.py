"""Reading one YAML file: plain values, and the place in the file of each of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from .marks import Fault, FileError, Location, Mark, where
from .nearest import nearest
from .reader import MAX_BYTES, Node, Value, mark_at, read

__all__ = [
    "KINDS", "Document", "Fault", "FileError", "Location", "Mark",
    "Value", "load_document", "nearest", "overlaid", "parse_document", "where",
]  # fmt: skip

FORMAT = 1
KINDS = ("mission", "scene", "robot", "faults", "cases", "plan")


@dataclass(frozen=True, slots=True)
class Document:
    """A file that was read. `data` is the whole mapping, `picktree` and `kind` included."""

    path: Path
    text: str
    kind: str
    data: dict[str, Value]
    root: Node

    def mark(self, loc: Location) -> Mark:
        """Where the value stands; of a value that is not there, where its nearest parent stands."""
        node = self.root
        for part in loc:
            child = node.child(part)
            if child is None:
                break
            node = child
        return node.mark

    def key_mark(self, loc: Location) -> Mark:
        """Where the key of the value stands."""
        parent: Node | None = self.root
        for part in loc[:-1]:
            parent = parent.child(part) if parent else None
        if parent and loc and isinstance(loc[-1], str) and loc[-1] in parent.keys:
            return parent.keys[loc[-1]]
        return self.mark(loc)

    def get(self, loc: Location) -> Value:
        """The value at that place, None when there is none."""
        node: Node | None = self.root
        for part in loc:
            node = node.child(part) if node else None
        return node.value if node else None

    def fault(
        self, loc: Location, message: str, hint: str = "", *, code: str = "", key: bool = False
    ) -> Fault:
        """A fault of the value there, or (`key`) of its key."""
        return Fault(self.key_mark(loc) if key else self.mark(loc), where(loc), message, hint, code)


def overlaid(base: Document, over: Document) -> Document:
    """`over` laid on `base` as a merge patch (RFC 7396): mappings merge, the rest replaces, null removes.

    Every value keeps its place in the file that it came from.
    """
    root = _merged(base.root, over.root)
    return Document(over.path, over.text, over.kind, cast("dict[str, Value]", root.value), root)


def _merged(base: Node, over: Node) -> Node:
    merged: dict[str, Node] = dict(base.entries)
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
    return Node(value, over.mark, entries=merged, keys=keys)


def load_document(path: Path, kind: str | None = None) -> Document:
    """Read a file. Raises FileError with every fault of its form; `kind` None takes any kind."""
    start = Mark(str(path), 1, 1)
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise FileError([Fault(start, "", "there is no such file")]) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise FileError([Fault(start, "", f"the file cannot be read: {reason}")]) from None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start].decode("utf-8", errors="replace")
        mark = mark_at(str(path), before, len(before))
        if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
            mark = start
        raise FileError([Fault(mark, "", "the file is not UTF-8", "save it as UTF-8")]) from None
    return parse_document(text, path, kind)


def parse_document(text: str, path: Path, kind: str | None = None) -> Document:
    """As `load_document`, of a text that was read already."""
    root = read(text, str(path))
    data = root.value
    if not isinstance(data, dict):
        raise FileError([Fault(root.mark, "", "a file is a mapping that begins with 'picktree: 1'")])
    faults = list(_header_faults(root, kind))
    if faults:
        raise FileError(faults)
    return Document(path, text, str(data["kind"]), data, root)


def _header_faults(root: Node, kind: str | None) -> Iterable[Fault]:
    version, given = root.entries.get("picktree"), root.entries.get("kind")
    top = Mark(root.mark.file, 1, 1)
    if version is None:
        yield Fault(top, "", f"'picktree: {FORMAT}' is missing", "every file begins with it")
    elif type(version.value) is not int or version.value < 1:
        yield Fault(version.mark, "picktree", "the format is a whole number", f"this is format {FORMAT}")
    elif version.value > FORMAT:
        message = f"format {version.value} is newer than this picktree reads ({FORMAT})"
        yield Fault(version.mark, "picktree", message, "upgrade picktree")
    if given is None:
        yield Fault(top, "", "'kind:' is missing", f"one of {', '.join(KINDS)}")
    elif given.value not in KINDS:
        yield Fault(given.mark, "kind", f"unknown kind {given.value!r}", nearest(str(given.value), KINDS))
    elif kind is not None and given.value != kind:
        yield Fault(given.mark, "kind", f"this is a {given.value} file; a {kind} file is wanted here")
