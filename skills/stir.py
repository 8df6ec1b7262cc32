"""Stir: push through a heap, so that things come to lie where the hand gets hold of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from picktree.trees import ARM, CAMERA, GRIPPER, In, Skill, Steps, port
from picktree.world import ObjectId, control, perception, planning, push, safety
from picktree.world import world as world_causes

if TYPE_CHECKING:
    from picktree.robot import World


class Stir(Skill):
    """Push through the heap in a tote with closed or open fingers, when nothing in it can be grasped.

    The strokes are planned from the height map. Things against a wall are pushed away from it; otherwise a
    stroke goes through the highest part. After each stroke the arm moves out of the view, and the camera
    looks. A stroke that changed nothing is not repeated. Grasps that failed where the depth has changed may
    be tried again.
    """

    example = """
    Stir: {in: tote}
    """

    tote: In[ObjectId] = port("the tote to stir in", key="in", names="tote")
    camera: In[str] = port("the camera that sees into the tote", default="overhead", names="camera")
    strokes: In[int] = port(
        "maximum number of strokes until the heap has changed", default=4, least=1, most=20
    )
    speed: In[float] = port("speed of the tool during a push", unit="m/s", default=0.08, above=0, most=0.2)
    force: In[float] = port("contact force on the tool that stops a stroke", unit="N", default=15.0, above=0)
    causes = (
        push.NO_STROKE,
        push.STALLED,
        perception.NOT_FOUND,
        perception.NO_IMAGE,
        planning.ANY,
        control.ANY,
        safety.ANY,
        world_causes.DISTURBED,
        world_causes.UNKNOWN_OBJECT,
    )
    uses = (ARM, GRIPPER, CAMERA)
    limit = 240.0

    def run(self, world: World) -> Steps:
        # OpenCV, which the search among strokes takes, is slow to load, and a check does without.
        from picktree.robot.manipulation import closed_loop_pushing, heap_pick, stir

        world.handover.drop()
        closed_loop_pushing.check_hand_is_free(world, self.tote)
        yield from world.move.rest()
        task = heap_pick.HeapPickTask(self.tote, self.path, self.camera, self.force, self.speed)
        yield from stir(world, task, self.strokes)
