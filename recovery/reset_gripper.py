"""ResetGripper: move the empty fingers open and closed, and measure whether they follow."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..manipulation.place.dropped_objects import open_gripper
from ..trees.ports import In, port
from ..trees.skill import GRIPPER, Doing, Skill, Steps
from ..world.causes import Failure, control, grasp, safety
from ..world.events.skill_events import GripperResetEvent

if TYPE_CHECKING:
    from ..cell.world import World


class ResetGripper(Skill):
    """Open the fingers, close them, open them again, and measure each time whether they did.

    For a gripper that did not do what it was told to. Between two tries it waits, since what jams may come
    free by itself. The hand must be empty; with `drop` what is held is let go first, where the hand is.
    """

    example = """
    ResetGripper: {tries: 3, wait: 2 s}
    """

    drop: In[bool] = port("whether to let go first of what the hand holds, where it is", default=False)
    tries: In[int] = port("how often the fingers are moved to and fro", default=3, least=1, most=20)
    wait: In[float] = port("time between two tries", unit="s", default=2.0, least=0)
    force: In[float] = port("with which each finger closes", unit="N", default=10.0, above=0)
    causes = (control.GRIPPER, control.TIMEOUT, grasp.NO_CANDIDATE, safety.ANY)
    uses = (GRIPPER,)
    hand_after = "empty"

    def run(self, world: World) -> Steps:
        held = world.scene.held
        if held is not None and not self.drop:
            raise Failure(
                grasp.NO_CANDIDATE, f"the hand is not free: it holds {held.id}", object=held.id, held=held.id
            )
        yield from world.control.settle()
        said = ""
        for number in range(1, self.tries + 1):
            said = yield from self._to_and_fro(world)
            if not said:
                world.journal.note(GripperResetEvent(f"the fingers follow again, at try {number}", self.path))
                return
            yield from self._pause(world)
        raise Failure(
            control.GRIPPER,
            f"after {self.tries} tries the fingers still do not follow: {said}",
            width=world.gripper.width,
            tries=self.tries,
        )

    def _to_and_fro(self, world: World) -> Doing[str]:
        """Open, close and open the fingers; return the error, empty when they follow."""
        most = world.robot.description.gripper.max_width
        for opens in (True, False, True):
            before = world.gripper.width
            try:
                if opens:
                    yield from open_gripper(world, "let go by ResetGripper")
                else:
                    yield from world.gripper.close(self.force)
            except Failure as failure:
                if failure.cause not in (control.TIMEOUT, control.GRIPPER):
                    raise
                return failure.message
            width = world.gripper.width
            if opens and width < most - MAX_OPENING_ERROR:
                return f"they opened to {width * 1000:.0f} mm of {most * 1000:.0f} mm"
            if not opens and before - width < MIN_CLOSING_SHARE * before:
                return f"they closed from {before * 1000:.0f} mm to {width * 1000:.0f} mm only"
        return ""

    def _pause(self, world: World) -> Steps:
        until = world.clock.now + self.wait
        while world.clock.now < until - 1e-9:
            yield


MAX_OPENING_ERROR = 5e-3
"""Opening error above which open fingers do not follow, m."""
MIN_CLOSING_SHARE = 0.5
"""Share of the opening by which the fingers must close; an object may be between them."""
