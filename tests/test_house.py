"""The checkout as a whole: import arrows, doctests, what its files may name, what its page promises."""

from __future__ import annotations

import doctest
import importlib
import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from picktree.files.shipped_files import rooms

from .commands import call
from .house.figures import docstring_figures, folder_sizes, lone_folders, long_modules
from .house.source import House, When, circles, own_house
from .rooms import PACKAGES, PROJECT, ROOMS, ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")


def modules_with_examples() -> list[str]:
    """Modules whose text has an example; the others are not imported for its want."""
    found = list[str]()
    for package in PACKAGES:
        for file in ROOT.joinpath(*package.split(".")[1:]).glob("*.py"):
            if ">>> " in file.read_text(encoding="utf-8"):
                found.append(package if file.stem == "__init__" else f"{package}.{file.stem}")
    return sorted(found)


@pytest.mark.parametrize("name", modules_with_examples())
def test_doctests(name: str) -> None:
    result = doctest.testmod(importlib.import_module(name))
    assert result.failed == 0 < result.attempted


def test_import_contracts() -> None:
    linter = Path(sys.executable).with_name("lint-imports")
    checked = subprocess.run(
        [str(linter), "--no-logo", "--no-cache"], cwd=ROOT, capture_output=True, text=True
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_every_list_of_packages_has_all_of_them() -> None:
    files = (file for room in rooms() for file in (ROOT / room).rglob("__init__.py"))
    folders = [file.parent.relative_to(ROOT).parts for file in files]
    assert sorted(PACKAGES) == sorted(".".join(("picktree", *parts)) for parts in [(), *folders])
    assert list(rooms()) == ROOMS
    tool = PROJECT["tool"]
    modules = [file.name for file in ROOT.glob("*.py")]
    assert sorted(tool["coverage"]["run"]["source_dirs"]) == ROOMS
    assert sorted(tool["pyright"]["include"]) == sorted([*modules, *ROOMS])
    assert sorted(tool["ruff"]["lint"]["flake8-tidy-imports"]["banned-api"]) == ROOMS
    (floors,) = (each for each in tool["importlinter"]["contracts"] if each["name"] == "floors")
    layers = {name.strip() for layer in floors["layers"] for name in layer.split("|")}
    assert {f"picktree.{room}" for room in ROOMS} <= layers


@pytest.fixture(scope="module")
def house() -> House:
    return own_house()


def test_no_file_imports_itself_in_a_circle(house: House) -> None:
    assert circles(house.graph([When.LOADING])) == []
    assert circles(house.graph(list(When))) == []  # types and imports in functions included


def test_files_and_folders_are_read_at_a_sitting(house: House) -> None:
    assert len(house.modules) > 300
    assert {module.file for module in long_modules(house, 410)} == set()
    assert max(folder_sizes(house).values()) <= 15
    assert len(lone_folders(house)) <= 2


def test_docstrings_get_no_more_obscure(house: House) -> None:
    """They begin with a verb or a noun, and their first sentence has 25 words at most."""
    found = docstring_figures(house)
    assert found["docstrings"] > 8000
    assert found["obscure first word"] == 0
    assert found["first sentence of more than 25 words"] <= 1


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
    from picktree.trees.loading.loader import parse_mission

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
            assert ran.returncode == 1 and " items done" in ran.stdout, told
            assert "timeout: " in ran.stdout, told
            continue
        answers = (0, 1, -signal.SIGKILL) if "--faults" in words else (0,)  # what is planted may well cost it
        assert ran.returncode in answers, told
        if "-o" in words:
            assert (tmp_path / words[words.index("-o") + 1]).stat().st_size > 1000


def test_readme_links_lead_somewhere() -> None:
    targets = re.findall(r"\]\(([^)#:]+)\)", README)
    assert [target for target in targets if not (ROOT / target).exists()] == []
