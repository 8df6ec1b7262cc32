"""Saving between two rounds and going on in another tree, as if nothing had been."""

from __future__ import annotations

import json
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from picktree.files import PicktreeError
from picktree.trees import NodeStatus
from picktree.trees.failure_reports import pack, report_from_plain, report_to_plain, unpack
from picktree.world import FailureReport, Plain, all_causes

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


ROUNDS = "{Repeat: {name: rounds, num_cycles: 3, do: {Scripted: {name: R}}}}"
MISSIONS = {
    "the whole": MISSION,
    "Repeat": f"Main: {ROUNDS}",
    "Sequence": f"Main: {{Sequence: [{{Scripted: {{name: A}}}}, {ROUNDS}]}}",
    "Fallback": f"Main: {{Fallback: [{{Scripted: {{name: A, script: grasp.missed}}}}, {ROUNDS}]}}",
    "Parallel": "Main: {Parallel: {failure_count: 2, success_count: 2, do: [{Scripted: {name: A, script: "
    f"grasp.missed}}}}, {{Scripted: {{name: B}}}}, {ROUNDS}]}}}}",
    "IfThenElse": f"Main: {{IfThenElse: [{{Scripted: {{name: A, script: S}}}}, {ROUNDS}]}}",
    "RunOnce": "Main: {Repeat: {num_cycles: 3, do: {RunOnce: {then_skip: false, do: "
    "{Scripted: {name: A}}}}}}",
    "RunOnce that failed": "Main: {RetryUntilSuccessful: {num_attempts: 3, do: {RunOnce: {then_skip: false, "
    "do: {Scripted: {name: A, script: grasp.missed}}}}}}",
    "RetryUntilSuccessful": "Main: {RetryUntilSuccessful: {num_attempts: 4, do: {Scripted: {name: A, script: "
    "grasp.missed | grasp.slipped | control.timeout}}}}",
    "ForEach": "Main: {ForEach: {in: [1, 2, 3], out: '{n}', do: {Scripted: {name: A}}}}",
    "a reference read at the start": "Main: {Sequence: [{SetBlackboard: {value: 3, output_key: '{n}'}}, "
    "{Repeat: {num_cycles: '{n}', do: {SetBlackboard: {value: 1, output_key: '{n}'}}}}]}",
}  # fmt: skip


def fresh(name: str) -> Run:
    return start(MISSIONS[name], FakeWorld())


@pytest.mark.parametrize("name", MISSIONS)
def test_a_tree_restored_or_edited_into_itself_at_any_quiet_moment_goes_on_tick_for_tick(name: str) -> None:
    ticks = len(fresh(name).to_end())
    quiet = 0
    for tick in range(1, ticks):
        live = fresh(name)
        for _ in range(tick):
            live.tick()
        if not live.tree.quiescent:
            continue
        quiet += 1
        saved: dict[str, Plain] = json.loads(json.dumps(live.tree.save()))
        restored, edited = fresh(name), fresh(name)
        for run in (restored, edited):
            run.world.clock.now = live.world.clock.now
            run.world.trace.extend(live.world.trace)
        restored.tree.restore(saved)
        adoption = edited.tree.adopt(saved)
        assert (adoption.fresh, adoption.gone) == ((), ())
        for run in (restored, edited):
            assert run.tree.save() == live.tree.save()
        assert restored.tree.failure == live.tree.failure
        while live.tree.status is NodeStatus.RUNNING:
            live.tick()
            for run in (restored, edited):
                run.tick()
                assert run.report == live.report
            assert restored.tree.failure == live.tree.failure
        assert restored.trace == edited.trace == live.trace
    assert quiet >= 2


def test_a_tree_is_not_saved_while_a_skill_runs() -> None:
    run = start("Main: {Scripted: {script: R S}}")
    run.tick()
    with pytest.raises(PicktreeError) as caught:
        run.tree.save()
    assert str(caught.value) == "a tree cannot be saved while a skill is running"


def test_a_state_of_another_mission_is_refused() -> None:
    other = start("Main: AlwaysSuccess")
    with pytest.raises(PicktreeError) as caught:
        other.tree.restore(fresh("the whole").tree.save())
    assert str(caught.value) == (
        "the saved state belongs to another mission: 'Main/AlwaysSuccess' is not in both"
    )


whole = st.integers(-(2**63) + 1, 2**63 - 1)
reports = st.recursive(
    st.builds(
        FailureReport,
        st.sampled_from(all_causes()),
        st.text(max_size=9),
        st.dictionaries(
            st.text(max_size=4),
            st.none() | st.booleans() | whole | st.text(max_size=4) | st.lists(st.floats(-9, 9)),
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
def test_a_report_survives_being_saved(report: FailureReport) -> None:
    assert report_from_plain(json.loads(json.dumps(report_to_plain(report)))) == report
    memory = (3, report, ("a", None), [1, [2]], {"b": 2.5})
    assert unpack(cast("Plain", json.loads(json.dumps(pack(memory))))) == memory
