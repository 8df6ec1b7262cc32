"""Random trees of nodes that BehaviorTree.CPP has, too, ticked by both: the same leaves in the same order."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias, cast

import pytest

from picktree.authoring.xml import mission_to_xml
from picktree.robot import World
from picktree.trees import Node, NodeStatus, build
from picktree.trees.loading import NodeRegistry, parse_mission

from ..trees.scripted import FILE, AnyFacts, FakeWorld, Run
from .btcpp_library import LIBRARY, OLD, Driver

TICKS = 8
KEYS = ("g", "h")
_Json: TypeAlias = object
_ANSWERS = {
    "S": NodeStatus.SUCCESS,
    "F": NodeStatus.FAILURE,
    "R": NodeStatus.RUNNING,
    "K": NodeStatus.SKIPPED,
}


@dataclass
class Scripted(FakeWorld):
    """Answers of the leaves in the present tick, by name."""

    answers: dict[str, str] = field(default_factory=dict[str, str])


class Told(Node):
    """A leaf that answers as the script says, however often it is asked in a tick."""

    kind = "action"

    def on_tick(self) -> NodeStatus:
        world = cast("Scripted", self.world)
        letter = world.answers[self.name]
        world.trace.append(f"{self.name}:{letter}")
        return _ANSWERS[letter]

    def on_halt(self) -> None:
        cast("Scripted", self.world).trace.append(f"halt {self.name}")


class Author:
    """Writer of one random tree, and of what happens at each of its ticks."""

    def __init__(self, seed: int, letters: str) -> None:
        self._halts_alike = "K" not in letters
        self._chance = random.Random(seed)
        self.leaves: list[str] = []
        self._keys: tuple[str, ...] = KEYS
        self._calls = self._called = self._shares = False
        kinds = ("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "SequenceWithMemory")
        self._around: tuple[Callable[[int], _Json], ...] = (
            *(self._listed(kind) for kind in kinds), self._listed("SequenceWithMemory"),
            # Without a third child the library's IfThenElse does not reset a condition that failed.
            self._listed("IfThenElse", 3, 3), self._listed("WhileDoElse", 2, 3),
            *(self._wrapped(kind) for kind in ("Inverter", "ForceSuccess", "ForceFailure", "RunOnce")),
            # In 4.7 a halt of these does not forget the child that ran.
            *(self._watched(kind) for kind in ("SkipUnlessUpdated", "WaitValueUpdate") if not OLD),
            *(() if OLD else (self._try_catch, self._try_catch)),
            self._parallel, self._parallel_all, self._parallel_all,
        )  # fmt: skip

    def mission(self) -> str:
        self._calls, main = True, self._node(3)
        self._calls, self._keys = False, tuple(f"@{key}" for key in KEYS)
        trees = {"Main": main, "Rooted": self._node(2)}
        self._keys = (*KEYS, "k")
        trees["Shared"] = self._node(2)
        return json.dumps({"picktree": 1, "kind": "mission", "trees": trees})

    def ticks(self, letters: str) -> list[tuple[dict[str, int], dict[str, str]]]:
        """Return, for each tick, the keys that are written before it, and the answers of the leaves."""
        return [
            (
                {key: self._chance.randint(0, 1) for key in KEYS if tick == 0 or self._chance.random() < 0.3},
                {leaf: self._chance.choice(letters) for leaf in self.leaves},
            )
            for tick in range(TICKS)
        ]

    def _node(self, depth: int) -> _Json:
        write = self._chance.choice(self._around) if depth and self._chance.random() < 0.75 else self._leaf
        node = cast("dict[str, dict[str, _Json]]", write(depth))
        if self._chance.random() < 0.3:
            ((_, body),) = node.items()
            for name in ("_skipIf", "_failureIf", "_successIf", "_while"):
                if self._chance.random() < 0.3:
                    body[name] = f"{self._chance.choice(self._keys)} == {self._chance.randint(0, 1)}"
            for name in ("_onSuccess", "_onFailure", "_post"):
                if self._chance.random() < 0.2:
                    body[name] = f"{self._chance.choice(self._keys)} := {self._chance.randint(0, 1)}"
        return node

    def _leaf(self, _: int) -> _Json:
        match self._chance.randrange(11):
            case 3 if self._calls and not self._called:
                self._called = True
                return {"Rooted": {}}
            case 4 if self._calls and not self._shares:
                self._shares = True
                return {"Shared": {"_autoremap": True}}
            case 2:
                operator = self._chance.choice((":=", ":=", "=", "+=", "-="))
                return {
                    "Script": {
                        "code": f"{self._chance.choice(self._keys)} {operator} {self._chance.randint(0, 1)}"
                    }
                }
            case 0:
                return {"WasEntryUpdated": {"entry": self._key()}}
            case 1:
                return {"Condition": {"if": f"{self._chance.choice(self._keys)} == 1"}}
            case _:
                self.leaves.append(f"L{len(self.leaves)}")
                return {"Told": {"name": self.leaves[-1]}}

    def _key(self) -> str:
        return f"{{{self._chance.choice(self._keys)}}}"

    def _children(self, depth: int, least: int = 1, most: int = 3) -> list[_Json]:
        return [self._node(depth - 1) for _ in range(self._chance.randint(least, most))]

    def _listed(self, kind: str, least: int = 1, most: int = 3) -> Callable[[int], _Json]:
        return lambda depth: {kind: {"do": self._children(depth, least, most)}}

    def _wrapped(self, kind: str) -> Callable[[int], _Json]:
        return lambda depth: {kind: {"do": self._node(depth - 1)}}

    def _watched(self, kind: str) -> Callable[[int], _Json]:
        return lambda depth: {kind: {"entry": self._key(), "do": self._node(depth - 1)}}

    def _count(self, total: int) -> int:
        return self._chance.randint(1, total) * self._chance.choice((1, -1))

    def _try_catch(self, depth: int) -> _Json:
        # The library takes one whose children were all skipped for RUNNING, and halts it in the same tick.
        self.leaves.append(f"L{len(self.leaves)}")
        first = {"Told": {"name": self.leaves[-1]}}
        parts = [first, *self._children(depth)]
        caught = self._halts_alike and self._chance.random() < 0.5
        return {"TryCatch": {"catch_on_halt": caught, "do": parts}}

    def _parallel(self, depth: int) -> _Json:
        parts = self._children(depth)
        # With a success_count below zero the library calls it a success when all children were skipped.
        counts = {
            "success_count": self._chance.randint(1, len(parts)),
            "failure_count": self._count(len(parts)),
        }
        return {"Parallel": {**counts, "do": parts}}

    def _parallel_all(self, depth: int) -> _Json:
        parts = self._children(depth)
        return {"ParallelAll": {"max_failures": self._count(len(parts)), "do": parts}}


def skips_by_itself(node: Node) -> bool:
    """Whether a node was ticked and passes on that its children were skipped.

    BehaviorTree.CPP then takes it for RUNNING at the next tick; here SKIPPED is an end like the others.
    """
    return node.ticked and node.state is NodeStatus.SKIPPED and any(below.ticked for below in node.below)


def compare(seed: int, letters: str, driver: Driver, folder: Path) -> int:
    """Tick a tree with both; return the number of ticks that were compared."""
    author = Author(seed, letters)
    text = author.mission()
    mission = parse_mission(text, FILE, NodeRegistry((Told,), installed=False), facts=AnyFacts())
    world = Scripted()
    run = Run(build(mission, cast("World", world)), world)
    assert driver.load(mission_to_xml(mission), folder / "tree.xml") == "loaded"
    for number, (written, answers) in enumerate(author.ticks(letters)):
        # A leaf that runs is not skipped: the library would go on to take it for RUNNING.
        running = {node.name for node in run.tree.nodes if node.state is NodeStatus.RUNNING}
        world.answers = answers | {leaf: "F" for leaf in running & answers.keys() if answers[leaf] == "K"}
        for key, value in written.items():
            run.tree.blackboard.write(f"Main/{key}", value, "test")
            driver.write(key, value)
        done = len(run.trace)
        run.tick()
        # A leaf may be ticked several times in a tick, and answers alike.
        told = [f"{leaf}={letter}" for leaf, letter in world.answers.items() for _ in range(4)]
        theirs = driver.ask(" ".join(("tick", *told)))
        if theirs.startswith("threw"):
            return number  # where the library throws, the mission goes on
        ours = " ".join((*run.trace[done:], "->", str(run.tree.status)))
        assert ours == " ".join(theirs.split()), f"tick {number} of {text}"
        if any(map(skips_by_itself, run.tree.nodes)):
            return number + 1
    return TICKS


@pytest.mark.parametrize("letters", ["SFR", "SFRK"])
def test_the_same_leaves_are_ticked_and_halted_with_the_same_answers(letters: str, tmp_path: Path) -> None:
    LIBRARY.require()
    with Driver() as driver:
        compared = [compare(seed, letters, driver, tmp_path) for seed in range(200)]
    assert sum(compared) > 60 * TICKS
