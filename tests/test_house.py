"""The checkout as a whole: import arrows, doctests, what its files may name, what its page promises."""

from __future__ import annotations

import ast
import doctest
import importlib
import shutil
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import grimp
import pytest

from picktree.files.file_system import rooms
from tests import import_contracts

from .docstrings import docstrings
from .rooms import PACKAGES, PROJECT, ROOMS, ROOT, modules
from .wording import sentences_with_tics, texts


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


def test_import_contracts(capsys: pytest.CaptureFixture[str]) -> None:
    assert import_contracts.main() == 0, capsys.readouterr().out


def test_a_skill_that_reaches_the_simulation_through_a_door_breaks_a_contract(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def sources(graph: grimp.ImportGraph) -> dict[str, str]:
        found = sources_of(graph)
        found["picktree.skills.grasp"] += "\n\ndef cheat():\n    from picktree.simulation import score\n"
        return found

    sources_of = import_contracts.sources_of
    monkeypatch.setattr(import_contracts, "sources_of", sources)
    assert import_contracts.main() == 1
    said = capsys.readouterr().out
    assert "truth is out of reach BROKEN" in said
    assert "picktree.skills.grasp -> picktree.simulation.scorer" in said


def test_who_is_outside_of_a_package_imports_from_its_door() -> None:
    doors = import_contracts.read_doors()
    assert len(doors) > 30
    sources = import_contracts.sources_of(grimp.build_graph("picktree", cache_dir=None))
    assert import_contracts.ways_around_doors(doors, sources) == []
    around = {
        "picktree.skills.grasp": "from picktree.robot.planning.solver import A\nimport picktree.world.causes",
        "picktree.skills.place": "from ..robot import World\nfrom .b import A\nfrom picktree.files import B",
        "picktree.robot.world": "from .control import SafetyMonitor\nfrom .vision import Vision",
    }
    assert import_contracts.ways_around_doors(doors, around) == [
        "picktree.skills.grasp, line 1: picktree.robot.planning.solver",
        "picktree.skills.grasp, line 2: picktree.world.causes",
        "picktree.skills.place, line 1: ..robot",
        "picktree.robot.world, line 1: .control",
    ]


def test_every_door_has_its_names() -> None:
    for door, names in import_contracts.read_doors().items():
        package = importlib.import_module(door)
        for name, module in names.items():
            assert getattr(package, name) is not None
            assert module in (f"{door}.{name}", *sys.modules)
        assert package.__all__ == sorted(names)


@pytest.mark.parametrize(
    ("program", "page"),
    [
        ("doors_page.py", "docs/doors.md"),
        ("page_types.py", "apps/studio/page/src/records.ts"),
        ("tables_page.py", "docs/reference-tables.md"),
        ("scenes_page.py", "docs/reference-scenes.md"),
    ],
)
def test_a_generated_page_is_up_to_date(program: str, page: str) -> None:
    """`make docs` makes it anew."""
    made = subprocess.run([sys.executable, str(ROOT / "docs" / program)], capture_output=True, text=True)
    assert made.stdout == (ROOT / page).read_text(encoding="utf-8"), made.stderr


def test_every_list_of_packages_has_all_of_them() -> None:
    files = (file for room in rooms() for file in (ROOT / room).rglob("__init__.py"))
    folders = [file.parent.relative_to(ROOT).parts for file in files]
    assert sorted(PACKAGES) == sorted(".".join(("picktree", *parts)) for parts in [(), *folders])
    assert list(rooms()) == ROOMS
    tool = PROJECT["tool"]
    assert sorted(tool["coverage"]["run"]["source_dirs"]) == ROOMS
    assert sorted(tool["ruff"]["lint"]["flake8-tidy-imports"]["banned-api"]) == ROOMS
    (floors,) = (each for each in tool["importlinter"]["contracts"] if each["name"] == "floors")
    layers = {name.strip() for layer in floors["layers"] for name in layer.split("|")}
    assert {f"picktree.{room}" for room in ROOMS} <= layers


def test_no_file_imports_itself_in_a_circle() -> None:
    """Imports in functions and for types count, too."""
    graph = grimp.build_graph("picktree", cache_dir=None)
    import_contracts.look_through_doors(
        graph, import_contracts.read_doors(), import_contracts.sources_of(graph)
    )
    assert len(graph.modules) > 300
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    TopologicalSorter(imports).prepare()  # its CycleError names the files


def test_docstrings_begin_with_a_verb_or_a_noun_and_a_short_sentence() -> None:
    found = [
        (f"{file.relative_to(ROOT)}:{docstring.line}: {docstring.first_line}", docstring)
        for file in modules()
        for docstring in docstrings(ast.parse(file.read_text(encoding="utf-8")))
    ]
    assert len(found) > 8000
    assert [place for place, docstring in found if docstring.has_obscure_first_word] == []
    assert [place for place, docstring in found if docstring.has_long_first_sentence] == []


MAX_TICS = 66
"""Number of sentences with a tic that are left; it is lowered when some are rewritten."""


def test_few_sentences_have_a_tic() -> None:
    assert sentences_with_tics("What is left stands there. It ends.") == [
        "a clause as subject: What is left stands there.",
        "stands: What is left stands there.",
    ]
    found = [(place, text) for place, text in texts()]
    assert len(found) > 12_000
    tics = [f"{place}: {each}" for place, text in found for each in sentences_with_tics(text)]
    assert len(tics) <= MAX_TICS, "\n".join(tics)


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
