"""Whatever passes the check can be rehearsed: random missions under random cases, without a fault of ours."""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

from picktree.authoring.rehearsal import Rehearsal, rehearse, to_json
from picktree.authoring.rehearsal.case_checks import examine_cases
from picktree.authoring.rehearsal.rehearsal import to_text
from picktree.files.yaml import read_document
from picktree.trees.loading import examine

from .wild_leaves import registry
from .wild_missions import wild_mission

Data: TypeAlias = dict[str, Any]
MISSIONS = 80
ANSWERS: dict[str, Sequence[str]] = {
    "Do": ("RUNNING", "grasp.missed", "grasp.slipped", "control.timeout", "world.unknown_object"),
    "Stop": ("SUCCESS", "safety.stop"),
    "Hold": ("SUCCESS", "RUNNING", "grasp.missed"),
    "Drop": ("SUCCESS", "control.timeout"),
    "Ask": ("SUCCESS", "FAILURE"),
    "Whim": ("SUCCESS", "FAILURE", "SKIPPED", "RUNNING"),
}
EFFECTS: Sequence[Data] = (
    {"hand": "empty"}, {"hand": "o1"}, {"objects": {"o2": None}}, {"facts": {"holding": True}},
    {"objects": {"o1": {"place": "hand"}}}, {"objects": {"o3": {}}, "facts": {"holding": None}},
)  # fmt: skip


def random_cases(mission: str, chance: random.Random) -> str:
    """Return a file with one case for the mission."""

    def answer(leaf: str) -> Data | str:
        if chance.random() < 0.5:
            return chance.choice(ANSWERS[leaf])
        found: Data = {} if leaf == "Ask" else {"ticks": chance.randint(0, 3)}
        if leaf == "Do":
            found["outputs"] = {"out": chance.randint(0, 2)}
        if chance.random() < 0.3:
            found["then"] = chance.choice(EFFECTS)
        return found

    objects: Data = {"o1": {"colour": "red", "destination": "x_bin"}, "o2": {}}
    case: Data = {
        "objects": {name: entry for name, entry in objects.items() if chance.random() < 0.8},
        "leaves": {
            leaf: [answer(leaf) for _ in range(chance.randint(1, 3))]
            for leaf in ANSWERS
            if f'"{leaf}"' in mission and (leaf == "Do" or chance.random() < 0.7)
        },
        "expect": {"ticks": chance.randint(5, 40)},
    }
    if chance.random() < 0.2:
        case["halt_after"] = chance.randint(1, 5)
    return json.dumps({"picktree": 1, "kind": "cases", "cases": {"it": case}})


def played(seed: int) -> Rehearsal | str:
    """One mission with its case; a code when the loader refuses the mission."""
    text = wild_mission(seed).replace('"Muddle"', '"Fallback"')  # it throws dice, which a rehearsal has not
    reading = examine(read_document(Path("mission.yaml"), "mission", text), registry())
    if reading.faults:
        return reading.faults[0].code
    cases = random_cases(text, random.Random(seed))
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


def test_a_checked_mission_never_breaks_in_a_rehearsal() -> None:
    ends: Counter[str] = Counter()
    for seed in range(MISSIONS):
        rehearsal = played(seed)
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
        rehearsal = played(seed)
        return rehearsal if isinstance(rehearsal, str) else json.dumps(to_json(rehearsal))

    assert [told(seed) for seed in range(15)] == [told(seed) for seed in range(15)]
