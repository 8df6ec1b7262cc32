"""Belts of both backends: surface, speed ramps, light barrier, and the feed that sets items down at the
upstream end.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from picktree.files import PicktreeError
from picktree.world import Box, ObjectId, Pose, Vector3, bottom, event_types
from picktree.world.scene import (
    MIN_BELT_GAP,
    SPACING_SPREAD,
    Belt,
    Fixture,
    SceneDescription,
    reach,
)

from .feed_cell import CELL_CHECK_INTERVAL, DROP_HEIGHT, MAX_SETTLING_TIME, FeedCell, ItemSource, Zone
from .footprints import distance, footprint
from .spawn import LooseItem, SpawnedItem, draw_load

MIN_ITEM_GAP = 0.005
"""Least gap between two items at the light barrier, m: at an item's rim the barrier may flicker."""

BELT_ACCELERATION = 0.25
"""Acceleration of a belt when it starts and stops, m/s².

A ball or lying cylinder of radius r keeps its place on the belt below g·c/r. With rolling friction c of 1 mm
and r of 20 mm that is 0.49 m/s². An upright body would slip only at g times its friction. A can topples only
at g times its radius over half its height: ten times as much.
"""
BEAM_HEIGHT = 0.004
"""Height of the light barrier above the belt, m: half a plate's thickness."""


@dataclass(frozen=True, slots=True)
class BeltState:
    """Complete state of a belt."""

    id: ObjectId
    wanted: bool = False
    """Whether the belt has the command to run."""
    speed: float = 0.0
    """Commanded speed in the last step, m/s; it follows ramps."""
    travelled: float = 0.0
    """Travel of the surface since the run began, m."""
    offset: float = 0.0
    """Offset of the slab from its place, m; 0 without physics."""

    @property
    def moving(self) -> bool:
        return self.wanted or self.speed > 0.0

    def after(self, top_speed: float, period: float) -> BeltState:
        """Return the state one control period later."""
        aim = top_speed if self.wanted else 0.0
        change = BELT_ACCELERATION * period
        speed = min(max(aim, self.speed - change), self.speed + change)
        return replace(self, speed=speed, travelled=self.travelled + speed * period)


@dataclass(frozen=True, slots=True)
class BeltSurface:
    """Level top of a belt. `pose` is its middle in the world, with x along the direction of travel."""

    pose: Pose
    length: float
    width: float

    @classmethod
    def of(cls, fixture: Fixture) -> BeltSurface:
        assert isinstance(fixture.shape, Box)
        length, width, height = fixture.shape.size
        return cls(fixture.pose @ Pose((0.0, 0.0, height / 2)), length, width)

    @property
    def height(self) -> float:
        """Height of the surface in the world, m."""
        return self.pose.position[2]

    def at(self, along: float, across: float = 0.0, above: float = 0.0) -> Vector3:
        """Return the point in the world at an offset in m from the middle."""
        return (self.pose @ Pose((along, across, above))).position

    def beam(self, along: float) -> tuple[Vector3, Vector3]:
        """Return the ends in the world of a light barrier that crosses the belt at `along` m from the
        middle."""
        half = self.width / 2
        return self.at(along, -half, BEAM_HEIGHT), self.at(along, half, BEAM_HEIGHT)

    def place(self, point: Vector3) -> tuple[float, float]:
        """Return how far along and across from the middle a point in the world lies, seen from above, m."""
        along, across, _ = (self.pose.inverse() @ Pose(point)).position
        return along, across

    def carries(self, point: Vector3) -> bool:
        """Return whether a point in the world lies over the belt, seen from above."""
        along, across = self.place(point)
        return abs(along) <= self.length / 2 and abs(across) <= self.width / 2


