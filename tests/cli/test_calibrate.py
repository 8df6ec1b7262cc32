"""`picktree calibrate`: a run that looks and touches, and the scene that believes what came of it."""

from __future__ import annotations

import contextlib
import io
import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from picktree.apps.cli import answer
from picktree.world.scene import load_scene

SCENE = """\
picktree: 1
kind: scene
base: three_bins_wrist
tool_error: [2 mm, -1.5 mm, 2 mm]
cameras:
  overhead: {error: {offset: [5 mm, -4 mm, 4 mm], rpy: [1 deg, -1 deg, 1 deg]}}
  wrist: {error: {offset: [5 mm, -4 mm, 4 mm], rpy: [1 deg, -1 deg, 1 deg]}}
"""


@dataclass(frozen=True)
class Done:
    folder: Path
    code: int
    out: str
    err: str


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Done:
    """One calibration of all that there is, in a folder of its own."""
    folder = tmp_path_factory.mktemp("calibrate")
    (folder / "cell.yaml").write_text(SCENE)
    out, err = io.StringIO(), io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = answer(["calibrate", "--scene", "cell.yaml", "--views", "4"])
    return Done(folder, code, out.getvalue(), err.getvalue())


def test_it_says_what_was_off_and_where_it_is_written(done: Done) -> None:
    assert done.code == 0
    lines = done.out.splitlines()
    assert [line.split()[0] for line in lines if not line.startswith(" ")][:2] == ["wrist", "overhead"]
    assert "            from 4 views; residual " in done.out
    assert "touching does not measure the tool's rotation" in done.out
    assert "written     cell_calibrated.yaml" in lines


def test_the_scene_that_it_writes_believes_what_is_true(done: Done) -> None:
    text = (done.folder / "cell_calibrated.yaml").read_text()
    assert text.startswith("picktree: 1\nkind: scene\nbase: cell.yaml\n\ncalibration:\n  date: ")
    scene = load_scene(str(done.folder / "cell_calibrated.yaml"))
    assert np.allclose(scene.tool.position, scene.tool_error.position, atol=3e-4)
    for camera in scene.cameras:
        believed, truly = camera.pose, camera.pose @ camera.error
        if camera.on == "hand":
            believed, truly = scene.tool @ believed, scene.tool_error @ truly
        assert believed.distance(truly) < 1e-3
        assert believed.angle(truly) < math.radians(0.3)
    before = load_scene(str(done.folder / "cell.yaml"))
    for stated, camera in zip(before.cameras, scene.cameras, strict=True):
        assert (stated.pose @ stated.error).distance(camera.pose @ camera.error) < 1e-12
    assert scene.spawn == before.spawn


def test_the_run_is_kept_and_can_be_explained(done: Done, capsys: pytest.CaptureFixture[str]) -> None:
    (run,) = (done.folder / "runs").iterdir()
    assert answer(["explain", str(run)]) == 0
    assert "calibrate" in capsys.readouterr().out


def test_a_file_that_exists_is_not_written_over_by_itself(
    done: Done, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(done.folder)
    before = (done.folder / "cell_calibrated.yaml").read_text()
    assert answer(["calibrate", "--scene", "cell.yaml"]) == 2
    message = "cell_calibrated.yaml exists; --replace writes over it, -o names another file\n"
    assert capsys.readouterr().err == message
    assert (done.folder / "cell_calibrated.yaml").read_text() == before
    assert answer(["calibrate", "--scene", "cell.yaml", "-o", "cell.yaml", "--replace"]) == 2
    assert capsys.readouterr().err == (
        "-o cell.yaml is the scene itself, which the new file needs as its base; name another file\n"
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--camera", "wrist"], "three_bins has no camera 'wrist'; known: overhead\n"),
        (["--target", "table"], "three_bins has no target 'table'; known: calibration_target\n"),
        (["--at", "0.5"], "--at 0.5: write X,Y or X,Y,YAW, as in --at 0.5,0,20deg\n"),
        (["-o", "found.txt"], "-o found.txt: a scene file ends in .yaml\n"),
        (["-o", "nowhere/a.yaml"], "nowhere/a.yaml cannot be written: there is no such folder\n"),
    ],
)
def test_what_cannot_be_done_is_said_before_anything_moves(
    words: list[str],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert answer(["calibrate", "--scene", "three_bins", *words]) == 2
    assert capsys.readouterr().err == message
    assert list(tmp_path.iterdir()) == []


def test_a_camera_that_does_not_see_the_target_is_the_answer_no(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["--scene", "three_bins", "--camera", "overhead", "--no-tcp", "--at", "0.3,0.75", "--json"]
    assert answer(["calibrate", *words]) == 1
    told = json.loads(capfd.readouterr().out)
    assert told["written"] is None
    assert told["why_not"].endswith("calibration_target is not in any view of overhead")
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]
