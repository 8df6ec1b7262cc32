"""The set-up: what is installed, to which version, and that a set-up that broke off is finished later."""

from __future__ import annotations

import os
import re
import subprocess
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from .needs import MAKE

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def requirements() -> Iterator[Requirement]:
    """All libraries that pyproject.toml names, without the extras that extras name."""
    project = PROJECT["project"]
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    for text in [line for group in groups for line in group] + PROJECT["build-system"]["requires"]:
        wanted = Requirement(text)
        if wanted.name != project["name"]:
            yield wanted


def test_each_library_stands_once() -> None:
    names = [canonicalize_name(wanted.name) for wanted in requirements()]
    assert sorted(names) == sorted(set(names))


def test_development_takes_all_extras_but_that_of_one_tool() -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    taken = set().union(*(r.extras for r in map(Requirement, extras["dev"]) if r.name == "picktree"))
    assert taken == extras.keys() - {"dev", "mutants"}


def test_every_library_is_pinned_within_its_range() -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pairs = [line.split("==") for line in lines if not line.startswith("#")]
    pins = {canonicalize_name(name): version for name, version in pairs}
    missing = [w.name for w in requirements() if canonicalize_name(w.name) not in pins]
    outside = [str(w) for w in requirements() if not w.specifier.contains(pins[canonicalize_name(w.name)])]
    assert (missing, outside) == ([], [])


STANDIN = """\
#!/bin/sh
# Answers as Python, venv and pip do, and writes down what is asked; $BREAK is asked and not survived.
case "$*" in
    "-c import"*) echo 3.11; exit;;
    "-m venv "*) asked=venv; mkdir -p "$3/bin" "$3/lib/python3.11/site-packages"; touch "$3/pyvenv.cfg"
        cp "$0" "$3/.kept"; ln -sf ../.kept "$3/bin/python";;
    "-m pip install "*) asked="pip ${*##* }";;
    "-m compileall "*) asked=compile;;
    *) asked="$*";;
esac
echo "$asked" >> "$ASKED"
[ "$asked" != "$BREAK" ] || kill -9 $$
[ "$asked" != venv ] || { touch "$3/bin/pip"; chmod +x "$3/bin/pip"; }
"""


@dataclass
class Checkout:
    """This checkout with an environment elsewhere and a stand-in for Python; what `make` answered last."""

    folder: Path
    code: int = 0
    out: str = ""
    err: str = ""

    def __post_init__(self) -> None:
        python = self.folder / "python"
        python.write_text(STANDIN, encoding="utf-8")
        python.chmod(0o755)

    @property
    def environment(self) -> Path:
        return self.folder / "venv"

    @property
    def libraries(self) -> Path:
        return self.environment / "lib" / "python3.11" / "site-packages"

    def make(self, *goals: str, python: Path | None = None, breaks: str = "") -> list[str]:
        """Make the goals and return what the stand-in was asked for."""
        asked = self.folder / "asked"
        asked.write_text("", encoding="utf-8")
        kept = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")}
        made = subprocess.run(
            ["make", *goals, f"PYTHON={python or self.folder / 'python'}", f"VENV={self.environment}"],
            env={**kept, "ASKED": str(asked), "BREAK": breaks}, cwd=ROOT, capture_output=True, text=True,
        )  # fmt: skip
        self.code, self.out, self.err = made.returncode, made.stdout, made.stderr
        return asked.read_text(encoding="utf-8").splitlines()


FIRST = ["venv", "pip setuptools", "pip .", "compile"]
MORE = ["pip setuptools", "pip .[dev]", "compile"]


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    MAKE.require()
    return Checkout(tmp_path)


def test_says_first_what_it_takes_and_does_it_once(checkout: Checkout) -> None:
    into = f"into {checkout.environment}:"
    assert checkout.make("setup") == FIRST
    assert checkout.out.startswith(f"Installing what runs need {into} 340 MB to download, ")
    assert checkout.make("setup") == []
    assert checkout.make("dev") == MORE
    assert checkout.out.startswith(f"Installing what tests and checks need {into} 840 MB to download, ")
    assert checkout.make("setup", "dev") == []


