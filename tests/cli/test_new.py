"""picktree new: what it writes passes every check, runs, and never replaces a file."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import jsonschema
import pytest
import yaml

from picktree.apps.cli import answer
from picktree.apps.cli.new import STARTERS, StartKind, write_start
from picktree.files import PicktreeError

KINDS: tuple[StartKind, ...] = ("mission", "scene", "plugin")


def files(folder: Path) -> dict[str, str]:
    return {str(f.relative_to(folder)): f.read_text() for f in sorted(folder.rglob("*")) if f.is_file()}


def faults(schema: Path, document: Any) -> list[str]:
    validator: Any = jsonschema.Draft7Validator(json.loads(schema.read_text()))
    return [error.message for error in validator.iter_errors(document)]


Begin: TypeAlias = Callable[[StartKind, Path], None]


@pytest.fixture(scope="module")
def begin(tmp_path_factory: pytest.TempPathFactory) -> Begin:
    """Copies starts that are written once: to make their schemas takes the time."""
    scratch = tmp_path_factory.mktemp("starts")

    def copy(kind: StartKind, folder: Path) -> None:
        if not (scratch / kind).exists():
            write_start(kind, scratch / kind)
        shutil.copytree(scratch / kind, folder, dirs_exist_ok=True)

    return copy


@pytest.mark.parametrize("kind", KINDS)
def test_a_start_has_no_faults_and_no_warnings(
    kind: StartKind, begin: Begin, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    begin(kind, tmp_path / "a" / "new one")
    assert answer(["check", "--strict", str(tmp_path)]) == 0
    assert capsys.readouterr().out.strip().endswith("no errors or warnings")


@pytest.mark.parametrize("kind", KINDS)
def test_editors_find_a_schema_that_takes_the_file(kind: StartKind, begin: Begin, tmp_path: Path) -> None:
    begin(kind, tmp_path)
    checked = 0
    for file in tmp_path.rglob("*.yaml"):
        first, *_ = file.read_text().splitlines()
        named = first.removeprefix("# yaml-language-server: $schema=")
        assert faults(file.parent / named, yaml.safe_load(file.read_text())) == []
        checked += 1
    assert checked == sum(1 for part in STARTERS[kind].parts if part.name.endswith(".yaml"))


def test_schema_of_a_plugin_knows_its_skill(begin: Begin, tmp_path: Path) -> None:
    begin("plugin", tmp_path)
    mission = yaml.safe_load((tmp_path / "lift.yaml").read_text())
    mission["trees"]["Main"]["Sequence"][1]["Recover"]["do"] = {"Lift": {"hight": 0.1}}
    assert len(faults(tmp_path / "schemas" / "lift.json", mission)) == 1


@pytest.mark.parametrize(("kind", "mission"), [("mission", "mission.yaml"), ("plugin", "lift.yaml")])
def test_cases_of_a_start_pass(
    kind: StartKind, mission: str, begin: Begin, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    begin(kind, tmp_path)
    assert answer(["rehearse", "-q", str(tmp_path / mission)]) == 0
    assert "2 of 2 cases passed" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("kinds", "run"),
    [(["mission", "scene"], ["mission.yaml", "--scene", "scene.yaml"]), (["plugin"], ["lift.yaml"])],
)
def test_a_start_runs_on_the_kinematic_backend(
    kinds: list[StartKind],
    run: list[str],
    begin: Begin,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for kind in kinds:
        begin(kind, tmp_path)
    monkeypatch.chdir(tmp_path)
    assert answer(["run", *run, "--backend", "kinematic"]) == 0
    assert "the goal is reached" in capsys.readouterr().out


def test_it_says_what_was_written_and_what_comes_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["bin/picktree"])
    assert answer(["new", "mission", "my cell"]) == 0
    out, err = capsys.readouterr()
    told, following = out.split("what to type next:\n")
    assert (err, told.splitlines()[0]) == ("", "written to my cell:")
    assert {line.split()[0] for line in told.splitlines()[1:]} == files(tmp_path / "my cell").keys()
    assert following.splitlines()[0] == "  bin/picktree check 'my cell'"
    assert following.splitlines()[-1] == "  bin/picktree run 'my cell/mission.yaml'"


def test_three_starts_share_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for kind in KINDS:
        write_start(kind, tmp_path)
    names = {part.name for kind in KINDS for part in STARTERS[kind].parts}
    assert set(files(tmp_path)) == names
    assert answer(["check", "--strict", str(tmp_path)]) == 0
    capsys.readouterr()


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_that_is_there_is_never_replaced(
    kind: StartKind, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    last = [part.name for part in STARTERS[kind].parts if not part.made][-1]
    (tmp_path / last).parent.mkdir(exist_ok=True)
    (tmp_path / last).write_text("mine\n")
    assert answer(["new", kind, str(tmp_path)]) == 2
    assert capsys.readouterr() == ("", f"{tmp_path / last} is there already; nothing was written\n")
    assert files(tmp_path) == {last: "mine\n"}


def test_a_link_to_nowhere_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").symlink_to(tmp_path / "elsewhere.yaml")
    with pytest.raises(PicktreeError, match=r"scene\.yaml is there already"):
        write_start("scene", tmp_path)
    assert not (tmp_path / "elsewhere.yaml").exists()


def test_nothing_is_left_of_a_start_that_cannot_be_written_whole(tmp_path: Path) -> None:
    (tmp_path / "cell").mkdir()
    (tmp_path / "cell" / "schemas").write_text("a file, where a folder is wanted")
    with pytest.raises(PicktreeError) as refused:
        write_start("mission", tmp_path / "cell")
    assert str(refused.value) == f"{tmp_path}/cell/schemas cannot be written: file exists"
    assert list(files(tmp_path)) == ["cell/schemas"]
    assert not (tmp_path / "cell" / "cases").exists()


def test_a_folder_that_is_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cell").write_text("")
    assert answer(["new", "scene", str(tmp_path / "cell")]) == 2
    assert capsys.readouterr() == ("", f"{tmp_path}/cell cannot be written: file exists\n")


def test_kinds_that_cannot_be_begun(capsys: pytest.CaptureFixture[str]) -> None:
    assert answer(["new", "robot", "x"]) == 2
    assert "'robot' is not one of 'mission', 'scene', 'plugin'" in capsys.readouterr().err
