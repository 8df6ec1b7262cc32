"""Walk through a JSON Schema of picktree: the parts that describe the value at a location."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import cast

from picktree.authoring.schema import Schema, schema, schemas
from picktree.files import Location

_NODE = "#/definitions/node."
_TREE = "#/definitions/tree."


class SchemaWalk:
    """Schema of one kind of file, queried by location."""

    def __init__(self, root: Schema) -> None:
        self._root = root
        self._definitions = schema(root.get("definitions"))

    def at(self, path: Location) -> list[Schema]:
        """Return the parts that describe the value at a location."""
        found = list(self._parts(self._root))
        for step in path:
            found = [
                part for each in found for below in self._below(each, step) for part in self._parts(below)
            ]
        return found

    def properties(self, parts: list[Schema]) -> dict[str, Schema]:
        """Return the keys of the mappings that the parts describe, each with its schema."""
        found: dict[str, Schema] = {}
        for part in parts:
            for name, below in schema(part.get("properties")).items():
                if below is not False:
                    found.setdefault(name, schema(below))
        return found

    def own_keys(self, body: Schema) -> dict[str, Schema]:
        """Return ports and slots of a node's body, without the keys of every node and without children."""
        found = schema(body.get("properties"))
        return {key: schema(part) for key, part in found.items() if "$ref" not in schema(part)}

    @property
    def nodes(self) -> frozenset[str]:
        """IDs of all nodes and sub-trees that the schema knows."""
        names = (name.partition(".") for name in self._definitions)
        return frozenset(identity for prefix, _, identity in names if identity and prefix in ("node", "tree"))

    def resolved(self, part: Schema) -> Schema:
        """Return a schema with the definition to which it refers; its own entries win."""
        target = part.get("$ref")
        return self.resolved(self._definition(target)) | part if isinstance(target, str) else part

    def port(self, node: str, key: str) -> Schema:
        """Return the schema of a key of a node or sub-tree; empty for none."""
        body = self._definition(f"{_NODE}{node}") or self._definition(f"{_TREE}{node}")
        return schema(schema(body.get("properties")).get(key))

    def _parts(self, part: Schema) -> Iterator[Schema]:
        """Yield a schema and those that hold with it: references, alternatives, conditional branches."""
        todo, seen = [part], 0
        while todo and seen < 200:
            each = todo.pop(0)
            seen += 1
            yield each
            target = each.get("$ref")
            if isinstance(target, str):
                todo.append(self._definition(target))
            for key in ("allOf", "anyOf", "oneOf"):
                todo += schemas(each.get(key))
            if schema(each.get("if")).get("type") != "string":
                branches = (each.get("then"), each.get("else"))
                todo += filter(None, map(schema, branches))

    def _definition(self, reference: str) -> Schema:
        return schema(self._definitions.get(reference.rpartition("/")[2]))

    def _below(self, part: Schema, step: str | int) -> Iterator[Schema]:
        if isinstance(step, int):
            items = part.get("items")
            if isinstance(items, list):
                several = schemas(cast("object", items))
                yield from several[step : step + 1]
            elif isinstance(items, dict):
                yield schema(cast("object", items))
            return
        properties = schema(part.get("properties"))
        if step in properties:
            yield schema(properties[step])
            return
        for pattern, below in schema(part.get("patternProperties")).items():
            if re.search(pattern, step):
                yield schema(below)
        if isinstance(part.get("additionalProperties"), dict):
            yield schema(part["additionalProperties"])


def node_ids(part: Schema) -> dict[str, Schema]:
    """Return the IDs of nodes and sub-trees among the keys of a schema, each with its reference."""
    found: dict[str, Schema] = {}
    for name, below in schema(part.get("properties")).items():
        target = schema(below).get("$ref")
        if isinstance(target, str) and target.startswith((_NODE, _TREE)):
            found[name] = schema(below)
    return found


def types_of(part: Schema) -> tuple[str, ...]:
    """Return the types that a schema allows; empty when it names none."""
    found = part.get("type")
    if isinstance(found, list):
        return tuple(str(each) for each in cast("list[object]", found))
    return (str(found),) if found is not None else ()


def markdown_of(parts: list[Schema]) -> str:
    """Return the first documentation among the parts; empty without any."""
    for key in ("markdownDescription", "description"):
        for part in parts:
            text = part.get(key)
            if isinstance(text, str) and text:
                return text
    return ""
