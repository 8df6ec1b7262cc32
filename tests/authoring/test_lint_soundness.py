"""The analysis against reality: random missions over the whole vocabulary, whose leaves do as they like.

Whatever node ends, in whatever way, with whatever keys written and whatever in the hand: the analysis has
allowed it. A campaign of more of them is `benchmarks/linting.py`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import pytest

from picktree.trees import NEXT, ChildFlow, Node
from picktree.trees.control_flow import FAILURE, SUCCESS
from picktree.trees.control_nodes import Fallback
from picktree.trees.decorators import ForceSuccess

from .watched import Watched
from .wild_missions import wild_mission

BATCH = 20


@pytest.mark.parametrize("first", range(0, 40, BATCH))
def test_nothing_happens_that_the_analysis_rules_out(first: int) -> None:
    assert unsound(range(first, first + BATCH)) == {}


def unsound(seeds: Iterable[int]) -> dict[tuple[int, int], str]:
    """What happened that the analysis had ruled out, by mission and run."""
    watched = ((seed, Watched(wild_mission(seed))) for seed in seeds)
    runs = {(seed, run): mission.run(run) for seed, mission in watched for run in range(3)}
    return {key: run.unsound for key, run in runs.items() if run.unsound}


MISSION = """
picktree: 1
kind: mission
trees:
  Main:
    Fallback:
      - ForceSuccess: {Do: {}}
      - Log: {message: never}
"""


def test_a_mission_that_does_as_it_is_told_passes_the_watch() -> None:
    assert [Watched(MISSION).run(run).unsound for run in range(5)] == [""] * 5


@pytest.mark.parametrize(
    ("node", "wrong"),
    [(ForceSuccess, ChildFlow(success=FAILURE)), (Fallback, ChildFlow(failure=SUCCESS, skipped=NEXT))],
)
def test_the_watch_sees_wrong_data(
    monkeypatch: pytest.MonkeyPatch, node: type[Node], wrong: ChildFlow
) -> None:
    monkeypatch.setattr(node, "declaration", replace(node.declaration, flow=wrong))
    assert any(unsound((seed,)) for seed in range(4 * BATCH))