class BeltDrive(ABC):
    """One belt as the feed sees it."""

    def __init__(self, belt: Belt, fixture: Fixture) -> None:
        self.belt = belt
        self.track = BeltSurface.of(fixture)
        self.state = BeltState(belt.id)

    @property
    def id(self) -> ObjectId:
        return self.belt.id

    @property
    def moving(self) -> bool:
        """Whether the belt runs, starts or stops."""
        return self.state.moving

    @property
    def travelled(self) -> float:
        """Travel of the surface since the run began, m."""
        return self.state.travelled

    def go(self) -> None:
        """Start the belt, if it does not run already."""
        self.state = replace(self.state, wanted=True)

    def halt(self) -> None:
        """Stop the belt by its ramp."""
        self.state = replace(self.state, wanted=False)

    @abstractmethod
    def interrupted(self) -> bool:
        """Return whether something interrupts the light barrier now."""


def check_belts(saved: Iterable[BeltState], belts: Iterable[ObjectId]) -> None:
    """Raise PicktreeError when a checkpoint is of other belts than the scene's."""
    names, known = [s.id for s in saved], list(belts)
    if names != known:
        raise PicktreeError(f"the checkpoint's belts are {names}, but the scene has {known}")


EDGE_DISTANCE = 0.005
"""Distance of new items from the belt's edges, m."""
Phase: TypeAlias = Literal["standing", "running", "stopping"]


@dataclass(frozen=True, slots=True)
class BeltFeedState:
    """Progress of a feed entry with a belt."""

    phase: Phase = "standing"
    """Phase of the belt. `running` lasts from the robot's request until a new item has come, also while the
    arm is in the way."""
    put: int = 0
    """Number of items set down so far."""
    last: float = 0.0
    """Travel of the belt when the last item was set down, m."""
    seen: float | None = None
    """Travel of the belt when the light barrier was last interrupted in this run, m; None: not in this
    run."""
    obstructed: bool = False
    runs: int = 0
    put_before: int = 0
    """Number of items set down before this run of the belt."""
    until: float = 0.0
    """Simulated time until which the feed waits for items to come to rest, s."""
    deliveries: int = 0


