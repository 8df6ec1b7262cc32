"""Place: put the held object into a bin or down at a point, and check that it is released."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias, cast

from ..manipulation.carry.hold_check import check_held_object, is_released
from ..manipulation.carry.weighing import GripMonitor, is_fragile, payload_force, update_payload_mass
from ..manipulation.grasp.straight_lines import lower, withdraw
from ..manipulation.motion.motion_watch import PlaceWatch, PutDownWatch
from ..manipulation.motion.replanning import ReplanBudget, plan_after_stop
from ..manipulation.pick.transfer_requests import lower_request
from ..manipulation.place.bin_spots import blocked, put_down_poses
from ..manipulation.place.dropped_objects import apply_bin_exchanges
from ..manipulation.place.release_poses import bin_target, levels, place_candidates
from ..planning.requests import MotionPlan, PoseGoal, Request
from ..trees.ports import In, port
from ..trees.skill import ARM, GRIPPER, Doing, Skill, Steps
from ..trees.values.port_types import PortProblem, PortValues
from ..world.belief.planning_scene import BeliefObject
from ..world.causes import Failure, control, grasp, place, planning, safety
from ..world.causes import world as world_causes
from ..world.events.skill_events import ItemDoneEvent
from ..world.scene.description import Bin
from ..world.shapes import bottom
from ..world.values import ObjectId, Pose

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..cell.handover import Handover, PlaceCandidate
    from ..cell.world import World
    from ..world.trajectory import Trajectory

Room: TypeAlias = PlaceWatch | PutDownWatch

PLACE_DEPENDENT_CAUSES = (planning.NO_IK, planning.GOAL_IN_COLLISION, planning.NO_PATH, planning.BUDGET)
"""Causes for which another place may succeed."""


class Place(Skill):
    """Place the held object into a bin, over the lowest part of its heap, or down at a point.

    The hold is felt again before the release, and that the hand is empty after it.
    """

    example = """
    Place: {object: "{item}", into: "{item.destination}"}
    """

    object: In[ObjectId] = port("the object to place, which the hand holds")
    into: In[ObjectId] = port(
        "the bin to place it into; not needed with `at`", default=ObjectId(""), names="bin"
    )
    at: In[list[float]] = port(
        "where its underside is put down, instead of `into`: x, y, z in the world", unit="m", default=[]
    )
    speed: In[float] = port(
        "share of the joints' speed limits: 1 for as fast as allowed", default=1.0, above=0, most=1
    )
    causes = (
        place.OCCUPIED,
        place.MISSED,
        place.FULL,
        grasp.SLIPPED,
        planning.ANY,
        control.ANY,
        safety.ANY,
        world_causes.UNKNOWN_OBJECT,
        world_causes.DISTURBED,
    )
    uses = (ARM, GRIPPER)
    takes_over = True
    hand_after = "empty"

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        if given.any_of("into") == given.any_of("at"):
            return ("one of 'into' and 'at' must be given, and not both",)
        at = given.constants.get("at")
        if isinstance(at, list) and len(cast("list[object]", at)) != 3:
            return (
                PortProblem("at", f"three numbers x, y, z are wanted, not {len(cast('list[object]', at))}"),
            )
        return ()

    def run(self, world: World) -> Steps:
        apply_bin_exchanges(world, self.path)
        replans = ReplanBudget(world, self.path, self.object)
        there = yield from self._carried(world, replans)
        while not there:
            held = yield from self._held(world)

            def over(held: BeliefObject = held) -> Doing[MotionPlan]:
                return self._over_point(world, held) if self.at else self._over_bin(world, held)

            plan = yield from plan_after_stop(world, over, self.path, after=replans.made)
            guard, watch = (
                world.handling.guard + payload_force(world),
                _OnTheWay(GripMonitor(world), self._room),
            )
            motion = world.move.along(plan.trajectory, guard=guard, watch=watch, node=self.path)
            there = yield from self._arrives(motion, watch, replans)
        held = yield from self._held(world)
        hanging = world.control.load()
        yield from lower(world, held, None if self.at else self._bin(world), self.path)
        yield from self._release(world, held, hanging)

    def _carried(self, world: World, replans: ReplanBudget) -> Doing[bool]:
        """Return whether the motion that `Grasp` has left brings the object to its place.

        The motion is then finished; otherwise the arm is stopped.
        """
        left, going = world.handover.take(), world.move.ongoing
        if left is None or going is None or not self._fits(world, left, going.trajectory):
            yield from world.move.rest()
            return False
        self._spot, self._floor = left.landing.spot, left.landing.height
        room = PlaceWatch(world, world.scene.get(self.object), left.landing)
        if left.version != world.scene.version and room.judged() is not None:
            yield from world.move.rest()
            return False
        guard, watch = world.handling.guard + payload_force(world), _OnTheWay(GripMonitor(world), room)
        motion = world.move.finish(guard=guard, watch=watch, node=self.path)
        return (yield from self._arrives(motion, watch, replans))

    def _fits(self, world: World, left: Handover, going: Trajectory) -> bool:
        """Return whether the handover concerns this object and this bin, and the object is still held.

        Changes of the belief are checked during the motion: free path, and room at the place.
        """
        held = world.scene.held
        return (
            not self.at
            and going is left.plan.trajectory
            and (left.object, left.landing.into) == (self.object, self.into)
            and held is not None
            and (held.id, held.object_in_tcp) == (left.object, left.object_in_tcp)
        )

    @staticmethod
    def _arrives(motion: Steps, watch: _OnTheWay, replans: ReplanBudget) -> Doing[bool]:
        """Follow a motion to its end.

        Return False when it was stopped: the fingers moved, an obstacle blocked it, or the place was taken.
        """
        try:
            yield from motion
        except Failure as failure:
            if failure is watch.grip.doubt:
                return False
            taken = failure is watch.room.noticed
            if not replans.allows(failure, *((place.OCCUPIED,) if taken else ())):
                raise
            return False
        return True

    def _bin(self, world: World) -> Bin:
        bin_ = world.scene.bins.get(self.into)
        if bin_ is None:
            raise Failure(
                world_causes.UNKNOWN_OBJECT,
                f"there is no bin {self.into!r}",
                object=self.object,
                known=list(world.scene.bins),
            )
        return bin_

    def _held(self, world: World) -> Doing[BeliefObject]:
        """Measure and return the held object. Raises grasp.slipped when it is no longer there."""
        held, hold = yield from check_held_object(world, self.object)
        update_payload_mass(world, hold)
        return held

    def _over_bin(self, world: World, held: BeliefObject) -> Doing[MotionPlan]:
        assert held.object_in_tcp is not None
        bin_ = self._bin(world)
        target = bin_target(world, held, bin_.id)
        if not target.cells:
            raise Failure(
                place.FULL,
                f"{bin_.id} is full: its heap is {target.heights.min() * 1000:.0f} mm high at its lowest",
                object=self.object,
                bin=bin_.id,
            )
        refused: Failure | None = None
        for level in levels(target):
            over = place_candidates(world, target, level, held.shape, held.object_in_tcp)
            try:
                plan = yield from self._down(world, tuple(landing.above for landing in over), over[0].drop)
            except Failure as failure:
                if failure.cause not in PLACE_DEPENDENT_CAUSES:
                    raise
                refused = failure
                continue
            self._spot, self._floor = level.spot.name, level.spot.height
            self._room = PlaceWatch(world, held, _reached(over, plan, world))
            return plan
        assert refused is not None
        raise refused

    def _down(self, world: World, over: tuple[Pose, ...], drop: float) -> Doing[MotionPlan]:
        """Plan to a pose above the bin, and straight down from it as far as that is free."""
        goal, scaling = PoseGoal(over), world.handling.scaling(self.speed)
        if drop > 0.0:
            try:
                return (
                    yield from world.plan.through(
                        (Request(goal, scaling=scaling), lower_request(world, drop)), node=self.path
                    )
                )
            except Failure as failure:
                if failure.evidence.get("leg") != 1:
                    raise
        return (yield from world.plan.to(goal, scaling=scaling, node=self.path))

    def _over_point(self, world: World, held: BeliefObject) -> Doing[MotionPlan]:
        assert held.object_in_tcp is not None
        if len(self.at) != 3:
            raise Failure(
                world_causes.UNKNOWN_OBJECT,
                f"`at` needs three numbers x, y, z, not {self.at}",
                object=self.object,
            )
        x, y, z = self.at
        poses = put_down_poses((x, y, z), held.shape, held.object_in_tcp)
        by = blocked(world.queries, held, poses[0])
        if by is not None:
            raise Failure(
                place.OCCUPIED, f"{by} stands where {self.object} should go", object=self.object, by=by
            )
        self._spot, self._floor = "point", 0.0
        self._room = PutDownWatch(world, held, poses[0])
        over = tuple(p.shifted((0.0, 0.0, world.handling.approach)) for p in poses)
        return (
            yield from world.plan.to(
                PoseGoal(over), scaling=world.handling.scaling(self.speed), node=self.path
            )
        )

    def _release(self, world: World, held: BeliefObject, before: float) -> Steps:
        """Release the object. `before`: load of the hanging object, N; lowered onto a support it weighs
        less."""
        held = world.scene.get(held.id)
        where = self.into or "table"
        try:
            yield from world.gripper.release(world.handling.release)
        except GeneratorExit:  # halted, but the fingers go on opening
            world.scene.detach(held.id, self._resting(world, held), where, "let go")
            raise
        world.control.wrist.carry(None)
        world.scene.detach(held.id, self._resting(world, held), where, "placed")
        if self.at:
            yield from withdraw(world, self.path)
        elif is_fragile(world, held.kind):
            yield from self._clear(world)
        yield from world.control.settle()
        after = world.control.load()
        if not is_released(before, after):
            world.scene.put(held, "still felt in the open hand")
            raise Failure(
                place.MISSED,
                f"{held.id} still hangs on the open fingers (load {before:.2f} N, then {after:.2f} N)",
                object=held.id,
                load_before=before,
                load_after=after,
            )
        world.journal.note(
            ItemDoneEvent(
                f"{held.id} placed {('into ' + self.into) if self.into else f'at {self.at}'}",
                self.path,
                object=held.id,
                form=held.form,
                into=self.into,
                spot=self._spot,
            )
        )

    def _clear(self, world: World) -> Steps:
        """Withdraw straight up as far as possible, away from bodies that the hand would crush."""
        try:
            yield from withdraw(world, self.path)
        except Failure as failure:
            if failure.cause not in (*PLACE_DEPENDENT_CAUSES, planning.START_IN_COLLISION):
                raise

    def _resting(self, world: World, held: BeliefObject) -> Pose:
        """Return the pose in which the object is believed to come to rest."""
        if self.at:
            return held.pose
        bin_ = self._bin(world)
        floor = bin_.pose.position[2] + bin_.wall + max(0.0, self._floor)
        return held.pose.shifted((0.0, 0.0, floor - bottom(held.shape, held.pose)))


@dataclass(frozen=True, slots=True)
class _OnTheWay:
    """Monitor of a carrying motion, called each tick: is the object held, and is there room at the place?"""

    grip: GripMonitor
    room: Room

    def __call__(self) -> Failure | None:
        return self.grip.watch() or self.room()


def _reached(over: Sequence[PlaceCandidate], plan: MotionPlan, world: World) -> PlaceCandidate:
    """Return the place candidate to which a plan leads."""
    ends = world.robot.tcp(plan.trajectory.end)
    return min(over, key=lambda landing: landing.above.angle(ends))
