"""Third rule: time is simulated. No wall clock changes what happens, and thinking takes time."""

from __future__ import annotations

import ast
import re
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path

import pytest

from picktree.session import RunRequest, Session
from picktree.world.scene.description import Thinking

from .rooms import ROOT, modules
from .skills.cell import EXAMPLES, Cell, items, sorting

MEASURING = {
    "trees/node.py",
    "robot/control/control_loop.py",
    "world/computing_time.py",
    "session/session.py",
    "logs/recording/recorder.py",
    "logs/mcap/writer.py",
    "session/run_recipe.py",
    "session/mission_edits.py",
    "apps/commissioning/calibration.py",
    "session/live_view.py",
    "session/observer.py",
    "logs/run_index.py",  # the age of a run
    "apps/api/batches.py",
    "analysis/report/report.py",
    "analysis/resim.py",
    "analysis/render/films.py",
    "drivers/external_hardware.py",  # waits for another process
}
"""Who may look at a clock of this machine, to put what it says into the record, a profile or a folder's
name; of a run that is watched, not to look at the mission's files at every tick, to pace it and to wait for
viewers; once a run is over, to say how long a report, a film or a comparison took."""
CLOCKS = {"time", "datetime", "sched", "timeit", "asyncio"}


def digest(folder: Path) -> str:
    request = RunRequest(EXAMPLES / "one_pick.yaml", seed=3, out=folder, backend="kinematic")
    result = Session(request).run()
    assert result.status == "success"
    return result.digest


def test_a_wall_clock_that_jumps_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = digest(tmp_path)
    asked = count()

    def jumping(unit: float) -> Callable[[], float]:
        """Hours forth, minutes back."""
        return lambda: (next(asked) * 7919 % 1000003) * unit

    def refuse(seconds: float) -> None:
        raise AssertionError(f"sleeps {seconds} s")

    with monkeypatch.context() as patch:
        for name in ("time", "perf_counter", "monotonic", "process_time", "thread_time"):
            patch.setattr(time, name, jumping(1.0))
            patch.setattr(time, f"{name}_ns", jumping(1_000_000_000))
        patch.setattr(time, "sleep", refuse)
        assert digest(tmp_path) == expected
    assert next(asked) > 100, "nobody has looked at the patched clocks"


def test_only_those_who_measure_import_a_clock() -> None:
    importing: set[str] = set()
    for path in modules(but=("apps/batch", "apps/cli", "apps/studio")):
        text = path.read_text(encoding="utf-8")
        if not re.search(rf"\b(import|from)\b.*\b({'|'.join(CLOCKS)})\b", text):
            continue
        for node in ast.walk(ast.parse(text)):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names = [node.module or ""]
            if CLOCKS & {name.partition(".")[0] for name in names}:
                importing.add(str(path.relative_to(ROOT)))
    assert importing <= MEASURING


def test_thinking_is_charged_in_whole_ticks() -> None:
    """The same plans and pictures; only what they cost differs. What is planned ahead passes while the arm
    moves, so that not all of it is waited for."""
    spans: list[float] = []
    owed: list[float] = []
    for share in (0.0, 1.0, 100.0):
        scene = items(block=1)
        cost = Thinking(scene.thinking.collision_check * share, scene.thinking.image * share)
        cell = Cell(sorting(), replace(scene, thinking=cost))
        cell.finish()
        assert cell.score().count.sorted == 1
        spans.append(cell.world.clock.now)
        owed.append(cell.world.thinking.total)
    assert owed[0] == 0.0
    assert owed[2] == pytest.approx(100 * owed[1], rel=0.2)
    assert owed[2] > 5.0
    for more in (1, 2):
        assert 0.8 * owed[more] - 0.5 < spans[more] - spans[0] < owed[more] + 0.5


def test_thinking_that_is_free_is_said_in_the_report(tmp_path: Path) -> None:
    scene = tmp_path / "free.yaml"
    scene.write_text(
        "picktree: 1\nkind: scene\nbase: sort_small\nthinking: {collision_check: 0 s, image: 0 s}\n"
    )
    request = RunRequest(
        EXAMPLES / "one_pick.yaml", scene=str(scene), seed=3, out=tmp_path, backend="kinematic"
    )
    result = Session(request).run()
    assert not result.thinking_charged
    assert "(planning and perception took no simulated time)" in result.to_text()
    assert result.to_json()["thinking_charged"] is False
