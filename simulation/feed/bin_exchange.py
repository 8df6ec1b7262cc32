"""Somebody who puts an empty bin in a full one's place when the robot asks."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from ...errors import PicktreeError
from ...world.journal import JournalEvent
from ...world.scene.description import Bin, SceneDescription
from ...world.values import ObjectId
from ..scoring.truth import TrueBody
from .cell_interface import LOOK, FeedCell
from .light_curtain import Zone

MARGIN = 0.05
"""Between the bin and the arm, m."""


@dataclass(frozen=True, slots=True)
class ExchangeState:
    """What was asked for and done."""

    asked: tuple[ObjectId, ...] = ()
    """Bins in the order in which they were asked for; the first is being exchanged."""
    worked: float = 0.0
    """How long somebody has been at it with the arm out of the way, s."""
    obstructed: bool = False
    done: Mapping[ObjectId, int] = field(default_factory=dict[ObjectId, int])
    """How often each bin was exchanged."""


class BinExchange:
    """One person: bins are exchanged one after the other. Without `exchange` in the scene nobody hears."""

    def __init__(self, scene: SceneDescription, cell: FeedCell) -> None:
        self._cell = cell
        self._bins: Mapping[str, Bin] = {each.id: each for each in scene.bins}
        self._exchange = scene.exchange
        self._asked: list[ObjectId] = []
        self._worked = 0.0
        self._done: Counter[ObjectId] = Counter()
        self.obstructed = False
        self._events: list[JournalEvent] = []

    @property
    def busy(self) -> bool:
        return bool(self._asked)

    @property
    def done(self) -> Mapping[ObjectId, int]:
        """How often each bin was exchanged; a copy."""
        return dict(self._done)

    def ask(self, bin_id: ObjectId) -> None:
        """Raises PicktreeError for what is no bin of the scene."""
        if bin_id not in self._bins:
            raise PicktreeError(f"there is no bin {bin_id!r}; known: {', '.join(self._bins)}")
        if self._exchange is not None and bin_id not in self._asked:
            self._asked.append(bin_id)

    def stepped(self, step: int) -> None:
        """A control period has passed, the step-th of the run."""
        if not self._asked or step % LOOK:
            return
        each = self._bins[self._asked[0]]
        self.obstructed = self._cell.arm_over(_zone(each))
        if self.obstructed:
            return
        self._worked += LOOK * self._cell.period
        assert self._exchange is not None
        if self._worked >= self._exchange.seconds - 1e-9:
            self._carry_out(each)

    def take_events(self) -> tuple[JournalEvent, ...]:
        """What has happened since it was asked last."""
        events, self._events = tuple(self._events), []
        return events

    def state(self) -> ExchangeState:
        """For a checkpoint."""
        return ExchangeState(tuple(self._asked), self._worked, self.obstructed, dict(self._done))

    def restore(self, state: ExchangeState) -> None:
        self._asked, self._worked = list(state.asked), state.worked
        self.obstructed, self._done = state.obstructed, Counter(state.done)

    def _carry_out(self, each: Bin) -> None:
        inside = [body.id for body in self._cell.here() if goes_with(each, body)]
        self._cell.take_with(each.id, inside)
        self._asked.pop(0)
        self._worked = 0.0
        self._done[each.id] += 1
        number = self._done[each.id]
        message = f"{each.id} is exchanged for an empty one, with {_counted(len(inside))} in it"
        self._events.append(
            JournalEvent(
                "bin_exchanged", message, "", {"bin": each.id, "items": len(inside), "number": number}
            )
        )


def goes_with(each: Bin, body: TrueBody) -> bool:
    """Whether a bin takes the item along when it is carried off: its centre is over the bin and above the
    bin's underside, be it inside, on the heap or across a wall. What leans on it from outside stays."""
    x, y, z = (each.pose.inverse() @ body.pose).position
    return abs(x) < each.size[0] / 2 and abs(y) < each.size[1] / 2 and z > 0.0


def _zone(each: Bin) -> Zone:
    x, y, _ = each.pose.position
    across = each.pose.rotation()[:, 0]
    yaw = math.atan2(float(across[1]), float(across[0]))
    return Zone((x, y), yaw, (each.size[0] / 2, each.size[1] / 2)).grown(MARGIN)


def _counted(items: int) -> str:
    return "1 item" if items == 1 else f"{items} items"
