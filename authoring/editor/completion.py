"""Completion: what may be written at the cursor, by the file's schema and the keys of its tree, and
skeletons for an empty text.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias, cast

from picktree.authoring.schema import Schema, header, schema
from picktree.files import Location
from picktree.files.yaml import KINDS, resolve
from picktree.trees import PRECONDITIONS, references
from picktree.world import world_facts

from .cursor import CURSOR, Cursor, Place, Span
from .schema_walk import SchemaWalk, markdown_of, node_ids, types_of
from .tree_keys import assigns, key_places, tree_of

ProposalKind: TypeAlias = Literal["node", "tree", "key", "value", "blackboard", "skeleton"]
_OPEN_REFERENCE = re.compile(rf"\{{(?P<written>@?[\w.]*){CURSOR}")
_PLAIN = re.compile(r"[A-Za-z_][\w ./-]*")


@dataclass(frozen=True, slots=True)
class Proposal:
    """Proposed text; `snippet` replaces the word at the cursor, with tab stops."""

    label: str
    kind: ProposalKind
    snippet: str
    doc: str = ""
    include: str = ""
    """File of the library that the mission must include for it; empty: none."""


def is_expression(walk: SchemaWalk, path: Location) -> bool:
    """Whether an expression or an assignment is allowed at a location of a mission."""
    if path and (path[-1] in PRECONDITIONS or assigns(path)):
        return True
    if len(path) < 2 or not isinstance(path[-1], str) or not isinstance(path[-2], str):
        return False
    return set(types_of(walk.port(path[-2], path[-1]))) == {"string", "boolean", "number"}


def proposals(cursor: Cursor, walk: SchemaWalk, library: Iterable[tuple[str, str]] = ()) -> list[Proposal]:
    """Return the proposals at the cursor.

    `library`: sub-trees that are not included, each with its file.
    """
    reference = _OPEN_REFERENCE.match(cursor.scalar)
    # `{item}` without quotes is a mapping for YAML: only a quoted one is a reference.
    if reference is not None and not cursor.is_key:
        return list(_keys(cursor, walk, reference["written"], braces=True))
    computed = cursor.scalar.startswith("{=")
    if not cursor.is_key and (computed or (is_expression(walk, cursor.path) and not cursor.in_list)):
        written = cursor.scalar.partition(CURSOR)[0]
        word = re.search(r"[\w.]*\Z", written)
        return list(_keys(cursor, walk, word[0] if word else "", braces=False))
    found: dict[str, Proposal] = {}
    parts = walk.at(cursor.path)
    as_key = cursor.is_key or cursor.alone or cursor.in_list
    if as_key and not (cursor.in_list and not cursor.alone):
        for proposal in _mapping_keys(cursor, walk, parts):
            found.setdefault(proposal.label, proposal)
    for proposal in _nodes(cursor, walk, parts, library):
        found.setdefault(proposal.label, proposal)
    if not cursor.is_key:
        for proposal in _values(cursor, parts):
            found.setdefault(proposal.label, proposal)
    return list(found.values())


def _keys(cursor: Cursor, walk: SchemaWalk, written: str, *, braces: bool) -> Iterator[Proposal]:
    close = _closing(cursor) if braces else ""
    if "." in written:
        owner = written.rpartition(".")[0]
        for name in references.ATTRIBUTES:
            text = f"{owner}.{name}"
            yield Proposal(text, "blackboard", escaped(text + close), "Attribute of the object.")
        return
    tree = tree_of(cursor.path)
    found: dict[str, str] = {}
    if tree is not None:
        for place in key_places(cursor.root, tree, lambda path: is_expression(walk, path)):
            if place.kind != "name":
                what = "Port" if place.kind == "port" else "Key"
                found.setdefault(place.key, f"{what} of the tree {tree}.")
    if not braces:
        found |= {name: "Fact of the world." for name in world_facts.FACTS if name not in found}
    for name, doc in found.items():
        yield Proposal(name, "blackboard", escaped(name + close), doc)


def _closing(cursor: Cursor) -> str:
    """Return the missing text behind a reference: its brace, and its quote where none follows."""
    if re.match(r"[\w.]*\}", cursor.behind):
        return ""
    quoted = cursor.before.rstrip("{").endswith('"')
    return "}" + ('"' if quoted and not cursor.behind.startswith('"') else "")


def _nodes(
    cursor: Cursor, walk: SchemaWalk, parts: list[Schema], library: Iterable[tuple[str, str]]
) -> Iterator[Proposal]:
    offered: dict[str, Schema] = {}
    for part in parts:
        if cursor.is_key or cursor.alone or cursor.in_list or "string" in types_of(part):
            offered |= node_ids(part)
    for name, reference in offered.items():
        if name in cursor.siblings:
            continue
        body = walk.resolved(reference)
        kind: ProposalKind = "tree" if str(reference["$ref"]).startswith("#/definitions/tree.") else "node"
        yield Proposal(name, kind, _call(cursor, name, body), markdown_of([body]))
    if offered:
        for name, file in library:
            if name not in offered:
                yield Proposal(name, "tree", _call(cursor, name, {}), f"Sub-tree of {file}.", file)


def _call(cursor: Cursor, name: str, body: Schema) -> str:
    """Return the text of a node with its required ports and children."""
    if cursor.behind.lstrip(" ").startswith(":"):
        return name
    types = types_of(body)
    required = [str(key) for key in cast("list[object]", body.get("required", []))]
    if required:
        keys = [
            f"{key}: {_stop(n, schema(body.get('properties')), key)}" for n, key in enumerate(required, 1)
        ]
        call = f"{name}: {{{', '.join(keys)}\\}}"
    elif "array" in types and "null" not in types:
        block = cursor.alone and not cursor.flow
        indent = "  " * (2 if cursor.before.rstrip().endswith("-") else 1)
        call = f"{name}:\n{indent}- $0" if block else f"{name}: [$1]"
    elif not cursor.is_key:
        return name
    else:
        call = f"{name}: {{$1\\}}"
    return call if cursor.is_key or cursor.alone or cursor.in_list else f"{{{call}\\}}"


def _stop(number: int, properties: Schema, key: str) -> str:
    """Return a tab stop with a usual value of the key."""
    usual = _examples(schema(properties.get(key)))
    return f"${{{number}:{escaped(_yaml(usual[0]))}}}" if usual else f"${number}"


def _mapping_keys(cursor: Cursor, walk: SchemaWalk, parts: list[Schema]) -> Iterator[Proposal]:
    nodes = {name for part in parts for name in node_ids(part)}
    colon = "" if cursor.behind.lstrip(" ").startswith(":") else ": "
    for name, below in walk.properties(parts).items():
        if name not in nodes and name not in cursor.siblings:
            known = walk.resolved(below)
            yield Proposal(name, "key", f"{escaped(name)}{colon}$0" if colon else name, markdown_of([known]))


def _values(cursor: Cursor, parts: list[Schema]) -> Iterator[Proposal]:
    quoted = cursor.before[-1:] in ('"', "'")
    for part in parts:
        for value in _examples(part):
            text = str(value) if quoted and isinstance(value, str) else _yaml(value)
            label = value if isinstance(value, str) else json.dumps(value)
            yield Proposal(label, "value", escaped(text), markdown_of([part]))


def _examples(part: Schema) -> list[object]:
    """Return the values that a schema names, the only ones before the usual ones."""
    found: list[object] = []
    for key in ("enum", "examples"):
        values = part.get(key)
        if isinstance(values, list):
            found += cast("list[object]", values)
    if "const" in part:
        found.append(part["const"])
    for snippet in cast("list[object]", part.get("defaultSnippets", [])):
        found.append(schema(snippet).get("body"))
    if "boolean" in types_of(part) and "number" not in types_of(part):
        found += [True, False]
    if "default" in part and part["default"] not in found:
        found.append(part["default"])
    for below in cast("list[object]", part.get("anyOf", [])):
        found += [value for value in _examples(schema(below)) if value not in found]
    return found


def _yaml(value: object) -> str:
    """Return a value as YAML writes it in one line."""
    if isinstance(value, str) and _PLAIN.fullmatch(value) and resolve(value) == value:
        return value
    return json.dumps(value, ensure_ascii=False)


def escaped(text: str) -> str:
    """Return a text in which the special characters of snippets are escaped."""
    return re.sub(r"[\\$}]", r"\\\g<0>", text)


SKELETONS: Final[Mapping[str, str]] = {
    "mission": """\
