"""What a run of the tests says of those that it had to leave out."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
TESTS = """\
import pytest

from .needs import Need, needs

LAMP = Need("lamp", False, "buy lamp")


@needs(LAMP)
@pytest.mark.parametrize("number", range(3))
def test_by_mark(number): ...


@pytest.fixture
def oil():
    Need("oil", False, "press olives && fill").require()


def test_by_fixture(oil): ...


@needs(Need("matches", True, ""))
def test_of_what_is_there(): ...


@pytest.mark.skip("too dark")
def test_for_another_reason(): ...
"""


@pytest.mark.parametrize("workers", ["0", "2"])
def test_last_line_says_what_is_missing_and_how_to_have_it(workers: str, tmp_path: Path) -> None:
    tests = tmp_path / "tests"
    tests.mkdir()
    for name in ("conftest.py", "needs.py", "other_process.py", "recorded_runs.py"):
        shutil.copy(HERE / name, tests)
    (tests / "test_night.py").write_text(TESTS, encoding="utf-8")
    options = ["-n", workers, "--durations=3", "--import-mode=importlib", "-p", "no:cacheprovider"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", *options],
        cwd=tmp_path, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    *_, left_out, last = ran.stdout.splitlines()
    assert left_out == (
        "Left out: 3 tests that need lamp (buy lamp), 1 test that needs oil (press olives && fill)"
    )
    assert "1 passed, 5 skipped" in last
