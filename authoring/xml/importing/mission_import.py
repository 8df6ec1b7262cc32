"""Importer: converts the text of a BehaviorTree.CPP 4 file to that of a mission file, and writes its YAML."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import cast

from ....errors import PicktreeError
from ....files.marks import Diagnostic, FileError
from ....files.yaml.document import Document, read_document
from ....files.yaml.reader import Value, resolve
from ....trees.loading.loader import examine
from ....trees.loading.registry import NodeRegistry
from ....trees.mission import MAIN, Mission
from ..export.mission_export import XmlExporter
from ..format import btcpp_vocabulary
from ..format.element import Element, MarkedEntry, MarkedValue, Scalar
from .attributes import NodeDraft
from .node_import import XmlNodeReader
from .port_import import PortsOfTrees, TreePort
from .source import XmlSource, read_source

MAX_LINE_LENGTH = 108
"""Maximum length of a line; values that fit are written in one."""
_MAX_MAPPINGS_IN_LINE = 3
"""Maximum number of nested or neighbouring mappings in a line."""
_PLAIN = re.compile(r"[A-Za-z_](?:[\w./<>=+*()!%' ;-]*[\w./<>=+*()!%';-])?", re.ASCII)
_IN_QUOTES = re.compile(r"[ !#-\[\]-~\u00a1-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]*")


def mission_text(document: MarkedValue) -> str:
    """Return the whole file: the head, then each tree after an empty line."""
    lines = [f"# {comment}" for comment in document.comments]
    for entry in document.entries or ():
        if entry.key != "trees":
            lines += _entry(entry, "")
            continue
        lines.append("trees:")
        for index, tree in enumerate(entry.value.entries or ()):
            lines += [""] if index else []
            lines += _entry(tree, "  ")
    return "\n".join([*lines, ""])


def scalar_text(value: Scalar) -> str:
    """Return a scalar's text, which reads back as the same value."""
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case int():
            return str(value)
        case float():
            return _float(value)
        case str():
            return _text(value)


def _float(value: float) -> str:
    if math.isinf(value):
        return "-.inf" if value < 0 else ".inf"
    return ".nan" if math.isnan(value) else repr(value)


def _text(text: str) -> str:
    if _PLAIN.fullmatch(text) and isinstance(resolve(text), str):
        return text
    if _IN_QUOTES.fullmatch(text):
        return f'"{text}"'
    if "'" not in text and "\n" not in text and _IN_QUOTES.fullmatch(text.replace('"', "").replace("\\", "")):
        return f"'{text}'"
    return _escaped(text)


def _escaped(text: str) -> str:
    # JSON's escapes are valid in YAML, but JSON allows characters that a YAML file cannot hold.
    quoted = json.dumps(text, ensure_ascii=False)
    return re.sub(r"[^ -~\u00a1-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]", _code, quoted)


def _code(match: re.Match[str]) -> str:
    return f"\\u{ord(match[0]):04x}" if ord(match[0]) < 0x10000 else f"\\U{ord(match[0]):08x}"


def _entry(entry: MarkedEntry, indent: str) -> Iterator[str]:
    """Yield the lines of `key: value`, in one line or as a block."""
    for comment in entry.value.comments:
        yield f"{indent}# {comment}"
    key = scalar_text(entry.key)
    line = _line(entry.value)
    if (
        line is not None
        and len(indent) + len(key) + 2 + len(line) <= MAX_LINE_LENGTH
        and not _is_children(entry)
    ):
        yield f"{indent}{key}: {line}"
    elif entry.value.entries or entry.value.items:
        yield f"{indent}{key}:"
        yield from _block(entry.value, indent + "  ")
    else:
        yield f"{indent}{key}: {_flow(entry.value)}"


def _block(value: MarkedValue, indent: str) -> Iterator[str]:
    for entry in value.entries or ():
        yield from _entry(entry, indent)
    for item in value.items or ():
        for comment in item.comments:
            yield f"{indent}# {comment}"
        line = _line(item)
        if line is not None and item.entries is not None and len(item.entries) == 1:
            # `- Grasp: {…}` reads better than `- {Grasp: {…}}`.
            line = line[1:-1]
        if line is not None and len(indent) + 2 + len(line) <= MAX_LINE_LENGTH:
            yield f"{indent}- {line}"
        elif item.entries:
            lines = [line for entry in item.entries for line in _entry(entry, indent + "  ")]
            yield f"{indent}- {lines[0][len(indent) + 2 :]}"
            yield from lines[1:]
        else:
            yield f"{indent}- {_flow(item)}"


def _is_children(entry: MarkedEntry) -> bool:
    """Whether the entry is a list of several children, which reads better from top to bottom."""
    several = entry.value.items is not None and len(entry.value.items) > 1
    nodes = several and any(item.entries is not None for item in entry.value.items or ())
    return nodes and (entry.key == "do" or entry.key[:1].isupper())


def _line(value: MarkedValue) -> str | None:
    """Return the value in one line; None where that is hard to read."""
    if _commented(value) or _mappings(value) > _MAX_MAPPINGS_IN_LINE or _has_children(value):
        return None
    return _flow(value)


def _commented(value: MarkedValue) -> bool:
    return any(below.comments or _commented(below) for below in _below(value))


def _has_children(value: MarkedValue) -> bool:
    return any(_is_children(entry) for entry in value.entries or ()) or any(
        _has_children(below) for below in _below(value)
    )


