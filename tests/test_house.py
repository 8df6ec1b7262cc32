"""The checkout as a whole: import arrows, doctests, what its files may name, what its page promises."""

from __future__ import annotations

import doctest
import importlib
import os
import pkgutil
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from .commands import call

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def modules() -> list[str]:
    found = set[str]()
    for package in PROJECT["tool"]["setuptools"]["packages"]:
        folder = ROOT.joinpath(*package.split(".")[1:])
        found |= {package} | {f"{package}.{m.name}" for m in pkgutil.iter_modules([str(folder)])}
    return sorted(name for name in found if not (name.count(".") == 1 and not _of_a_room(name)))


def _of_a_room(name: str) -> bool:
    return (ROOT / name.split(".")[1]).is_dir() or name == "picktree.__main__"


@pytest.mark.parametrize("name", modules())
def test_doctests(name: str) -> None:
    module = importlib.import_module(name)
    assert doctest.testmod(module).failed == 0


def test_import_contracts() -> None:
    linter = Path(sys.executable).with_name("lint-imports")
    checked = subprocess.run(
        [str(linter), "--no-logo", "--no-cache"], cwd=ROOT, capture_output=True, text=True
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


def tracked_files() -> list[Path]:
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: which files are tracked is not known")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    paths = (ROOT / name for name in listed.stdout.split("\0") if name)
    return [path for path in paths if path.is_file() and not path.is_symlink()]


def test_no_tracked_file_names_a_package_registry() -> None:
    registries = [
        first + second
        for first, second in (
            ("pypi", ".org"),
            ("pypi", ".python.org"),
            ("python", "hosted.org"),
            ("registry.", "npmjs"),
            ("registry.", "yarnpkg"),
            ("--index", "-url"),
            ("--extra-index", "-url"),
            ("--find", "-links"),
        )
    ]
    named = [
        f"{path.relative_to(ROOT)}: {registry}"
        for path in tracked_files()
        for registry in registries
        if registry.encode() in path.read_bytes()
    ]
    assert named == []


def test_every_dependency_is_pinned_within_its_range() -> None:
    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    pins = {
        canonicalize_name(name): version
        for name, version in (
            line.split("==")
            for line in (ROOT / "constraints.txt").read_text().splitlines()
            if not line.startswith("#")
        )
    }
    project = PROJECT["project"]
    wanted = [
        Requirement(text) for text in (*project["dependencies"], *project["optional-dependencies"]["dev"])
    ]
    missing = [w.name for w in wanted if canonicalize_name(w.name) not in pins]
    outside = [
        str(w)
        for w in wanted
        if (pin := pins.get(canonicalize_name(w.name))) is not None and not w.specifier.contains(pin)
    ]
    assert (missing, outside) == ([], [])


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def in_block(block: str) -> list[list[str]]:
    return [words for line in block.splitlines() if (words := shlex.split(line, comments=True))]


def commands() -> list[list[str]]:
    return [words for block in blocks("sh") for words in in_block(block)]


def test_readme_shows_only_make_and_picktree() -> None:
    assert {words[0] for words in commands()} == {"make", ".venv/bin/picktree"}


@pytest.mark.parametrize("target", [words[1] for words in commands() if words[0] == "make"])
def test_make_target_of_the_readme_exists(target: str) -> None:
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE)


def test_mission_of_the_readme_loads() -> None:
    from picktree.trees.loader import parse_mission

    (mission,) = blocks("yaml")
    assert parse_mission(mission, Path("first.yaml")).name == "first mission"


FEWER = {"0:20": "0:1"}
"""A test needs no rate: of what the README runs for the sake of numbers, less is run."""
BEGINNINGS = (
    "examples/continuous_sort.yaml", "examples/kitting.yaml", "examples/sort_past_obstacles.yaml",
)  # fmt: skip
"""Missions that go on for long; what they come to after a few items is enough."""
ONE_WORKER = ("batch", "run")


def shortened(words: list[str]) -> list[str]:
    """A command of the README as it is run here: word by word the same, but for a rate or a long mission."""
    fewer = [FEWER.get(word, word) for word in words[1:]]
    if any(word in BEGINNINGS for word in words):
        fewer += ["--limit", "8 s"]
    if tuple(words[1:3]) == ONE_WORKER:
        fewer += ["--workers", "1"]  # else it has one for each core of the machine
    return fewer


@pytest.mark.slow
@pytest.mark.parametrize(
    "block", [b for b in blocks("sh") if "picktree " in b], ids=lambda block: "_".join(block.split()[1:3])
)
def test_picktree_commands_of_the_readme_run_in_their_order(block: str, tmp_path: Path) -> None:
    (mission,) = blocks("yaml")
    (tmp_path / "first.yaml").write_text(mission, encoding="utf-8")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for words in in_block(block):
        ran = call(shortened(words), tmp_path)
        told = f"{shlex.join(words)}\n{ran.stdout}\n{ran.stderr}"
        if any(word in BEGINNINGS for word in words):
            assert (ran.returncode, ran.stdout.count(" items done")) == (1, 2), told
            assert "timeout: " in ran.stdout, told
            continue
        answers = (0, 1, -signal.SIGKILL) if "--faults" in words else (0,)  # what is planted may well cost it
        assert ran.returncode in answers, told
        if "-o" in words:
            assert (tmp_path / words[words.index("-o") + 1]).stat().st_size > 1000


def test_readme_links_lead_somewhere() -> None:
    targets = re.findall(r"\]\(([^)#:]+)\)", README)
    assert [target for target in targets if not (ROOT / target).exists()] == []


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
@pytest.mark.parametrize(
    ("version", "said"),
    [("", "missing or no Python"), ("3.12", "Python 3.12"), ("2.7", "Python 2.7")],
)
def test_setup_says_in_one_line_what_is_wrong_with_the_python(
    version: str, said: str, tmp_path: Path
) -> None:
    python = tmp_path / "python"
    if version:
        python.write_text(f"#!/bin/sh\necho {version}\n")
        python.chmod(0o755)
    environment = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")}
    made = subprocess.run(
        ["make", "setup", f"PYTHON={python}", f"VENV={tmp_path / 'venv'}"],
        cwd=ROOT, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert made.returncode == 2
    assert made.stdout == ""
    (line,) = made.stderr.splitlines()
    assert f"picktree needs Python 3.11; '{python}' is {said}" in line
    assert not (tmp_path / "venv").exists()
