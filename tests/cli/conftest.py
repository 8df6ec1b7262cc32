"""A result to be shown, and a session that needs no simulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from picktree.logs import PickCount, RunResult, WallSeconds
from picktree.logs.episode_counts import CureCount, PlantedCount
from picktree.world import FormCount, ItemCount

RESULT = RunResult(
    status="success",
    seed=7,
    digest="0123456789abcdef" * 4,
    items=ItemCount(4, 2, 1, 1, {"sphere": FormCount(1, 0), "box": FormCount(3, 2)}),
    picks=PickCount(tried=5, held=4, objects=4, held_first_try=3),
    sim_seconds=20.05,
    cpu_seconds=2.34567,
    wall_seconds=WallSeconds(2.5, 1.25, 0.5, 0.3, 0.2),
    log=Path("/runs/a run/log.mcap"),
    folder=Path("/runs/a run"),
    failures={"grasp.missed": 2, "control.tracking": 1},
    recoveries={"grasp.missed": 2},
    cures=(
        CureCount("control.tracking", "", 1, unhandled=1, seconds=0.04),
        CureCount("grasp.missed", "RetreatAndLook", 2, 1, 1, tries=3, tries_cured=2, seconds=9.5),
    ),
    planted=(PlantedCount("slip", "grasp.missed", "cured", 1), PlantedCount("jam", "", "", 1)),
)


@pytest.fixture
def result() -> RunResult:
    return RESULT


@dataclass
class Stage:
    """What the command asked of the session, and what the session does."""

    requests: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    observers: list[list[str]] = field(default_factory=list[list[str]])
    act: Callable[[], RunResult] = lambda: RESULT


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Stage:
    """`picktree run` meets this instead of a session."""
    stage = Stage()

    class Session:
        def __init__(
            self, request: dict[str, Any], observers: Sequence[object] = (), planning_worker: bool = False
        ) -> None:
            stage.requests.append(request)
            stage.observers.append([type(each).__name__ for each in observers])

        def run(self) -> RunResult:
            return stage.act()

    monkeypatch.setattr("picktree.session.Session", Session)
    monkeypatch.setattr("picktree.session.RunRequest", dict)
    return stage
