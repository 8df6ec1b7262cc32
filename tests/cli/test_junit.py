"""JUnit files of `picktree rehearse` and `batch run`, and the coverage of recovery that CI demands."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from junitparser import Error, Failure, JUnitXml, Skipped, TestCase, TestSuite

from picktree.apps.batch import Store, local_executor, to_junit
from picktree.apps.cli import answer
from picktree.files import JunitCase, junit_text

from ..commands import forked_worker

ONE_PICK = Path(__file__).parents[2] / "examples/one_pick.yaml"
MISSION = """\
picktree: 1
kind: mission
trees:
  Main:
    Recover:
      attempts: 2
      do: [GoTo, {Fallback: [{GoTo: {name: back}}, SafeRetreat, {GoTo: {name: last}}]}]
      when: {planning.*: [SafeRetreat], control.*: [SafeRetreat]}
"""
CASES = """\
picktree: 1
kind: cases
cases:
  blocked:
    doc: The way back is blocked.
    leaves: {back: planning.no_path}
    expect: {status: SUCCESS}
  wrong:
    leaves: {back: planning.no_path}
    expect: {status: FAILURE, never: [SafeRetreat]}
"""


def suite(file: Path) -> list[TestCase]:
    """Return the cases of the file's one suite, whose counts are those of its cases."""
    read = JUnitXml.fromfile(str(file))
    (only,) = list(read)
    assert isinstance(only, TestSuite)
    cases = list(only)
    kinds = [type(result) for case in cases for result in case.result]
    counted = (only.tests, only.failures, only.errors, only.skipped)
    assert counted == (len(cases), kinds.count(Failure), kinds.count(Error), kinds.count(Skipped))
    assert counted == (read.tests, read.failures, read.errors, read.skipped)
    return cases


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.yaml").write_text(MISSION)
    (tmp_path / "c.yaml").write_text(CASES)
    return tmp_path


REHEARSE = ["rehearse", "m.yaml", "--cases", "c.yaml", "-q"]


def test_a_rehearsal_as_junit(folder: Path) -> None:
    assert answer([*REHEARSE, "--junit", "r.xml"]) == 1
    blocked, wrong = suite(folder / "r.xml")
    assert (blocked.classname, blocked.name, blocked.result) == ("c", "blocked", [])
    assert (blocked.time, blocked.system_out) == (0.05, "The way back is blocked.")
    (failure,) = wrong.result
    assert failure.type == "SUCCESS"
    assert failure.message == "FAILURE is expected, but the mission is SUCCESS"
    assert failure.text is not None
    assert "expect.never" in failure.text
    assert "GoTo" in (wrong.system_out or "")
    assert 'file="c.yaml" line="8"' in (folder / "r.xml").read_text()


def test_too_little_recovery_is_an_answer_of_no(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    order = [*REHEARSE, "--junit", "r.xml"]
    (folder / "c.yaml").write_text(CASES.partition("  wrong:")[0])
    assert answer([*order, "--min-recovery-coverage", "25"]) == 0
    out, err = capsys.readouterr()
    assert "recovery  25 %: 1 of 4 branches of recovery reached" in out
    assert err == ""
    assert len(suite(folder / "r.xml")) == 1
    assert answer([*order, "--min-recovery-coverage", "26"]) == 1
    sentence = (
        "coverage of recovery is 25 %, less than 26 %: no case reaches Main/Recover/Sequence/Fallback/last, "
        "Main/Recover/planning.*, Main/Recover/control.*"
    )
    assert capsys.readouterr().err == f"{sentence}\n"
    *_, coverage = suite(folder / "r.xml")
    assert (coverage.name, coverage.result[0].message) == ("coverage", sentence)


def test_recovery_is_counted_in_json_and_not_for_single_cases(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer([*REHEARSE, "--full-coverage", "--case", "blocked"]) == 1
    assert "and --full-coverage demands all" in capsys.readouterr().err
    assert answer([*REHEARSE, "--case", "blocked", "--min-recovery-coverage", "10"]) == 2
    assert "--min-recovery-coverage is about all cases: leave out --case" in capsys.readouterr().err
    (folder / "m.yaml").write_text("picktree: 1\nkind: mission\ntrees: {Main: GoTo}\n")
    (folder / "c.yaml").write_text("picktree: 1\nkind: cases\ncases: {one: {expect: {status: SUCCESS}}}\n")
    assert answer([*REHEARSE, "--min-recovery-coverage", "100"]) == 0
    assert "recovery" not in capsys.readouterr().out


def test_a_place_without_a_folder_is_refused_before_the_work(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer([*REHEARSE, "--junit", "no/r.xml"]) == 2
    out, err = capsys.readouterr()
    assert (out, err) == ("", f"no/r.xml cannot be written: there is no folder {folder}/no\n")
    assert answer([*REHEARSE, "--junit", "."]) == 2
    assert ". is a folder; name a file in it" in capsys.readouterr().err


def test_a_batch_as_junit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_executor, "_started", forked_worker)
    night, file = tmp_path / "night", tmp_path / "night.xml"
    places = ["--out", str(night), "--junit", str(file)]
    options = ["--mission", str(ONE_PICK), "--seeds", "0:2", "--backend", "kinematic", "--workers", "1"]
    assert answer(["batch", "run", *options, "--limit", "4 s", *places]) == 1
    capsys.readouterr()
    first, second = suite(file)
    assert (first.classname, first.name, second.name) == ("one_pick", "seed 0", "seed 1")
    (failure,) = first.result
    assert isinstance(failure, Failure)
    assert failure.text is not None
    assert "timeout" in failure.text
    assert second.result == []
    with closing(sqlite3.connect(night / "results.sqlite")) as results:
        results.execute("UPDATE jobs SET status = 'crashed', message = 'SIGSEGV' WHERE seed = 0")
        results.execute("UPDATE jobs SET status = 'waiting' WHERE seed = 1")
        results.commit()
    with Store(night / "results.sqlite") as store:
        file.write_text(to_junit(store))
    (crashed,), (waiting,) = (case.result for case in suite(file))
    assert (type(crashed), crashed.message) == (Error, "SIGSEGV")
    assert type(waiting) is Skipped


@given(st.text(), st.text())
def test_any_text_makes_a_valid_file(name: str, message: str) -> None:
    case = JunitCase(name, name, outcome="failure", message=message, detail=message, output=message)
    read = JUnitXml.fromstring(junit_text(name, [case], {name: message}).encode())
    assert read.failures == 1


def test_outcomes_are_told_apart() -> None:
    cases = [
        JunitCase("a", "passes", 1.5),
        JunitCase("a", "fails", outcome="failure", kind="grasp.slipped", message="it slipped"),
        JunitCase("a", "crashes", outcome="error", message="SIGSEGV"),
        JunitCase("a", "waits", outcome="skipped", message="later"),
    ]
    (read,) = list(JUnitXml.fromstring(junit_text("s", cases).encode()))
    results = [case.result for case in read]
    assert [[type(each) for each in result] for result in results] == [[], [Failure], [Error], [Skipped]]
    assert (results[1][0].type, results[1][0].message) == ("grasp.slipped", "it slipped")
    assert read.time == 1.5
