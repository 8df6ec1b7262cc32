"""Present: hold what is in the hand before a camera, and learn what it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..trees.ports import In, port
from ..trees.skill import ARM, CAMERA, Skill, Steps
from ..world.causes import control, grasp, perception, planning, safety
from ..world.causes import world as world_causes
from ..world.values import ObjectId

if TYPE_CHECKING:
    from ..skill_world.world import World


class Present(Skill):
    """Hold the thing in the hand before a fixed camera, look at it from both sides of the hand, and learn its
    hull, colour, size and tag.

    The pose follows from the camera's place and field of view; the fingers are beside the thing, so that they
    do not hide it. Two different tags, or surfaces of two colours, show that more than one thing is in the
    hand: the skill fails with `grasp.double`, and the hand still holds them. What is learnt is kept for a
    thing that nobody has catalogued; an object of a known kind is only looked at.
    """

    example = """
    Present: {object: "{thing}", until_classified: true}
    """

    object: In[ObjectId] = port("the object to present, which the hand holds")
    camera: In[str] = port("the fixed camera to hold it before", default="overhead", names="camera")
    looks: In[int] = port("looks at most: 2 for both sides of the hand", default=2, least=1, most=2)
    until_classified: In[bool] = port(
        "whether it ends as soon as the scene's `destinations` know what they ask for; at once when they do "
        "already",
        default=False,
    )
    speed: In[float] = port(
        "share of the joints' speed limits: 1 for as fast as allowed", default=0.7, above=0, most=1
    )
    causes = (
        grasp.DOUBLE,
        grasp.SLIPPED,
        perception.NOT_FOUND,
        perception.NO_IMAGE,
        planning.ANY,
        control.ANY,
        safety.ANY,
        world_causes.UNKNOWN_OBJECT,
    )
    uses = (ARM, CAMERA)
    hand_before = "full"
    hand_after = "full"
    limit = 120.0

    def run(self, world: World) -> Steps:
        # Perception of what is held is slow to load, and a check does without.
        from ..manipulation.pick.presentation import PresentTask, present

        world.handover.drop()
        yield from world.move.rest()
        task = PresentTask(self.object, self.path, self.camera, self.looks, self.until_classified, self.speed)
        yield from present(world, task)
