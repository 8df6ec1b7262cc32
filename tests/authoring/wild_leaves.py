"""Leaves that do as they like within what they declare, and a world that lets them."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

from picktree.recovery import Recover, RecoveryNode
from picktree.trees import (
    ARM,
    ConditionNode,
    ControlNode,
    In,
    Node,
    NodeStatus,
    Out,
    Skill,
    Steps,
    children,
    port,
)
from picktree.trees.loading import NodeRegistry
from picktree.world import Failure, cause_named, control, grasp, safety
from picktree.world.world_facts import FACTS

from ..trees.scripted import FakeWorld

if TYPE_CHECKING:
    from picktree.robot import World

CAUSES = (
    "grasp.missed",
    "grasp.slipped",
    "control.timeout",
    "safety.stop",
    "planning.no_path",
    "tree.timeout",
)


@dataclass
class WildWorld(FakeWorld):
    """Its facts and leaves are drawn anew each time."""

    chance: random.Random = field(default_factory=random.Random)
    holds: str = ""
    """The path of the node that filled the hand."""

    def facts(self) -> Mapping[str, object]:
        drawn: dict[type, object] = {bool: self.chance.random() < 0.5, int: self.chance.randrange(3), str: ""}
        facts = {name: drawn.get(kind, self.clock.now) for name, kind in FACTS.items()}
        return {**facts, "holding": bool(self.holds)}


class Do(Skill):
    """Runs for some ticks, writes at the end, and fails now and then, before or after it wrote."""

    value: In[object] = port("anything", default=None)
    out: Out[object] = port("a number")
    causes = (grasp.ANY, control.TIMEOUT)
    uses = (ARM,)

    def run(self, world: World) -> Steps:
        wild = cast("WildWorld", world)
        for _ in range(wild.chance.choice((0, 0, 0, 1, 2))):
            yield
        if wild.chance.random() < 0.3:
            self._fail(wild)
        self.out = wild.chance.randrange(3)
        if wild.chance.random() < 0.1:
            yield
            self._fail(wild)

    def _fail(self, wild: WildWorld) -> None:
        raise Failure(cause_named(wild.chance.choice(CAUSES[:3])), "as it likes")


class Stop(Skill):
    """Fails with a safety stop, as often as not."""

    causes = (safety.STOP,)

    def run(self, world: World) -> Steps:
        if cast("WildWorld", world).chance.random() < 0.5:
            yield
            raise Failure(safety.STOP, "as it likes")


class Hold(Skill):
    """Fills the hand; a failure may leave it full or as it was."""

    causes = (grasp.MISSED,)
    hand_after = "full"

    def run(self, world: World) -> Steps:
        wild = cast("WildWorld", world)
        yield from _wait(wild)
        if wild.chance.random() < 0.7:
            wild.holds = self.path
        yield from _wait(wild)
        if wild.chance.random() < 0.3:
            raise Failure(grasp.MISSED, "as it likes")
        wild.holds = self.path


class Drop(Skill):
    """Empties the hand, if it succeeds."""

    causes = (control.TIMEOUT,)
    hand_after = "empty"

    def run(self, world: World) -> Steps:
        wild = cast("WildWorld", world)
        yield from _wait(wild)
        if wild.chance.random() < 0.3:
            raise Failure(control.TIMEOUT, "as it likes")
        wild.holds = ""


def _wait(wild: WildWorld) -> Iterator[None]:
    for _ in range(wild.chance.choice((0, 0, 1))):
        yield


class Whim(Node):
    """Any status at any tick."""

    kind = "action"

    def on_tick(self) -> NodeStatus:
        chance = cast("WildWorld", self.world).chance
        return chance.choice((NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.RUNNING, NodeStatus.SKIPPED))


class Ask(ConditionNode):
    """Yes or no, whatever it is asked."""

    value: In[object] = port("anything", default=None)

    def answer(self, world: World) -> bool:
        return cast("WildWorld", world).chance.random() < 0.5


class Muddle(ControlNode):
    """A control node of somebody else: ticks any of its children in any order, and ends as it likes."""

    parts = children("whatever")

    def on_tick(self) -> NodeStatus:
        chance = cast("WildWorld", self.world).chance
        running = [part for part in self.parts if part.state is NodeStatus.RUNNING]
        last = chance.choice(running or self.parts)
        state = last.step()
        if state is NodeStatus.RUNNING or chance.random() < 0.3:
            return NodeStatus.RUNNING
        state = chance.choice((state, NodeStatus.SUCCESS, NodeStatus.SKIPPED, NodeStatus.FAILURE))
        return self.fail_with(last.failure) if state is NodeStatus.FAILURE else state


NODES: tuple[type[Node], ...] = (Do, Stop, Hold, Drop, Whim, Ask, Muddle, Recover, RecoveryNode)


def registry() -> NodeRegistry:
    return NodeRegistry(NODES, installed=False)
