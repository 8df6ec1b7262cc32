"""The JSON Schemas: what we ship fits them, and what they refuse the checker refuses, too."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, cast

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from picktree.apps.cli.author_commands import Kind, registry
from picktree.apps.cli.file_schemas import CHECKS, FileKind, file_schema
from picktree.authoring.schema import Schema, any_mission, mission_schema, one_mission, to_text
from picktree.files import FileError
from picktree.files.fault_codes import pages
from picktree.files.yaml import Document, file_models, read_document
from picktree.trees.loading import NodeRegistry
from picktree.world.scene import SceneFile
from picktree.world.scene.description import SceneSettings
from picktree.world.scene.scene_schema import SECTIONS

from .mistakes import CHANGES, Change, Value, changed, paths

ROOT = Path(__file__).parents[2]
PATTERNS = ("examples/**/*.yaml", "trees/library/*.yaml", "world/scenes/*.yaml", "world/robots/*.yaml")
SHIPPED = tuple(sorted(file for pattern in PATTERNS for file in ROOT.glob(pattern)))
BESIDE = ROOT / "examples/made.yaml"
"""Where made files stand: what they name lies beside it."""
FAULTS = """\
picktree: 1
kind: faults
scene: three_bins
faults:
  - {fault: remove, when: {at: 3 s}, target: {index: 0}}
  - {fault: friction, friction: 0.1, mass: 2 kg, when: {node: Grasp, start: 2}, target: {nearest_to: object}}
  - {fault: bump, velocity: [1, 0, 0], when: {node: Grasp, delay: 1 s}, target: {kind: block, colour: red}}
"""
MISSION = """\
picktree: 1
kind: mission
scene: three_bins
goal: sorted >= 1
trees:
  Main:
    ports: {n: {type: int, default: 3, doc: how many}, who: object}
    Sequence:
      - Timeout: {msec: 2 s, do: [{Grasp: {object: "{who}", force: 20 N, name: first, breakpoint: before}}]}
      - Delay: {delay_msec: 20, GoTo: {pose: home, speed: 0.5, _skipIf: holding, _onSuccess: "a := 1"}}
      - Inverter: {sub_one: {x: 3}}
      - Switch: {variable: "{n}", cases: {"1": GoTo, "2": [GoTo, OpenGripper]}, default: GoTo}
      - IfThenElse: [{Condition: {if: holding}}, GoTo]
      - Recover:
          attempts: 2
          do: {Place: {object: "{who}", at: [500 mm, 0, 0]}}
          when: {grasp.*: SafeRetreat, "*": {SafeRetreat: {hand: open}}}
          give_up: GoTo
      - Observe: {objects: "{items}"}
      - ForEach: {in: "{items}", out: "{it}", on_failure: continue, Sequence: [{Log: {message: x}}]}
      - Repeat: {while: items_left, num_cycles: 3, do: GoTo}
      - Sub: {}
  sub_one: {ports: {x: any}, GoTo: {}}
  Sub: GoTo
