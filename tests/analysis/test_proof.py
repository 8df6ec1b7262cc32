"""Root causes are proven or refuted by continuations with and without them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from picktree.analysis import Run, prove
from picktree.analysis.explain import RootCause
from picktree.apps.cli import answer

from ..logs.rewriting import Content
from .test_explain_roots import BLOCK, MISSION, run
from .test_explain_without_truth import HIDDEN_EVENTS

BOUND = 6.0
"""Simulated s after the cause."""


@pytest.fixture(scope="module")
def emptied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run in which the only item is taken out of its bin, after it was placed."""
    fault = "{fault: remove, when: {at: 5 s}, target: {index: 0}}"
    mission = f"{MISSION}      - Sleep: {{msec: 4 s}}\n"
    return run(tmp_path_factory.mktemp("emptied"), items=BLOCK, mission=mission, fault=fault)


def without_faults_events(log: Path, out: Path) -> Path:
    content = Content.of(log)
    kept = [
        sent
        for sent in content.messages
        if sent.topic != "/events" or json.loads(sent.data)["kind"] not in HIDDEN_EVENTS
    ]
    return replace(content, messages=kept).write(out)


def words(found: dict[str, Any]) -> dict[str, Any]:
    """Return the proof without its costs and the name of its log."""
    trials = [{k: v for k, v in each.items() if k != "cpu_seconds"} for each in found["with"]]
    rest = {k: v for k, v in found.items() if k not in ("cpu_seconds", "log", "without", "with")}
    return {**rest, "with": trials}


def test_the_cause_is_proven_and_no_event_of_a_fault_is_read(emptied: Path, tmp_path: Path) -> None:
    costs: list[str] = []
    proof = prove(emptied, bound=BOUND, forecast=lambda each: costs.append(each.to_text()))
    assert (proof.verdict, proof.sentence) == ("proven", "without it blue_block_1 is sorted")
    assert [len(trials) for trials in (proof.with_cause, proof.without)] == [2, 3]
    assert "blue_block_1 is not where it belongs: 2 of 2 with the cause, 0 of 3 without" in proof.to_text()
    assert "without it  blue_block_1 is not taken away\n" in proof.to_text()
    assert costs[0].startswith("up to 6 continuations, ")
    assert max(trial.end for trial in proof.with_cause) <= proof.bound + 5.0
    with Run(emptied) as log:
        assert any(at.record.kind == "fault" for at in log.events)
        bare = without_faults_events(log.path, tmp_path / "log.mcap")
    assert words(prove(bare, bound=BOUND).to_json()) == words(proof.to_json())


def test_a_device_that_works_is_refuted(emptied: Path) -> None:
    other = RootCause(
        "gripper.weak",
        "the gripper is weak",
        (),
        ended_run=True,
        reasons=(),
        time=4.9,
        items=("blue_block_1",),
    )
    proof = prove(emptied, cause=other, bound=2.0)
    assert (proof.verdict, len(proof.without)) == ("refuted", 2)
    assert proof.sentence == "without it the same happens: blue_block_1 is not where it belongs"


def test_without_a_known_removal_an_experiment_is_named(
    emptied: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    crowded = RootCause("bin.crowded", "the bin is crowded", (), ended_run=True, reasons=(), about="blue_bin")
    proof = prove(emptied, cause=crowded)
    assert proof.verdict == "not decided"
    assert proof.sentence == (
        "no way to take it away is known. A person could empty or move the bin in a copy of the scene, and "
        "run `picktree resim LOG --scene FILE`"
    )
    assert answer(["explain", str(emptied), "--prove", "--cause", "joint.weak"]) == 2
    told = capfd.readouterr().err
    assert "--cause joint.weak: the run has no such root cause; it has 1 item.gone" in told
