"""Files with one fault each, and all that `picktree check` says of them.

`faulty/NAME.txt` is what it says of `faulty/NAME.yaml`, word for word. Whoever changes a sentence writes it
anew, by `picktree check NAME.yaml > NAME.txt` in that folder, and reads it aloud.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.apps.cli import answer
from picktree.apps.cli.file_schemas import CHECKS
from picktree.files.file_checks import check_files

FOLDER = Path(__file__).parent / "faulty"
NAMES = sorted(path.stem for path in FOLDER.glob("*.yaml"))


@pytest.mark.parametrize("name", NAMES)
def test_the_whole_text(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(FOLDER)
    code = answer(["check", f"{name}.yaml"])
    out, err = capsys.readouterr()
    assert out == (FOLDER / f"{name}.txt").read_text(encoding="utf-8")
    assert err == ""
    assert code == (2 if " error" in out.splitlines()[-1] else 0)


def test_each_has_one_fault_and_together_they_are_of_all_kinds_and_many_codes() -> None:
    single = [name for name in NAMES if name != "twelve"]
    report = check_files([FOLDER / f"{name}.yaml" for name in single], CHECKS)
    assert sorted({fault.mark.file for fault in report.faults}) == [str(FOLDER / f"{n}.yaml") for n in single]
    assert len(report.faults) == len(single)
    assert len(single) >= 130
    assert len({fault.code for fault in report.faults}) >= 75
    assert {name.partition("_")[0] for name in single} == {
        "form", "mission", "scene", "robot", "faults", "cases",
    }  # fmt: skip


def test_twelve_faults_of_one_file_come_at_once() -> None:
    """Of its form, of its types and of its meaning."""
    report = check_files([FOLDER / "twelve.yaml"], CHECKS)
    assert [fault.code for fault in report.faults] == [
        "P401", "P110", "P108", "P109", "P107", "P105", "P410", "P106", "P417", "P416", "P113", "P104",
    ]  # fmt: skip
