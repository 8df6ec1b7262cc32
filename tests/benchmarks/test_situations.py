"""Drawn situations: their draw, their label by experiment, and the score of an explanation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from picktree.simulation.fault_entries import KINDS

Program = Callable[[str], ModuleType]
GONE: dict[str, Any] = {
    "cause": "item.gone", "title": "red_can_1 was taken away between 5.2 and 5.4 s", "item": "red_can_1",
    "ended_run": True, "reasons": [], "failures": [0], "time": 5.2, "confidence": "likely", "items": [],
}  # fmt: skip


def test_a_draw_depends_on_its_seed_alone(program: Program) -> None:
    drawing = program("_situation_drawing")
    first = [drawing.drawn(seed) for seed in (3, 4, 5)]
    drawing.drawn.cache_clear()
    drawing.drawn_cell.cache_clear()
    assert [drawing.drawn(seed) for seed in (5, 4, 3)] == first[::-1]
    assert first[0].cell == first[2].cell
    assert not set(drawing.DEVELOPMENT) & set(drawing.FINAL)


def test_the_table_has_an_answer_for_each_kind(program: Program) -> None:
    drawing, answers = program("_situation_drawing"), program("_situation_score").answers()
    assert set(drawing.FAULT_WEIGHTS) == set(KINDS)
    assert {*drawing.FAULT_WEIGHTS, *drawing.SCENE_WEIGHTS} <= set(answers)
    cell = drawing.drawn_cell(2)
    mission = {each.kind for each in drawing.mission_changes(drawing.random.Random(1), cell)}
    assert mission
    assert mission <= set(answers)


def test_what_a_fault_did_is_its_label_and_a_harmless_one_has_none(program: Program, tmp_path: Path) -> None:
    drawing, labels = program("_situation_drawing"), program("_situation_labels")
    cell = drawing.Cell("made up", _mission(), _scene(), "panda", "kinematic", 5)
    taken = drawing.Deviation(
        "remove", "fault", {"fault": "remove", "target": {}}, drawing.Occasion(0.2, ("Grasp",), 0.0)
    )
    noise = {"fault": "camera_noise", "factor": 1.1}
    harmless = drawing.Deviation("camera_noise", "fault", noise, drawing.Occasion(0.1))
    situation = drawing.Situation(0, cell, (taken, harmless))
    experiment = labels.Experiment(situation, tmp_path / "situation", tmp_path / "cells")
    label = experiment.label()
    assert (label.status, label.groups, label.excluded) == ("cause", ((0,),), (1,))
    assert experiment.targets()[0] == "goal"
    struck = experiment.strikes()[0]
    assert f"item {struck.item}" in experiment.targets()
    assert "red block" in struck.words
    alone = drawing.Situation(0, cell, (harmless,))
    assert labels.Experiment(alone, tmp_path / "alone", tmp_path / "cells").label().status == "harmless"


def _mission() -> dict[str, Any]:
    steps = [
        {"Observe": {"camera": "overhead", "objects": "{items}"}},
        {"ForEach": {"in": "{items}", "out": "{item}", "on_failure": "continue", "do": [
            {"Grasp": {"object": "{item}"}}, {"Place": {"object": "{item}", "into": "{item.destination}"}}]}},
    ]  # fmt: skip
    trees = {"Main": {"Sequence": steps}}
    return {"picktree": 1, "kind": "mission", "name": "made up", "scene": "scene.yaml", "trees": trees}


def _scene() -> dict[str, Any]:
    area = {"min": [0.4, -0.1], "max": [0.6, 0.1]}
    spawn = [{"of": {"block": 1}, "colours": ["red"], "area": area}]
    return {"picktree": 1, "kind": "scene", "base": "three_bins", "checkpoint_every": 1, "spawn": spawn}


@pytest.mark.parametrize(
    ("counts", "expected"),
    [
        # number of continuations with the outcome, of 3, by the present deviations
        ({"01": 3, "0": 3, "1": 0}, ("cause", (0,))),
        ({"01": 3, "0": 0, "1": 0}, ("cause", (0, 1))),
        ({"01": 3, "0": 3, "1": 3, "": 0}, ("cause", (0, 1))),
        ({"01": 3, "0": 3, "1": 3, "": 3}, ("no cause", ())),
        ({"01": 3, "0": 3, "1": 1, "": 0}, ("undecided", ())),
        ({"01": 1, "0": 1, "1": 0, "": 0}, ("undecided", ())),
        ({"01": 0, "0": 0, "1": 0, "": 0}, ("no cause", ())),
        ({"01": 2, "0": 3, "1": 0}, ("cause", (0,))),
    ],
)
def test_a_cause_is_in_a_smallest_set_that_ends_the_outcome(
    program: Program, counts: Mapping[str, int], expected: tuple[str, tuple[int, ...]]
) -> None:
    runs = {
        frozenset(map(int, present)): [frozenset({"goal"})] * number + [frozenset[str]()] * (3 - number)
        for present, number in counts.items()
    }
    tests = _compared(program, runs)
    assert program("_situation_labels").cause_of(tests, frozenset({0, 1}), "goal") == expected


def _compared(program: Program, runs: Mapping[frozenset[int], Any]) -> dict[frozenset[int], Any]:
    """Return the comparisons by what is taken away, from the outcomes by what is present."""
    comparison, whole = program("_situation_labels").Comparison, frozenset({0, 1})
    return {whole - left: comparison(runs[whole], runs[left]) for left in runs if left != whole}


def test_an_item_that_two_deviations_lose_has_a_set_of_its_own(program: Program) -> None:
    one, both = frozenset({"goal", "item 1"}), frozenset({"goal", "item 1", "item 2"})
    runs = {
        frozenset({0, 1}): [both] * 3,
        frozenset({1}): [one] * 3,
        frozenset({0}): [both] * 3,
        frozenset(): [frozenset()] * 3,
    }
    label = program("_situation_labels").label_of(
        _compared(program, runs), frozenset({0, 1}), ("goal", "item 1", "item 2")
    )
    assert (label.status, label.groups, label.excluded) == ("cause", ((0,), (0, 1)), ())


def _row(
    *kinds: str, status: str = "cause", groups: Sequence[Sequence[int]] = ((0,),), **rest: Any
) -> dict[str, Any]:
    deviations = [{"kind": kind, "where": "fault", "names": {}, "magnitude": None, **rest} for kind in kinds]
    strikes = {str(n): {"at": 5.3, "words": ("item_02", "red can")} for n in range(len(kinds))}
    label = {"status": status, "groups": groups, "target": "goal", "excluded": list(range(len(kinds)))}
    return {"deviations": deviations, "strikes": strikes, "label": label}


def _account(*causes: Mapping[str, Any], failures: int = 1) -> dict[str, Any]:
    return {"causes": list(causes), "failures": failures, "facts": ["failure grasp Grasp red_can"]}


def test_a_right_cause_names_item_and_time(program: Program) -> None:
    verdict = program("_situation_score").verdict_of
    gone = _row("remove")
    assert verdict(gone, _account(GONE)) == "right"
    late = {**GONE, "title": "red_can_1 was taken away between 9.2 and 9.4 s", "time": 9.2}
    assert verdict(gone, _account(late)) == "partly"
    other = {**GONE, "title": "blue_can_1 was taken away", "item": "blue_can_1"}
    assert verdict(gone, _account(other)) == "partly"
    assert verdict(gone, _account({**GONE, "cause": "item.moved"}, GONE)) == "wrong"
    assert verdict(gone, _account()) == "untold"
    assert verdict(gone, _account({**GONE, "confidence": "the log does not tell"})) == "untold"


def test_a_magnitude_is_within_a_third(program: Program) -> None:
    verdict = program("_situation_score").verdict_of
    heavy = _row("heavier", magnitude=1.5)
    said = {**GONE, "cause": "item.heavy", "title": "red_can_1 is heavier than its kind: it weighs 1.20 kg"}
    assert verdict(heavy, _account(said)) == "right"
    assert verdict(heavy, _account({**said, "title": "red_can_1 is heavy: it weighs 900 g"})) == "partly"


def test_all_causes_are_named_and_the_costliest_first(program: Program) -> None:
    verdict = program("_situation_score").verdict_of
    slid = {**GONE, "cause": "item.slippery", "title": "red_can_1 is slippery"}
    apart, joint = (
        _row("remove", "friction", groups=((0,), (1,))),
        _row("remove", "friction", groups=((0, 1),)),
    )
    assert verdict(apart, _account(GONE, slid)) == "right"
    assert verdict(apart, _account(slid, GONE)) == "partly"
    assert verdict(apart, _account(GONE)) == "partly"
    assert verdict(joint, _account(slid)) == "right"


def test_where_nothing_was_caused_nothing_is_blamed(program: Program) -> None:
    verdict = program("_situation_score").verdict_of
    calm = _row("remove", status="harmless", groups=())
    assert verdict(calm, _account(failures=0)) == "silent"
    assert verdict(calm, _account(GONE)) == "blamed"
    excluded = _row("remove", status="no cause", groups=())
    assert verdict(excluded, _account(GONE)) == "blamed"
    assert verdict(excluded, _account({**GONE, "cause": "joint.weak"})) == "unexplained"


def test_the_rates_of_confidence_are_fitted_on_judged_causes(program: Program) -> None:
    situations = program("situations")
    told = GONE | {"doubtful": False}
    row: dict[str, Any] = {
        "label": {"status": "cause", "target": "goal", "groups": [], "excluded": []},
        "account": {"causes": [told], "facts": []}, "verdict": "right",
        "blind_account": {"causes": [told], "facts": []}, "blind_verdict": "wrong",
    }  # fmt: skip
    found = situations.fit([row, row, row | {"verdict": "silent", "blind_verdict": "silent"}])
    module: dict[str, Any] = {}
    exec(situations.fit_module(found), module)
    assert module["FITTED"] == {("item", False, True): (2, 2), ("item", False, False): (0, 2)}
