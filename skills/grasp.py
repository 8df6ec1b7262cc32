"""Grasp: grip an object, check that it is held, and lift it clear."""

from __future__ import annotations

from typing import TYPE_CHECKING

from picktree.robot.manipulation import held_object, object_pick
from picktree.trees import ARM, GRIPPER, Doing, In, Skill, Steps, port
from picktree.world import ObjectId, control, grasp, perception, planning, safety
from picktree.world import world as world_causes

if TYPE_CHECKING:
    from picktree.robot import World


class Grasp(Skill):
    """Grasp an object between the fingers from above and lift it clear.

    Each candidate has a grasp and the place where the grasp leads; candidates are ranked. A candidate counts
    only if the hand fits between the neighbours and the arm reaches it. From there the arm must also be able
    to put the object where it belongs. Where the hand does not fit upright, as beside a wall, it leans. The
    fingers close until contact, and the hand gives way to the finger that touches first. Finger opening and
    load on the wrist show whether the object is held; an object that slips is gripped more firmly. An object
    that was missed or lost is grasped once more, if it is seen from there or was lost where it was gripped.
    """

    example = """
    Grasp: {object: "{item}", force: 20 N}
    """

    object: In[ObjectId] = port("the object to grasp")
    force: In[float] = port(
        "maximum grip force of each finger: the applied force follows from weight and friction, and "
        "is limited by this port, by the item (`force_limit`) and by the gripper",
        unit="N",
        default=70.0,
        above=0,
    )
    speed: In[float] = port(
        "share of the joints' speed limits: 1 for the full limits", default=1.0, above=0, most=1
    )
    onward: In[bool] = port(
        "whether lift and transfer to the destination are one motion, for a `Place` as the next "
        "skill; the arm stops by itself when no `Place` follows",
        default=True,
    )
    servo: In[bool] = port(
        "whether the hand stops over the object and corrects the grasp by an image of the hand "
        "camera, if the robot has one",
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
        if (yield from held_object.is_in_hand(world, self.object, self.path)):
            return
        task = object_pick.PickTask(self.object, self.path, self.force, self.speed, self.onward, self.servo)
        lost = yield from self._pick(world, task)
        if (
            lost is not None
            and (again := (yield from object_pick.relocate_object(world, task, lost))) is not None
        ):
            lost = yield from self._pick(world, again, firmer=lost.gripped)
        if lost is not None:
            raise lost.failure

    def _pick(
        self, world: World, task: object_pick.PickTask, *, firmer: bool = False
    ) -> Doing[object_pick.LostGrasp | None]:
        """Pick with the best remaining candidate. None: the object is lifted and held."""
        approached = yield from object_pick.approach_object(world, task)
        grip = yield from object_pick.close_on_object(world, task, approached, firmer=firmer)
        return (yield from object_pick.lift_object(world, task, grip))
