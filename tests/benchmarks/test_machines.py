"""The table of golden runs on other machines: a failure costs one cell, and a finished cell is kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = """\
import json, os, sys
for name in sys.argv[1:]:
    if name == "bad":
        sys.exit("it is bad")
    seen = os.environ.get("OPENBLAS_CORETYPE", "none"), os.environ.get("GLIBC_TUNABLES", "none")
    print(json.dumps({"name": name, "digest": f"{len(sys.argv)} {' '.join(seen)}", "cpu_seconds": 0.25}))
"""
EMULATOR = """\
#!/bin/sh
case "$*" in
  --version) echo "qemu-x86_64 version 7.2.22 (Debian 1:7.2)";;
  "-cpu help") echo "x86 Haswell  (alias)"; echo "  EPYC-Rome  (alias)";;
  "-cpu Haswell "*) echo SORTED;;
esac
"""


@pytest.fixture(scope="module")
def machines(program: Callable[[str], ModuleType]) -> ModuleType:
    return program("machines")


def executed(machines: ModuleType, runs: list[str], **where: object) -> dict[str, object]:
    return dict(machines.execute(runs, machines.Surroundings("here", **where)))


@pytest.fixture
def script(machines: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Digests that tell how many words the command had, and what its environment was."""
    path = tmp_path / "script.py"
    path.write_text(SCRIPT)
    monkeypatch.setattr(machines, "SCRIPT", path)
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Zen")
    monkeypatch.setenv("GLIBC_TUNABLES", "glibc.cpu.hwcaps=-FMA")


@pytest.mark.usefixtures("script")
def test_a_run_that_fails_costs_the_others_nothing(machines: ModuleType) -> None:
    cells = executed(machines, ["a", "bad", "b", "c"])
    assert [cells[name].digest for name in "abc"] == ["5 none none", "3 none none", "3 none none"]
    assert [cells[name].cpu_seconds for name in "abc"] == [0.25, 0.25, 0.25]
    assert (cells["bad"].digest, cells["bad"].failure) == ("", "it is bad")


@pytest.mark.usefixtures("script")
def test_the_environment_is_that_of_the_surroundings_alone(machines: ModuleType) -> None:
    cells = executed(machines, ["a"], variables={"OPENBLAS_CORETYPE": "SkylakeX"})
    assert cells["a"].digest == "2 SkylakeX none"


@pytest.mark.usefixtures("script")
def test_alone_each_run_has_a_process_whose_cpu_time_counts(machines: ModuleType) -> None:
    cells = executed(machines, ["a", "b"], alone=True)
    assert [cells[name].digest for name in "ab"] == ["2 none none", "2 none none"]
    assert all(0.0 < cells[name].cpu_seconds != 0.25 for name in "ab")


def test_cells_are_kept_until_their_sources_change(machines: ModuleType, tmp_path: Path) -> None:
    file, here = tmp_path / "runs" / "cells.json", machines.Surroundings("here")
    cell = machines.Cell("ab", 1.0)
    machines.Cells(file, "before").add(here, "pick", cell)
    assert machines.Cells(file, "before").row(here) == {"pick": cell}
    assert machines.Cells(file, "before").row(machines.Surroundings("here", {"A": "1"})) == {}
    assert machines.Cells(file, "after").row(here) == {}


def test_a_row_names_where_its_digest_is_another(machines: ModuleType) -> None:
    cell = machines.Cell
    native = {"a process for each run": cell("ab", 3.0), "A=1": cell("ab", 1.0), "A=2": cell("ab", 2.0)}
    same = machines.Row("pick", "ab", native, {"Haswell": cell("ab", 40.0)})
    other = machines.Row("push", "", native, {"Haswell": cell("cd", 40.0), "Dhyana": cell("", 1.0, "dead")})
    assert (same.one_digest, other.one_digest) == (True, False)
    assert not machines.Row("pick", "cd", native, {}).one_digest
    assert not machines.Row("pick", "", {"A=1": cell("", 1.0, "dead")}, {}).one_digest
    assert machines.to_table([same, other])[2:] == [
        "| pick | yes | 3 of 3 | 1 of 1 | 1.5 | 3.0 | 40.0 |",
        "| push | **no** | 3 of 3 | 0 of 2; not `Haswell`, `Dhyana` | 1.5 | 3.0 | 20.5 |",
    ]


def test_the_section_replaces_itself_in_the_page(machines: ModuleType) -> None:
    old, new = "## One\n\nold\n", "## One\n\nnew\n"
    assert machines.put(new, "# Figures\n\ntext\n") == "# Figures\n\ntext\n\n## One\n\nnew\n"
    assert machines.put(new, f"# Figures\n\n{old}\n## Two\n") == "# Figures\n\n## One\n\nnew\n\n## Two\n"
    assert machines.put(new, f"# Figures\n\n{old}") == "# Figures\n\n## One\n\nnew\n"


@pytest.mark.parametrize(("answer", "right"), [("True", True), ("False", False), ("", False)])
def test_processors_are_those_that_the_emulator_knows(
    machines: ModuleType, tmp_path: Path, answer: str, right: bool
) -> None:
    emulator = tmp_path / "qemu"
    emulator.write_text(EMULATOR.replace("SORTED", answer))
    emulator.chmod(0o755)
    found, skipped = machines.emulated(str(emulator))
    assert [(one.name, one.emulator, one.gathers) for one in found] == [
        ("Haswell", "qemu-x86_64 version 7.2.22", right),
        ("EPYC-Rome", "qemu-x86_64 version 7.2.22", right),
    ]
    assert skipped["Dhyana"] == "qemu-x86_64 version 7.2.22 does not know it"
    assert len(found) + len(skipped) == len(machines.PROCESSORS)


def test_without_an_emulator_all_processors_are_left_out(machines: ModuleType) -> None:
    found, skipped = machines.emulated("no-such-emulator")
    assert found == []
    assert skipped == dict.fromkeys(machines.PROCESSORS, "no-such-emulator is not installed")


def test_a_defective_emulator_runs_numpy_without_gathers(
    machines: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import json, sys\n"
        "from picktree.files import numpy_kernels\n"
        "found = {'name': sys.argv[1], 'digest': numpy_kernels(), 'cpu_seconds': 0}\n"
        "print(json.dumps(found))\n"
    )
    monkeypatch.setattr(machines, "SCRIPT", script)
    assert executed(machines, ["a"])["a"].digest == "X86_V3"
    assert executed(machines, ["a"], gathers=False)["a"].digest == "baseline"
