"""Runs and a page that several tests of this folder look at; do not change files."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.analysis import Run
from picktree.analysis.report import write_report
from picktree.logs.log_files import Rotation
from picktree.session import ResumeRequest, Resumption, RunRequest, Session
from picktree.session.mission_edits import MissionReload

from ..session.test_watch import LOGGED, MISSION, Editor

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="session")
def report(troubled_log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the run in which the second item is snatched away."""
    file = tmp_path_factory.mktemp("report") / "report.html"
    with Run(troubled_log) as run:
        write_report(run, file)
    return file


@pytest.fixture(scope="session")
def in_parts(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The folder of a run with a log in two files, and that of the run that goes on with it."""
    out = tmp_path_factory.mktemp("parts")
    request = RunRequest(
        EXAMPLES / "sort_by_colour.yaml",
        backend="kinematic",
        out=out,
        limit=13.0,
        rotation=Rotation(seconds=9.0),
    )
    folder = Session(request).run().folder
    with Resumption(ResumeRequest(folder, out=out / "resumed", limit=16.0)) as resumption:
        return folder, resumption.session().run().folder


@pytest.fixture(scope="session")
def edited(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run whose mission was edited while it ran."""
    out = tmp_path_factory.mktemp("edited")
    (out / "mission.yaml").write_text(MISSION, encoding="utf-8")
    editor = Editor(out, {0.3: {"mission.yaml": LOGGED}})
    request = RunRequest(out / "mission.yaml", backend="kinematic", out=out)
    session = Session(request, observers=[MissionReload(editor)])
    editor.clock = lambda: session.execution.world.clock.now
    return session.run().folder
