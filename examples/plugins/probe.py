"""A skill of one's own in one file: a mission beside it says `plugins: [plugins/probe.py]`."""

from picktree.skills.plugin import (
    ARM,
    GRIPPER,
    Cause,
    Failure,
    In,
    Out,
    Skill,
    Steps,
    World,
    control,
    port,
    register_cause,
    safety,
)

NOTHING = register_cause(Cause("probe.nothing", "Nothing is there to be felt.", "probe deeper"))


class Probe(Skill):
    """Feel with closed fingers, straight down, how high the surface below is; then go back up."""

    depth: In[float] = port("how far to feel down", unit="m", default=0.5)
    height: Out[float] = port("height in the world of what was felt", unit="m")
    causes = (NOTHING, control.ANY, safety.ANY)
    uses = (ARM, GRIPPER)
    example = 'Probe: {depth: 400 mm, height: "{table}"}'

    def run(self, world: World) -> Steps:
        yield from world.gripper.close(force=10.0)
        felt = yield from world.move.guarded((0, 0, -1), self.depth, force=6.0, speed=0.05, node=self.path)
        yield from world.move.guarded((0, 0, 1), felt.travelled, force=20.0, speed=0.2, node=self.path)
        if not felt.contact:
            raise Failure(NOTHING, f"nothing within {self.depth:.2f} m below the hand", depth=self.depth)
        self.height = felt.pose.position[2] - world.robot.description.gripper.tip


NODES = (Probe,)
