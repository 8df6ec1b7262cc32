"""GoTo: move the arm to a named configuration."""

from __future__ import annotations

from ..trees.ports import In, port
from ..trees.skill import ARM, Skill, Steps
from ..world.causes import control, planning, safety
from ..world.motion.requests import NamedGoal
from ..world.world import World


class GoTo(Skill):
    """Move the arm, free of collisions, to a named configuration of the robot file."""

    pose: In[str] = port("name of the configuration", default="home")
    causes = (planning.ANY, control.ANY, safety.ANY)
    uses = (ARM,)

    def run(self, world: World) -> Steps:
        plan = yield from world.plan.to(NamedGoal(self.pose), node=self.path)
        yield from world.move.along(plan.trajectory, node=self.path)
