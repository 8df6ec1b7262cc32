"""The reference of scene, robot, faults, cases and plan files: whole, up to date, and its examples hold."""

from __future__ import annotations

import re
from pathlib import Path
from typing import cast

import pytest

from picktree.apps.batch import plan_schema
from picktree.apps.cli import answer
from picktree.apps.cli.file_schemas import CHECKS, FileKind, file_schema
from picktree.authoring.schema import Schema, file_reference
from picktree.authoring.schema.reference_page import EXAMPLES, FileReference, example_text
from picktree.files.file_checks import check_files
from picktree.files.yaml import Value, read, read_document

ROOT = Path(__file__).resolve().parents[2]
KINDS = sorted(EXAMPLES)


def schema_of(kind: str) -> Schema:
    return plan_schema() if kind == "plan" else file_schema(cast("FileKind", kind))


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_has_a_meaning_and_an_example(kind: str) -> None:
    reference = file_reference(kind, schema_of(kind))
    assert reference.missing == []
    keys = [key for section in reference.sections.values() for key in section.keys]
    assert len(keys) >= {"scene": 120, "robot": 55, "faults": 50, "cases": 45, "plan": 14}[kind]
    rows = [line for line in reference.page(kind).splitlines() if line.startswith("| `")]
    assert len(rows) == len(keys)
    for row in rows:
        _, key, meaning, example, _ = re.split(r"(?<!\\)\|", row)
        assert meaning.strip() and example.strip().startswith(f"{key.strip().rstrip('`')}: "), row


@pytest.mark.parametrize("kind", KINDS)
def test_an_example_is_what_its_file_says(kind: str) -> None:
    whole = [text for text in file_reference(kind, schema_of(kind)).examples.values() if "\u2026" not in text]
    assert len(whole) >= 10
    for text in whole:
        ((key, value),) = cast("dict[str, object]", read(f"{{{text}}}", "example").root.value).items()
        assert text.startswith(f"{key}: ") and value is not None


@pytest.mark.parametrize("kind", KINDS)
def test_the_files_of_the_examples_have_no_faults(kind: str) -> None:
    others = () if kind in ("cases", "plan") else EXAMPLES[kind]  # rehearsals and the linter read those
    patterns = (*others, f"examples/reference/{kind}.yaml")
    files = sorted({path for pattern in patterns for path in ROOT.glob(pattern)})
    assert ROOT / f"examples/reference/{kind}.yaml" in files
    assert [str(fault) for fault in check_files(files, CHECKS).faults] == []


@pytest.mark.parametrize("kind", KINDS)
def test_the_page_is_up_to_date(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["schema", kind, "--markdown"]) == 0
    page = (ROOT / f"docs/reference-{kind}.md").read_text(encoding="utf-8")
    assert page == capsys.readouterr().out, "renew it: make docs"
    assert f"reference-{kind}.md" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")


def test_a_key_without_an_example_would_be_found() -> None:
    reference = FileReference(schema_of("plan"))
    reference.take(read_document(ROOT / "examples/plan_grip_force.yaml", "plan"))
    assert ".robots" in reference.missing and ".seeds" not in reference.missing


def test_a_long_value_is_shortened_from_inside() -> None:
    inner: Value = {"at": [1, 2, 3], "colour": "light_grey", "box": [0.1, 0.2, 0.3], "yaw": "45 deg"}
    assert example_text("camera", inner) == (
        "camera: {at: [\u2026], colour: light_grey, box: [\u2026], yaw: 45 deg}"
    )
    assert example_text("seeds", "0:40") == 'seeds: "0:40"'
    assert example_text("force", "60 N") == "force: 60 N"


def test_missions_have_a_page_of_their_own(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["schema", "mission", "--markdown"]) == 2
    assert capsys.readouterr().err == (
        "docs/language.md has the keys of missions, 'picktree nodes --markdown' the nodes\n"
    )
