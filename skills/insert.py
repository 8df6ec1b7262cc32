"""Insert: put the held object into a hole, searched by contact."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from picktree.robot.control import InsertionParameters
from picktree.robot.manipulation import held_object, insertion, withdraw
from picktree.trees import ARM, GRIPPER, In, Skill, Steps, port
from picktree.world import ObjectId, control, event_types, grasp, insert, place, planning, safety
from picktree.world import world as world_causes

if TYPE_CHECKING:
    from picktree.robot import World


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
        "the hole, or a fixture, whose free hole with the closest fit is used; by default the "
        "destination of the object",
        default=ObjectId(""),
        names="hole",
    )
    search: In[Literal["tilt", "spiral", "none"]] = port(
        "search for the mouth: `tilt`, with a tilted object and one point of it first, then a spiral; "
        "`spiral`, upright over the surface; `none`, straight down",
        default="tilt",
    )
    force: In[float] = port("force of the object into the hole", unit="N", default=15.0, above=0, most=40)
    press: In[float] = port(
        "force of the object on the surface during the search", unit="N", default=8.0, above=0, most=25
    )
    grip: In[float] = port(
        "grip force of each finger during the insertion; limited by `force_limit` of the item",
        unit="N",
        default=30.0,
        above=0,
    )
    depth: In[float] = port(
        "depth of the insertion; 0 for down to the bottom", unit="m", default=0.0, least=0
    )
    pitch: In[float] = port("distance between two turns of the spiral", unit="m", default=0.001, above=0)
    attempts: In[int] = port(
        "maximum number of searches, each with other parameters", default=3, least=1, most=10
    )
    speed: In[float] = port(
        "share of the joints' speed limits on the way to the hole: 1 for the full limits",
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
    hand_before = "full"
    hand_after = "empty"

    def run(self, world: World) -> Steps:
        world.handover.drop()
        held, _ = yield from held_object.check_held_object(world, self.object)
        task = yield from insertion.choose_hole(world, held, self.into, self.path)
        with world.step(self.path, "transfer"):
            yield from insertion.move_over_hole(world, self.object, task, self.speed, self.path)
        held, _ = yield from held_object.check_held_object(world, self.object)
        hanging = world.control.load()
        touch = InsertionParameters(
            press=self.press, push=self.force, pitch=self.pitch, attempts=self.attempts
        )
        depth = self.depth or task.hole.depth
        result = yield from insertion.insert_by_contact(
            world, held, task, self.search, touch, self.grip, depth, self.path
        )
        if not result.inserted:
            raise (yield from insertion.explain_missed_insertion(world, self.object, task, result))
        with world.step(self.path, "withdraw"):
            yield from withdraw(world, self.path)
        yield from held_object.confirm_release(world, held, hanging, insert.MISSED, hole=task.hole.id)
        world.journal.note(
            event_types.ItemDoneEvent(
                f"{held.id} inserted into {task.hole.id}",
                self.path,
                object=held.id,
                form=held.form,
                into=task.hole.id,
                spot=task.hole.id,
                depth=result.motion.depth,
                force=result.force,
                seconds=result.seconds,
                found_by=result.motion.tried[-1] if result.motion.tried else "",
            )
        )
