"""Recorded runs and a browser, which tests of several rooms share. Each is made on first use."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from picktree.logs import RunResult

    from .browser import Chromium

TESTS = Path(__file__).parent
EXAMPLES = TESTS.parent / "examples"


@pytest.fixture(scope="session")
def sample() -> ModuleType:
    """The made-up run of `sample.py`: `record(path)`, `told(path)` and their parts."""
    spec = importlib.util.spec_from_file_location("logs_sample", TESTS / "logs" / "sample.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def log_path(sample: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished log; do not change the file."""
    path = tmp_path_factory.mktemp("logs") / "log.mcap"
    sample.record(path)
    return path


@pytest.fixture(scope="session")
def picked(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """Result of a run of `one_pick` without physics; do not change its files."""
    out = tmp_path_factory.mktemp("picked")

    from picktree.session import RunRequest, Session

    mission = EXAMPLES / "one_pick.yaml"
    return Session(RunRequest(mission, backend="kinematic", out=out)).run()


TROUBLE = """\
picktree: 1
kind: faults
faults:
  - {fault: remove, when: {node: Grasp, start: 2}, target: {nearest_to: object}}
"""


@pytest.fixture(scope="session")
def troubled_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a run without physics in which the second item is snatched away; do not change the file."""

    from picktree.session import RunRequest, Session

    out = tmp_path_factory.mktemp("troubled")
    (out / "faults.yaml").write_text(TROUBLE, encoding="utf-8")
    request = RunRequest(
        mission=EXAMPLES / "sort_by_colour.yaml",
        scene="sort_small",
        backend="kinematic",
        faults=out / "faults.yaml",
        out=out,
    )
    return Session(request).run().folder / "log.mcap"


@pytest.fixture(scope="session")
def chromium() -> Iterator[Chromium]:
    """Browser for tests that need CHROMIUM."""
    from .browser import Chromium

    browser = Chromium()
    yield browser
    browser.close()


def pick_from_a_tote(folder: Path) -> Path:
    """Write a mission that picks once from a tote with three things, and its scene; return the mission."""
    (folder / "scene.yaml").write_text(
        "picktree: 1\nkind: scene\nbase: tote\n"
        "spawn: [{of: {assortment: 3}, colours: [red, blue], into: tote, drop: heap}]\n"
    )
    mission = folder / "pick.yaml"
    mission.write_text(
        "picktree: 1\nkind: mission\nname: pick\nscene: scene.yaml\ntrees:\n  Main:\n"
        '    PickAny: {from: tote, out: "{thing}"}\n'
    )
    return mission
