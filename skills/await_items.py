"""AwaitItems: report to the feed that the robot is ready, and wait for items."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..manipulation.place.dropped_objects import apply_bin_exchanges, forget_belt_items
from ..trees.ports import In, port
from ..trees.skill import Skill, Steps
from ..world.causes import Failure, feed

if TYPE_CHECKING:
    from ..skill_world.world import World


class AwaitItems(Skill):
    """Tell the feed that the robot is ready for more, and wait until something has come.

    SUCCESS when something was set down since the robot last looked or waited, or when the feed is exhausted:
    the fact `feed_exhausted` tells which. What came, and where it lies, only a camera says: observe next. The
    arm must be out of the feed's way, for nothing is set down below it, and no belt runs there. What is
    believed on a belt is forgotten, for it rides on.
    """

    example = """
    AwaitItems: {longest: 2 min}
    """

    longest: In[float] = port("how long it waits at most", unit="s", default=120.0, above=0)
    clearance: In[float] = port(
        "how long the feed may wait for the arm to leave before it fails", unit="s", default=5.0, least=0
    )
    causes = (feed.LATE, feed.OBSTRUCTED)
    limit = 10.0
    waits_for = "longest"

    def run(self, world: World) -> Steps:
        began = world.clock.now
        obstructed_since: float | None = None
        asked = False
        while True:
            apply_bin_exchanges(world, self.path)
            signals, waited = world.feed.read(), world.clock.now - began
            if signals.deliveries > world.noticed.deliveries:
                world.noticed.deliveries = signals.deliveries
                return
            if signals.exhausted:
                return
            if not asked:
                world.feed.ready()
                forget_belt_items(world)
                asked = True
            if not signals.obstructed:
                obstructed_since = None
            elif obstructed_since is None:
                obstructed_since = world.clock.now
            elif world.clock.now - obstructed_since >= self.clearance:
                raise Failure(
                    feed.OBSTRUCTED,
                    f"the feed has waited {self.clearance:g} s for the arm to leave, and sets nothing down",
                    waited=waited,
                    deliveries=signals.deliveries,
                )
            if waited >= self.longest:
                raise Failure(
                    feed.LATE,
                    f"nothing came within {self.longest:g} s",
                    waited=waited,
                    busy=signals.busy,
                    obstructed=signals.obstructed,
                    deliveries=signals.deliveries,
                )
            yield
