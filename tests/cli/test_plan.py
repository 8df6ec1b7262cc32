"""`picktree plan`: a plan or its failure, without a mission."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from picktree.analysis.render import Picture
from picktree.apps.cli import answer


def asked(capfd: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Exit code, output and errors of `picktree plan` in a small scene."""
    code = answer(["plan", "--scene", "sort_small", *words])
    out, err = capfd.readouterr()
    return code, out, err


def picture(path: Path) -> Picture:
    import cv2

    read = cv2.imread(str(path))
    assert read is not None
    return np.asarray(read, np.uint8)


def test_a_named_pose(capfd: pytest.CaptureFixture[str]) -> None:
    code, out, _ = asked(capfd, "--to", "observe", "--verify")
    assert code == 0
    lines = out.splitlines()
    assert lines[:3] == [
        "to observe, from home",
        "scene sort_small, robot panda, seed 0; the belief has everything at its true place",
        "",
    ]
    assert [line.split("  ")[0] for line in lines[3:]] == [
        "planner",
        "checks",
        "motion",
        "nearest",
        "itself",
        "singularity",
        "joint limits",
        "judged",
    ]
    assert lines[3] == "planner       direct"
    assert lines[-1] == "judged        free by the second checker"


def test_onto_an_object_and_its_picture(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, _, err = asked(capfd, "--to", "nothing")
    assert code == 2
    name = err.splitlines()[-1].removeprefix("  objects: ").split(", ")[0]
    file = tmp_path / "plan.png"
    words = ("--to", name, "--json", "--picture", str(file), "--size", "320x200")
    code, out, _ = asked(capfd, *words)
    assert code == 0
    told = json.loads(out)
    assert told["asked"] == f"onto {name}"
    assert told["found"]["planner"] == "chain"
    assert told["found"]["legs"][1] == "line"
    assert told["grasp"].startswith("yaw ")
    assert told["picture"] == str(file)
    assert picture(file).shape == (200, 320, 3)


def test_a_refusal_tells_why_and_marks_it(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "no.png"
    words = ("--to", "500mm,0,-10mm,180deg,0,0", "--line", "--picture", str(file), "--size", "320x200")
    code, out, _ = asked(capfd, *words)
    assert code == 1
    assert "no plan: planning.no_path\n  only " in out
    assert " of the line is free (after " in out and " table\n" in out
    assert picture(file).shape == (200, 320, 3)


def test_the_same_for_another_arm(capfd: pytest.CaptureFixture[str]) -> None:
    code, out, _ = asked(capfd, "--to", "0.4,0.1,0.3", "--robot", "xarm6", "--upright", "20deg")
    assert code == 0
    assert out.startswith("to 0.4,0.1,0.3, upright within 20 deg, from home\nscene sort_small, robot xarm6,")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--to", "homme"), "--to homme: there is no such pose, bin or object; did you mean 'home'?"),
        (("--to", "1,2"), "--to 1,2: write x,y,z or x,y,z,roll,pitch,yaw, as in --to 500mm,0,200mm"),
        (("--to", "1,2,3 s"), "--to 3 s: "),
        (("--to", "home", "--from", "1,2"), "--from 1,2: 2 numbers; the arm has 7 joints"),
        (
            ("--to", "home", "--from", "away"),
            "--from away: not a pose of the robot; known: home, observe, rest;",
        ),
        (("--to", "home", "--clearance", "-1mm"), "a clearance of -1 mm: it must not be negative"),
        (("--to", "home", "--upright", "10 mm"), "--upright 10 mm: "),
        (("--to", "home", "--picture", "/dev/null/all.png"), "/dev/null/all.png cannot be written: "),
        (("--to", "home", "--view", "behind"), "view 'behind': write corner, front, "),
    ],
)
def test_bad_input(capfd: pytest.CaptureFixture[str], words: tuple[str, ...], sentence: str) -> None:
    code, out, err = asked(capfd, *words)
    assert code == 2
    assert out == ""
    assert err.startswith(sentence)
    assert "Traceback" not in err
