"""The pages on plug-ins: their files work as they say, their commands run, their package is found."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from picktree.apps.cli import answer
from picktree.files.fault_codes import page
from picktree.skills import plugin
from picktree.trees.loading import NodeRegistry, load_mission
from picktree.world import all_causes

from .scripted import letters, run_of
from .waving import forgotten

ROOT = Path(__file__).parents[2]
PAGES = ("plugins.md", "plugin-tests.md", "plugin-reference.md")
PAGE = "".join((ROOT / "docs" / name).read_text(encoding="utf-8") for name in PAGES)
FILES = dict(
    re.findall(r"^```(?:python|yaml|toml)\n# ([\w/]+\.\w+)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
)


@pytest.fixture(autouse=True)
def alone() -> Iterator[None]:
    with forgotten():
        yield


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Somebody's folder with all files of the page, as the present one."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_file_that_it_shows_is_the_example() -> None:
    for name in ("plugins/probe.py", "plugins/weigh.py"):
        assert FILES[name] == (ROOT / "examples" / name).read_text(encoding="utf-8")


def test_the_page_lists_the_constants_of_all_causes() -> None:
    listed = {
        f"{family}.{name}"
        for family, names in re.findall(r"^\| `([a-z]+)` \| (`[A-Z].*) \|$", PAGE, re.MULTILINE)
        for name in re.findall(r"`([A-Z_]+)`", names)
    }
    known = {cause.name for cause in all_causes() if cause.name.partition(".")[0] in dir(plugin)}
    assert {name.lower() for name in listed} == known
    for name in listed:
        family, _, constant = name.partition(".")
        assert getattr(getattr(plugin, family), constant).name == name.lower()


def test_its_commands_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = re.findall(r"^```sh\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    commands = [line.split("#")[0].split()[1:] for line in block.splitlines()]
    assert [command[0] for command in commands] == ["check", "nodes", "schema", "run", "run"]
    for command in commands[:-1]:  # in physics it takes as long again, and tests/ has it elsewhere
        assert answer(command) == 0, command
    assert "Feel with closed fingers" in capsys.readouterr().out
    assert "probe.nothing" in (folder / "feel.schema.json").read_text(encoding="utf-8")


def test_its_case_passes(folder: Path) -> None:
    assert answer(["check", "cases.yaml", "feel.yaml", "--strict"]) == 0
    assert answer(["rehearse", "feel.yaml", "--cases", "cases.yaml"]) == 0


def test_its_test_passes(folder: Path) -> None:
    source = FILES["test_probe.py"]
    names: dict[str, object] = {}
    exec(compile(source, "test_probe.py", "exec"), names)
    test = names["test_it_feels_the_table"]
    assert callable(test)
    test(folder / "runs")


def test_its_condition_and_its_decorator_work(folder: Path) -> None:
    (folder / "shift.yaml").write_text("""\
picktree: 1
kind: mission
plugins: [plugins/shift.py]
trees:
  Main:
    Sequence:
      - Before: {time: 100 ms}
      - ForEach: {in: [1, 2, 3, 4], out: "{n}", do: {EveryOther: {Log: {message: turn, value: "{n}"}}}}
      - Inverter: {Before: {time: 100 ms}}
""")
    assert answer(["check", "shift.yaml"]) == 0
    run = run_of(load_mission(folder / "shift.yaml"))
    assert letters(run.to_end()) == "RRRS"
    assert [note.message for note in run.notes("log")] == ["turn: 1", "turn: 3"]


def test_its_package_is_found_by_its_entry_point(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "my_cell").mkdir(exist_ok=True)
    (folder / "my_cell" / "__init__.py").write_text("")
    (folder / "my_cell" / "skills.py").write_text(FILES["plugins/probe.py"])
    site = folder / "site"
    site.mkdir()
    program = f"from setuptools import build_meta; build_meta.prepare_metadata_for_build_wheel({str(site)!r})"
    subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, cwd=folder, env=os.environ
    )
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.syspath_prepend(str(site))
    importlib.invalidate_caches()
    try:
        registry = NodeRegistry()
        found = registry.find("Probe")
        assert found is not None and found.__module__ == "my_cell.skills"
        assert registry.problems == ()
    finally:
        for name in ("my_cell", "my_cell.skills"):
            sys.modules.pop(name, None)


def test_it_names_the_codes_by_their_pages() -> None:
    codes = re.findall(r"^\| (P\d{3}) \|", PAGE, re.MULTILINE)
    assert codes == [f"P{number}" for number in range(251, 258)]
    assert all(page(code).title.startswith("Plug-in") for code in codes)
