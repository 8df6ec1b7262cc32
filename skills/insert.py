"""Insert: put the held object into a hole, searched by contact."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from ..control.cartesian.compliant_motion import CartesianStiffness
from ..control.contact.hole_search import InsertionMotion, InsertionParameters
from ..control.contact.peg_motion import ExtractionMotion
from ..manipulation.carry.hold_check import GripCheck, check_held_object, fail_as_slipped, is_released
from ..manipulation.grasp.straight_lines import withdraw
from ..manipulation.insert.insertion import (
    SEARCH_HEIGHT,
    InsertionTask,
    fit,
    inserted_pose,
    mouth,
    peg,
    poses_over,
)
from ..manipulation.motion.replanning import follow_with_replanning
from ..planning.requests import PoseGoal
from ..trees.ports import In, port
from ..trees.skill import ARM, GRIPPER, Doing, Skill, Steps
from ..world.belief.hole_matching import find_hole, fits_hole, fitting_hole, occupied
from ..world.causes import Failure, control, grasp, insert, place, planning, safety
from ..world.causes import world as world_causes
from ..world.events.skill_events import ItemDoneEvent
from ..world.values import ObjectId

if TYPE_CHECKING:
    from ..cell.world import World
    from ..world.belief.planning_scene import BeliefObject

LINEAR_STIFFNESS, ANGULAR_STIFFNESS = 600.0, 30.0
"""Stiffness of the Cartesian impedance during the search, N/m and Nm/rad."""
GRIP_SETTLE_TIME = 0.4
"""Time in which the pads settle on the object after the grip was tightened, s."""
SEARCH_TIME_LIMIT = 120.0
"""Time limit of one insertion by contact, s."""
MIN_OPENING_CHANGE = 0.0015
"""Change of the opening that shows that the object has turned in the hand, m."""
SEEN_MOUTH_UNCERTAINTY = 0.002
"""Uncertainty of a mouth's position seen by the hand camera, m."""


