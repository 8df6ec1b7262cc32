"""Grasp: take an object between the fingers, feel that it is held, and lift it clear."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..trees.ports import In, port
from ..trees.skill import ARM, GRIPPER, Doing, Skill, Steps
from ..world.causes import Failure, control, grasp, planning, safety
from ..world.causes import world as world_causes
from ..world.journal import Happened
from ..world.manipulation.choice import choose
from ..world.manipulation.dropping import let_go
from ..world.manipulation.grasps import GraspCandidate, grasp_candidates
from ..world.manipulation.holding import Hold
from ..world.manipulation.reaching import descend, lift
from ..world.motion.requests import PoseGoal
from ..world.values import ObjectId

if TYPE_CHECKING:
    from ..world.scene.planning_scene import BeliefObject
    from ..world.world import World


class Grasp(Skill):
    """Grasp an object between the fingers from above and lift it clear.

    Candidates are ranked; one counts only if the hand fits between the neighbours, the arm reaches it,
    and the object can from there be put where it belongs. Whether it is held is felt, by the opening of
    the fingers and by the load on the wrist.
    """

    example = """
    Grasp: {object: "{item}", force: 20 N}
    """

    object: In[ObjectId] = port("the object to grasp")
    force: In[float] = port("grip force of each finger", unit="N", default=30.0, above=0)
    speed: In[float] = port(
        "share of the joints' speed limits: 1 for as fast as allowed", default=1.0, above=0, most=1
    )
    causes = (
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

    def run(self, world: World) -> Steps:
        if (yield from self._already_held(world)):
            return
        belief = world.scene.get(self.object)
        ranked = grasp_candidates(belief, world.robot.description.gripper)
        refused: Failure | None = None
        tried_before = world.attempts.count(self.path, self.object)
        candidates = world.attempts.remaining(self.path, self.object, ranked)
        while candidates:
            candidate = yield from choose(world, belief, candidates, self.path)
            if candidate is None:
                break
            candidates = candidates[candidates.index(candidate) + 1 :]
            try:
                yield from self._approach(world, candidate)
            except Failure as failure:
                world.attempts.failed(self.path, self.object, candidate.name)
                if not failure.cause.name.startswith("planning."):
                    raise
                refused = failure
                continue
            yield from self._close_and_lift(world, candidate, first=tried_before == 0)
            return
        raise refused or Failure(
            grasp.NO_CANDIDATE,
            f"none of {len(ranked)} grasps of {self.object} is free, reachable and leads to a place",
            object=self.object,
            candidates=len(ranked),
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
        hold = Hold(world.grip.width, world.control.load())
        if hold.held:
            return True
        let_go(world.scene, "no longer felt in the hand")
        raise Failure(
            grasp.SLIPPED,
            f"{self.object} was in the hand and is gone: opening {hold.width * 1000:.1f} mm",
            object=self.object,
            width=hold.width,
            load=hold.load,
        )

    def _approach(self, world: World, candidate: GraspCandidate) -> Steps:
        world.grip.start(candidate.opening)
        pre_grasp = candidate.tcp_in_world.shifted((0.0, 0.0, world.handling.approach))
        plan = yield from world.plan.to(
            PoseGoal((pre_grasp,)), scaling=world.handling.scaling(self.speed), node=self.path
        )
        yield from world.move.along(plan.trajectory, guard=world.handling.guard, node=self.path)
        yield from world.control.settle()
        world.control.tare()
        yield from descend(world, candidate, self.object, self.path)

    def _close_and_lift(self, world: World, candidate: GraspCandidate, *, first: bool) -> Steps:
        belief = world.scene.get(self.object)
        limit = next((e.force_limit for e in world.description.catalogue if e.kind == belief.kind), None)
        width = yield from world.grip.close(self.force if limit is None else min(self.force, limit))
        felt = Hold(width, None)
        if not felt.empty:
            world.scene.attach(self.object, world.control.tcp.inverse() @ belief.pose)
        try:
            yield from lift(world, self.object, self.path)
        except Failure:
            world.attempts.failed(self.path, self.object, candidate.name)
            self._note(world, belief, candidate, felt, first=first)
            raise
        yield from world.control.settle()
        hold = Hold(world.grip.width, world.control.load())
        self._note(world, belief, candidate, hold, first=first)
        if hold.held:
            world.attempts.clear(self.path, self.object)
            return
        world.attempts.failed(self.path, self.object, candidate.name)
        let_go(world.scene, "not felt in the hand")
        yield from world.grip.open()
        cause, what = (
            (grasp.MISSED, "the fingers met and hold nothing")
            if felt.empty
            else (grasp.SLIPPED, "it was between the fingers and slipped out")
        )
        raise Failure(
            cause,
            f"{self.object}: {what} (opening {hold.width * 1000:.1f} mm, load {hold.load or 0.0:.2f} N)",
            object=self.object,
            candidate=candidate.name,
            width=hold.width,
            load=hold.load,
            expected_width=candidate.expected_width,
        )

    def _note(
        self, world: World, belief: BeliefObject, candidate: GraspCandidate, hold: Hold, *, first: bool
    ) -> None:
        """One closing of the fingers, and what they hold as far as it was felt."""
        world.journal.note(
            Happened(
                "pick",
                f"{self.object}: {'held' if hold.held else 'not held'}",
                self.path,
                {
                    "object": self.object,
                    "form": belief.form,
                    "candidate": candidate.name,
                    "held": hold.held,
                    "first_try": first,
                    "width": hold.width,
                    "load": hold.load,
                },
            )
        )
