"""A run's summary and its log tell the same of what was seen, tried and cured."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from picktree.analysis import Run
from picktree.analysis.explain import explain, to_json_text, to_text
from picktree.logs.episode_counts import CureCount, PlantedCount, added_planted, by_cause
from picktree.logs.item_episodes import Decision
from picktree.logs.run_account import account_of
from picktree.session import RunCounters, tally_of
from picktree.session.run_tally import EpisodeCountersState
from picktree.world import event_types

from ..logs.scripted_log import begins, ends, record, tree
from ..logs.test_episodes import tries

MISSED = CureCount("grasp.missed", "SafeRetreat + Observe", 1, 0, 1, tries=1, seconds=6.65)
LOST = CureCount("world.unknown_object", "Observe", 1, 0, 1, tries=1, seconds=1.55)


def test_the_summary_and_the_log_agree(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        found, result = run.account.recovery, run.result
        later = tally_of(run, run.end)
        later.finish(run.end)
    assert result is not None and result.cures is not None
    assert {(c.cause, c.cure, c.seen, c.given_up, c.tries) for c in result.cures} == {
        (c.cause, c.cure, c.seen, c.given_up, c.tries) for c in (MISSED, LOST)
    }
    assert found.cures == result.cures == later.cures
    assert result.planted == (PlantedCount("remove", "grasp.missed", "given_up", 1),) == later.planted
    assert [each.cause for each in by_cause(result.cures)] == ["grasp.missed", "world.unknown_object"]


def test_outcomes_of_failures_are_recorded_while_the_run_continues(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        decided = [at for at in run.events if isinstance(at.record, event_types.FailureDecidedEvent)]
        assert len(decided) == len(run.failures) > 0
        assert all(at.record.time <= at.time < run.last_tick for at in decided)


@pytest.mark.parametrize("lost", [0.0, 2.0, 5.0, 1000.0])
def test_decisions_that_a_log_lacks_follow_from_its_ticks(troubled_log: Path, lost: float) -> None:
    """Decisions before `lost` (simulated s) are taken out of the log, as damage does."""
    with Run(troubled_log) as run:
        made = [at for at in run.events if isinstance(at.record, Decision)]
        left = [at for at in run.events if at not in made or at.time > lost]
        assert len(made) > len(run.account.failures) > 0
        account = account_of(run.log, left)
        assert account.recovery == run.account.recovery
        assert account.failures == run.account.failures


def test_a_recorded_decision_holds_against_the_ticks(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        (first, *_) = (at for at in run.events if isinstance(at.record, event_types.EpisodeEvent))
        other = replace(first, record=replace(first.record, end="done_instead"))
        account = account_of(run.log, [other if at is first else at for at in run.events])
        ends = [each.end for each in account.recovery.episodes]
        expected = [each.end for each in run.account.recovery.episodes]
    assert ends == ["done_instead", *expected[1:]]


def test_times_within_a_run_add_up_to_what_its_branches_took(troubled_log: Path) -> None:
    """An episode lasts from the start of the run that failed first to the end of the node that gave up."""
    with Run(troubled_log) as run:
        lost = sum(episode.seconds for episode in run.account.recovery.episodes)
        (given_up,) = [v for v in run.visits if v.id == "Recover" and v.outcome == "FAILURE"]
    assert abs(lost - given_up.duration) < 1e-6


def test_a_checkpoint_keeps_what_was_counted(troubled_log: Path) -> None:
    with Run(troubled_log) as run:
        state = tally_of(run, run.end).state()
    states = TypeAdapter(RunCounters)
    text = states.dump_json(state)
    assert RunCounters.resumed(states.validate_json(text)).state() == state
    older = json.loads(text)
    del older["episodes"]
    assert states.validate_python(older).episodes == EpisodeCountersState()


def test_the_story_of_a_failure_says_what_cured_it(tmp_path: Path) -> None:
    nodes = tree("Main", "Main/Recover", "Main/Recover/Grasp", "Main/Recover/LookAgain")
    recover, grasp, look = "Main/Recover", "Main/Recover/Grasp", "Main/Recover/LookAgain"
    script = {
        0: [begins("Main"), begins(recover), begins(grasp, "ball_1")],
        20: [ends(grasp, "FAILURE", "grasp.missed"), tries(recover, "grasp.missed", "grasp.*", grasp)],
        21: [begins(look)],
        40: [ends(look)],
        41: [begins(grasp, "ball_1")],
        60: [ends(grasp), ends(recover), ends("Main")],
    }
    log = record(tmp_path / "log.mcap", nodes, 61, script)
    with Run(log) as run:
        found = explain(run)
        text = to_text(run, found, "LOG")
        told = json.loads(to_json_text(run, found))
    assert (
        "Recover tried LookAgain for grasp.* (SUCCESS after 0.9 s). Cured by LookAgain after 1 try: "
        "Recover continued at 3.00 s; 2.0 s lost."
    ) in " ".join(text.split())
    assert (
        "Recovery (1 episode: 1 cured; 2.0 s lost)\n"
        "  cause         seen  cured  tries   s lost  by\n"
        "  grasp.missed     1      1    1.0      2.0  LookAgain\n"
    ) in text
    (cause,) = told["recovery"]["causes"]
    assert (cause["cause"], cause["seen"], cause["cured"], cause["seconds"]) == ("grasp.missed", 1, 1, 2.05)
    assert told["recovery"]["episodes"][told["failures"][0]["episode"]]["cure"] == "LookAgain"
    assert told["failures"][0]["handled_by"][0]["ran"] == "LookAgain"


def test_planted_faults_are_counted_together() -> None:
    slip = PlantedCount("slip", "grasp.slipped", "cured", 2)
    assert added_planted([slip, slip, PlantedCount("slip", "", "", 1)]) == (
        PlantedCount("slip", "", "", 1),
        PlantedCount("slip", "grasp.slipped", "cured", 4),
    )
