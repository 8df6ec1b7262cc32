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

from picktree.apps.studio.folder_slice import example_files

from .rooms import PACKAGES, ROOMS, ROOT

FOLDERS = (*ROOMS, "schemas")
CELL = "picktree_cell"
"""The other package of the wheel: it shares the protocol with picktree and nothing else."""
TOP = [*ROOT.glob("*.py"), *ROOT.glob("*.pyi"), ROOT / "py.typed"]
EXAMPLES = [ROOT / "examples" / file for file in example_files()]
EXAMPLES += [file for file in (ROOT / "examples/templates").rglob("*.*") if file.suffix in (".py", ".yaml")]
"""Examples that the studio offers."""
LEFT_OUT = ("__pycache__",)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy of the checkout in a folder of another name: a build writes into its source."""
    source = tmp_path_factory.mktemp("source")
    for name in ("README.md", "LICENSE", "NOTICE"):
        shutil.copy(ROOT / name, source)
    for file in (*TOP, ROOT / "pyproject.toml"):
        shutil.copy(file, source)
    for folder in (*FOLDERS, CELL):
        shutil.copytree(ROOT / folder, source / folder, ignore=shutil.ignore_patterns(*LEFT_OUT))
    for file in EXAMPLES:
        target = source / file.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, target)
    shutil.copytree(ROOT / "links", source / "links", symlinks=True)
    return source


@pytest.fixture(scope="module")
def wheel(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
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
    files += [*TOP, *EXAMPLES]
    wanted = {f"picktree/{file.relative_to(ROOT).as_posix()}" for file in files}
    wanted |= {file.relative_to(ROOT).as_posix() for file in (ROOT / CELL).glob("*.py")}

    with zipfile.ZipFile(wheel) as archive:
        found = {name for name in archive.namelist() if ".dist-info/" not in name}

    assert sorted(wanted - found) == [], "missing from the wheel: list them in pyproject.toml"
    assert sorted(found - wanted) == []


def test_an_editable_install_is_one_path_that_editors_follow(source: Path, tmp_path: Path) -> None:
    build = f"from setuptools.build_meta import build_editable; build_editable({str(tmp_path)!r})"
    subprocess.run([sys.executable, "-c", build], cwd=source, capture_output=True, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        (path_file,) = (name for name in archive.namelist() if ".dist-info/" not in name)
        (path,) = archive.read(path_file).decode().splitlines()
    assert path_file.endswith(".pth") and Path(path).is_absolute()
    assert (Path(path) / "picktree" / "__init__.pyi").samefile(source / "__init__.pyi")

    program = (
        "import picktree, picktree.skills; print(picktree.__file__, picktree.skills.__file__, sep=chr(10))"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert ran.stdout.splitlines() == [str(source / "__init__.py"), str(source / "skills" / "__init__.py")]


def test_wheel_carries_licence_and_notice(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = [Path(name).name for name in archive.namelist() if ".dist-info/" in name]
    assert {"LICENSE", "NOTICE", "entry_points.txt"} <= set(names)


@pytest.fixture(scope="module")
def elsewhere(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a process that has the wheel and none of the checkout."""
    packages = tmp_path_factory.mktemp("packages")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*pip, "--target", str(packages), str(wheel)], check=True)
    environment = {**os.environ, "PYTHONPATH": str(packages)}
    where = subprocess.run(
        [sys.executable, "-c", "import picktree; print(picktree.__file__)"],
        cwd=packages.parent, env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert Path(where.stdout.strip()).is_relative_to(packages)
    return environment


def test_every_door_of_the_wheel_opens(elsewhere: dict[str, str]) -> None:
    program = (
        "import importlib, pkgutil, picktree\n"
        "doors = [one.name for one in pkgutil.walk_packages(picktree.__path__, 'picktree.') if one.ispkg]\n"
        "names = [getattr(importlib.import_module(door), name) for door in doors\n"
        "         for name in getattr(importlib.import_module(door), '__all__', ())]\n"
        "print(len(doors), len(names))"
    )
    ran = subprocess.run([sys.executable, "-c", program], env=elsewhere, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    doors, names = map(int, ran.stdout.split())
    assert doors >= len(PACKAGES) - 1 and names > 500


@pytest.mark.slow
def test_wheel_runs_the_smallest_example_by_its_name_in_an_empty_folder(
    elsewhere: dict[str, str], tmp_path: Path
) -> None:
    run = subprocess.run(
        [sys.executable, "-m", "picktree", "run", "one_pick", "--json"],
        cwd=tmp_path, env=elsewhere, capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    assert json.loads(run.stdout)["status"] == "success"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["runs"]


@pytest.mark.slow
def test_notebook_runs_from_the_wheel(elsewhere: dict[str, str], tmp_path: Path) -> None:
    for file in (ROOT / "tests" / "api" / "notebook.py", ROOT / "examples" / "python.ipynb"):
        shutil.copy(file, tmp_path)
    run = subprocess.run(
        [sys.executable, "notebook.py", "python.ipynb"],
        cwd=tmp_path, env=elsewhere, capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    shown = [word for word in run.stdout.split() if word.startswith("_repr_")]
    assert shown == [
        "_repr_html_", "_repr_html_", "_repr_png_", "_repr_png_", "_repr_svg_",
        "_repr_html_", "_repr_html_", "_repr_html_", "_repr_png_", "_repr_html_",
    ]  # fmt: skip
    assert "Warning" not in run.stderr
