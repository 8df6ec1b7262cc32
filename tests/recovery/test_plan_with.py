"""PlanWith: what its child plans is planned otherwise, and nothing else is."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import cast

from picktree.robot import World
from picktree.robot.planning import DEFAULT_CHECK_BUDGET, NamedGoal, OffsetGoal, PlannerOverrides, Request
from picktree.trees import Skill, Steps
from picktree.world import Failure, planning

from ..trees.scripted import FakeWorld, Run, letters
from . import scripted_recovery


@dataclass
class FakePlan:
    """As much of a plan service as the node needs."""

    manner: PlannerOverrides = field(default_factory=PlannerOverrides)

    @contextmanager
    def in_manner(self, manner: PlannerOverrides) -> Generator[None]:
        before, self.manner = self.manner, self.manner & manner
        try:
            yield
        finally:
            self.manner = before


@dataclass
class PlanningWorld(FakeWorld):
    plan: FakePlan = field(default_factory=FakePlan)


class Plans(Skill):
    """Notes in which manner it would plan, in two ticks; fails when its name says so."""

    causes = (planning.ANY,)

    def run(self, world: World) -> Steps:
        fake = cast("PlanningWorld", world)
        for _ in range(2):
            manner = fake.plan.manner
            fake.trace.append(f"{self.name} {manner.seed} {manner.budget:g} {manner.clearance:g}")
            yield
        if self.name == "Fails":
            raise Failure(planning.NO_PATH, "none")


def start(body: str, world: FakeWorld) -> Run:
    return scripted_recovery.start(body, world, Plans)


def test_the_manner_holds_in_the_child_s_ticks_only() -> None:
    body = """\
Parallel:
  failure_count: 2
  do:
    - PlanWith: {seed: 3, budget: 2, clearance: 10 mm, do: {Plans: {name: Fails}}}
    - Plans: {name: Beside}
"""
    world = PlanningWorld()
    assert letters(start(body, world).to_end()) == "RRF"
    assert world.trace == ["Fails 3 2 0.01", "Beside 0 1 0"] * 2
    halted = start(body, world)
    halted.tick()
    halted.tree.halt()
    assert world.plan.manner == PlannerOverrides()


def test_manners_add_up() -> None:
    body = "PlanWith: {seed: 3, budget: 2, do: {PlanWith: {budget: 3, clearance: 5 mm, do: Plans}}}\n"
    world = PlanningWorld()
    start(body, world).to_end()
    assert world.trace == ["Plans 3 6 0.005"] * 2


def test_it_answers_as_its_child() -> None:
    body = 'PlanWith: {seed: 1, do: {Scripted: {script: "RR S|R grasp.missed"}}}\n'
    run = start(body, FakeWorld())
    assert letters(run.to_end()) == "RRS"
    assert letters(run.to_end()) == "RF"
    assert str(run.tree.failure.cause) == "grasp.missed"


def test_a_manner_changes_what_is_asked() -> None:
    manner = PlannerOverrides(seed=2, budget=2.5, clearance=0.01)
    free = manner.of(Request(NamedGoal("home"), clearance=0.002))
    assert (free.budget, round(free.clearance, 6)) == (round(2.5 * DEFAULT_CHECK_BUDGET), 0.012)
    line = manner.of(Request(OffsetGoal((0.0, 0.0, 0.1))))
    assert (line.budget, line.clearance) == (round(2.5 * DEFAULT_CHECK_BUDGET), 0.0)
    assert manner.stream("planner a") == "planner a seed 2"
    assert PlannerOverrides().stream("planner a") == "planner a"
