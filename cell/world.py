"""What skills, recovery and trees see of the robot and its surroundings: beliefs, sensors, motions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..world.belief.facts import facts, to_do
from ..world.belief.feed_notices import Noticed
from ..world.no_feed import NoFeed
from .handling_parameters import Handling
from .handover import Underway
from .operator_desk import OperatorDesk

if TYPE_CHECKING:  # so that who only names the type, as a plug-in does, does not wait for planner and robot
    from ..control.execution.control_loop import ControlLoop
    from ..control.execution.gripper_motion import Grip
    from ..control.execution.motions import Motions
    from ..planning.collision.scene_queries import SceneQueries
    from ..planning.service.plan_service import PlanService
    from ..robots.model import RobotModel
    from ..world.belief.attempts import Attempts
    from ..world.belief.planning_scene import BeliefObject, PlanningScene
    from ..world.journal import Journal
    from ..world.protocols import Clock, Feed
    from ..world.random_streams import Streams
    from ..world.scene.description import SceneDescription
    from ..world.thinking_time import ThinkingAccount
    from .vision import Eyes


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
