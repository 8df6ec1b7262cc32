"""Whatever passes the check can be rehearsed: random missions under random cases, without a fault of ours."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest

from picktree.authoring.rehearsal import Rehearsal, rehearse, to_json
from picktree.authoring.rehearsal.case_checks import examine_cases
from picktree.authoring.rehearsal.rehearsal import to_text
from picktree.files.yaml import read_document
from picktree.trees.loading import examine

from ..trees.random_missions import LEAVES, Author
from ..trees.rehearsing import NODES, nodes

REGISTRY = nodes()
MISSIONS = 20
"""Of each seed."""


def played(author: Author) -> Rehearsal | str:
    """One mission with its case; a code when the loader refuses the mission."""
    text = author.mission()
    reading = examine(read_document(Path("mission.yaml"), "mission", text), REGISTRY)
    if reading.faults:
        return reading.faults[0].code
    cases = author.cases(text)
    found = examine_cases(read_document(Path("cases.yaml"), "cases", cases), reading.mission)
    # A tree that is never called has leaves for which nobody answers; nothing else may be wrong.
    assert {fault.code for fault in found.errors} <= {"P703"}, f"{text}\n{cases}\n{found.errors}"
    if found.errors:
        return found.errors[0].code
    rehearsal = rehearse(reading.mission, found.cases)
    (it,) = rehearsal.cases
    faults = [str(one) for one in it.differences if "a fault of the program" in str(one)]
    assert (it.cause != "internal.error", faults) == (True, []), f"{text}\n{cases}\n{it.message}"
    return rehearsal


@pytest.mark.parametrize("seed", range(4))
def test_a_checked_mission_never_breaks_in_a_rehearsal(seed: int) -> None:
    author = Author(seed)
    ends: Counter[str] = Counter()
    for _ in range(MISSIONS):
        rehearsal = played(author)
        if isinstance(rehearsal, str):
            ends[rehearsal] += 1
            continue
        (it,) = rehearsal.cases
        ends[it.status] += 1
        assert 1 <= it.ticks <= 40
        assert all(run.last is not None or run.outcome == "RUNNING" for run in it.runs)
        assert to_text(rehearsal).splitlines()[-1].startswith("mission: ")
        assert to_json(rehearsal)["cases"][0]["ticks"] == it.ticks
    # The samples are worth something: most are rehearsed, and they end in every way.
    assert sum(ends[status] for status in ("SUCCESS", "FAILURE", "RUNNING")) > MISSIONS / 2, ends
    assert min(ends[status] for status in ("SUCCESS", "FAILURE")) > 0, ends


def test_a_rehearsal_is_the_same_each_time() -> None:
    def told(seed: int) -> str:
        rehearsal = played(Author(seed))
        return rehearsal if isinstance(rehearsal, str) else json.dumps(to_json(rehearsal))

    assert [told(seed) for seed in range(15)] == [told(seed) for seed in range(15)]


def test_every_leaf_of_these_has_answers() -> None:
    assert {one.__name__ for one in NODES} - {"Peek"} == set(LEAVES)
