"""PickAny: pick any thing out of a tote or a pile."""

from __future__ import annotations

from typing import TYPE_CHECKING

from picktree.trees import ARM, CAMERA, GRIPPER, In, Out, Skill, Steps, port
from picktree.world import ObjectId, control, grasp, perception, planning, safety
from picktree.world import world as world_causes

if TYPE_CHECKING:
    from picktree.robot import World


class PickAny(Skill):
    """Pick some thing out of a tote or a pile, without knowing its shape, size or weight.

    The camera maps the heights of the heap. The hand's shape is swept over the map: vertical grasps come
    first, then tilted ones, then grasps that meet looser demands. The weight at the wrist after the lift
    shows whether something is held. The thing then becomes an object of the belief with hull, colour and
    weight, for `Place`. A thing that the hand holds already is kept. A place where a grasp has failed is left
    out until the depth there changes.
    """

    example = """
    PickAny: {from: tote, out: "{thing}"}
    """

    tote: In[ObjectId] = port("the tote, or the fixture with a pile, to pick from", key="from", names="tote")
    thing: Out[ObjectId] = port("id of the thing in the hand", key="out")
    camera: In[str] = port("the camera that sees the heap", default="overhead", names="camera")
    force: In[float] = port("maximum grip force of each finger", unit="N", default=30.0, above=0)
    attempts: In[int] = port("maximum number of grasps, with a look before each", default=3, least=1)
    speed: In[float] = port(
        "share of the joints' speed limits: 1 for the full limits", default=1.0, above=0, most=1
    )
    causes = (
        perception.NOT_FOUND,
        perception.NO_IMAGE,
        grasp.NO_CANDIDATE,
        grasp.MISSED,
        grasp.SLIPPED,
        planning.ANY,
        control.ANY,
        safety.ANY,
        world_causes.DISTURBED,
        world_causes.UNKNOWN_OBJECT,
    )
    hand_after = "full"
    uses = (ARM, GRIPPER, CAMERA)
    limit = 240.0

    def run(self, world: World) -> Steps:
        # OpenCV, which the search among grasps takes, is slow to load, and a check does without.
        from picktree.robot.manipulation import heap_pick

        world.handover.drop()
        yield from world.move.rest()
        task = heap_pick.HeapPickTask(self.tote, self.path, self.camera, self.force, self.speed)
        held = yield from heap_pick.thing_in_hand(world)
        self.thing = held or (yield from heap_pick.pick_any(world, task, self.attempts))
