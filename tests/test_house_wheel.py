"""The wheel holds the rooms, whole and nothing else, and runs on its own in an empty folder."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from .rooms import ROOMS, ROOT

FOLDERS = (*ROOMS, "schemas")
LEFT_OUT = ("__pycache__",)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy: a build writes into its source."""
    source = tmp_path_factory.mktemp("source")
    for name in ("pyproject.toml", "README.md", "LICENSE", "NOTICE", "py.typed"):
        shutil.copy(ROOT / name, source)
    for file in ROOT.glob("*.py"):
        shutil.copy(file, source)
    for folder in FOLDERS:
        shutil.copytree(ROOT / folder, source / folder, ignore=shutil.ignore_patterns(*LEFT_OUT))
    out = tmp_path_factory.mktemp("wheel")
    built = subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(source)],
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    (wheel,) = out.glob("*.whl")
    return wheel


def test_wheel_holds_every_file_of_the_rooms_and_nothing_else(wheel: Path) -> None:
    files = [
        file
        for folder in FOLDERS
        for file in (ROOT / folder).rglob("*")
        if file.is_file() and not set(file.parts) & set(LEFT_OUT)
    ]
    files += [*ROOT.glob("*.py"), ROOT / "py.typed"]
    wanted = {f"picktree/{file.relative_to(ROOT).as_posix()}" for file in files}

    with zipfile.ZipFile(wheel) as archive:
        found = {name for name in archive.namelist() if ".dist-info/" not in name}

    assert sorted(wanted - found) == [], "missing from the wheel: list them in pyproject.toml"
    assert sorted(found - wanted) == []


def test_wheel_carries_licence_and_notice(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = [Path(name).name for name in archive.namelist() if ".dist-info/" in name]
    assert {"LICENSE", "NOTICE", "entry_points.txt"} <= set(names)


@pytest.mark.slow
def test_wheel_runs_the_smallest_mission_in_an_empty_folder(wheel: Path, tmp_path: Path) -> None:
    packages, folder = tmp_path / "packages", tmp_path / "empty"
    folder.mkdir()
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*pip, "--target", str(packages), str(wheel)], check=True)
    shutil.copy(ROOT / "examples" / "one_pick.yaml", folder)
    environment = {**os.environ, "PYTHONPATH": str(packages)}

    where = subprocess.run(
        [sys.executable, "-c", "import picktree; print(picktree.__file__)"],
        cwd=folder, env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert Path(where.stdout.strip()).is_relative_to(packages)

    run = subprocess.run(
        [sys.executable, "-m", "picktree", "run", "one_pick.yaml", "--json"],
        cwd=folder, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    assert json.loads(run.stdout)["status"] == "success"
    assert sorted(path.name for path in folder.iterdir()) == ["one_pick.yaml", "runs"]
