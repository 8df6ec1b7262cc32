"""Old names of modules and classes lead to the new ones, with a warning."""

from __future__ import annotations

import importlib
import re
import sys
import warnings
from collections.abc import Iterator
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path

import pytest

from picktree.moved import ALIASES, MODULES, NAMES, Aliases, install

from .rooms import ROOT

FILES = {
    "cottage/__init__.py": "",
    "cottage/kitchen/__init__.py": "def __getattr__(name): return aliases.find(__name__, name)\n",
    "cottage/kitchen/stove.py": "class GasStove: pass\nclass Pan: pass\nclass Lid: pass\n",
    "cottage/kitchen/table.py": "PLACE = 'kitchen'\n",
}
MOVED = {"hall.heating.oven": "kitchen.stove", "hall.bench": "nowhere", "kitchen.table": "kitchen.stove"}
RENAMED = {
    "hall.heating.oven.Oven": "kitchen.stove.GasStove",
    "hall.heating.oven.Lid": "kitchen.stove.Cover",
    "kitchen.Pot": "kitchen.stove.Pan",
}


@pytest.fixture
def cottage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Aliases]:
    """The finder of a package with these files."""
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    aliases = Aliases("cottage", MOVED, RENAMED)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, aliases])
    vars(importlib.import_module("cottage.kitchen"))["aliases"] = aliases
    yield aliases
    for name in [name for name in sys.modules if name.partition(".")[0] == "cottage"]:
        del sys.modules[name]


def run(text: str) -> tuple[dict[str, object], list[str]]:
    """Return the names of a program and its warnings, which all belong to its second line."""
    names: dict[str, object] = {}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        exec(compile(f"\n{text}", "a_plugin.py", "exec"), names)
    assert {(each.filename, each.lineno) for each in caught} <= {("a_plugin.py", 2)}
    assert {each.category for each in caught} <= {DeprecationWarning}
    return names, [str(each.message) for each in caught]


@pytest.mark.parametrize(
    ("line", "name", "warning"),
    [
        ("from cottage.hall.heating.oven import Oven", "GasStove",
         "cottage.hall.heating.oven.Oven is deprecated: write from cottage.kitchen.stove import GasStove"),
        ("from cottage.hall.heating.oven import Pan as Oven", "Pan",
         "cottage.hall.heating.oven.Pan is deprecated: write from cottage.kitchen.stove import Pan"),
        ("import cottage.hall.heating.oven as o; Oven = o.Oven", "GasStove",
         "cottage.hall.heating.oven.Oven is deprecated: write from cottage.kitchen.stove import GasStove"),
        ("from cottage.hall.heating import oven; Oven = oven.Oven", "GasStove",
         "cottage.hall.heating.oven.Oven is deprecated: write from cottage.kitchen.stove import GasStove"),
        # Moved, and not yet renamed.
        ("from cottage.hall.heating.oven import Lid as Oven", "Lid",
         "cottage.hall.heating.oven.Lid is deprecated: write from cottage.kitchen.stove import Lid"),
        # Lost by a package that exists.
        ("from cottage.kitchen import Pot as Oven", "Pan",
         "cottage.kitchen.Pot is deprecated: write from cottage.kitchen.stove import Pan"),
    ],
)  # fmt: skip
def test_an_old_name_is_the_new_one_and_warns_once(
    line: str, name: str, warning: str, cottage: Aliases
) -> None:
    assert "cottage.kitchen.stove" not in sys.modules
    names, warned = run(line)
    assert names["Oven"] is vars(sys.modules["cottage.kitchen.stove"])[name]
    assert warned == [warning]
    assert run(line)[1] == []


def test_an_alias_imports_nothing_until_a_name_is_asked_of_it(cottage: Aliases) -> None:
    assert run("import cottage.hall.heating.oven")[1] == []
    assert "cottage.kitchen.stove" not in sys.modules


def test_a_module_that_exists_is_itself(cottage: Aliases) -> None:
    assert run("from cottage.kitchen.table import PLACE")[0]["PLACE"] == "kitchen"


@pytest.mark.parametrize(
    ("line", "error", "message"),
    [
        ("from cottage.hall.heating.oven import Kettle", ImportError,
         "cannot import name 'Kettle' from 'cottage.hall.heating.oven' (unknown location)"),
        ("import cottage.hall.heating.oven as o; o.Kettle", AttributeError,
         "module 'cottage.hall.heating.oven' is 'cottage.kitchen.stove' now, and has no attribute 'Kettle'"),
        ("import cottage.kitchen; cottage.kitchen.Kettle", AttributeError,
         "module 'cottage.kitchen' has no attribute 'Kettle'"),
        ("from cottage.hall import heating; heating.fire", AttributeError,
         "module 'cottage.hall.heating' has no attribute 'fire'"),
        ("import cottage.cellar", ModuleNotFoundError, "No module named 'cottage.cellar'"),
        ("import cottage.hall.heating.fire", ModuleNotFoundError,
         "No module named 'cottage.hall.heating.fire'"),
        ("import cottage.kitchen.table.leg", ModuleNotFoundError,
         "No module named 'cottage.kitchen.table.leg'; 'cottage.kitchen.table' is not a package"),
        ("from cottage.hall.bench import Seat", ModuleNotFoundError, "No module named 'cottage.nowhere'"),
        ("import kitchen.stove", ModuleNotFoundError, "No module named 'kitchen'"),
    ],
)  # fmt: skip
def test_an_unknown_name_is_unknown(
    line: str, error: type[Exception], message: str, cottage: Aliases
) -> None:
    with pytest.raises(error) as raised:
        run(line)
    assert (type(raised.value), str(raised.value)) == (error, message)


def test_picktree_looks_for_old_names_last() -> None:
    assert sys.meta_path.index(ALIASES) > sys.meta_path.index(PathFinder)
    install()
    assert sys.meta_path.count(ALIASES) == 1


def documented() -> Iterator[tuple[str, str]]:
    """Module and name of each import that documents, examples and templates show."""
    files = [ROOT / "README.md"]
    files += [
        file for room in ("docs", "examples", "cli/author/templates") for file in (ROOT / room).rglob("*")
    ]
    for file in files:
        if file.suffix in (".md", ".py", ".ipynb"):
            found = re.findall(r"from picktree\.([\w.]+) import ([\w, ]+)", file.read_text(encoding="utf-8"))
            yield from ((module, name) for module, names in found for name in names.split(", "))


@pytest.mark.parametrize(("module", "name"), sorted(set(documented())))
def test_a_name_of_the_documents_can_be_imported(module: str, name: str) -> None:
    assert hasattr(importlib.import_module(f"picktree.{module}"), name)
    assert not isinstance(sys.modules[f"picktree.{module}"].__loader__, Aliases), "it is an old name"


def test_every_old_name_leads_somewhere() -> None:
    assert len(set(documented())) > 40
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        for old in NAMES:
            module, _, name = old.rpartition(".")
            assert hasattr(importlib.import_module(f"picktree.{module}"), name), old
    for old, new in MODULES.items():
        assert find_spec(f"picktree.{old}"), old
        exists = not isinstance(importlib.import_module(f"picktree.{old}").__loader__, Aliases)
        assert exists or find_spec(f"picktree.{new}"), new