def test_the_readme_says_the_same() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    pages = [(ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/development.md")]
    readme = "".join(pages).replace(" in all (", " (")
    sizes = re.findall(r"_TAKES := (\d+ MB) to download, ([\d.]+ GB) of disk", makefile)
    assert len(sizes) == 2
    assert [size for size in sizes if f"{size[1]} ({size[0]} to download)" not in readme] == []


def test_development_alone_is_one_pass(checkout: Checkout) -> None:
    assert checkout.make("dev") == ["venv", *MORE]
    assert checkout.make("setup") == []


@pytest.mark.parametrize("file", ["pyproject.toml", "constraints.txt"])
def test_what_changed_is_installed_into_what_is_there(checkout: Checkout, file: str) -> None:
    checkout.make("dev")
    assert checkout.make("-W", file, "setup") == FIRST[1:]
    assert checkout.make("dev") == MORE


def test_an_environment_that_broke_off_starts_over(checkout: Checkout) -> None:
    assert checkout.make("setup", breaks="venv") == ["venv"]
    assert checkout.code == 2
    (checkout.libraries / "half").touch()
    assert checkout.make("setup") == FIRST
    assert checkout.code == 0
    assert not (checkout.libraries / "half").exists()


@pytest.mark.parametrize("breaks", FIRST[1:])
def test_an_installation_that_broke_off_goes_on(checkout: Checkout, breaks: str) -> None:
    assert checkout.make("setup", breaks=breaks)[-1] == breaks
    assert checkout.code == 2
    assert checkout.make("setup") == FIRST[1:]
    assert checkout.code == 0
    assert checkout.make("setup") == []


def test_the_next_step_that_broke_off_leaves_no_stamp_of_the_first(checkout: Checkout) -> None:
    """pip may have been about to replace what runs need."""
    checkout.make("setup")
    checkout.make("dev", breaks="pip .[dev]")
    assert "The installation broke off: the next make goes on with it." in checkout.err
    assert checkout.make("setup") == FIRST[1:]
    assert checkout.make("dev") == MORE


def test_half_installed_libraries_are_hidden_from_pip(checkout: Checkout) -> None:
    checkout.make("setup", breaks="pip .")
    for name, record in (
        ("whole", "a.py,,\na-1.dist-info/INSTALLER,,\n"),
        ("half", "a.py,,\n"),
        ("new", None),
    ):
        info = checkout.libraries / f"{name}-1.dist-info"
        info.mkdir()
        if record is not None:
            (info / "RECORD").write_text(record, encoding="utf-8")
    (checkout.libraries / "~ld").mkdir()
    checkout.make("setup")
    assert [path.name for path in checkout.libraries.iterdir()] == ["whole-1.dist-info"]


def test_an_environment_whose_interpreter_is_gone_starts_over(checkout: Checkout) -> None:
    checkout.make("dev")
    (checkout.environment / ".kept").unlink()
    assert checkout.make("setup") == FIRST


def test_a_folder_that_is_no_environment_keeps_what_is_in_it(checkout: Checkout) -> None:
    checkout.environment.mkdir()
    (checkout.environment / "letters").touch()
    assert checkout.make("setup") == FIRST
    assert (checkout.environment / "letters").exists()


@pytest.mark.parametrize(
    ("version", "said"),
    [("", "missing or no Python"), ("3.12", "Python 3.12"), ("2.7", "Python 2.7")],
)
def test_says_in_one_line_what_is_wrong_with_the_python(
    checkout: Checkout, version: str, said: str, tmp_path: Path
) -> None:
    python = tmp_path / "other"
    if version:
        python.write_text(f"#!/bin/sh\necho {version}\n")
        python.chmod(0o755)
    assert checkout.make("setup", python=python) == []
    assert checkout.code == 2
    assert checkout.out == ""
    (line,) = checkout.err.splitlines()
    assert f"picktree needs Python 3.11; '{python}' is {said}" in line
    assert not checkout.environment.exists()
