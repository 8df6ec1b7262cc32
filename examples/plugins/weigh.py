"""A skill that weighs what is held, and fails when that is too heavy."""

from picktree.skills.plugin import (
    ARM,
    Cause,
    Failure,
    In,
    Out,
    Skill,
    Steps,
    World,
    control,
    grasp,
    port,
    register_cause,
    safety,
)

HEAVY = register_cause(Cause("weigh.heavy", "An item weighs more than it may.", "take it elsewhere"))


class Weigh(Skill):
    """Hold still and weigh what is in the hand, to about 15 g."""

    most: In[float] = port("greatest mass with which it succeeds", unit="kg", default=0.13)
    mass: Out[float] = port("what it weighs", unit="kg")
    causes = (HEAVY, grasp.SLIPPED, control.ANY, safety.ANY)
    uses = (ARM,)
    hand_after = "full"
    example = 'Weigh: {most: 130 g, mass: "{mass}"}'

    def run(self, world: World) -> Steps:
        yield from world.move.settle()
        held = world.scene.held
        if held is None:
            raise Failure(grasp.SLIPPED, "nothing is held that could be weighed")
        self.mass = world.control.load() / 9.81
        if self.mass > self.most:
            message = f"{held.id} weighs {1000 * self.mass:.0f} g, more than {1000 * self.most:.0f} g"
            raise Failure(HEAVY, message, object=held.id, mass=self.mass)


NODES = (Weigh,)
