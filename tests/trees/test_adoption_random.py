"""Whatever mission is edited into whatever other, at any quiet moment: it goes on without a fault."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any, TypeAlias, cast

import pytest

from picktree.files.yaml import read_document
from picktree.recovery import NODES as RECOVERY
from picktree.robot import World
from picktree.trees import Mission, Node, NodeStatus, Steps, build
from picktree.trees.loading import NodeRegistry, examine
from picktree.world import Failure, ObjectId, grasp, perception, place, safety
from tests.trees import rehearsing

from .random_missions import Author
from .scripted import FakeWorld, Run

Data: TypeAlias = dict[str, Any]
EDITS = 5
"""Of each seed: missions that are edited while they run, and go on."""
TICKS = 60
"""After an edit; a loop may have no end."""


@dataclass
class DicedWorld(FakeWorld):
    """Leaves throw its dice."""

    dice: random.Random = field(default_factory=lambda: random.Random(0))

    def chance(self, n: int) -> bool:
        return self.dice.randrange(n) == 0


def diced(world: World) -> DicedWorld:
    return cast("DicedWorld", world)


class Look(rehearsing.Look):
    """Finds up to two objects."""

    def run(self, world: World) -> Steps:
        yield from wait(world)
        if diced(world).chance(4):
            raise Failure(perception.NOT_FOUND, "diced")
        self.objects = [ObjectId(name) for name in diced(world).dice.sample(["o1", "o2"], 2)]


class Pick(rehearsing.Pick):
    """Picks or misses."""

    def run(self, world: World) -> Steps:
        yield from wait(world)
        if diced(world).chance(2):
            raise Failure(diced(world).dice.choice([grasp.MISSED, safety.FORCE_LIMIT]), "diced")


class Put(rehearsing.Put):
    """Puts, or finds the bin full."""

    def run(self, world: World) -> Steps:
        yield from wait(world)
        if diced(world).chance(3):
            raise Failure(place.FULL, "diced")


class Go(rehearsing.Go):
    """Goes."""

    def run(self, world: World) -> Steps:
        yield from wait(world)


class Weigh(rehearsing.Weigh):
    """Weighs."""

    def run(self, world: World) -> Steps:
        yield from wait(world)
        self.weight, self.sort = 1.0, "light"


class Ready(rehearsing.Ready):
    """Yes or no."""

    def answer(self, world: World) -> bool:
        return diced(world).chance(2)


class Maybe(rehearsing.Maybe):
    """Any answer."""

    def on_tick(self) -> NodeStatus:
        return diced(self.world).dice.choice(
            [NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.SKIPPED, NodeStatus.RUNNING]
        )


def wait(world: World) -> Steps:
    for _ in range(diced(world).dice.randrange(3)):
        yield


NODES: tuple[type[Node], ...] = (Look, Pick, Put, Go, Weigh, Ready, Maybe, *RECOVERY)
REGISTRY = NodeRegistry(NODES, installed=False)
ALIKE = (
    "Sequence",
    "SequenceWithMemory",
    "PipelineSequence",
    "Fallback",
    "ReactiveSequence",
    "ReactiveFallback",
    "RoundRobin",
    "Parallel",
)


def lists(value: object) -> Iterator[list[Data]]:
    """All lists of nodes in a mission's data."""
    match value:
        case dict():
            for part in cast("Data", value).values():
                yield from lists(part)
        case list() if value and all(isinstance(item, dict) for item in cast("list[object]", value)):
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
    reading = examine(read_document(Path("mission.yaml"), "mission", text), REGISTRY)
    return None if reading.faults else reading.mission


def begin(mission: Mission, world: DicedWorld) -> Run:
    return Run(build(mission, cast("World", world)), world)


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


@pytest.mark.parametrize("seed", range(2))
def test_any_edit_of_any_mission_goes_on(seed: int) -> None:
    author, dice = Author(seed), random.Random(seed)
    went_on = 0
    for number in count():
        assert number < 2000, f"only {went_on} of them were edited while they ran"
        if went_on == EDITS:
            break
        before = author.mission()
        after = edited(before, dice) if dice.randrange(4) else author.mission()
        old, new = read(before), read(after)
        if old is None or new is None:
            continue
        world = DicedWorld(dice=random.Random(seed))
        world.put("o1", "red")
        world.put("o2", "blue")
        run = begin(old, world)
        if not quiet(run, dice):
            continue
        saved = json.loads(json.dumps(run.tree.save()))
        going_on = begin(new, world)
        adoption = going_on.tree.adopt(saved)
        assert sorted((*adoption.kept, *adoption.fresh)) == sorted(n.path for n in going_on.tree.nodes)
        went_on += going_on.tree.status is NodeStatus.RUNNING
        world.journal.take()
        for _ in range(TICKS):
            if going_on.tick() is not NodeStatus.RUNNING:
                break
        assert faults(going_on) == [], f"{before}\n{after}\n{saved}"