"""


@cache
def known() -> NodeRegistry:
    return registry(shipped=True)


@cache
def schema(kind: str) -> Schema:
    if kind == "mission":
        return mission_schema(known(), any_mission())
    return file_schema(cast("FileKind", kind))


def refusals(document: Document) -> list[str]:
    """What the schema says against it."""
    return [str(error.message) for error in _validator(document.kind).iter_errors(document.data)]


@cache
def _validator(kind: str) -> Any:
    return jsonschema.Draft7Validator(schema(kind))


def errors(document: Document) -> list[str]:
    """What the checker says against it."""
    return [str(fault) for fault in CHECKS[document.kind](document) if fault.severity == "error"]


# The schemas themselves.


@pytest.mark.parametrize("kind", list(Kind))
def test_committed_schema_is_up_to_date(kind: Kind) -> None:
    text = (ROOT / f"schemas/{kind.value}.json").read_text(encoding="utf-8")
    assert text == to_text(schema(kind.value)), "renew it: make docs"


@pytest.mark.parametrize("kind", list(Kind))
def test_schema_is_of_draft_07_and_says_something_at_each_key(kind: Kind) -> None:
    jsonschema.Draft7Validator.check_schema(schema(kind.value))
    dumb = [where for where, part in _parts(schema(kind.value)) if not _told(part)]
    assert dumb == []


def _parts(part: Value, where: str = "") -> Iterator[tuple[str, Value]]:
    """Every property of every mapping of a schema."""
    if isinstance(part, dict):
        mapping = cast("dict[str, Value]", part)
        if "type" in mapping:  # what stands under `if` and `then` only adds to what is said elsewhere
            yield from ((f"{where}/{key}", below) for key, below in mapping.get("properties", {}).items())
        for key, below in mapping.items():
            yield from _parts(below, f"{where}/{key}")
    elif isinstance(part, list):
        for number, below in enumerate(cast("list[Value]", part)):
            yield from _parts(below, f"{where}/{number}")


def _told(part: Value) -> bool:
    if not isinstance(part, dict) or "$ref" in part:
        return True  # what is referred to is told there
    return len(str(cast("Schema", part).get("description", ""))) > 5


def test_a_mission_s_own_schema_closes_its_names() -> None:
    document = read_document(BESIDE, "mission", MISSION)
    own = registry(shipped=True)
    validator: Any = jsonschema.Draft7Validator(mission_schema(own, one_mission(document, own)))
    assert list(validator.iter_errors(document.data)) == []
    for right, wrong in (("- Sub: {}", "- Sab: {}"), ("{x: 3}", "{y: 3}"), ("pose: home", "pose: hme")):
        assert right in MISSION
        data = read_document(BESIDE, "mission", MISSION.replace(right, wrong)).data
        assert not validator.is_valid(data), wrong


def test_sections_of_a_scene_are_those_that_are_read() -> None:
    settings = file_models.keys_of(SceneSettings)
    assert set(file_models.keys_of(SceneFile)) == {*settings, *SECTIONS}


# What is right fits.


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: str(file.relative_to(ROOT)))
def test_what_we_ship_fits(file: Path) -> None:
    assert refusals(read_document(file)) == []


@pytest.mark.parametrize("text", [FAULTS, MISSION], ids=["faults", "mission"])
def test_made_files_fit(text: str) -> None:
    document = read_document(BESIDE, text=text)
    assert (refusals(document), errors(document)) == ([], [])


def _as_file(code: str, text: str) -> Document | None:
    """An example of a page as a file; None when it cannot be read as one."""
    head = "picktree: 1\nkind: mission\n" if text.startswith("trees:") else ""
    try:
        document = read_document(BESIDE, text=head + text + "\n")
    except FileError:
        return None
    return document if document.kind in CHECKS else None


def test_the_right_examples_of_all_pages_fit() -> None:
    looked_at = 0
    for page in pages():
        document = _as_file(page.code, page.right.text) if page.right.language == "yaml" else None
        if document is not None:
            looked_at += 1
            assert (page.code, refusals(document)) == (page.code, [])
    assert looked_at > 60


# What is wrong does not, where a schema can see it.

SEEN = frozenset(
    (
        "P104", "P105", "P106", "P108", "P109", "P110", "P111",
        "P201", "P202", "P205", "P206", "P208", "P210", "P211", "P212", "P214", "P215", "P216", "P217",
        "P218", "P219", "P220", "P221", "P222", "P223", "P228", "P229", "P230", "P231", "P232", "P233",
        "P234", "P248", "P249", "P250", "P601", "P602", "P605", "P606",
    )
)  # fmt: skip
"""Codes whose wrong example the schema refuses."""


def test_wrong_examples_are_refused_where_a_schema_can_see_it() -> None:
    refused = set[str]()
    for page in pages():
        document = _as_file(page.code, page.wrong.text) if page.wrong.language == "yaml" else None
        if document is not None and refusals(document):
            refused.add(page.code)
    assert SEEN - refused == set()


# What the schema refuses, the checker refuses.


@cache
def sources() -> tuple[Document, ...]:
    made = (read_document(BESIDE, text=text) for text in (FAULTS, MISSION, MISSION))
    return (*made, *(read_document(file) for file in SHIPPED))


@cache
def vocabulary() -> tuple[str, ...]:
    found = dict.fromkeys(str(path[-1]) for document in sources() for path in paths(document.data) if path)
    return (*(word for word in found if not word.isdigit()), *known().ids())


@settings(max_examples=60)
@given(which=st.integers(0, 1000), changes=st.lists(CHANGES, min_size=1, max_size=3))
def test_what_the_schema_refuses_the_checker_refuses(which: int, changes: list[Change]) -> None:
    source = sources()[which % len(sources())]
    data = copy.deepcopy(source.data)
    for change in changes:
        changed(data, change, vocabulary())
    try:
        document = read_document(source.path, text=json.dumps(data))
    except FileError:
        return  # refused before anybody looks at what it says
    if "base" in data and "null" in json.dumps(data):
        return  # an unknown key that is null takes nothing away from the base: the checker never sees it
    refused = refusals(document)
    assert refused == [] or errors(document) != [], (refused, json.dumps(data))
