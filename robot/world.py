"""World: the interface of skills, recovery and trees to the robot: beliefs, sensors and motions."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from picktree.robot.planning import MotionPlan, Scaling
from picktree.world import Failure, NoFeed, ObjectId, Pose, event_types, facts, internal, world_facts

from .operator_desk import OperatorRequests

if TYPE_CHECKING:
    from picktree.robot.control import ArmMotion, ControlLoop, GripperControl
    from picktree.robot.planning import PlanService, SceneQueries
    from picktree.world import (
        BeliefObject,
        Clock,
        ComputeTimeAccount,
        Feed,
        Journal,
        PlanningScene,
        RandomStreams,
        world_facts,
    )
    from picktree.world.robot_model import RobotModel
    from picktree.world.scene import SceneDescription

    from .vision import Vision


@dataclass(frozen=True, slots=True)
class PlaceCandidate:
    """Place candidate: release pose of an object over a bin."""

    into: ObjectId
    spot: str
    """Name of the bin's cell."""
    height: float
    """Height of the heap in this cell above the bin's floor, m."""
    above: Pose
    """Pose of the TCP in the world over the bin: start and end of all motions that are not straight lines."""
    drop: float
    """Straight way down from `above` to the pose in which the fingers open, m."""
    name: str = ""
    """Short description for the log."""

    @property
    def release(self) -> Pose:
        """Pose of the TCP in the world in which the fingers open."""
        return self.above.shifted((0.0, 0.0, -self.drop))


@dataclass(frozen=True, slots=True, eq=False)
class Handover:
    """Carried object and the motion to its release pose, which one skill leaves to the next."""

    object: ObjectId
    object_in_tcp: Pose
    landing: PlaceCandidate
    plan: MotionPlan
    """Lift, transfer and descent as one motion."""
    version: int
    """Belief version at the handover."""


class HandoverSlot:
    """Slot for at most one handover, which the next skill takes.

    It is no part of a checkpoint: those are taken with an empty hand and the arm at rest.
    """

    def __init__(self) -> None:
        self._left: Handover | None = None

    def leave(self, carriage: Handover) -> None:
        self._left = carriage

    def take(self) -> Handover | None:
        """Return the handover and empty the slot; None when it is empty."""
        left, self._left = self._left, None
        return left

    def drop(self) -> None:
        """Discard the handover."""
        self._left = None


@dataclass(frozen=True, slots=True)
class HandlingParameters:
    """Motion and force parameters for a table-top arm with a parallel gripper; m, N, m/s."""

    approach: float = 0.08
    """Height of the pre-grasp pose above the grasp, m; also the length of the straight lift."""
    guard: float = 25.0
    """Contact force that stops a free motion, N."""
    touch: float = 4.0
    """Contact force that ends a guarded descent, N."""
    touch_speed: float = 0.05
    felt_way: float = 0.010
    """Last part of the descent on which contact is watched for flat objects, m."""
    back_off: float = 0.001
    """Distance of the lift after contact, m."""
    free: float = 0.98
    """Share of the joints' speed limits on planned motions. Measured speeds exceed the commanded ones by less
    than 1 %."""
    line: float = 0.5
    """Share of the joints' limits of speed and acceleration where contact is near or expected."""
    rounded: float = 0.05
    """Length of a straight leg of a pick or place that may be rounded at its free end, m."""
    lower_speed: float = 0.12
    """Speed of a guarded descent with an object in the hand, m/s."""
    rim_clearance: float = 0.005
    """Clearance of the finger tips above a bin's rim when an object is lowered into it, m."""
    release: float = 0.03
    """Extra opening beyond the object's width at release, m."""

    unknown_hold: float = 0.2
    """Share of the joints' accelerations with a thing in the hand whose hold is unknown."""

    def scaling(self, speed: float, held: BeliefObject | None = None) -> Scaling:
        """Return the scaling of planned motions at `speed`, a share in (0, 1], with `held` in the hand."""
        share = self.unknown_hold if held is not None and held.kind == "unknown" else 1.0
        return Scaling(velocity=self.free * speed, acceleration=speed * share)

    @property
    def slowly(self) -> Scaling:
        """Scaling of straight lines where contact is near or expected."""
        return Scaling(velocity=self.line, acceleration=self.line)


@dataclass(frozen=True)
class World:
    """World of one run: one robot and one belief, shared by all nodes of a tree. It contains no ground
    truth."""

    description: SceneDescription
    robot: RobotModel
    clock: Clock
    scene: PlanningScene
    journal: Journal
    attempts: world_facts.AttemptMemory
    streams: RandomStreams
    thinking: ComputeTimeAccount
    control: ControlLoop
    plan: PlanService
    move: ArmMotion
    gripper: GripperControl
    vision: Vision
    queries: SceneQueries
    feed: Feed = field(default_factory=NoFeed)
    noticed: world_facts.FeedProgress = field(default_factory=world_facts.FeedProgress)
    handover: HandoverSlot = field(default_factory=HandoverSlot)
    handling: HandlingParameters = field(default_factory=HandlingParameters)
    operator: OperatorRequests = field(default_factory=OperatorRequests)
    tick: float = 0.05
    """Time between two ticks of the tree, s."""
    running_steps: dict[str, str] = field(default_factory=dict[str, str])
    """Step that a skill is in, by the path of its node; see `step`."""

    @contextmanager
    def step(self, node: str, name: str) -> Generator[None]:
        """Show the work done inside as a step of the skill at `node`: in its message, and as an event.

        A step inside another takes its place meanwhile.
        """
        outer = self.running_steps.get(node)
        self.running_steps[node] = name
        start, outcome, cause = self.clock.now, "success", ""
        try:
            yield
        except GeneratorExit:
            outcome = "halted"
            raise
        except Failure as failure:
            outcome, cause = "failure", failure.cause.name
            raise
        except Exception:
            outcome, cause = "failure", internal.ERROR.name
            raise
        finally:
            if outer is None:
                del self.running_steps[node]
            else:
                self.running_steps[node] = outer
            seconds = f"{self.clock.now - start:.2f} s"
            message = {
                "success": f"{name}: {seconds}",
                "failure": f"{name} failed after {seconds}: {cause}",
                "halted": f"{name} halted after {seconds}",
            }[outcome]
            self.journal.note(
                event_types.StepEvent(message, node, step=name, start=start, outcome=outcome, cause=cause)
            )

    def to_do(self) -> tuple[BeliefObject, ...]:
        """Return the items that are believed to be neither at their destination nor set aside."""
        return world_facts.items_to_do(self.scene)

    def facts(self) -> Mapping[str, bool | int | float | str]:
        """Return the names that every expression of a mission may use, with their present values."""
        return facts(
            self.scene,
            looked=self.vision.observations > 0,
            stopped=self.control.monitor.stopped is not None,
            exhausted=self.feed.read().exhausted,
            done=self.journal.items_done,
            now=self.clock.now,
        )
