"""SafeRetreat: come to rest, acknowledge a safety stop, get clear, and go home."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

from ..trees.declaration import Hand
from ..trees.ports import In, port
from ..trees.references import Binding, Constant
from ..trees.skill import ARM, GRIPPER, Skill, Steps
from ..world.causes import Failure, control, planning, safety
from ..world.causes import world as world_causes
from ..world.journal import Happened
from ..world.manipulation.dropping import open_hand
from ..world.manipulation.escape import escape
from ..world.motion.requests import NamedGoal

if TYPE_CHECKING:
    from ..world.world import World


class SafeRetreat(Skill):
    """Brake, acknowledge a latched safety stop, move clear of what is near, then go to a safe pose.

    The way out is straight up, else back along the way that the arm came; never through an obstacle.
    When there is no safe way the skill says so and stays where it is.
    """

    example = """
    SafeRetreat: {pose: home, hand: open}
    """

    pose: In[str] = port("named pose of the robot to end in", default="home", names="pose")
    hand: In[Literal["keep", "open"]] = port(
        "a held object: keep it, or open the hand and drop it where it is", default="keep"
    )
    speed: In[float] = port(
        "share of the joints' speed limits: 1 for as fast as allowed", default=0.4, above=0, most=1
    )
    causes = (planning.ANY, control.ANY, safety.ANY, world_causes.DISTURBED)
    uses = (ARM, GRIPPER)
    hand_after = "kept"

    @classmethod
    def hand_with(cls, ports: Mapping[str, Binding]) -> tuple[Hand, tuple[Hand, ...]]:
        # Even where it finds no way, nothing better can be done about what is held.
        match ports.get("hand", Constant("keep", "keep")):
            case Constant(value="keep"):
                return "kept", ("kept",)
            case Constant():
                return "empty", ("kept", "empty")
            case _:
                return "kept", ("kept", "empty")

    def run(self, world: World) -> Steps:
        yield from world.move.rest()
        stop = world.control.monitor.stopped
        if stop is not None:
            world.control.monitor.acknowledge()
            world.journal.note(Happened("safety_acknowledged", f"{stop.cause}: {stop.message}", self.path))
        if self.hand == "open":
            yield from open_hand(world, "let go by SafeRetreat")
        slowly = world.handling.scaling(self.speed)
        yield from escape(world, slowly, self.path)
        try:
            plan = yield from world.plan.to(NamedGoal(self.pose), scaling=slowly, node=self.path)
        except Failure as failure:
            raise Failure(
                failure.cause, f"there is no safe way to {self.pose}: {failure.message}", **failure.evidence
            ) from failure
        yield from world.move.along(plan.trajectory, guard=world.handling.guard, node=self.path)