class BeltFeed(ItemSource[BeltFeedState]):
    """Feed entry with a belt.

    The belt stops when its light barrier detects another item; an item that was left at the barrier rides on.
    After the last item the belt stops once that item is at the barrier.
    """

    def __init__(
        self, scene: SceneDescription, number: int, cell: FeedCell, drive: BeltDrive, seed: int
    ) -> None:
        super().__init__(scene, number, cell, seed, BeltFeedState())
        self._drive = drive
        load = self._delivery.load
        # Each round of the mixture has the same number of each colour.
        self._round = replace(load, counts={kind: n * len(load.colours) for kind, n in load.counts.items()})
        self._size = self._round.number
        widest = max(reach(scene.entry(kind).shape, load.lying) for kind in load.counts)
        track = drive.track
        self._start = -track.length / 2 + widest + EDGE_DISTANCE
        self._aside = max(0.0, track.width / 2 - widest - EDGE_DISTANCE)
        self._rest = max(0.0, drive.belt.eye - self._start - widest)
        self._zone = Zone.around(track.pose, (track.length, track.width))
        self._next = self._drawn(0)

    @property
    def exhausted(self) -> bool:
        return self._state.phase == "standing" and self._all_at_barrier

    @property
    def busy(self) -> bool:
        return self._state.phase != "standing"

    @property
    def obstructed(self) -> bool:
        return self._state.obstructed

    def ready(self) -> None:
        """Start the belt, unless it is running, stopping or exhausted."""
        if not self.busy and not self.exhausted:
            state = self._state
            self._state = replace(state, phase="running", runs=state.runs + 1, put_before=state.put)

    def stepped(self, step: int) -> None:
        match self._state.phase:
            case "standing":
                return
            case "running":
                if step % CELL_CHECK_INTERVAL == 0:
                    self._mind_the_arm()
                if self._drive.moving:
                    self._run()
            case "stopping":
                if step % CELL_CHECK_INTERVAL == 0 and not self._drive.moving:
                    self._wait_for_rest()

    def restore(self, state: BeltFeedState) -> None:
        super().restore(state)
        self._next = self._drawn(state.put)

    def _mind_the_arm(self) -> None:
        """Run the belt unless the arm is in the way. The belt stops while the arm is over it."""
        obstructed = self._cell.arm_over(self._zone)
        self._state = replace(self._state, obstructed=obstructed)
        if obstructed:
            self._drive.halt()
            return
        if not self._drive.moving:
            # An item that lies in the barrier now does not count as another item.
            here = self._drive.travelled if self._drive.interrupted() else None
            self._state = replace(self._state, seen=here)
            belt = self._drive.id
            self._events.append(
                event_types.BeltRunsEvent(
                    f"{belt} runs", feed=self._number, belt=belt, number=self._state.runs
                )
            )
        self._drive.go()

    def _run(self) -> None:
        if self._another_comes() or self._all_at_barrier:
            self._drive.halt()
            self._state = replace(
                self._state, phase="stopping", obstructed=False, until=self._cell.now + MAX_SETTLING_TIME
            )
        elif self._is_due():
            self._put()

    def _another_comes(self) -> bool:
        """Return whether the light barrier is interrupted after it was free for a while."""
        if not self._drive.interrupted():
            return False
        here, before = self._drive.travelled, self._state.seen
        self._state = replace(self._state, seen=here)
        return before is None or here - before > MIN_ITEM_GAP

    def _wait_for_rest(self) -> None:
        riding = [b.id for b in self._cell.here() if self._drive.track.carries(b.pose.position)]
        state = self._state
        if self._cell.now >= state.until or self._cell.at_rest(riding):
            self._state = replace(state, phase="standing", deliveries=state.deliveries + 1)
            items = state.put - state.put_before
            belt, runs = self._drive.id, self._state.runs
            self._events.append(
                event_types.BeltStopsEvent(
                    f"{belt} stops", feed=self._number, belt=belt, number=runs, items=items
                )
            )

    @property
    def _all_put(self) -> bool:
        return self._state.put == self._delivery.total

    @property
    def _all_at_barrier(self) -> bool:
        """Whether the last of all items has come so far that no further stop could bring more."""
        return self._all_put and self._drive.travelled - self._state.last >= self._rest

    def _is_due(self) -> bool:
        state = self._state
        return not self._all_put and (
            state.put == 0 or self._drive.travelled - state.last >= self._next.spacing
        )

    def _put(self) -> None:
        """Set the next item down, unless its place is occupied until the belt clears it."""
        coming = self._next
        entry = self._scene.entry(coming.item.kind)
        turn = coming.item.turn
        low = bottom(entry.shape, Pose(orientation=turn))
        point = self._drive.track.at(self._start, coming.aside, DROP_HEIGHT - low)
        outline = footprint(entry.shape, turn).at(point[:2])
        for body in self._cell.here():
            other = footprint(body.shape, body.pose.orientation).at(body.pose.position[:2])
            if distance(outline, other) < MIN_BELT_GAP:
                return
        name = self._cell.next_id()
        self._cell.put(
            SpawnedItem(name, entry, coming.item.colour, Pose(point, turn), False, brought_by=self._number)
        )
        self._state = replace(self._state, put=self._state.put + 1, last=self._drive.travelled)
        self._next = self._drawn(self._state.put)

    def _drawn(self, number: int) -> NextBeltItem:
        """Draw the item with a number, from scene and seed alone."""
        name = f"feed/{self._number}"
        rng = self._streams.at(name, number // self._size)
        items = draw_load(self._scene, self._round, rng)
        order = rng.permutation(len(items))
        place = self._streams.at(f"{name}/place", number)
        spacing = self._delivery.spacing * float(place.uniform(1 - SPACING_SPREAD, 1 + SPACING_SPREAD))
        aside = float(place.uniform(-self._aside, self._aside))
        return NextBeltItem(items[int(order[number % self._size])], spacing, aside)


@dataclass(frozen=True, slots=True)
class NextBeltItem:
    """Next item for a belt, with its spacing and lateral position."""

    item: LooseItem
    spacing: float
    """Travel of the belt since the previous item, m."""
    aside: float
    """Offset from the belt's middle line, m."""
