"""Reference page of a kind of file: each key with its meaning and an example."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from picktree.files import file_system
from picktree.files.yaml import Document, Value, YamlNode, read_document, resolve

from .schema_parts import Schema, schema, schemas

_PATCH = "Patch"
"""Ending of definitions for files that change another file: their keys are those of the whole file."""
_MAX_EXAMPLE_LENGTH = 70
_PLAIN = re.compile(r"[\w./*(+-][\w ./*()%°<>=+-]*", re.ASCII)
"""Text that needs no quotes, even in a flow mapping."""
_HEADER = ("picktree", "kind")


@dataclass(slots=True)
class KeySection:
    """Keys of the file itself (`name` is empty), or of one kind of mapping in it."""

    name: str
    doc: str
    keys: dict[str, Schema]
    under: list[str] = field(default_factory=list[str])
    """Keys whose values are such mappings."""


def file_reference(kind: str, root: Schema) -> FileReference:
    """Return the keys of a kind of file with their examples. `root`: its schema."""
    reference = FileReference(root)
    # A wheel has the files of scenes and robots only.
    for pattern in (*EXAMPLES[kind], f"examples/reference/{kind}.yaml"):
        for path in sorted(file_system.ROOT.glob(pattern)):
            reference.take(read_document(path, kind))
    return reference


class FileReference:
    """Keys of a schema by section, with the examples found so far."""

    def __init__(self, root: Schema) -> None:
        self._definitions = schema(root.get("definitions"))
        self._top = schema(root.get("else")) or root
        self._doc = str(root.get("description", ""))
        self.sections: dict[str, KeySection] = {}
        self.examples: dict[tuple[str, str], str] = {}
        """Example by section and key."""
        self._section("", self._top)

    @property
    def missing(self) -> list[str]:
        """Return the keys without an example, as `Camera.fov`."""
        return [
            f"{section.name}.{key}"
            for section in self.sections.values()
            for key in section.keys
            if (section.name, key) not in self.examples
        ]

    def take(self, document: Document) -> None:
        """Use the values of a file as examples of keys that have none yet."""
        self._visit(document.root, self._top, "")

    def page(self, kind: str) -> str:
        return "\n".join(self._lines(kind)) + "\n"

    def _lines(self, kind: str) -> Iterator[str]:
        yield f"# {_TITLES[kind][0]}\n"
        yield f"All keys of the kind `{kind}`, each with an example. {self._doc} See {_TITLES[kind][1]}.\n"
        yield "```sh"
        yield f"picktree check examples/reference/{kind}.yaml"
        yield f"picktree schema {kind}           # for editors, which complete and underline by it"
        yield "```\n"
        yield "Made by `make docs` from the declarations; do not edit. The examples are from shipped files,"
        yield "and from those of `examples/reference`; tests check them."
        for section in self.sections.values():
            yield f"\n## {section.name or 'The file'}\n"
            if section.name:
                under = ", ".join(f"`{key}`" for key in dict.fromkeys(section.under))
                yield f"{section.doc} It is written under {under}.\n"
            yield "| key | meaning | example |"
            yield "|---|---|---|"
            for key, found in section.keys.items():
                example = self.examples.get((section.name, key), "")
                yield f"| `{key}` | {_meaning(found)} | {f'`{_cell(example)}`' if example else ''} |"

    # Sections of the schema.

    def _section(self, name: str, part: Schema) -> None:
        properties = schema(part.get("properties"))
        keys = {key: schema(below) for key, below in properties.items() if below is not False}
        keys = {key: below for key, below in keys.items() if name or key not in _HEADER}
        self.sections[name] = KeySection(name, str(part.get("description", "")), keys)
        inner = [(f"{name}.{key}" if name else key, below) for key, below in keys.items()]
        inner += [(name, schema(rule.get("then"))) for rule in schemas(part.get("allOf"))]
        for under, below in inner:
            for target in self._targets(below):
                if target not in self.sections:
                    self._section(target, schema(self._definitions[target]))
                self.sections[target].under.append(under)

    def _targets(self, part: Schema) -> Iterator[str]:
        """Yield the names of the definitions of mappings in a value."""
        target = part.get("$ref")
        if isinstance(target, str):
            name = target.rpartition("/")[2]
            found = schema(self._definitions.get(name))
            if not name.endswith(_PATCH) and "properties" in found:
                yield name
            elif not name.endswith(_PATCH):
                yield from self._targets(found)
        for below in _inner(part):
            yield from self._targets(below)

    # Examples.

    def _visit(self, node: YamlNode, part: Schema, section: str) -> None:
        for found, name in self._alternatives(node, part, section):
            properties = schema(found.get("properties"))
            for key, child in node.entries.items():
                below = schema(properties.get(key))
                if below:
                    self.examples.setdefault((name, key), example_text(key, child.value))
                    self._visit(child, below, name)
                else:
                    for other in _others(found):
                        self._visit(child, other, name)
            items = schema(found.get("items"))
            for child in node.items if items else ():
                self._visit(child, items, name)

    def _alternatives(self, node: YamlNode, part: Schema, section: str) -> Iterator[tuple[Schema, str]]:
        yield part, section
        if "then" in part and _holds(schema(part["if"]), node):
            yield from self._alternatives(node, schema(part["then"]), section)
        target = part.get("$ref")
        if isinstance(target, str):
            name = target.rpartition("/")[2]
            found = schema(self._definitions.get(name))
            yield from self._alternatives(
                node, found, name.removesuffix(_PATCH) if "properties" in found else section
            )
        for key in ("anyOf", "allOf", "oneOf"):
            for below in schemas(part.get(key)):
                yield from self._alternatives(node, below, section)


_TITLES: Mapping[str, tuple[str, str]] = {
    "scene": ("The scene file", "[language.md](language.md) and [heaps.md](heaps.md)"),
    "robot": ("The robot file", "[robots.md](robots.md)"),
    "faults": ("The faults file", "[faults.md](faults.md)"),
    "cases": ("The cases file", "[rehearsal.md](rehearsal.md)"),
    "plan": ("The plan of a batch", "[batches.md](batches.md)"),
}
"""Title and neighbouring pages by kind of file."""
EXAMPLES: Mapping[str, tuple[str, ...]] = {
    "scene": ("world/scenes/three_bins.yaml", "world/scenes/*.yaml"),
    "robot": ("world/robots/panda.yaml", "world/robots/*.yaml"),
    "faults": ("examples/faults/*.yaml",),
    "cases": ("examples/cases/sort_by_colour.yaml", "examples/cases/*.yaml"),
    "plan": ("examples/plan_*.yaml",),
}
"""Files from which the examples are taken by kind, besides those of `examples/reference`."""


def example_text(key: str, value: Value) -> str:
    """Return a key with its value in one line; inner mappings and lists are left out where it is long."""
    for depth in (9, 2, 1, 0):
        text = f"{key}: {_flow(value, depth)}"
        if len(text) <= _MAX_EXAMPLE_LENGTH:
            break
    return text if len(text) <= _MAX_EXAMPLE_LENGTH else f"{key}: …"


def _flow(value: Value, depth: int) -> str:
    match value:
        case dict():
            if depth == 0:
                return "{…}"
            return "{" + ", ".join(f"{key}: {_flow(item, depth - 1)}" for key, item in value.items()) + "}"
        case list():
            if depth == 0:
                return "[…]"
            return "[" + ", ".join(_flow(item, depth - 1) for item in value) + "]"
        case None:
            return "null"
        case bool():
            return str(value).lower()
        case str() if resolve(value) != value or not _PLAIN.fullmatch(value):
            return json.dumps(value, ensure_ascii=False)
        case _:
            return str(value)


def _inner(part: Schema) -> Iterator[Schema]:
    """Yield the schemas of a value's possible contents and forms."""
    for key in ("anyOf", "allOf", "oneOf"):
        yield from schemas(part.get(key))
    items = part.get("items")
    yield from filter(None, (schema(items), *schemas(items), schema(part.get("then"))))
    yield from _others(part)


def _holds(condition: Schema, node: YamlNode) -> bool:
    """Whether a mapping has the constants that a condition names, of which there is at least one."""
    wanted = {
        key: schema(part)["const"]
        for key, part in schema(condition.get("properties")).items()
        if "const" in schema(part)
    }
    return bool(wanted) and all(
        key in node.entries and node.entries[key].value == value for key, value in wanted.items()
    )


def _others(part: Schema) -> Iterator[Schema]:
    """Yield the schemas of entries whose names the author chooses."""
    yield from filter(None, (schema(part.get("additionalProperties")),))
    for below in schema(part.get("patternProperties")).values():
        yield schema(below)


def _meaning(part: Schema) -> str:
    text = str(part.get("markdownDescription") or part.get("description") or "")
    return _cell(text.replace("\n\n", " "))


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
