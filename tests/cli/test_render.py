"""picktree render: where the picture goes, and what stands in its way."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.apps.cli import answer

MISSION = """picktree: 1
kind: mission
name: two
trees:
  Main: {Sequence: [One, {GoTo: {pose: home}}]}
  One: AlwaysSuccess
"""
TEXT = """two

Main
└── → Sequence
    ├── ▣ One
    └── □ GoTo  pose: home

One
└── □ AlwaysSuccess
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "m.yaml"
    path.write_text(MISSION, encoding="utf-8")
    return path


def test_without_a_file_the_text_is_printed(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["render", str(file)]) == 0
    assert capsys.readouterr() == (TEXT, "")


def test_expanded_text(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["render", str(file), "--expand"]) == 0
    assert capsys.readouterr().out.splitlines()[3:] == [
        "└── → Sequence",
        "    ├── ▣ One",
        "    │   └── □ AlwaysSuccess",
        "    └── □ GoTo  pose: home",
    ]


@pytest.mark.parametrize(
    ("suffix", "begins"),
    [
        ("svg", "<svg xmlns="),
        ("html", "<!doctype html>"),
        ("dot", 'digraph "two" {'),
        ("txt", "two\n\nMain\n"),
    ],
)
@pytest.mark.parametrize("options", [[], ["--expand"]])
def test_suffix_says_what_is_written(
    suffix: str, begins: str, options: list[str], file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = file.with_suffix(f".{suffix}")
    assert answer(["render", str(file), "-o", str(picture), *options]) == 0
    assert capsys.readouterr() == (f"{picture}\n", "")
    assert picture.read_text(encoding="utf-8").startswith(begins)


def test_a_mission_with_faults_gets_the_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "m.yaml"
    path.write_text("picktree: 1\nkind: mission\ntrees:\n  Main: {Sequence: [Grap, {GoTo: {pse: home}}]}\n")
    picture = tmp_path / "m.svg"
    assert answer(["render", str(path), "-o", str(picture)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    unknown, no_port = (line for line in err.splitlines() if line.startswith(str(path)))
    assert unknown.endswith(" error P207: Main/Sequence: unknown node 'Grap' (did you mean 'Grasp'?)")
    assert no_port.endswith(": Main/Sequence/GoTo: GoTo has no port 'pse' (did you mean 'pose'?)")
    assert not picture.exists()


@pytest.mark.parametrize(
    ("picture", "said"),
    [
        ("tree.pdf", "tree.pdf: a picture is a file that ends in .svg, .html, .dot or .txt\n"),
        ("no/tree.svg", "{}/no/tree.svg cannot be written: no such file or directory\n"),
    ],
)
def test_picture_that_cannot_be_written(
    picture: str, said: str, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer(["render", str(file), "-o", str(file.parent / picture)]) == 2
    assert capsys.readouterr() == ("", said.format(file.parent))


def test_another_kind_of_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "s.yaml"
    path.write_text("picktree: 1\nkind: scene\n")
    assert answer(["render", str(path)]) == 2
    assert "this is a scene file; a mission file is wanted here" in capsys.readouterr().err
