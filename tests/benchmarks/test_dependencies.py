"""Files that runs depend on: a change of one of them makes results old, and no other change does."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def dependencies(program: Callable[[str], ModuleType]) -> ModuleType:
    return program("_dependencies")


def loaded(*paths: str) -> dict[str, object]:
    return {path: SimpleNamespace(__file__=str(ROOT / path)) for path in paths}


def test_files_that_are_read_count_and_written_or_foreign_ones_do_not(
    dependencies: ModuleType, tmp_path: Path
) -> None:
    (tmp_path / "foreign").touch()
    with dependencies.opened() as files:
        (ROOT / "examples" / "one_pick.yaml").read_text()
        (ROOT / "benchmarks" / "evidence.json").read_text()
        (tmp_path / "foreign").read_text()
        with (tmp_path / "written").open("w"):
            pass
    (ROOT / "examples" / "jog.yaml").read_text()
    assert dependencies.used(files, {}) == ["examples/one_pick.yaml"]
    assert not any("written" in file for file in files)


def test_files_that_are_read_for_their_digests_do_not_count(dependencies: ModuleType) -> None:
    dependencies.contents.cache_clear()
    with dependencies.opened() as files:
        dependencies.used((), loaded("skills/push.py"))
    assert dependencies.used(files, {}) == []


def test_what_workers_load_for_others_counts_only_where_the_benchmark_imports_it(
    dependencies: ModuleType,
) -> None:
    everywhere = ("skills/push.py", "analysis/run.py", "apps/batch/executor.py", "benchmarks/_campaign.py")
    assert dependencies.used((), loaded(*everywhere, "benchmarks/sorting.py")) == [
        "benchmarks/sorting.py",
        "skills/push.py",
    ]
    assert "analysis/run.py" in dependencies.used((), loaded(*everywhere, "benchmarks/fault_campaign.py"))


def test_a_run_that_starts_a_command_depends_on_all_that_commands_run(dependencies: ModuleType) -> None:
    with dependencies.opened() as files:
        subprocess.run([sys.executable, "-c", "", "picktree"], check=True)
    found = dependencies.used(files, {})
    assert {"skills/push.py", "world/scenes/dense.yaml"} <= set(found)
    assert not any(path.startswith(("studio/", "docs/")) for path in found)


def test_a_program_depends_on_its_helpers_and_on_no_page_of_figures(dependencies: ModuleType) -> None:
    found = dependencies.of_program(ROOT / "benchmarks" / "fault_campaign.py")
    assert {"benchmarks/fault_campaign.py", "benchmarks/_fault_table.py", "analysis/run.py"} <= set(found)
    assert "apps/cli/run.py" in found
    assert "apps/cli/attach.py" not in found
    assert not {"benchmarks/_evidence.py", "benchmarks/_soaking.py", "benchmarks/_insertion_cell.py"} & set(
        found
    )
    assert not any(path.startswith(("studio/", "docs/")) for path in found)


def test_a_digest_holds_until_one_of_its_files_changes(dependencies: ModuleType, tmp_path: Path) -> None:
    own, other = tmp_path / "own.py", tmp_path / "other.py"
    own.write_text("a = 1\n")
    other.write_text("b = 1\n")
    kept = dependencies.Dependencies(tmp_path)
    code = kept.add([str(own)])
    other.write_text("b = 2\n")
    kept = dependencies.Dependencies(tmp_path)
    assert kept.hold(code)
    assert kept.files == [str(own)]
    own.write_text('"""A module."""\na = 1  # one\n')
    assert kept.hold(code)
    own.write_text("a = 2\n")
    assert not kept.hold(code)
    assert kept.changed
    assert kept.files == []
    assert not kept.hold("unknown")
