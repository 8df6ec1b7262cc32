"""The figures of `make house`, counted in a small product whose figures are known."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest

from .house import __main__
from .house.docstrings import docstrings, sentences
from .house.figures import (
    Figures,
    figures,
    folder_sizes,
    function_lengths,
    importers,
    loaded,
    lone_folders,
    single_importers,
    starts,
)
from .house.lists import LISTS
from .house.names import classes, constants, in_several_modules, public_functions, with_equal_value
from .house.source import ALWAYS, House, When, circles, closure, own_house, read_house
from .house.table import table

LOADING = (When.LOADING,)


def house_of(root: Path, files: dict[str, str]) -> House:
    """Write files of a product `toy` to a folder of that name, and parse them."""
    files = {"__init__.py": "", **files}
    packages = {"toy": None}
    for name, text in files.items():
        path = root / "toy" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(dedent(text), encoding="utf-8")
        packages[".".join(("toy", *Path(name).parts[:-1]))] = None
    (root / "toy" / "pyproject.toml").write_text(
        f"[tool.setuptools]\npackages = {list(packages)}\npackage-dir = {{ toy = '.' }}\n"
    )
    return read_house(root / "toy")


def listed(house: House, what: str) -> list[str]:
    return [str(entry) for entry in LISTS[what](house)]


def test_modules_are_those_of_the_listed_packages_without_init(tmp_path: Path) -> None:
    (tmp_path / "toy" / "room" / "templates").mkdir(parents=True)
    (tmp_path / "toy" / "room" / "templates" / "example.py").write_text("1 +\n")
    house = house_of(tmp_path, {"__main__.py": "", "room/__init__.py": "X = 1\n", "room/a.py": "1\n2\n\n3"})
    assert [(module.name, module.lines) for module in house.modules] == [
        ("toy.__main__", 0),
        ("toy.room.a", 4),
    ]
    found = figures(house)
    assert found["modules"] | {"modules": 2, "lines": 4, "lines of a module, median": 2} == found["modules"]
    assert found["modules by room"] == {"(top)": 1, "room/": 1}
    assert found["lines by room"] == {"(top)": 0, "room/": 4}


def test_long_modules_and_lengths_of_functions(tmp_path: Path) -> None:
    short = "def f():\n    return 1\n"
    text = """
        class A:
            @property
            def f(self):
                def g():
                    return 1
                return g
        """
    house = house_of(tmp_path, {"a.py": text, "b.py": short * 200, "c.py": short * 201, "d.py": short * 150})
    assert sorted(function_lengths(house))[-2:] == [2, 4]
    found = figures(house)["modules"]
    assert (found["above 300 lines"], found["above 400 lines"], found["functions"]) == (2, 1, 553)
    assert listed(house, "long") == ["c.py:1: 402 lines", "b.py:1: 400 lines"]


def test_ninth_decile_of_ten_functions_is_the_ninth(tmp_path: Path) -> None:
    functions = (f"def f{n}():\n" + "    1\n" * n for n in range(1, 11))
    found = figures(house_of(tmp_path, {"a.py": "".join(functions)}))["modules"]
    assert found["lines of a function, 90 % have no more"] == 10
    assert found["lines of a function, median"] == 6.5


def test_time_of_imports(tmp_path: Path) -> None:
    text = """
        from typing import TYPE_CHECKING
        import typing
        if TYPE_CHECKING:
            from . import b
        else:
            from . import c
        if typing.TYPE_CHECKING:
            import toy.d
        class A:
            from .e import x
            def f(self):
                if True:
                    from .f import y
        try:
            from toy import g
        except ImportError:
            from . import h
        """
    house = house_of(tmp_path, {"a.py": text, **{f"{name}.py": "" for name in "bcdefgh"}})
    assert {(one.imported[-1], one.line, one.when) for one in house.imports} == {
        ("b", 5, When.TYPING),
        ("c", 7, When.LOADING),
        ("d", 9, When.TYPING),
        ("e", 11, When.LOADING),
        ("f", 14, When.CALLING),
        ("g", 16, When.LOADING),
        ("h", 18, When.LOADING),
    }


def test_relative_imports_from_folders_and_packages(tmp_path: Path) -> None:
    house = house_of(
        tmp_path,
        {
            "room/__init__.py": "from .a import value\n",
            "room/a.py": "value = 1\n",
            "room/inner/__init__.py": "from ..a import value\n",
            "room/inner/b.py": "from ...other import c\nfrom ...other.c import d\nfrom os import path\n",
            "other/__init__.py": "",
            "other/c.py": "import toy.room.inner.b as e\n",
        },
    )
    graph = {importer.removeprefix("toy."): imported for importer, imported in house.graph().items()}
    assert graph["room"] == graph["room.inner"] == {"toy.room.a"}
    assert graph["room.inner.b"] == {"toy.other.c"}
    assert graph["other.c"] == {"toy.room.inner.b"}


def test_a_re_exported_name_is_imported_from_its_module(tmp_path: Path) -> None:
    house = house_of(
        tmp_path,
        {
            "room/__init__.py": "from .a import value\nfrom .b import other as second\n",
            "room/a.py": "value = 1\n",
            "room/b.py": "other = 1\n",
            "c.py": "from .room import second\n",
        },
    )
    assert house.graph()["toy.c"] == {"toy.room", "toy.room.b"}
    assert importers(house) == {"toy.c": set(), "toy.room.a": set(), "toy.room.b": {"toy.c"}}


def test_modules_with_one_importer(tmp_path: Path) -> None:
    lazy = "def f():\n    from .a import x\n    from .a import y\n"
    types = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from ..b import x\n"
    house = house_of(
        tmp_path,
        {
            "a.py": "from . import a", "b.py": "", "c.py": lazy,
            "room/__init__.py": "from .. import c", "room/d.py": types,
            "e.py": "", "f.py": "from . import e", "g.py": "from . import e",
        },
    )  # fmt: skip
    assert single_importers(house) == {"toy.a": "toy.c", "toy.b": "toy.room.d"}
    assert figures(house)["modules with one importer"] == {"modules": 2, "importer in the same folder": 1}
    assert listed(house, "single") == [
        "a.py:1: imported by c.py alone, same folder",
        "b.py:1: imported by room/d.py alone",
    ]


def test_names_in_several_modules(tmp_path: Path) -> None:
    a = """
        if True:
            class Target:
                class Inner: ...
        def of(): ...
        def _of(): ...
        class A:
            def method(self): ...
        """
    b = """
        class Target: ...
        class Inner: ...
        async def of(): ...
        def _of(): ...
        def method(): ...
        """
    house = house_of(tmp_path, {"a.py": a, "b.py": b, "c.py": "class Twice: ...\nclass Twice: ...\n"})
    assert list(in_several_modules(classes(house))) == ["Target"]
    assert list(in_several_modules(public_functions(house))) == ["of"]
    assert list(figures(house)["names in several modules"].values()) == [1, 2, 1, 2]
    assert listed(house, "classes") == ["a.py:3: Target (one of 2)", "b.py:2: Target (one of 2)"]
    assert listed(house, "functions") == ["a.py:5: of (one of 2)", "b.py:4: of (one of 2)"]


def test_constants(tmp_path: Path) -> None:
    a = """
        from typing import TypeVar
        T = TypeVar("T")
        STEP: float = 0.50
        _NEAR = f(-1)
        X, Y = 1, 2
        declared: float = 1.0
        LATER: float
        if True:
            FAR = [1, 2]
        def f():
            LOCAL = 1
        """
    b = "STEP = .5\nFAR = [2, 1]\n_NEAR = f(-1)\nMixed = 1\nX, Z = 1, 2\n"
    house = house_of(tmp_path, {"a.py": a, "b.py": b})
    found = constants(house)
    assert [one.name for one in found] == ["STEP", "_NEAR", "X", "Y", "FAR", "STEP", "FAR", "_NEAR", "X", "Z"]
    assert list(in_several_modules(found)) == ["FAR", "STEP", "X", "_NEAR"]
    assert list(with_equal_value(found)) == ["STEP = 0.5"]
    assert list(figures(house)["constants"].values()) == [10, 2, 4, 8, 1, 2]
    assert listed(house, "equal") == ["a.py:4: STEP = 0.5 (one of 2)", "b.py:1: STEP = 0.5 (one of 2)"]


def test_most_frequent_constants(tmp_path: Path) -> None:
    house = house_of(
        tmp_path, {f"m{n:02}.py": "".join(f"C{k:02} = 1\n" for k in range(n, 13)) for n in range(13)}
    )
    (frequent,) = (rows for group, rows in figures(house).items() if group.startswith("constants in several"))
    assert frequent == {f"C{12 - n:02}": 13 - n for n in range(10)}


CIRCLES = {
    "lazy/__init__.py": "",
    "lazy/a.py": "from . import b\n",
    "lazy/b.py": "from . import c\n",
    "lazy/c.py": "def f():\n    from . import a\n",
    "room/__init__.py": "",
    "room/d.py": "from .inner import e\nfrom ..first import lone\n",
    "room/inner/__init__.py": "",
    "room/inner/e.py": "",
    "room/inner/f.py": "from .. import g\n",
    "room/g.py": "from . import h\n",
    "room/h.py": "from . import g\n",
    "first/__init__.py": "",
    "first/lone.py": "",
}


def test_circles_between_files(tmp_path: Path) -> None:
    house = house_of(tmp_path, CIRCLES)
    pair = ["toy.room.g", "toy.room.h"]
    assert circles(house.graph(LOADING)) == [pair]
    assert circles(house.graph(ALWAYS)) == [["toy.lazy.a", "toy.lazy.b", "toy.lazy.c"], pair]
    assert list(figures(house)["circles of imports between files"].values()) == [1, 2, 2, 2, 3, 5]
    assert listed(house, "circles") == [
        "room/g.py:1: when loaded, circle 1 (2 files): imports room/h.py when it is loaded",
        "room/h.py:1: when loaded, circle 1 (2 files): imports room/g.py when it is loaded",
        "lazy/a.py:1: all imports, circle 1 (3 files): imports lazy/b.py when it is loaded",
        "lazy/b.py:1: all imports, circle 1 (3 files): imports lazy/c.py when it is loaded",
        "lazy/c.py:2: all imports, circle 1 (3 files): imports lazy/a.py in a function",
        "room/g.py:1: all imports, circle 2 (2 files): imports room/h.py when it is loaded",
        "room/h.py:1: all imports, circle 2 (2 files): imports room/g.py when it is loaded",
    ]


def test_circles_between_folders(tmp_path: Path) -> None:
    house = house_of(tmp_path, CIRCLES)
    assert house.folder_graph(LOADING)["toy.room"] == {"toy.room.inner", "toy.first"}
    assert circles(house.folder_graph(LOADING)) == [["toy.room", "toy.room.inner"]]
    assert list(figures(house)["circles of imports between folders"].values()) == [1, 2, 2, 1, 2, 2]
    assert listed(house, "folder-circles")[:2] == [
        "room/d.py:1: when loaded, circle 1 (2 folders): imports room/inner/e.py when it is loaded",
        "room/inner/f.py:1: when loaded, circle 1 (2 folders): imports room/g.py when it is loaded",
    ]


def test_files_of_the_top_folder_are_in_no_circle_of_folders_together(tmp_path: Path) -> None:
    files = {"__init__.py": "from .room import a", "errors.py": "", "room/a.py": "from .. import errors"}
    house = house_of(tmp_path, files)
    assert circles(house.folder_graph()) == []
    assert house.folder_graph() == {"toy": {"toy.room"}, "toy.errors": set(), "toy.room": {"toy.errors"}}


def test_circles_that_touch_are_one() -> None:
    graph = {
        "a": ["b"],
        "b": ["a", "c"],
        "c": ["b", "d"],
        "d": ["e"],
        "e": ["f"],
        "f": ["e"],
        "g": ["a", "g"],
    }
    assert circles(graph) == [["a", "b", "c"], ["e", "f"]]


def test_folders(tmp_path: Path) -> None:
    house = house_of(
        tmp_path, {**CIRCLES, **{f"full/m{n}.py": "" for n in range(16)}, "full/__init__.py": ""}
    )
    sizes = {"toy": 0, "toy.lazy": 3, "toy.room": 3, "toy.room.inner": 2, "toy.first": 1, "toy.full": 16}
    assert folder_sizes(house) == sizes
    assert lone_folders(house) == ["toy.first"]
    assert list(figures(house)["folders"].values()) == [4, 6, 16, 1, 1]
    assert listed(house, "folders")[0] == "full/:1: 16 directly in it"
    assert "first/:1: 1 directly in it, no other below" in listed(house, "folders")


PRODUCT = {
    "__main__.py": """
        import sys
        print("noise")
        if sys.argv[1] == "check":
            import toy.cli.author.check
        sys.exit(int(sys.argv[2]))
        """,
    "cli/__init__.py": "",
    "cli/author/__init__.py": "",
    "cli/author/check.py": "from ...skills import data\ndef check(): ...\n",
    "check.py": "",
    "skills/__init__.py": "from . import grasp\n",
    "skills/grasp.py": "from .data import x\nclass Grasp: ...\ndef f():\n    from . import other\n",
    "skills/data.py": "from ..deep import y\nx = 1\n",
    "skills/other.py": "class GoTo: ...\n",
    "skills/another.py": "class GoTo: ...\n",
    "deep.py": "y = 1\n",
}


def test_imports_of_skills_and_commands(tmp_path: Path) -> None:
    house = house_of(tmp_path, PRODUCT)
    assert starts(house) == {
        "skill Grasp": "toy.skills.grasp",
        "skill GoTo": None,  # two classes of that name
        "command check": "toy.cli.author.check",
        "command explain": None,
    }
    reached = {"toy.skills.grasp", "toy.skills.data", "toy.deep"}
    assert closure(house.graph(LOADING), "toy.skills.grasp") == reached
    found = figures(house)["imported at the top of modules from"]
    assert list(found.values()) == [3, 7, None, None, 3, 5, None, None]


def test_what_a_command_loads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    house_of(tmp_path, PRODUCT)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    packages = {"toy", "toy.cli", "toy.cli.author", "toy.skills"}
    modules = {"toy.cli.author.check", "toy.skills.grasp", "toy.skills.data", "toy.deep"}
    assert loaded("toy", ["check", "0"]) == packages | modules
    assert loaded("toy", ["other", "0"]) == {"toy"}
    with pytest.raises(subprocess.CalledProcessError):
        loaded("toy", ["check", "2"])


DOCSTRINGS = f'''
"""Of the module. Fine."""
X = 1
"""Upper bound of `X`."""
"""No docstring: it follows none."""


class A:
    """What {"long " * 24}it is.

    - {"long " * 26}item
    """

    x: int
    """Width. {"Many " * 25}words."""
    if True:
        y = 1
        """By the height."""

    def f(self):
        """Return
        {"many " * 25}."""
        text = 1
        """no docstring"""

        class B:
            z = 1
            "Depth."
            a = 1
            """Height{" many" * 24}."""

    async def g(self):
        """
        On a line of its own.

            {"code " * 40}
        """
'''


def test_docstrings(tmp_path: Path) -> None:
    house = house_of(tmp_path, {"a.py": DOCSTRINGS.lstrip()})
    found = docstrings(house.files["toy.a"].tree)
    assert [one.line for one in found] == [1, 3, 8, 14, 17, 20, 27, 29, 32]
    assert [one.line for one in found if one.has_obscure_first_word] == [1, 8, 17, 32]
    assert [one.line for one in found if one.has_long_first_sentence] == [8, 20]
    assert [one.line for one in found if one.has_long_sentence] == [8, 14, 20]
    assert list(figures(house)["docstrings"].values()) == [9, 4, 2, 3]
    assert [line.partition("long")[0] for line in listed(house, "docstrings")] == [
        "a.py:1: first word: Of the module. Fine.",
        "a.py:8: first word, first sentence of 27 words, sentence of 27 words: What ",
        f"a.py:14: sentence of 26 words: Width. {'Many ' * 25}words.",
        "a.py:17: first word: By the height.",
        "a.py:20: first sentence of 26 words: Return",
        "a.py:32: first word: On a line of its own.",
    ]


def test_sentences() -> None:
    assert sentences("Speed, m/s, e.g. 0.5 m/s. `None`: no limit! (See there.) 0: off?") == [
        "Speed, m/s, e.g. 0.5 m/s.", "`None`: no limit!", "(See there.", "0: off?",
    ]  # fmt: skip
    assert sentences("Rules:\n- first\n- second\n\nEnd\nof it") == [
        "Rules:",
        "- first",
        "- second",
        "End\nof it",
    ]
    assert sentences("Add.\n\n>>> add(1. , 2)\n3") == ["Add."]


def test_table_of_two_states() -> None:
    now: Figures = {"sizes": {"lines": 12345, "median": 6.5}, "rooms": {"new/": 3}}
    before: Figures = {"sizes": {"lines": 9, "median": None}, "rooms": {"old/": 4}}
    assert table(now, before).splitlines() == [
        "               now    before",
        "sizes",
        "  lines     12,345         9",
        "  median       6.5         –",
        "",
        "rooms",
        "  new/           3         –",
        "  old/           –         4",
    ]
    assert table(now).splitlines()[:2] == ["sizes", "  lines     12,345"]


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> None:
    monkeypatch.setattr(sys, "argv", ["tests.house", *words])
    __main__.main()


def test_command_lists_what_is_under_a_path(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run(monkeypatch, "--list", "folders", "--under", "cli/")
    lines = capsys.readouterr().out.splitlines()
    assert lines
    assert all(line.startswith("cli/") for line in lines)


@pytest.mark.slow
def test_figures_of_the_product_are_all_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    after, before = tmp_path / "after.json", tmp_path / "before.json"
    before.write_text('{"modules": {"modules": 1}}')
    run(monkeypatch, "--json", str(after), "--before", str(before))
    found: Figures = json.loads(after.read_text())
    assert [(group, name) for group, rows in found.items() for name in rows if rows[name] is None] == []
    imported = found["imported at the top of modules from"]
    for name, number in found["loaded by a run of"].items():
        assert (number or 0) >= (imported[name] or 0) > 0
    count = len(own_house().modules)
    assert capsys.readouterr().out.splitlines()[2].split() == ["modules", f"{count:,}", "1"]
