"""Start of a file: skeletons for an empty text, and the two keys at the top of every file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final

from ...files.yaml.document import KINDS
from ..schema.schema_parts import Schema, header
from .completion import Proposal, escaped, proposals
from .cursor import Cursor, Place, Span
from .schema_walk import SchemaWalk

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


def _head() -> Schema:
    keys = header(KINDS[0])
    kind: Schema = {"enum": list(KINDS), "description": keys["kind"]["description"]}
    return {"type": "object", "properties": keys | {"kind": kind}}


_HEAD = SchemaWalk(_head())
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
    return span, list(_proposed())


def _proposed() -> Iterator[Proposal]:
    for kind, text in SKELETONS.items():
        doc = f"Skeleton of a {kind} file.\n\n```yaml\n{text}```"
        yield Proposal(f"picktree {kind}", "skeleton", f"{escaped(text)}$0", doc)


def head_proposals(cursor: Cursor) -> list[Proposal]:
    """Return the keys and values at the top of a file without a kind; empty where other keys stand."""
    known = set(cursor.root.entries) - {cursor.scalar} <= {"picktree", "kind"}
    return proposals(cursor, _HEAD) if known else []