def _mappings(value: MarkedValue) -> int:
    return (value.entries is not None) + sum(_mappings(below) for below in _below(value))


def _below(value: MarkedValue) -> Iterator[MarkedValue]:
    yield from value.items or ()
    yield from (entry.value for entry in value.entries or ())


def _flow(value: MarkedValue) -> str:
    if value.items is not None:
        return f"[{', '.join(map(_flow, value.items))}]"
    if value.entries is not None:
        entries = (f"{scalar_text(e.key)}: {_flow(e.value)}" for e in value.entries)
        return f"{{{', '.join(entries)}}}"
    return scalar_text(value.scalar)


_ONE = ("name", "scene", "goal")
_MANY = ("include", "plugins")


def xml_to_mission(text: str, path: Path, registry: NodeRegistry | None = None) -> str:
    """Convert XML text to the text of a mission file; `path` is the place of the file.

    Raises FileError with all errors, and with everything that a mission cannot express.
    """
    return _Importer(text, path, (registry or NodeRegistry()).copy()).text()


class _Importer:
    def __init__(self, text: str, path: Path, registry: NodeRegistry) -> None:
        self._text = text
        self._path = path
        self._registry = registry
        self._source: XmlSource = read_source(text, path)
        self._refuse(self._source.faults)

    def text(self) -> str:
        for plugin in self._source.said("plugins"):
            try:
                self._registry.add_plugin(plugin.value, self._path.parent)
            except PicktreeError:
                continue  # the loader tells it with its place
        whole = self._document()
        root = whole.node()
        data = cast("dict[str, Value]", root.value)
        document = Document(self._path, self._text, "mission", data, root)
        reading = examine(document, self._registry)
        self._refuse(reading.faults)
        self._refuse(self._changed(reading.mission))
        written = mission_text(whole)
        assert read_document(self._path, "mission", written).data == data
        return written

    def _refuse(self, faults: Iterable[Diagnostic]) -> None:
        found = tuple(faults)
        if any(fault.severity == "error" for fault in found):
            raise FileError(found)

    def _document(self) -> MarkedValue:
        source = self._source
        ports = PortsOfTrees(source, self._registry)
        declared = ports.find()
        reader = XmlNodeReader(self._registry, declared, self._called)
        trees = MarkedValue.mapping(source.root.mark)
        for name, element in source.trees.items():
            if name not in source.included and element.children:
                root = reader.node(element.children[0], self._called(name))
                body = _tree(root, declared[name], element)
                trees.put(self._called(name), body, element.place("ID"))
        self._refuse([*self._twice(), *ports.faults, *reader.faults])
        whole = MarkedValue.mapping(source.root.mark)
        whole.comments = source.root.comments
        self._head(whole)
        whole.put("trees", trees)
        return whole

    def _called(self, name: str) -> str:
        """Return the tree's name in the mission, whose first tree is `Main`."""
        return MAIN if name == self._source.main else name

    def _twice(self) -> Iterable[Diagnostic]:
        other = self._source.trees.get(MAIN)
        if other is not None and self._source.main not in ("", MAIN):
            message = f"a mission begins with {MAIN!r}, which is {self._source.main!r} here"
            yield Diagnostic(other.place("ID"), MAIN, message, "give this tree another name", "P914")

    def _head(self, whole: MarkedValue) -> None:
        whole.put("picktree", 1)
        whole.put("kind", "mission")
        if self._source.main == "":
            whole.put("library", True)
        for key in _ONE:
            for said in self._source.said(key)[:1]:
                whole.put(key, said.value, said.mark)
        for key in _MANY:
            said = self._source.said(key)
            if said:
                items = [MarkedValue(one.mark, one.value) for one in said]
                whole.put(key, MarkedValue(said[0].mark, items=items), said[0].mark)

    def _changed(self, mission: Mission) -> Iterable[Diagnostic]:
        """Report trees of other mission files for which the XML differs."""
        exporter = XmlExporter(mission)
        for name in sorted(self._source.included):
            given, tree = self._source.trees.get(name), mission.trees.get(name)
            if given is None:
                continue
            if tree is None:
                message = f"none of the included files holds the tree {name!r}"
                yield Diagnostic(
                    given.place("ID"), name, message, "name its file in the metadata 'include'", "P916"
                )
            elif _bare(exporter.tree(tree)) != _bare(given):
                message = f"the tree {name!r} says something else than the included {tree.mark.file}"
                hint = "change that file, or give the tree another name here"
                yield Diagnostic(given.place("ID"), name, message, hint, "P916")


def _tree(root: NodeDraft, ports: tuple[TreePort, ...], element: Element) -> MarkedValue:
    """Return the body under the tree's name."""
    written = root.written()
    if not ports:
        written.comments = (*element.comments, *written.comments)
        return written
    body = MarkedValue.mapping(element.mark)
    body.comments = element.comments
    declared = MarkedValue.mapping(element.mark)
    for port in ports:
        declared.put(port.key, port.declared(), port.mark)
    body.put("ports", declared)
    if written.entries is None:
        body.put(root.id, MarkedValue.mapping(root.mark))
    else:
        body.put(root.id, written.entries[0].value, written.mark)
    return body


def _bare(element: Element) -> Element:
    """Return the element without the attributes that Groot2 adds."""
    kept = {
        key: value
        for key, value in element.attributes.items()
        if key not in btcpp_vocabulary.IGNORED and not (key == "name" and value == element.name)
    }
    return dataclasses.replace(element, attributes=kept, children=tuple(map(_bare, element.children)))
