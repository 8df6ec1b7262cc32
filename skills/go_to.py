"""GoTo: move the arm to a named configuration."""

from __future__ import annotations

from typing import TYPE_CHECKING

from picktree.robot.manipulation import follow_with_replanning
from picktree.robot.planning import NamedGoal
from picktree.trees import ARM, In, Skill, Steps, port
from picktree.world import control, planning, safety

if TYPE_CHECKING:
    from picktree.robot import World


class GoTo(Skill):
    """Move the arm, free of collisions, to a named configuration of the robot file.

    When the camera shows a new obstacle in its path, the arm stops and replans.
    """

    example = """
    GoTo: {pose: observe, speed: 0.5}
    """

    pose: In[str] = port("named pose of the robot", default="home", names="pose")
    speed: In[float] = port(
        "share of the joints' speed limits: 1 for the full limits", default=1.0, above=0, most=1
    )
    causes = (planning.ANY, control.ANY, safety.ANY)
    uses = (ARM,)

    def run(self, world: World) -> Steps:
        goal, scaling = NamedGoal(self.pose), world.handling.scaling(self.speed)
        yield from follow_with_replanning(
            world, lambda: world.plan.to(goal, scaling=scaling, node=self.path), node=self.path
        )
