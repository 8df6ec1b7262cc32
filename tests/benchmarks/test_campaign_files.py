"""The campaign's plan and fault files: they check, and each kind of fault is among them."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.apps.batch import load_plan
from picktree.simulation import load_faults
from picktree.simulation.fault_entries import KINDS
from picktree.world.scene import load_scene

CAMPAIGN = Path(__file__).parents[2] / "benchmarks" / "campaign"
FILES = sorted((CAMPAIGN / "faults").glob("*.yaml"))


def test_the_plan_runs_every_fault_file_and_none_with_recovery_and_without() -> None:
    plan = load_plan(CAMPAIGN / "plan.yaml")
    assert plan.faults[0] is None
    assert sorted(path for path in plan.faults if path) == FILES
    assert [mission.stem for mission in plan.missions] == ["sort_tirelessly", "sort_plainly"]
    assert (plan.seeds, plan.backend, plan.keep) == (tuple(range(20)), "physics", "all")


def test_each_kind_of_fault_is_in_the_plan() -> None:
    planted = {fault.fault for path in FILES for fault in load_faults(path).faults}
    assert planted == set(KINDS)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_each_fault_file_says_what_is_expected_and_why(path: Path) -> None:
    file = load_faults(path)
    assert file.expect is not None
    assert 0 <= file.expect.lost <= 1
    comments = [line for line in file.text.splitlines() if line.startswith("# ")]
    assert len(comments) >= 2  # the schema, and why it is as it is


def test_the_scene_is_sort_small_and_has_a_checkpoint_after_each_item() -> None:
    ours, shipped = load_scene(str(CAMPAIGN / "sort_small_kept.yaml")), load_scene("sort_small")
    assert (ours.checkpoint_every, shipped.checkpoint_every) == (1, 1)
    for name in ("fixtures", "bins", "cameras", "catalogue", "spawn", "limits", "robot"):
        assert getattr(ours, name) == getattr(shipped, name)
