"""What skills, recovery and trees see of the robot and its surroundings: beliefs, sensors, motions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..planning.requests import Scaling
from ..world.belief.facts import FeedProgress, facts, items_to_do
from ..world.protocols import NoFeed
from .handover import HandoverSlot
from .operator_desk import OperatorRequests

if TYPE_CHECKING:
    from ..control.execution.control_loop import ControlLoop
    from ..control.execution.gripper_motion import GripperControl
    from ..control.execution.motions import ArmMotion
    from ..planning.collision.scene_queries import SceneQueries
    from ..planning.service.plan_service import PlanService
    from ..robots.model import RobotModel
    from ..world.belief.attempts import AttemptMemory
    from ..world.belief.planning_scene import BeliefObject, PlanningScene
    from ..world.journal import Journal
    from ..world.protocols import Clock, Feed
    from ..world.random_streams import RandomStreams
    from ..world.scene.description import SceneDescription
    from ..world.thinking_time import ComputeTimeAccount
    from .vision import Vision


@dataclass(frozen=True, slots=True)
class HandlingParameters:
    """Defaults for a table-top arm with a parallel gripper. m, N, m/s."""

    approach: float = 0.08
    """From the pre-grasp pose straight down to the grasp, and up again."""
    guard: float = 25.0
    """Contact force that stops a free motion."""
    touch: float = 4.0
    """Contact force that a guarded descent feels for."""
    touch_speed: float = 0.05
    felt_way: float = 0.010
    """Last bit of the way down that is felt for flat objects."""
    back_off: float = 0.001
    """Raised again by this much after having touched."""
    free: float = 0.9
    """Share of the joints' speed limits on free motions: the servo overshoots a little."""
    line: float = 0.5
    """Share of the joints' speed limits on straight lines next to objects."""
    lower_speed: float = 0.12
    """Of a guarded lowering with an object in the hand."""
    rim_clearance: float = 0.005
    """Of the finger tips above the rim of a bin, when an object is lowered into it."""
    release: float = 0.03
    """How much wider than the object the fingers open to release it."""

    def scaling(self, speed: float) -> Scaling:
        """For free motions at `speed`, a share (0, 1]."""
        return Scaling(velocity=self.free * speed, acceleration=speed)

    @property
    def slowly(self) -> Scaling:
        """For straight lines next to objects."""
        return Scaling(velocity=self.line, acceleration=self.line)


@dataclass(frozen=True)
class World:
    """One robot and one belief, shared by all nodes of a tree. Ground truth is not in here."""

    description: SceneDescription
    robot: RobotModel
    clock: Clock
    scene: PlanningScene
    journal: Journal
    attempts: AttemptMemory
    streams: RandomStreams
    thinking: ComputeTimeAccount
    control: ControlLoop
    plan: PlanService
    move: ArmMotion
    grip: GripperControl
    eyes: Vision
    queries: SceneQueries
    feed: Feed = field(default_factory=NoFeed)
    noticed: FeedProgress = field(default_factory=FeedProgress)
    underway: HandoverSlot = field(default_factory=HandoverSlot)
    handling: HandlingParameters = field(default_factory=HandlingParameters)
    operator: OperatorRequests = field(default_factory=OperatorRequests)
    tick: float = 0.05
    """Seconds between two ticks of the tree."""

    def to_do(self) -> tuple[BeliefObject, ...]:
        """Items that are believed to lie elsewhere than where they belong, and are not put aside."""
        return items_to_do(self.scene)

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