picktree: 1
kind: mission
name: my mission
scene: sort_small
trees:
  Main:
    Sequence:
      - Observe: {camera: overhead, objects: "{items}"}
      - ForEach: {in: "{items}", out: "{item}", on_failure: continue, do: {SortOne: {item: "{item}"}}}
      - Fallback: [{GoTo: {pose: home}}, SafeRetreat]
  SortOne:
    ports: {item: {type: object}}
    Recover:
      attempts: 3
      do:
        Sequence:
          - Grasp: {object: "{item}"}
          - Place: {object: "{item}", into: "{item.destination}"}
      otherwise: [SafeRetreat, {Observe: {camera: overhead}}]
      give_up: [{SafeRetreat: {hand: open}}]
""",
    "scene": """\
picktree: 1
kind: scene
base: sort_small
spawn:
  - of: {block: 2, ball: 2}
    colours: [red, blue]
    area: {min: [0.38, -0.20], max: [0.62, 0.20]}
""",
    "faults": """\
picktree: 1
kind: faults
scene: sort_small
faults:
  - {fault: slip, when: {node: Place, delay: 300 ms}, lasts: 400 ms}
""",
    "cases": """\
picktree: 1
kind: cases
mission: ../mission.yaml
objects:
  near: {kind: block, colour: red}
cases:
  one_item:
    expect: {status: SUCCESS}
""",
    "plan": """\
picktree: 1
kind: plan
missions: [mission.yaml]
seeds: 0:20
""",
}
"""Shortest useful file of each kind; a robot file is proposed by `picktree robot new`."""
_KEYS = header(KINDS[0])
_KIND: Schema = {"enum": list(KINDS), "description": _KEYS["kind"]["description"]}
_HEAD = SchemaWalk({"type": "object", "properties": _KEYS | {"kind": _KIND}})
_WORD = re.compile(r"[\w ]*")


def skeletons(text: str, place: Place) -> tuple[Span, list[Proposal]] | None:
    """Return the skeletons for a text of at most one word, and the word; None for another text.

    Comments do not count.
    """
    lines = text.split("\n")
    content = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    word = lines[place.line].rstrip("\r") if place.line < len(lines) else ""
    if content not in ([], [lines[place.line]]) or not _WORD.fullmatch(word):
        return None
    span = Span(Place(place.line, 0), Place(place.line, len(word)))
    return span, [
        Proposal(
            f"picktree {kind}",
            "skeleton",
            f"{escaped(skeleton)}$0",
            f"Skeleton of a {kind} file.\n\n```yaml\n{skeleton}```",
        )
        for kind, skeleton in SKELETONS.items()
    ]


def head_proposals(cursor: Cursor) -> list[Proposal]:
    """Return the keys and values at the top of a file without a kind; empty for a file with other keys."""
    known = set(cursor.root.entries) - {cursor.scalar} <= {"picktree", "kind"}
    return proposals(cursor, _HEAD) if known else []
