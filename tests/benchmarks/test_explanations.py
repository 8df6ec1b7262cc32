"""Scores of explanations, and the table of cases behind them."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from picktree.simulation import load_faults
from picktree.simulation.fault_entries import KINDS
from picktree.trees.loading import load_mission
from picktree.world.scene import load_scene

Program = Callable[[str], ModuleType]


def case(program: Program, *expect: Any, **rest: Any) -> Any:
    return program("_explanation_cases").Case("made_up", 10, tuple(expect), "why", "", "", **rest)


def told(*causes: tuple[str, str], status: str = "incomplete", **rest: Any) -> dict[str, Any]:
    named: list[dict[str, Any]] = [
        {"cause": cause, "title": title, "item": "", "reasons": [], "confidence": "", "ended_run": True}
        for cause, title in causes
    ]
    struck = [{"id": "item_02", "kind": "can", "colour": "red"}]
    row: dict[str, Any] = {"status": status, "failures": 1, "struck": struck, "causes": named}
    return row | rest


def test_the_cause_that_is_named_first_is_scored(program: Program) -> None:
    cause = program("_explanation_cases").Cause
    gone = case(program, cause(("item.gone", "item.t*"), ("grasp.missed",), ("<item>", "hand|fingers")))
    right, other = ("item.gone", "red_can_1 was taken out of the hand"), ("item.moved", "it had moved")
    assert gone.judge(told(right, other)) == "right"
    assert gone.judge(told(("item.taken", "item_02 left the fingers"))) == "right"
    assert gone.judge(told(("item.gone", "red_ball_1 was taken out of the hand"))) == "partly"
    assert gone.judge(told(("item.gone", "red_can_1 was taken away"))) == "partly"
    assert gone.judge(told(("grasp.missed", "the hand missed it"))) == "partly"
    assert gone.judge(told(other, right)) == "wrong"
    assert gone.judge(told()) == "does not tell"


def test_who_says_that_the_log_does_not_tell_is_not_wrong(program: Program) -> None:
    gone = case(program, program("_explanation_cases").Cause(("item.gone",)))
    unsure = told(("item.moved", "it may have moved"))
    unsure["causes"][0]["confidence"] = "the log does not tell"
    assert gone.judge(unsure) == "does not tell"
    repeating = told(("grasp.missed", "Grasp failed"))
    repeating["causes"][0]["reasons"] = ["nothing else in the log shows the cause"]
    assert gone.judge(repeating) == "does not tell"
    repeating["causes"][0]["cause"] = "item.gone"
    assert gone.judge(repeating) == "right"


def test_two_causes_are_named_both_and_the_costlier_first(program: Program) -> None:
    cause = program("_explanation_cases").Cause
    colour, slip = cause(("perception.mistaken",)), cause(("item.slipped",))
    seen, slid = ("perception.mistaken", ""), ("item.slipped", "")
    both, either = case(program, colour, slip), case(program, colour, slip, either=True)
    verdicts = [one.judge(told(*named)) for one in (both, either) for named in ((seen, slid), (slid, seen))]
    assert verdicts == ["right", "partly", "right", "right"]
    assert [one.judge(told(seen)) for one in (both, either)] == ["partly", "partly"]
    assert both.judge(told(("item.moved", ""), seen)) == "wrong"


def test_where_nothing_went_wrong_nothing_is_to_be_blamed(program: Program) -> None:
    cause = program("_explanation_cases").Cause
    harmless, gone = case(program, cause(("none",))), case(program, cause(("item.gone",)))
    slid = told(("item.slipped", ""), status="success")
    assert harmless.judge(slid) == "wrong"
    slid["causes"][0]["ended_run"] = False
    assert harmless.judge(slid) == "right"
    assert harmless.judge(told()) == "right"
    assert gone.judge(told(status="success", failures=0)) == "nothing happened"
    assert gone.judge(told(("item.moved", ""), status="success", failures=0)) == "wrong"


def test_an_expectation_that_was_false_is_left_out_with_its_reason(program: Program) -> None:
    cases = {
        "made_up": case(program, program("_explanation_cases").Cause(("item.gone",)), corrected={12: "no"})
    }
    row = told(("item.moved", "")) | {"job": {"case": "made_up"}}
    judged = [program("explanations").judged(row | {"seed": seed}, cases) for seed in (10, 12)]
    assert [(each["verdict"], each["corrected"]) for each in judged] == [("wrong", ""), ("corrected", "no")]
    text = program("explanations").report([each | {"quoted": 1} for each in judged])
    assert "2 runs of 1 cases, 1 scored" in text
    assert "left out: corrected 1" in text
    assert "  item.gone  item.moved (wrong) 1" in text


def test_a_confidence_is_held_against_the_rate_that_is_documented(program: Program) -> None:
    def stated(word: str, right: int, wrong: int) -> list[dict[str, Any]]:
        return [
            {"causes": [{"confidence": word}], "verdict": verdict}
            for verdict, number in (("right", right), ("wrong", wrong))
            for _ in range(number)
        ]

    rows = [*stated("likely", 93, 7), *stated("possible", 10, 0), *stated("the log does not tell", 0, 3)]
    likely, possible, untold = program("explanations").calibration(rows)
    assert "93 of 100" in likely
    assert "95 % interval 86.3 … 96.6 %; documented at least 92 %: holds" in likely
    assert "documented" not in possible
    assert "0 of 3" in untold
    assert "documented" not in untold
    assert "does NOT hold" in program("explanations").calibration(stated("likely", 91, 9))[0]
    assert program("explanations").calibration([])[0].lstrip().startswith("likely")


def test_a_log_is_explained_again_and_not_run_again(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    benchmark = program("explanations")
    (job,) = benchmark.wanted(argparse.Namespace(only=["too_wide"], first=0, runs=1, final=False))
    first = benchmark.one(job, tmp_path / "logs" / "a")
    monkeypatch.delattr(benchmark, "_run")
    again = benchmark.one(replace(job, explains="other"), tmp_path / "logs" / "b")
    assert first["causes"] == again["causes"]
    assert first["causes"][0]["cause"] == "item.too_wide"
    with pytest.raises(NameError):
        benchmark.one(replace(job, table="other"), tmp_path / "logs" / "c")


def test_the_seeds_for_the_end_are_others(program: Program) -> None:
    given = argparse.Namespace(only=[], first=0, runs=5, final=False)
    seeds = {job.seed for job in program("explanations").wanted(given)}
    given.final = True
    last = [job.seed for job in program("explanations").wanted(given)]
    assert len(last) == len(set(last)) == len(seeds) == 5 * len(program("_explanation_cases").load())
    assert not seeds & set(last)


def test_the_table_has_each_fault_and_many_cases_without(program: Program) -> None:
    cases = program("_explanation_cases").load()
    planted = {fault["fault"] for case in cases for fault in case.faults}
    assert planted == set(KINDS)
    assert len(cases) >= 60
    assert sum(not case.faults for case in cases) >= 25
    assert sum(len(case.faults) == 2 for case in cases) >= 6
    assert all(case.why for case in cases)


def test_the_files_of_all_cases_are_read(program: Program, tmp_path: Path) -> None:
    for each in program("_explanation_cases").load():
        folder = tmp_path / each.name
        each.write(folder)
        load_mission(folder / "mission.yaml")
        scene = load_scene("scene.yaml", folder)
        if each.faults:
            load_faults(folder / "faults.yaml")
        assert scene.bins, each.name


def test_seeds_that_overlap_are_refused(program: Program, tmp_path: Path) -> None:
    row = "{seeds: %d, mission: x, scene: y, why: z, expect: [{causes: [none]}]}"
    table = tmp_path / "table.yaml"
    table.write_text(f"missions: {{}}\nscenes: {{}}\ncases:\n  a: {row % 10}\n  b: {row % 19}\n")
    with pytest.raises(ValueError, match="seeds of two cases are less than 10 apart: 10"):
        program("_explanation_cases").load(table)
