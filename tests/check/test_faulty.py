"""Files with one fault each, and all that `picktree check` says of them.

`faulty/NAME.txt` is what it says of `faulty/NAME.yaml`, word for word. Whoever changes a sentence writes it
anew, by `picktree check NAME.yaml > NAME.txt` in that folder, and reads it aloud.
"""

from __future__ import annotations

import pytest

from picktree.apps.cli import answer

from .faulty_files import FAULTY, faulty_report

NAMES = sorted(path.stem for path in FAULTY.glob("*.yaml"))


@pytest.mark.parametrize("name", NAMES)
def test_the_whole_text(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(FAULTY)
    code = answer(["check", f"{name}.yaml"])
    out, err = capsys.readouterr()
    assert out == (FAULTY / f"{name}.txt").read_text(encoding="utf-8")
    assert err == ""
    assert code == (2 if " error" in out.splitlines()[-1] else 0)


def test_each_has_one_fault_and_together_they_are_of_all_kinds_and_many_codes() -> None:
    single = [name for name in NAMES if name != "twelve"]
    faults = [fault for fault in faulty_report().faults if not fault.mark.file.endswith("twelve.yaml")]
    assert sorted(fault.mark.file for fault in faults) == [str(FAULTY / f"{name}.yaml") for name in single]
    assert len(single) >= 130
    assert len({fault.code for fault in faults}) >= 75
    assert {name.partition("_")[0] for name in single} == {
        "form", "mission", "scene", "robot", "faults", "cases",
    }  # fmt: skip
