"""Opens the hand, or would."""

from picktree.robot import World
from picktree.trees import GRIPPER, Skill, Steps


class Wave(Skill):
    """Open the hand twice."""

    uses = (GRIPPER,)

    def run(self, world: World) -> Steps:
        world.gripper.open()
        yield from world.gripper.open()


NODES = (Wave,)
