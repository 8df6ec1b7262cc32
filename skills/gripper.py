"""OpenGripper and CloseGripper: motions of the fingers alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from picktree.robot.manipulation import held_object
from picktree.trees import GRIPPER, In, Out, Skill, Steps, port
from picktree.world import control

if TYPE_CHECKING:
    from picktree.robot import World


class OpenGripper(Skill):
    """Open the fingers; the belief then has no object in the hand."""

    example = """
    OpenGripper: {width: 60 mm}
    """

    width: In[float] = port(
        "opening between the fingers; 0 for the full opening", unit="m", default=0.0, least=0
    )
    causes = (control.GRIPPER,)
    uses = (GRIPPER,)
    hand_after = "empty"

    def run(self, world: World) -> Steps:
        yield from held_object.open_gripper(world, "let go by OpenGripper", self.width or None)


class CloseGripper(Skill):
    """Close the fingers with a force and report the opening at which they stopped."""

    example = """
    CloseGripper: {force: 20 N, width: "{gap}"}
    """

    force: In[float] = port("grip force of each finger", unit="N", default=30.0, above=0)
    width: Out[float] = port("opening at which the fingers stopped", unit="m")
    causes = (control.GRIPPER,)
    uses = (GRIPPER,)

    def run(self, world: World) -> Steps:
        self.width = yield from world.gripper.close(self.force)
