"""Formats of `picktree check` for CI systems, each read by what reads it there."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urljoin, urlparse

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.apps.cli import answer
from picktree.apps.cli.file_schemas import CHECKS
from picktree.files import Diagnostic, Mark
from picktree.files.fault_rendering import as_github
from picktree.files.file_checks import check_files, to_sarif

from .faulty_files import FAULTY, faulty_report
from .sarif_schema import SARIF

WRONG = "picktree: 1\nkind: scene\nrobot: panda\ngoal: sorted = total\n"


def checked(log: str) -> Any:
    """Return the log, which the schema holds for valid."""
    read = json.loads(log)
    jsonschema.Draft7Validator(SARIF, format_checker=jsonschema.FormatChecker()).validate(read)
    return read


def test_sarif_of_one_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "my scenes").mkdir()
    (tmp_path / "my scenes" / "a%b.yaml").write_text(WRONG)
    monkeypatch.chdir(tmp_path)
    assert answer(["check", "my scenes", "--format", "sarif"]) == 2
    (run,) = checked(capsys.readouterr().out)["runs"]
    assert run["results"] == [
        {
            "ruleId": "P419",
            "level": "error",
            "message": {"text": "not an expression: compare with '=='"},
            "locations": [
                {
                    "physicalLocation": {
                        "artifactLocation": {"uri": "my%20scenes/a%25b.yaml", "uriBaseId": "SRCROOT"},
                        "region": {"startLine": 4, "startColumn": 14},
                    },
                    "logicalLocations": [{"fullyQualifiedName": "goal"}],
                }
            ],
            "ruleIndex": 0,
        }
    ]
    assert [rule["id"] for rule in run["tool"]["driver"]["rules"]] == ["P419"]
    base = run["originalUriBaseIds"]["SRCROOT"]["uri"]
    address = urljoin(base, run["artifacts"][0]["location"]["uri"])
    assert Path(unquote(urlparse(address).path)).read_text() == WRONG


def test_sarif_of_all_kinds_of_faults() -> None:
    report = faulty_report()
    (run,) = checked(to_sarif(report, "1.2.3", FAULTY.parent))["runs"]
    assert len(run["results"]) == len(report.faults) > 100
    rules = [rule["id"] for rule in run["tool"]["driver"]["rules"]]
    assert [rules[result["ruleIndex"]] for result in run["results"]] == [f.code for f in report.faults]
    places = [result["locations"][0]["physicalLocation"] for result in run["results"]]
    assert {place["artifactLocation"]["uri"].partition("/")[0] for place in places} == {"faulty"}


def test_sarif_of_a_file_elsewhere_of_stdin_and_of_no_line(tmp_path: Path) -> None:
    (tmp_path / "outside.yaml").write_text(WRONG)
    report = check_files([tmp_path / "outside.yaml"], CHECKS)
    (run,) = checked(to_sarif(report, "1", FAULTY))["runs"]
    (artifact,) = run["artifacts"]
    assert artifact == {"location": {"uri": (tmp_path / "outside.yaml").as_uri()}}
    fault = Diagnostic(Mark("<stdin>", 0, 0), "", "a sentence", code="P101")
    log = checked(to_sarif(type(report)(("<stdin>",), (), (fault,)), "1", FAULTY))
    place = log["runs"][0]["results"][0]["locations"][0]["physicalLocation"]
    assert place == {"artifactLocation": {"uri": "%3Cstdin%3E"}}


@dataclass(frozen=True)
class Annotation:
    """A workflow command as GitHub's runner reads it: ActionCommand.TryParseV2."""

    command: str
    properties: dict[str, str]
    message: str


def annotation(line: str) -> Annotation:
    found = re.fullmatch(r"::(?P<command>[a-z]+)(?: (?P<properties>.*?))?::(?P<data>.*)", line)
    assert found is not None, line
    pairs = [pair.split("=", 1) for pair in (found["properties"] or "").split(",") if pair]

    def plain(text: str, *escapes: tuple[str, str]) -> str:
        for escaped, letter in (*escapes, ("%0D", "\r"), ("%0A", "\n"), ("%25", "%")):
            text = text.replace(escaped, letter)
        return text

    properties = {key: plain(value, ("%3A", ":"), ("%2C", ",")) for key, value in pairs}
    return Annotation(found["command"], properties, plain(found["data"]))


_TEXTS = st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=30)


@given(_TEXTS, _TEXTS, _TEXTS)
def test_a_workflow_command_reads_back(file: str, message: str, hint: str) -> None:
    fault = Diagnostic(Mark(file, 3, 7), "", message, hint, "P104")
    read = annotation(as_github(fault))
    assert read == Annotation(
        "error",
        {"file": file, "line": "3", "col": "7", "title": "P104 Unknown key"},
        f"{message} ({hint})",
    )


def test_workflow_commands_of_all_faulty_files() -> None:
    read = [annotation(as_github(fault)) for fault in faulty_report().faults]
    assert {each.command for each in read} == {"error", "warning"}
    assert all(Path(each.properties["file"]).is_file() for each in read)


def test_a_place_without_a_line_has_none() -> None:
    fault = Diagnostic(Mark("a.yaml", 0, 0), "", "x", code="P101")
    assert annotation(as_github(fault)).properties == {"file": "a.yaml", "title": "P101 Not valid YAML"}


def test_files_of_others_are_left_out_where_that_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "compose.yaml").write_text("services: {}\n")
    (tmp_path / "a.yaml").write_text(WRONG)
    assert answer(["check", "--ours-only", "compose.yaml"]) == 0
    assert (
        capsys.readouterr().out
        == "0 files, no errors or warnings; 1 YAML file without 'picktree:' left out\n"
    )
    assert answer(["check", "--ours-only", "compose.yaml", "a.yaml"]) == 2
    assert capsys.readouterr().out.splitlines()[0].startswith("a.yaml:4:14: error P419")
    assert answer(["check", "compose.yaml"]) == 2
