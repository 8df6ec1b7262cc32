"""picktree convert: where the other form goes, and what the exit code says."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from picktree.apps.cli import answer

EXAMPLE = Path(__file__).parents[2] / "examples" / "one_pick.yaml"


def test_a_mission_and_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    xml, again, twice = tmp_path / "pick.xml", tmp_path / "again.yaml", tmp_path / "twice.xml"
    assert answer(["convert", str(EXAMPLE), "-o", str(xml)]) == 0
    assert answer(["convert", str(xml), "--out", str(again)]) == 0
    assert answer(["convert", str(again), "-o", str(twice)]) == 0
    assert capsys.readouterr() == ("", "")
    assert xml.read_bytes() == twice.read_bytes()
    assert answer(["check", str(again)]) == 0


def test_without_out_it_goes_to_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["convert", str(EXAMPLE)]) == 0
    out, err = capsys.readouterr()
    assert out.startswith('<?xml version="1.0" encoding="UTF-8"?>\n')
    assert '\n<root BTCPP_format="4" main_tree_to_execute="Main">\n' in out
    assert (out[-8:], err) == ("</root>\n", "")


def test_all_that_is_wrong_is_shown_with_code_and_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wrong.xml"
    path.write_text(
        '<root BTCPP_format="4">\n  <BehaviorTree ID="Main">\n    <Sequence>\n      <Graps/>\n'
        '      <GoTo poes="home"/>\n    </Sequence>\n  </BehaviorTree>\n</root>\n'
    )
    assert answer(["convert", str(path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err == (
        f"{path}:4:7: error P906: Main/Sequence/Graps: unknown node 'Graps' (did you mean 'Grasp'?)\n"
        "    4 |       <Graps/>\n      |       ^\n"
        f"{path}:5:19: error P908: Main/Sequence/GoTo: GoTo has no port 'poes' (did you mean 'pose'?)\n"
        '    5 |       <GoTo poes="home"/>\n      |                   ^\n'
    )


def test_a_mission_with_faults_is_not_converted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text("picktree: 1\nkind: mission\ntrees: {Main: Graps}\n")
    assert answer(["convert", str(path), "-o", str(tmp_path / "out.xml")]) == 2
    assert "error P207: Main: unknown node 'Graps' (did you mean 'Grasp'?)" in capsys.readouterr().err
    assert not (tmp_path / "out.xml").exists()


def test_the_file_that_is_read_is_not_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "pick.yaml"
    shutil.copy(EXAMPLE, path)
    assert answer(["convert", str(path), "-o", str(path)]) == 2
    assert capsys.readouterr().err == f"{path} is the file that is read; give another one with -o\n"
    assert path.read_bytes() == EXAMPLE.read_bytes()


def test_where_nothing_can_be_written_and_what_is_not_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "no" / "folder.xml"
    assert answer(["convert", str(EXAMPLE), "-o", str(out)]) == 2
    assert capsys.readouterr().err == f"{out} cannot be written: No such file or directory\n"
    assert answer(["convert", str(tmp_path / "none.xml")]) == 2
    assert f"{tmp_path / 'none.xml'}:1:1: error P124: there is no such file" in capsys.readouterr().err
