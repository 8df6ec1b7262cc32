"""AwaitItems and ExchangeBin: requests to the feed, and waiting for their completion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from picktree.robot.manipulation import bin_belief
from picktree.trees import Doing, In, Skill, Steps, control_flow, port
from picktree.world import Failure, ObjectId, feed
from picktree.world import world as world_causes
from picktree.world.scene import Bin

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.world import FeedSignals


@dataclass
class _Obstruction:
    """Time for which the arm has been in the way of the feed."""

    clearance: float
    """Time that the feed may wait for the arm, s."""
    since: float | None = None
    """Start of the obstruction, simulated s; None: the way is free."""

    def obstructs_for_long(self, signals: FeedSignals, now: float) -> bool:
        """Return whether the arm has been in the way for `clearance`, by the signals at the time `now`, s."""
        if not signals.obstructed:
            self.since = None
        elif self.since is None:
            self.since = now
        else:
            return now - self.since >= self.clearance
        return False


class AwaitItems(Skill):
    """Signal the feed that the robot is ready for more items, and wait for a delivery.

    SUCCESS when items were set down since the last look or wait, or when the feed is exhausted (fact
    `feed_exhausted`). Only a camera finds kind and place of new items: observe next. The arm must be out of
    the feed's way: nothing is set down below it, and no belt runs there. Objects on a belt are removed from
    the belief, since the belt moves them.
    """

    example = """
    AwaitItems: {longest: 2 min}
    """

    longest: In[float] = port("maximum waiting time", unit="s", default=120.0, above=0)
    clearance: In[float] = port(
        "maximum time that the feed waits for the arm to leave, before the node fails",
        unit="s",
        default=5.0,
        least=0,
    )
    causes = (feed.LATE, feed.OBSTRUCTED)
    limit = 10.0
    waits_for = "longest"

    def run(self, world: World) -> Steps:
        began, arm = world.clock.now, _Obstruction(self.clearance)
        requested = False
        while True:
            bin_belief.apply_bin_exchanges(world, self.path)
            signals, waited = world.feed.read(), world.clock.now - began
            if signals.deliveries > world.noticed.deliveries:
                world.noticed.deliveries = signals.deliveries
                return
            if signals.exhausted:
                return
            if not requested:
                world.feed.ready()
                bin_belief.forget_belt_items(world)
                requested = True
            if arm.obstructs_for_long(signals, world.clock.now):
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


class ExchangeBin(Skill):
    """Request an empty bin in place of a full one, and wait until it is there. A tote that the feed of the
    scene fills comes back full, as long as items are left.

    With `fill` it requests an exchange only for a bin whose heap, as seen, is at least that high; for any
    other bin it succeeds immediately. The content of the bin is removed from the belief. The arm must be
    clear of the bin, and so must a held item: bins are not exchanged below the arm.
    """

    flow = control_flow.LeafFlow(empties=("bin", "fill"))
    example = """
    ExchangeBin: {bin: red_bin, fill: 0.6}
    """

    bin: In[ObjectId] = port("the bin to exchange", names="bin")
    level: In[float] = port(
        "least height of the heap for an exchange, as a share of the bin's depth; 0 for any height",
        key="fill",
        default=0.0,
        least=0,
        most=1,
    )
    longest: In[float] = port("maximum waiting time", unit="s", default=120.0, above=0)
    clearance: In[float] = port(
        "maximum time that the exchange waits for the arm to leave, before the node fails",
        unit="s",
        default=5.0,
        least=0,
    )
    causes = (feed.NO_EXCHANGE, feed.OBSTRUCTED, world_causes.UNKNOWN_OBJECT)
    limit = 10.0
    waits_for = "longest"

    def run(self, world: World) -> Steps:
        bin_ = self._bin(world)
        if self.bin in bin_belief.apply_bin_exchanges(world, self.path):
            return  # at an earlier request, whose wait was cut short
        full = bin_belief.bin_fill_level(world, bin_)
        if full < self.level:
            self.feedback_message = f"{self.bin} is {full:.0%} full"
            return
        world.feed.exchange(self.bin)
        yield from self._wait(world, full)

    def _bin(self, world: World) -> Bin:
        found = world.scene.bins.get(self.bin)
        if found is None:
            raise Failure(
                world_causes.UNKNOWN_OBJECT, f"there is no bin {self.bin!r}", known=list(world.scene.bins)
            )
        return found

    def _wait(self, world: World, full: float) -> Doing[None]:
        began, arm = world.clock.now, _Obstruction(self.clearance)
        while True:
            yield
            if self.bin in bin_belief.apply_bin_exchanges(world, self.path):
                return
            signals, waited = world.feed.read(), world.clock.now - began
            if arm.obstructs_for_long(signals, world.clock.now):
                raise Failure(
                    feed.OBSTRUCTED,
                    f"{self.bin} has not been exchanged for {self.clearance:g} s: the arm is over it",
                    bin=self.bin,
                    waited=waited,
                    fill=full,
                )
            if waited >= self.longest:
                raise Failure(
                    feed.NO_EXCHANGE,
                    f"no empty bin replaced {self.bin} within {self.longest:g} s",
                    bin=self.bin,
                    waited=waited,
                    fill=full,
                    busy=signals.busy,
                )
