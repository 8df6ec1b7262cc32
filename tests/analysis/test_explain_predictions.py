"""Predictions of hypotheses, and the confidence that development situations give to causes."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from picktree.analysis.explain import FailureStory, confidence
from picktree.analysis.explain.case import Investigation
from picktree.analysis.explain.device_causes import fingers_press_too_little
from picktree.analysis.explain.explanation import Finding, Spans
from picktree.analysis.explain.predictions import PREDICTIONS, refutations
from picktree.logs.series import GripperSeries, WrenchSeries
from picktree.world import Box
from picktree.world.scene import CatalogueEntry

TIMES = np.asarray(0.05 * np.arange(100), np.float64)
BLOCK = CatalogueEntry("block", "box", Box((0.04, 0.04, 0.04)), 0.2, 0.6)


def pick(time: float, **known: object) -> SimpleNamespace:
    told = {"object": "can_1", "held": True, "first_try": True, "force": 20.0, "load": 2.0, "width": 0.04}
    return SimpleNamespace(time=time, record=SimpleNamespace(**told | known))


def case(*, seen: tuple[float, ...] = (), picks: tuple[SimpleNamespace, ...] = (), **known: Any) -> Any:
    """An investigation of one item, `can_1`, that is truly `item_00`."""

    def events(_: object, start: float = 0.0, end: float = 9.0) -> list[SimpleNamespace]:
        return [at for at in picks if start <= at.time <= end]

    told: dict[str, Any] = {
        "visit": lambda _: SimpleNamespace(start=3.0),
        "identities": SimpleNamespace(
            by_item={"can_1": [SimpleNamespace(time=time, true="item_00") for time in seen]}
        ),
        "believed": {"item_00": ("can_1",)},
        "entry_of": lambda _: BLOCK,
        "events": events,
        "once": lambda _: (),
        "sampled": 0.1,
        "least_width": 0.0,
        "gripper": GripperSeries(TIMES, np.full(100, 0.04), np.full(100, 19.0)),
    }
    return cast("Investigation", SimpleNamespace(**told | known))


SPANS: Spans = ((1.0, 4.0),)


def against(asked: Any, cause: str, about: str, **evidence: object) -> list[str]:
    failure = SimpleNamespace(item="can_1", cause="grasp.missed", evidence=evidence, time=4.0)
    finding = Finding(cause, about, "", item="can_1", time=1.0, spans=SPANS)
    return list(refutations(asked, cast("FailureStory", failure), finding))


def plans(*times: float) -> SimpleNamespace:
    found = SimpleNamespace(outcome="found")
    return SimpleNamespace(plans=[SimpleNamespace(time=time, record=found) for time in times])


def felt(size: float) -> SimpleNamespace:
    return SimpleNamespace(wrenches=WrenchSeries(TIMES, np.full((100, 3), size), np.zeros((100, 3))))


@pytest.mark.parametrize(
    ("cause", "about", "wrong", "words", "right"),
    [
        ("camera.off", "overhead", case(seen=(0.1,)), "can_1 was last seen at 0.10 s, in an "
         "image without this fault", case(seen=(0.1, 2.0))),
        ("camera.noisy", "overhead", case(seen=(2.0,), picks=(pick(2.5),)), "can_1 was gripped at once where "
         "such an image showed it", case(seen=(2.0,), picks=(pick(2.5, held=False),))),
        ("wrist.biased", "wrist", case(run=felt(0.5)), "the sensor mostly read less than 2.5 N between 1.5 "
         "and 4.0 s", case(run=felt(8.0))),
        ("gripper.jammed", "gripper", case(gripper=GripperSeries(TIMES, 0.02 * TIMES, 0 * TIMES)),
         "the fingers moved by 6 mm between 3.7 and 4.0 s", case()),
        ("gripper.weak", "gripper", case(picks=(pick(2.0),)), "the fingers pressed with the commanded force "
         "at 2.00 s", case(picks=(pick(2.0, force=90.0),))),
        ("planner.refuses", "planner", case(run=plans(2.0)), "the planner found 1 other path meanwhile",
         case(run=plans(0.5, 4.5))),
        ("item.heavy", "item_00", case(picks=(pick(2.0),)), "the wrist weighed 0.20 kg at 2.00 s",
         case(picks=(pick(2.0, load=6.0),))),
        ("item.gone", "item_00", case(seen=(2.0,)), "it was seen at 2.00 s", case(seen=(0.5,))),
        ("perception.phantom", "can_1", case(picks=(pick(2.0),)), "the hand held it at 2.00 s", case()),
    ],
)  # fmt: skip
def test_a_record_against_a_prediction_is_evidence_against_its_cause(
    cause: str, about: str, wrong: Any, words: str, right: Any
) -> None:
    assert against(wrong, cause, about) == [words]
    assert against(right, cause, about) == []


def test_each_prediction_is_about_a_documented_cause() -> None:
    page = (Path(__file__).parents[2] / "docs/explain.md").read_text()
    assert [cause for causes, _ in PREDICTIONS for cause in causes if f"`{cause}`" not in page] == []


def test_an_item_between_the_fingers_is_not_gone() -> None:
    assert "the fingers closed on something 20 mm wide" in against(case(), "item.gone", "item_00", width=0.02)


def test_fingers_whose_force_no_log_has_are_not_weak() -> None:
    silent = GripperSeries(TIMES, np.full(100, 0.04), np.zeros(100))
    assert list(fingers_press_too_little(case(picks=(pick(2.0),), gripper=silent))) == []
    weak = GripperSeries(TIMES, np.full(100, 0.04), np.full(100, 2.0))
    (found,) = fingers_press_too_little(case(picks=(pick(2.0),), gripper=weak))
    assert found.title == "the gripper presses with 10 % of the commanded force"


@pytest.mark.parametrize(
    ("cause", "doubtful", "rate", "word"),
    [
        ("camera.off", False, 0.95, "likely"),
        ("item.moved", False, 0.8, "possible"),
        ("contact.item", False, None, "possible"),  # no case of its kind
        ("camera.off", True, None, "possible"),  # too few
    ],
)
def test_a_cause_is_likely_where_such_causes_were_right(
    monkeypatch: pytest.MonkeyPatch, cause: str, doubtful: bool, rate: float | None, word: str
) -> None:
    counts: dict[tuple[str, bool, bool], tuple[int, int]] = {
        ("device", False, True): (19, 20), ("item", False, True): (16, 20), ("device", True, True): (1, 4),
        ("item", False, False): (0, 9),
    }  # fmt: skip
    monkeypatch.setattr(confidence, "FITTED", counts)
    found = confidence.fitted_rate(cause, doubtful=doubtful, truth=True)
    assert found == (None if rate is None else pytest.approx(rate))
    assert confidence.stated(found) == word
