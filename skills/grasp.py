"""Grasp: grip an object, check that it is held, and lift it clear."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..cell.handover import Handover
from ..manipulation.carry.hold_check import GripCheck
from ..manipulation.carry.weighing import LiftWeighing, payload_force, register_payload, update_payload_mass
from ..manipulation.grasp.compliant_closing import close, relocate_object
from ..manipulation.grasp.grasp_candidates import GraspCandidate, grasp_candidates
from ..manipulation.grasp.grip_force import grip_force
from ..manipulation.grasp.straight_lines import LIFT_GUARD_FORCE, descend_until_contact, lift, lift_off
from ..manipulation.motion.motion_watch import TargetWatch
from ..manipulation.motion.replanning import ReplanBudget
from ..manipulation.pick.pick_candidates import (
    PLACE_STAGE,
    PickPlaceCandidate,
    count_rejections,
    describe_rejections,
)
from ..manipulation.pick.pick_stream import CandidateSearch
from ..manipulation.pick.transfer_requests import transfer_requests
from ..manipulation.pick.visual_servoing import servo_to_grasp
from ..manipulation.place.dropped_objects import release_object
from ..manipulation.retreat.clearing import escape_contact
from ..planning.requests import HeldObject, MotionPlan
from ..trees.ports import In, port
from ..trees.skill import ARM, GRIPPER, Doing, Skill, Steps
from ..world.causes import Failure, control, grasp, perception, planning, safety
from ..world.causes import world as world_causes
from ..world.events.skill_events import PickEvent
from ..world.values import ObjectId, Pose, Vector3

if TYPE_CHECKING:
    from ..cell.world import World
    from ..planning.service.lookahead_planning import LookaheadResult
    from ..world.belief.planning_scene import BeliefObject

CLEAR_LIFT_SHARE = 0.5
"""Share of the lift height above which an object is clear of its neighbours."""
MAX_START_ERROR = 0.005
"""Start error above which a plan belongs to another configuration, rad in any joint."""


class Grasp(Skill):
    """Grasp an object between the fingers from above and lift it clear.

    Candidates are grasps with the places that they lead to, ranked. A candidate counts only if the hand fits
    between the neighbours and the arm reaches it. From there the arm must also be able to put the object
    where it belongs. The fingers close until contact, and the hand gives way to the one that touches first.
    Finger opening and load on the wrist show whether the object is held; an object that slips is gripped more
    firmly. An object that was missed or lost is grasped once more, if it is seen from there or was lost where
    it was gripped.
    """

    example = """
    Grasp: {object: "{item}", force: 20 N}
    """

    object: In[ObjectId] = port("the object to grasp")
    force: In[float] = port(
        "greatest grip force of each finger: it presses as weight and friction need, but never harder "
        "than this, than the item bears (`force_limit`) or than the gripper can",
        unit="N",
        default=70.0,
        above=0,
    )
    speed: In[float] = port(
        "share of the joints' speed limits: 1 for as fast as allowed", default=1.0, above=0, most=1
    )
    onward: In[bool] = port(
        "whether the object is carried on towards where it belongs, for a `Place` that follows at once: lift "
        "and transfer are one motion then; the arm stops by itself when none does",
        default=True,
    )
    servo: In[bool] = port(
        "whether the hand stops over the object and corrects its way by what the camera on it sees, where "
        "there is one",
        default=True,
    )
    causes = (
        perception.AMBIGUOUS,
        perception.NO_IMAGE,
        grasp.NO_CANDIDATE,
        grasp.MISSED,
        grasp.SLIPPED,
        planning.ANY,
        control.ANY,
        safety.ANY,
        world_causes.UNKNOWN_OBJECT,
        world_causes.DISTURBED,
    )
    hand_after = "full"
    uses = (ARM, GRIPPER)
    limit = 240.0

    def run(self, world: World) -> Steps:
        world.handover.drop()
        if (yield from self._already_held(world)):
            return
        self._gripped: Vector3 | None = None
        try:
            yield from self._pick(world)
        except Failure as failure:
            if failure.cause not in (grasp.MISSED, grasp.SLIPPED):
                raise
            if not (yield from relocate_object(world, self.object, self.path, failure, self._gripped)):
                raise
            yield from self._pick(world)

    def _pick(self, world: World) -> Steps:
        """Pick with the best remaining candidate, up to the lifted object.

        The arm stops and replans when an obstacle blocks the path, or the object is seen elsewhere.
        """
        replans = ReplanBudget(world, self.path, self.object)
        while not (yield from self._try(world, replans)):
            pass

    def _try(self, world: World, replans: ReplanBudget) -> Doing[bool]:
        """Run one attempt. Return False when the arm stopped on the way to the object and a new plan may
        help."""
        belief = world.scene.get(self.object)
        ranked = grasp_candidates(belief, world.robot.description.gripper)
        first = world.attempts.count(self.path, self.object) == 0
        offered = world.attempts.remaining(self.path, self.object, ranked)
        stream = CandidateSearch(world, belief, offered, self.path)
        while True:
            pick = yield from self._next(world, stream)
            watch = TargetWatch(world, belief)
            if pick is None:
                raise self._none(stream, len(ranked), len(ranked) - len(offered))
            carried: LookaheadResult[MotionPlan] | None = None
            try:
                if self.servo and world.vision.hand is not None:
                    pick = yield from servo_to_grasp(world, pick, self.path, first=first, watch=watch)
                    # Detections of the hand camera count; another camera may err by its mounting.
                    watch = None
                carried = self._prepared(world, pick)
                yield from self._approach(world, pick, carried, watch)
            except Failure as failure:
                if carried is not None and failure is carried.answer:
                    stream.refuse(pick, failure)
                    continue
                seen = watch is not None and failure is watch.noticed
                if replans.allows(failure, *((world_causes.DISTURBED,) if seen else ())):
                    return False
                if not seen:
                    world.attempts.failed(self.path, self.object, pick.grasp.name)
                raise
            yield from self._close_and_lift(world, pick, carried, first=first)
            return True

    def _next(self, world: World, stream: CandidateSearch) -> Doing[PickPlaceCandidate | None]:
        """Return the next candidate. An arm in believed contact first moves out of it."""
        try:
            return (yield from stream.find(speed=self.speed))
        except Failure as failure:
            if failure.cause is not planning.START_IN_COLLISION:
                raise
        yield from escape_contact(world, world.handling.slowly, self.path)
        return (yield from stream.find(speed=self.speed))

    def _none(self, stream: CandidateSearch, ranked: int, tried_before: int) -> Failure:
        """Return the failure for "no candidate": the planner's last failure at the place stage, or the
        rejections."""
        if stream.refused is not None and stream.trail.count(PLACE_STAGE):
            return stream.refused
        trail = stream.trail.entry()
        why = (
            describe_rejections(count_rejections(trail.tried, trail.into))
            or "an object of this width is not grasped"
        )
        return Failure(
            grasp.NO_CANDIDATE,
            f"none of {ranked} grasps of {self.object} is free, reachable and leads to a place: {why}",
            object=self.object,
            candidates=ranked,
            tried_before=tried_before,
        )

    def _already_held(self, world: World) -> Doing[bool]:
        held = world.scene.held
        if held is None:
            return False
        if held.id != self.object:
            raise Failure(
                grasp.NO_CANDIDATE,
                f"the hand is not free: it holds {held.id}",
                object=self.object,
                held=held.id,
            )
        yield from world.control.settle()
        hold = GripCheck(world.gripper.width, world.control.load())
        if not hold.empty and not hold.loaded:
            # The object between the fingers may touch or be inside another body.
            yield from lift_off(world, self.path)
            yield from world.control.settle()
            hold = GripCheck(world.gripper.width, world.control.load())
        if hold.held:
            return True
        release_object(world.scene, "no longer felt in the hand")
        raise Failure(
            grasp.SLIPPED,
            f"{self.object} was in the hand and is gone: opening {hold.width * 1000:.1f} mm",
            object=self.object,
            width=hold.width,
            load=hold.load,
        )

    def _prepared(self, world: World, pick: PickPlaceCandidate) -> LookaheadResult[MotionPlan] | None:
        """Start look-ahead planning of the transfer during the approach.

        None for flat objects, whose grasp height is known only after contact.
        """
        if pick.above is None or pick.landing is None or pick.grasp.flat or not self.onward:
            return None
        holding = HeldObject(self.object, pick.object_in_tcp)
        legs = transfer_requests(
            world, holding, pick.at, pick.grasp.expected_width, pick.above, pick.landing.drop, self.speed
        )
        return world.plan.ahead(world.plan.through(legs, node=self.path))

    def _approach(
        self,
        world: World,
        pick: PickPlaceCandidate,
        carried: LookaheadResult[MotionPlan] | None,
        target: TargetWatch | None,
    ) -> Steps:
        """Move to the pre-grasp and down in one motion.

        The arm stops when no transfer exists from there, or the object is elsewhere.
        """

        def in_vain() -> Failure | None:
            known = carried is not None and carried.ready <= world.clock.now
            if carried and known and isinstance(carried.answer, Failure):
                return carried.answer
            return world.gripper.late() or (None if target is None else target())

        yield from world.control.settle()
        world.control.zero()
        world.gripper.start(pick.grasp.opening)
        guard = world.handling.guard
        plan = pick.approach.trajectory
        yield from world.move.along(plan, guard=guard, watch=in_vain, node=self.path)
        yield from descend_until_contact(world, pick.grasp, self.object, self.path)

    def _close_and_lift(
        self,
        world: World,
        pick: PickPlaceCandidate,
        carried: LookaheadResult[MotionPlan] | None,
        *,
        first: bool,
    ) -> Steps:
        belief = world.scene.get(self.object)
        entry = next((e for e in world.description.catalogue if e.kind == belief.kind), None)
        press = grip_force(entry, self.force, world.robot.description.gripper)
        if self._gripped is not None:
            press = press.firmer()
        object_in_tcp = world.control.tcp.inverse() @ belief.pose
        if carried is None and pick.landing is not None and self.onward:
            carried = self._from_here(world, pick, object_in_tcp)
        closed = yield from close(world, press, self.path)
        if closed.gave_way and carried is not None:
            carried = self._from_here(world, pick, object_in_tcp)
        felt = GripCheck(closed.width, None)
        if not felt.empty:
            self._gripped = belief.pose.position
            register_payload(world, press, entry, object_in_tcp)
            world.scene.attach(self.object, object_in_tcp)
        try:
            hold = yield from self._lift(world, pick, carried, felt)
        except Failure:
            world.attempts.failed(self.path, self.object, pick.grasp.name)
            self._note(world, belief, pick.grasp, felt, first=first)
            raise
        self._note(world, belief, pick.grasp, hold, first=first)
        if hold.held:
            update_payload_mass(world, hold, press)
            world.attempts.clear(self.path, self.object)
            return
        world.attempts.failed(self.path, self.object, pick.grasp.name)
        world.handover.drop()
        release_object(world.scene, "not felt in the hand")
        yield from world.gripper.open()
        cause, what = (
            (grasp.MISSED, "the fingers met and hold nothing")
            if felt.empty
            else (grasp.SLIPPED, "it was between the fingers and slipped out")
        )
        raise Failure(
            cause,
            f"{self.object}: {what} ({hold})",
            object=self.object,
            candidate=pick.grasp.name,
            width=hold.width,
            load=hold.load,
            expected_width=pick.grasp.expected_width,
        )

    def _from_here(
        self, world: World, pick: PickPlaceCandidate, object_in_tcp: Pose
    ) -> LookaheadResult[MotionPlan]:
        """Plan the transfer from the present configuration while the fingers close."""
        assert pick.landing is not None
        holding = HeldObject(self.object, object_in_tcp)
        tcp = world.control.tcp
        # The object is held higher or lower than planned; it must land at the planned place.
        moved = pick.grasp.tcp_in_world.position[2] - tcp.position[2]
        above = pick.landing.above.shifted((0.0, 0.0, -moved))
        start = world.control.held_position
        legs = transfer_requests(
            world, holding, start, pick.grasp.expected_width, (above,), pick.landing.drop, self.speed
        )
        return world.plan.ahead(world.plan.through(legs, node=self.path))

    def _lift(
        self,
        world: World,
        pick: PickPlaceCandidate,
        carried: LookaheadResult[MotionPlan] | None,
        felt: GripCheck,
    ) -> Doing[GripCheck]:
        """Lift the object and measure the grip, on the way to the bin or at rest."""
        plan = None if carried is None or felt.empty else (yield from self._onward(world, carried))
        if plan is not None and pick.landing is not None:
            lifted = plan.passes[0] + world.tick
            weighing = LiftWeighing(world, plan.passes[0])
            guard = world.handling.guard + max(LIFT_GUARD_FORCE, payload_force(world))
            try:
                yield from world.move.along(
                    plan.trajectory, guard=guard, watch=weighing.watch, hand_over=lifted, node=self.path
                )
            except Failure as failure:
                if failure is not weighing.doubt and not ReplanBudget(world, self.path, self.object).allows(
                    failure
                ):
                    raise
                if failure.cause is planning.BLOCKED and not self._is_clear(world, pick):
                    yield from lift(world, self.object, self.path)
            if weighing.hold is not None:
                held = world.scene.get(self.object)
                if held.object_in_tcp is not None:
                    left = Handover(self.object, held.object_in_tcp, pick.landing, plan, world.scene.version)
                    world.handover.leave(left)
                return weighing.hold
        else:
            yield from lift(world, self.object, self.path)
        yield from world.control.settle()
        return GripCheck(world.gripper.width, world.control.load())

    @staticmethod
    def _is_clear(world: World, pick: PickPlaceCandidate) -> bool:
        """Return whether the hand has lifted the object out of its surroundings."""
        risen = world.control.tcp.position[2] - pick.grasp.tcp_in_world.position[2]
        return risen > CLEAR_LIFT_SHARE * world.handling.approach

    def _onward(self, world: World, carried: LookaheadResult[MotionPlan]) -> Doing[MotionPlan | None]:
        """Return the planned transfer if it starts at the present configuration and is still valid, else
        None."""
        try:
            plan = yield from world.plan.take(carried)
        except Failure:
            return None
        if plan is None:
            return None
        off = float(np.abs(plan.trajectory.start - world.control.held_position).max())
        return plan if off < MAX_START_ERROR else None

    def _note(
        self, world: World, belief: BeliefObject, candidate: GraspCandidate, hold: GripCheck, *, first: bool
    ) -> None:
        """Record one closing of the fingers, and the measured grip."""
        world.journal.note(
            PickEvent(
                f"{self.object}: {'held' if hold.held else 'not held'}",
                self.path,
                object=self.object,
                form=belief.form,
                candidate=candidate.name,
                held=hold.held,
                first_try=first,
                width=hold.width,
                load=hold.load,
                force=world.gripper.force,
            )
        )
