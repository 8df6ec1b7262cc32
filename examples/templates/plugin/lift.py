"""A skill of my own: the mission beside this file says `plugins: [lift.py]`."""

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
    port,
    register_cause,
    safety,
)

BLOCKED = register_cause(Cause("lift.blocked", "Something is in the way above the hand.", "retreat safely"))


class Lift(Skill):
    """Raise the hand straight up, and stop where it meets something."""

    height: In[float] = port("distance to rise", unit="m", default=0.05)
    risen: Out[float] = port("distance that it rose", unit="m")
    causes = (BLOCKED, control.ANY, safety.ANY)  # all that it may fail with, for `when:` and the linter
    uses = (ARM,)  # two users of the arm cannot run at once
    example = 'Lift: {height: 50 mm, risen: "{risen}"}'

    def run(self, world: World) -> Steps:  # each yield is one tick; return succeeds, raise Failure fails
        moved = yield from world.move.guarded((0, 0, 1), self.height, force=10.0, speed=0.1, node=self.path)
        self.risen = moved.travelled
        if moved.contact:
            raise Failure(BLOCKED, f"met something after {moved.travelled:.3f} m", travelled=moved.travelled)


NODES = (Lift,)