class Insert(Skill):
    """Put the held object into a hole or slot whose place is known roughly: touch, search, press, let go.

    The arm descends to contact, searches the mouth, presses with a wiggle down to the bottom, and lets go.
    Where the object gets stuck it is pulled back and pressed again, then drawn out and searched for with
    another pattern. When nothing helps, the skill ends with the object in the hand above the hole.
    """

    example = """
    Insert: {object: "{item}", search: tilt, force: 15 N}
    """

    object: In[ObjectId] = port("the object to insert, which the hand holds")
    into: In[ObjectId] = port(
        "the hole, or the fixture of whose free holes it takes the closest fit; by default where the object "
        "belongs",
        default=ObjectId(""),
        names="hole",
    )
    search: In[Literal["tilt", "spiral", "none"]] = port(
        "how the mouth is searched: `tilt`, with the object leaning and one point of it first, after it a "
        "spiral; `spiral`, upright over the surface; `none`: straight down",
        default="tilt",
    )
    force: In[float] = port("presses the object into the hole", unit="N", default=15.0, above=0, most=40)
    press: In[float] = port(
        "presses the object onto the surface while searching", unit="N", default=8.0, above=0, most=25
    )
    grip: In[float] = port(
        "of each finger while inserting; never more than the object bears", unit="N", default=30.0, above=0
    )
    depth: In[float] = port(
        "how deep the object is to go; 0 for down to the bottom", unit="m", default=0.0, least=0
    )
    pitch: In[float] = port("between two turns of the spiral", unit="m", default=0.001, above=0)
    attempts: In[int] = port(
        "how often a search may begin anew, each time otherwise", default=3, least=1, most=10
    )
    speed: In[float] = port(
        "share of the joints' speed limits on the way there: 1 for as fast as allowed",
        default=1.0,
        above=0,
        most=1,
    )
    causes = (
        insert.NOT_FOUND,
        insert.JAMMED,
        insert.MISSED,
        place.OCCUPIED,
        place.FULL,
        grasp.SLIPPED,
        planning.ANY,
        control.ANY,
        safety.ANY,
        world_causes.UNKNOWN_OBJECT,
        world_causes.DISTURBED,
    )
    uses = (ARM, GRIPPER)
    limit = 300.0
    hand_after = "empty"

    def run(self, world: World) -> Steps:
        world.handover.drop()
        held, _ = yield from check_held_object(world, self.object)
        plan = yield from self._choose(world, held)
        yield from self._over(world, plan)
        held, _ = yield from check_held_object(world, self.object)
        hanging = world.control.load()
        with world.control.contact(rate=plan.rate):
            world.gripper.press(self.grip)
            for _ in range(math.ceil(GRIP_SETTLE_TIME / world.tick)):
                yield
            width = world.gripper.width
            course = yield from self._feel(world, plan)
            if course.outcome == "in":
                yield from self._let_go(world, held, plan)
        if course.outcome != "in":
            yield from self._out(world, plan, course, width)
        yield from withdraw(world, self.path)
        yield from self._gone(world, held, plan, course, hanging)

    # Before the search.

    def _choose(self, world: World, held: BeliefObject) -> Doing[InsertionTask]:
        """Return the hole, and how the object is held for it."""
        scene = world.scene
        into = self.into or scene.destination(self.object)
        if into is None:
            raise Failure(
                insert.MISSED, f"no rule says into which hole {self.object} belongs", object=self.object
            )
        fixture = scene.fixtures.get(into)
        if fixture is None or not fixture.holes:
            _, hole = find_hole(scene, into)
            if occupied(scene, hole.id):
                raise Failure(place.OCCUPIED, f"{hole.id} is taken already", object=self.object, hole=hole.id)
            if not fits_hole(hole, held.shape):
                raise Failure(
                    insert.MISSED,
                    f"{self.object} does not fit into {hole.id}",
                    object=self.object,
                    hole=hole.id,
                )
        chosen = fitting_hole(scene, self.object, into)
        if chosen is None:
            raise Failure(
                place.FULL, f"{into} has no free hole that {self.object} fits", object=self.object, into=into
            )
        assert held.object_in_tcp is not None
        fixture, hole = find_hole(scene, chosen.id)
        plan = fit(fixture, hole, held.shape, held.object_in_tcp)
        seen = None
        if any(camera.on == "hand" for camera in world.description.cameras):
            from ..manipulation.insert.hole_servoing import look_at_hole  # needs OpenCV

            seen = yield from look_at_hole(world, hole.id, self.path)
        return plan if seen is None else plan.seen_at(seen, SEEN_MOUTH_UNCERTAINTY)

    def _over(self, world: World, plan: InsertionTask) -> Steps:
        """Move the object upright above the mouth."""
        poses = poses_over(plan, SEARCH_HEIGHT)
        if not poses:
            raise Failure(
                planning.NO_IK,
                f"{self.object} is not held upright: however the hand turns above {plan.hole.id}, it does "
                "not stand over it",
                object=self.object,
                hole=plan.hole.id,
            )
        scaling = world.handling.scaling(self.speed)
        yield from follow_with_replanning(
            world,
            lambda: world.plan.to(PoseGoal(poses), scaling=scaling, node=self.path),
            guard=world.handling.guard,
            node=self.path,
        )

    # Search by contact.

    def _feel(self, world: World, plan: InsertionTask) -> Doing[InsertionMotion]:
        touch = InsertionParameters(
            press=self.press, push=self.force, pitch=self.pitch, attempts=self.attempts
        )
        course = InsertionMotion(
            peg(plan, world.control.tcp),
            mouth(plan, self.depth or plan.hole.depth, world.robot.description.gripper.tip),
            touch,
            self.search,
            LINEAR_STIFFNESS,
        )
        stiffness = CartesianStiffness(linear=LINEAR_STIFFNESS, angular=ANGULAR_STIFFNESS)
        done = yield from world.move.comply(course, SEARCH_TIME_LIMIT, stiffness=stiffness, node=self.path)
        if not done.finished:
            out = ExtractionMotion(course.up, course.depth)
            yield from world.move.comply(
                out, SEARCH_TIME_LIMIT, stiffness=stiffness, zero=done.zero, node=self.path
            )
        self._force, self._seconds = done.force, done.seconds
        return course

    def _out(self, world: World, plan: InsertionTask, course: InsertionMotion, width: float) -> Steps:
        """Check the grip above the hole after a failed insertion, and raise the failure."""
        yield from world.control.settle()
        hold = GripCheck(world.gripper.width, world.control.load())
        if not hold.held:
            yield from fail_as_slipped(
                world, self.object, hold, f"slipped out of the fingers at {plan.hole.id}"
            )
        if abs(hold.width - width) > MIN_OPENING_CHANGE:
            raise Failure(
                grasp.SLIPPED,
                f"{self.object} has turned in the hand at {plan.hole.id}: the fingers stood "
                f"{width * 1000:.1f} mm apart, now {hold.width * 1000:.1f} mm",
                object=self.object,
                width=hold.width,
                load=hold.load,
                before=width,
            )
        mm = 1000.0
        told = {
            "no bottom": (insert.MISSED, f"it went {course.deepest * mm:.0f} mm deep and met no bottom"),
            "not found": (
                insert.NOT_FOUND,
                f"the surface was felt, but no mouth within {course.searched * mm:.1f} mm",
            ),
            "jammed": (insert.JAMMED, f"it got stuck {course.deepest * mm:.1f} mm deep"),
        }
        cause, what = told.get(
            course.outcome, (insert.JAMMED, f"it was not in after {self._seconds:.0f} s of trying")
        )
        raise Failure(
            cause,
            f"{self.object} is not in {plan.hole.id}: {what}",
            object=self.object,
            hole=plan.hole.id,
            depth=round(course.deepest, 5),
            wanted=min(self.depth or plan.hole.depth, plan.hole.depth),
            force=round(self._force, 2),
            searched=round(course.searched, 5),
            surface=round(course.surface, 5),
            tried=list(course.tried),
            pulled_back=course.pulled,
            clearance=round(plan.slack, 5),
        )

    # After the insertion.

    def _let_go(self, world: World, held: BeliefObject, plan: InsertionTask) -> Steps:
        pose = inserted_pose(plan, world.control.tcp)
        try:
            yield from world.gripper.release(world.handling.release)
        except GeneratorExit:  # halted, but the fingers go on opening
            world.scene.detach(held.id, pose, plan.hole.id, "let go")
            raise
        world.control.wrist.carry(None)
        world.scene.detach(held.id, pose, plan.hole.id, "inserted")

    def _gone(
        self, world: World, held: BeliefObject, plan: InsertionTask, course: InsertionMotion, hanging: float
    ) -> Steps:
        """Check that the hand has released the object; then finish."""
        yield from world.control.settle()
        after = world.control.load()
        if not is_released(hanging, after):
            world.scene.put(held, "still felt in the open hand")
            raise Failure(
                insert.MISSED,
                f"{held.id} still hangs on the open fingers (load {hanging:.2f} N, then {after:.2f} N)",
                object=held.id,
                hole=plan.hole.id,
                load_before=hanging,
                load_after=after,
            )
        world.journal.note(
            ItemDoneEvent(
                f"{held.id} inserted into {plan.hole.id}",
                self.path,
                object=held.id,
                form=held.form,
                into=plan.hole.id,
                spot=plan.hole.id,
                depth=course.depth,
                force=self._force,
                seconds=self._seconds,
                found_by=course.tried[-1] if course.tried else "",
            )
        )
