"""Saving between two rounds and going on in another tree, as if nothing had been."""

from __future__ import annotations

import json
from typing import cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from picktree.trees.reports import pack, report_from_plain, report_to_plain, unpack
from picktree.trees.status import NodeStatus
from picktree.world.causes import FailureReport, all_causes
from picktree.world.errors import PicktreeError
from picktree.world.journal import Plain

from .scripted import FakeWorld, Run, start

MISSION = """
Main:
  Sequence:
    - Find: {ids: [red_1, blue_1, red_2], found: "{items}"}
    - RunOnce: {Scripted: {name: once, script: R S}}
    - ForEach:
        in: "{items}"
        out: "{item}"
        on_failure: continue
        do:
          RetryUntilSuccessful:
            num_attempts: 3
            do:
              Sequence:
                - Take: {object: "{item}"}
                - Fallback:
                    - Scripted: {name: A, script: grasp.missed | S | R grasp.slipped | S}
                    - Scripted: {name: B, script: control.timeout | S | grasp.missed | S}
    - Timeout: {msec: 900, do: {Repeat: {num_cycles: 3, do: {Delay: {delay_msec: 100, do: AlwaysSuccess}}}}}
    - RunOnce: {name: second, do: AlwaysSuccess}
    - Switch: {variable: "{item}", cases: {red_2: {Parallel: [AlwaysSuccess, {Scripted: {name: C}}]}}}
"""


def quiet(run: Run) -> bool:
    return run.tree.quiescent and run.tree.status is NodeStatus.RUNNING


def fresh() -> Run:
    return start(MISSION, FakeWorld())


def number_of_ticks() -> int:
    return len(fresh().to_end())


def test_the_mission_has_quiet_moments_between_rounds() -> None:
    run, seen = fresh(), 0
    while run.tick() is NodeStatus.RUNNING:
        seen += quiet(run)
    assert run.tree.status is NodeStatus.SUCCESS
    assert seen >= 5


@pytest.mark.parametrize("tick", range(1, number_of_ticks()))
def test_a_restored_tree_goes_on_tick_for_tick(tick: int) -> None:
    live = fresh()
    for _ in range(tick):
        live.tick()
    if not live.tree.quiescent:
        with pytest.raises(PicktreeError) as caught:
            live.tree.save()
        assert str(caught.value) == "a tree cannot be saved while a skill is running"
        return
    saved: dict[str, Plain] = json.loads(json.dumps(live.tree.save()))
    resumed = fresh()
    resumed.world.clock.now = live.world.clock.now
    resumed.world.trace.extend(live.world.trace)
    resumed.tree.restore(saved)
    assert resumed.tree.save() == live.tree.save()
    assert resumed.tree.failure == live.tree.failure
    while live.tree.status is NodeStatus.RUNNING:
        live.tick()
        resumed.tick()
        assert resumed.report == live.report
    assert resumed.trace == live.trace


def test_a_state_of_another_mission_is_refused() -> None:
    other = start("Main: AlwaysSuccess")
    with pytest.raises(PicktreeError) as caught:
        other.tree.restore(fresh().tree.save())
    assert str(caught.value) == (
        "the saved state belongs to another mission: 'Main/AlwaysSuccess' is not in both"
    )


reports = st.recursive(
    st.builds(
        FailureReport,
        st.sampled_from(all_causes()),
        st.text(max_size=9),
        st.dictionaries(
            st.text(max_size=4),
            st.none() | st.booleans() | st.integers() | st.text(max_size=4) | st.lists(st.floats(-9, 9)),
            max_size=3,
        ),
        st.text(max_size=9),
    ),
    lambda inner: st.builds(
        FailureReport, st.sampled_from(all_causes()), st.text(max_size=3), st.just({}), st.text(max_size=3),
        st.lists(inner, max_size=2).map(tuple),
    ),
    max_leaves=4,
)  # fmt: skip


@given(reports)
@settings(max_examples=50)
def test_a_report_survives_being_saved(report: FailureReport) -> None:
    assert report_from_plain(json.loads(json.dumps(report_to_plain(report)))) == report
    memory = (3, report, ("a", None), [1, [2]], {"b": 2.5})
    assert unpack(cast("Plain", json.loads(json.dumps(pack(memory))))) == memory
