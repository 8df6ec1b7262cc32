"""Place: put the held object into a bin or down at a point, and check that it is released."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from picktree.robot.manipulation import bin_belief, held_object, object_placement
from picktree.trees import ARM, GRIPPER, In, PortProblem, PortValues, Skill, Steps, port
from picktree.world import ObjectId, control, event_types, grasp, place, planning, safety
from picktree.world import world as world_causes

if TYPE_CHECKING:
    from picktree.robot import World


class Place(Skill):
    """Place the held object into a bin, over the lowest part of its heap, or down at a point.

    The skill checks the hold before the release, and the empty hand after it. An object placed into a tote
    with a heap becomes part of the heap again and does not count as done.
    """

    example = """
    Place: {object: "{item}", into: "{item.destination}"}
    """

    object: In[ObjectId] = port("the object to place, which the hand holds")
    into: In[ObjectId] = port(
        "the bin to place it into; not needed with `at`", default=ObjectId(""), names="bin"
    )
    at: In[list[float]] = port(
        "place of the object's underside, instead of `into`: x, y, z in the world", unit="m", default=[]
    )
    speed: In[float] = port(
        "share of the joints' speed limits: 1 for the full limits", default=1.0, above=0, most=1
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
    hand_before = "full"
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
        bin_belief.apply_bin_exchanges(world, self.path)
        task = object_placement.PlaceTask(self.object, self.path, self.into, tuple(self.at), self.speed)
        with world.step(self.path, "transfer"):
            spot = yield from object_placement.carry_to_place(world, task)
        held = yield from object_placement.lower_and_release(world, task, spot)
        if self.into in world.scene.regions:
            world.scene.remove(held.id, held_object.PUT_BACK)
            message = f"{held.id} is put back into {self.into}"
            world.journal.note(event_types.PutDownEvent(message, self.path, object=held.id))
            return
        world.journal.note(
            event_types.ItemDoneEvent(
                f"{held.id} placed {('into ' + self.into) if self.into else f'at {self.at}'}",
                self.path,
                object=held.id,
                form=held.form,
                into=self.into,
                spot=spot.name,
            )
        )
