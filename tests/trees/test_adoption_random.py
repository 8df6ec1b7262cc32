"""Whatever mission is edited into whatever other, at any quiet moment: it goes on without a fault."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any, TypeAlias, cast

from picktree.files.yaml import read_document
from picktree.trees import Mission, NodeStatus
from picktree.trees.loading import examine

from ..authoring.wild_leaves import WildWorld, registry
from ..authoring.wild_missions import wild_mission
from .scripted import Run, run_of

Data: TypeAlias = dict[str, Any]
EDITS = 15
"""Missions that are edited while they run, and go on."""
TICKS = 60
"""After an edit; a loop may have no end."""
ALIKE = ("Sequence", "SequenceWithMemory", "Fallback", "ReactiveSequence", "RoundRobin", "Parallel")


def lists(value: object) -> Iterator[list[Data]]:
    """All lists of nodes in a mission's data."""
    match value:
        case dict():
            for part in cast("Data", value).values():
                yield from lists(part)
        case list() if value and all(isinstance(item, dict | str) for item in cast("list[object]", value)):
            yield cast("list[Data]", value)
            for item in cast("list[Data]", value):
                yield from lists(item)
        case _:
            pass


def nodes_of(value: object) -> Iterator[Data]:
    """All mappings of one ID to its ports."""
    if isinstance(value, dict):
        data = cast("Data", value)
        if len(data) == 1 and next(iter(data))[:1].isupper():
            yield data
        for part in data.values():
            yield from nodes_of(part)
    elif isinstance(value, list):
        for part in cast("list[object]", value):
            yield from nodes_of(part)


def edited(text: str, dice: random.Random) -> str:
    """A few edits as an author makes them: a node more, less, elsewhere, of another type, other numbers."""
    data = json.loads(text)
    for _ in range(dice.randint(1, 3)):
        found = list(lists(data["trees"]))
        where = dice.choice(found)
        match dice.randrange(5):
            case 0 if len(where) > 1:
                where.pop(dice.randrange(len(where)))
            case 1:
                where.insert(
                    dice.randint(0, len(where)), json.loads(json.dumps(dice.choice(dice.choice(found))))
                )
            case 2:
                dice.shuffle(where)
            case 3:
                node = dice.choice([n for n in nodes_of(data["trees"]) if next(iter(n)) in ALIKE] or [{}])
                if node:
                    node[dice.choice(ALIKE)] = node.pop(next(iter(node)))
            case _:
                numbers = [
                    (ports, key)
                    for node in nodes_of(data["trees"])
                    for ports in node.values()
                    if isinstance(ports, dict)
                    for key, value in cast("Data", ports).items()
                    if type(value) is int
                ]
                if numbers:
                    ports, key = dice.choice(numbers)
                    ports[key] = dice.randint(1, 4)
    return json.dumps(data)


def read(text: str) -> Mission | None:
    reading = examine(read_document(Path("mission.yaml"), "mission", text), registry())
    return None if reading.faults else reading.mission


def quiet(run: Run, dice: random.Random) -> bool:
    """Run to one of the moments at which an edit may be taken over; False when the mission has none left."""
    for _ in range(TICKS):
        if run.tick() is not NodeStatus.RUNNING:
            return False
        if run.tree.quiescent and dice.randrange(3) == 0:
            return True
    return False


def faults(run: Run) -> list[str]:
    """Faults of the program, but for a `Parallel` that wants more children than it has, which says so."""
    return [note.message for note in run.notes("internal_error") if "are wanted" not in note.message]


def test_any_edit_of_any_mission_goes_on() -> None:
    dice = random.Random(0)
    went_on = 0
    for seed in count():
        assert seed < 2000, f"only {went_on} of them were edited while they ran"
        if went_on == EDITS:
            break
        before = wild_mission(seed)
        after = edited(before, dice) if dice.randrange(4) else wild_mission(seed + 5000)
        old, new = read(before), read(after)
        if old is None or new is None:
            continue
        run = run_of(old, WildWorld(chance=dice))
        if not quiet(run, dice):
            continue
        saved = json.loads(json.dumps(run.tree.save()))
        going_on = run_of(new, run.world)
        adoption = going_on.tree.adopt(saved)
        assert sorted((*adoption.kept, *adoption.fresh)) == sorted(n.path for n in going_on.tree.nodes)
        went_on += going_on.tree.status is NodeStatus.RUNNING
        run.world.journal.take()
        for _ in range(TICKS):
            if going_on.tick() is not NodeStatus.RUNNING:
                break
        assert faults(going_on) == [], f"{before}\n{after}\n{saved}"
