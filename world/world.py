"""What skills, recovery and trees see of the robot and its surroundings: beliefs, sensors, motions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from .facts import facts, to_do
from .handling import Handling
from .no_feed import NoFeed
from .noticed import Noticed
from .operator import OperatorDesk
from .underway import Underway

if TYPE_CHECKING:  # so that who only names the type, as a plug-in does, does not wait for planner and robot
    from .attempts import Attempts
    from .control.grip import Grip
    from .control.loop import ControlLoop
    from .control.motion import Motions
    from .eyes import Eyes
    from .journal import Journal
    from .motion.fcl_queries import SceneQueries
    from .motion.service import PlanService
    from .protocols import Clock, Feed
    from .robot.model import RobotModel
    from .scene.description import SceneDescription
    from .scene.planning_scene import BeliefObject, PlanningScene
    from .streams import Streams
    from .thinking import ThinkingAccount


@dataclass(frozen=True)
class World:
    """One robot and one belief, shared by all nodes of a tree. Ground truth is not in here."""

    description: SceneDescription
    robot: RobotModel
    clock: Clock
    scene: PlanningScene
    journal: Journal
    attempts: Attempts
    streams: Streams
    thinking: ThinkingAccount
    control: ControlLoop
    plan: PlanService
    move: Motions
    grip: Grip
    eyes: Eyes
    queries: SceneQueries
    feed: Feed = field(default_factory=NoFeed)
    noticed: Noticed = field(default_factory=Noticed)
    underway: Underway = field(default_factory=Underway)
    handling: Handling = field(default_factory=Handling)
    operator: OperatorDesk = field(default_factory=OperatorDesk)
    tick: float = 0.05
    """Seconds between two ticks of the tree."""

    def to_do(self) -> tuple[BeliefObject, ...]:
        """Items that are believed to lie elsewhere than where they belong, and are not put aside."""
        return to_do(self.scene)

    def facts(self) -> Mapping[str, bool | int | float | str]:
        """Names that every expression of a mission may use, with their values now."""
        return facts(
            self.scene,
            looked=self.eyes.looks > 0,
            stopped=self.control.monitor.stopped is not None,
            exhausted=self.feed.read().exhausted,
            done=self.journal.items_done,
            now=self.clock.now,
        )
