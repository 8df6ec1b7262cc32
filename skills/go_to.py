"""GoTo: move the arm to a named configuration."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..trees.ports import In, port
from ..trees.skill import ARM, Skill, Steps
from ..world.causes import control, planning, safety
from ..world.motion.requests import NamedGoal

if TYPE_CHECKING:
    from ..world.world import World


class GoTo(Skill):
    """Move the arm, free of collisions, to a named configuration of the robot file."""

    example = """
    GoTo: {pose: observe, speed: 0.5}
    """

    pose: In[str] = port("named pose of the robot", default="home", names="pose")
    speed: In[float] = port(
        "share of the joints' speed limits: 1 for as fast as allowed", default=1.0, above=0, most=1
    )
    causes = (planning.ANY, control.ANY, safety.ANY)
    uses = (ARM,)

    def run(self, world: World) -> Steps:
        plan = yield from world.plan.to(
            NamedGoal(self.pose), scaling=world.handling.scaling(self.speed), node=self.path
        )
        yield from world.move.along(plan.trajectory, node=self.path)
