"""Sleeping items: the engine skips items at rest until an awake body comes near them.

The engine wakes whole islands before it solves their contacts: all bodies whose bounding boxes overlap, robot
included. So a sleeping item that is touched behaves as one that never slept. Any other change that may set
items in motion, such as a removed body, has to call `wake_all`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from ...world.values import ObjectId, Quaternion, Vector3
from ..engine import CONTACT_DISTANCE, pb

SLEEP_CHECK_INTERVAL = 12
"""Number of steps between two checks of the items."""


class Rest(NamedTuple):
    """Test of rest: an item keeps its place within bounds at a number of consecutive checks."""

    displacement: float
    """Greatest displacement, m."""
    rotation: float
    """Greatest change of a component of the quaternion."""
    checks: int


REST, HEAP_REST = Rest(5e-5, 5e-4, 5), Rest(1e-3, 0.02, 10)
"""Tests of rest: of any item, within 0.25 s at 240 Hz; and of items in a heap, within 0.5 s.

A body off balance falls e-fold faster in each 0.05 s, so it passes neither. In a heap the solver lets items
tremble and creep, by up to 2 mm/s, and the first test would never let them sleep. Only the robot and belts
move a heap so slowly, and these keep it awake.
"""
MIN_HEAP = 3
"""Least number of items near each other that are a heap."""
AWAKE_SLEEP_THRESHOLD = 1e-10
"""Sleep threshold of awake bodies, (m/s)² + (rad/s)²: a slower body may fall asleep again at once.

The engine's own threshold of 0.05 would freeze an item in the middle of sliding or toppling.
"""
DOZING_SLEEP_THRESHOLD, DOZE_STEPS = 1e-4, 3
"""Sleep threshold, (m/s)² + (rad/s)², of an item that falls asleep, and its duration in steps. Resting
contacts tremble by up to 7 mrad/s."""
ISLAND_QUERY_MARGIN = CONTACT_DISTANCE + 0.001
"""Enlargement of a query box, m.

The engine enlarges bounding boxes by its contact distance; bodies whose boxes overlap wake each other. It
enlarges the boxes of bodies that it returns, but not the query box.
"""
ZERO_VELOCITY = (0.0, 0.0, 0.0)


@dataclass(slots=True)
class _Place:
    """Pose of an item when a test of rest began, and the number of checks that it passed since."""

    position: Vector3
    orientation: Quaternion
    checks: int = 0


def _turn(one: Quaternion, other: Quaternion) -> float:
    """Return the greatest change of a component; a quaternion and its negative are one orientation."""
    return min(
        max(abs(a - b) for a, b in zip(one, other, strict=True)),
        max(abs(a + b) for a, b in zip(one, other, strict=True)),
    )


class SleepingItems:
    """Sleep control for the items of one pybullet client; their poses alone decide which may sleep."""

    def __init__(self, client: int, running: Callable[[], Collection[int]] = tuple) -> None:
        """`running` returns the body numbers of static bodies that move now: items on them do not sleep."""
        self._client = client
        self._running = running
        self._numbers: Mapping[ObjectId, int] = {}
        self._fixed: Collection[int] = ()
        self._places: dict[ObjectId, list[_Place]] = {}
        """Where each awake item was when each test of rest began anew."""
        self._asleep: set[ObjectId] = set()
        self._dozing: dict[ObjectId, int] = {}
        self._steps = 0

    def watch(self, numbers: Mapping[ObjectId, int], fixed: Collection[int]) -> None:
        """Watch these items, all awake, by pybullet's body numbers; `fixed` bodies wake nothing."""
        self._numbers, self._fixed = numbers, fixed
        for body in (*fixed, *numbers.values()):
            self._set(body, pb.ACTIVATION_STATE_ENABLE_SLEEPING, AWAKE_SLEEP_THRESHOLD)
        for body in fixed:
            self._set(body, pb.ACTIVATION_STATE_SLEEP, AWAKE_SLEEP_THRESHOLD)
        self._asleep, self._dozing, self._steps = set(), {}, 0
        self._places = {name: self._place(name) for name in numbers}

    def add(self, name: ObjectId) -> None:
        """Add an awake item, whose body is in the watched mapping."""
        self._set(self._numbers[name], pb.ACTIVATION_STATE_ENABLE_SLEEPING, AWAKE_SLEEP_THRESHOLD)
        self._places[name] = self._place(name)

    def stand(self, body: int) -> None:
        """Add a static body, which is in the collection given as `fixed`."""
        self._set(body, pb.ACTIVATION_STATE_ENABLE_SLEEPING, AWAKE_SLEEP_THRESHOLD)
        self._set(body, pb.ACTIVATION_STATE_SLEEP, AWAKE_SLEEP_THRESHOLD)
        self.wake_all()

    def stepped(self) -> None:
        """Update sleep after a step; the items are checked at some steps only."""
        self._steps += 1
        if self._dozing:
            self._doze()
        if self._steps % SLEEP_CHECK_INTERVAL == 0:
            self._look()

    def _look(self) -> None:
        self._notice_woken()
        resting, creeping = set(self._asleep), set(self._asleep)
        for name in self._places:
            rests, creeps = self._rests(name)
            resting |= {name} if rests else set()
            creeping |= {name} if creeps else set()
        for name in list(self._places):
            if name in creeping and name not in self._asleep:
                island = self._island(name)
                if island is not None and island <= (creeping if len(island) >= MIN_HEAP else resting):
                    self.sleep(sorted(island - self._asleep))

    def sleep(self, names: Iterable[ObjectId]) -> None:
        """Put items to sleep."""
        for name in names:
            pb.resetBaseVelocity(self._numbers[name], ZERO_VELOCITY, ZERO_VELOCITY, self._client)
            self._set(self._numbers[name], pb.ACTIVATION_STATE_SLEEP, DOZING_SLEEP_THRESHOLD)
            self._places.pop(name, None)
            self._asleep.add(name)
            self._dozing[name] = DOZE_STEPS

    def wake_all(self) -> None:
        """Wake all items after one was changed or removed, because others may lean on it.

        The engine wakes them at the end of the next step; velocities set before then are lost.
        """
        for body in self._numbers.values():
            self._set(body, pb.ACTIVATION_STATE_WAKE_UP, AWAKE_SLEEP_THRESHOLD)
        self._asleep, self._dozing = set(), {}
        self._places = {name: self._place(name) for name in self._numbers}

    @property
    def quiet(self) -> bool:
        """Whether all items sleep, as far as was seen."""
        return len(self._asleep) == len(self._numbers) and not self._dozing

    def asleep(self) -> frozenset[ObjectId]:
        """Return the names of the sleeping items."""
        self._notice_woken()
        return frozenset(self._asleep)

    def _doze(self) -> None:
        for name, steps in list(self._dozing.items()):
            if steps > 1:
                self._dozing[name] = steps - 1
            else:
                del self._dozing[name]
                pb.changeDynamics(
                    self._numbers[name],
                    -1,
                    sleepThreshold=AWAKE_SLEEP_THRESHOLD,
                    physicsClientId=self._client,
                )

    def _notice_woken(self) -> None:
        """Update the list of sleeping items: the engine wakes bodies itself, and keeps a sleeping one at
        exactly zero velocity."""
        for name, body in self._numbers.items():
            if name in self._asleep and name not in self._dozing:
                velocity, spin = pb.getBaseVelocity(body, self._client)
                if any(velocity) or any(spin):
                    self._asleep.discard(name)
                    self._places[name] = self._place(name)

    def _rests(self, name: ObjectId) -> tuple[bool, bool]:
        """Check an item; return whether it passes the test of any item, or at least that of a heap."""
        position, orientation = self._pose(name)
        passed = list[bool]()
        for place, rest in zip(self._places[name], (REST, HEAP_REST), strict=True):
            moved = max(abs(a - b) for a, b in zip(place.position, position, strict=True))
            if moved > rest.displacement or _turn(place.orientation, orientation) > rest.rotation:
                place.position, place.orientation, place.checks = position, orientation, 0
            else:
                place.checks += 1
            passed.append(place.checks >= rest.checks)
        return passed[0], any(passed)

    def _place(self, name: ObjectId) -> list[_Place]:
        return [_Place(*self._pose(name)) for _ in (REST, HEAP_REST)]

    def _island(self, name: ObjectId) -> set[ObjectId] | None:
        """Return the item and all items that the engine would wake with it; None when the robot or a running
        belt is among them."""
        names = {body: each for each, body in self._numbers.items()}
        running = self._running()
        found: set[ObjectId] = set()
        waiting = [name]
        while waiting:
            one = waiting.pop()
            if one in found:
                continue
            found.add(one)
            low, high = pb.getAABB(self._numbers[one], -1, self._client)
            near = pb.getOverlappingObjects(
                [c - ISLAND_QUERY_MARGIN for c in low],
                [c + ISLAND_QUERY_MARGIN for c in high],
                physicsClientId=self._client,
            )
            for body, _ in near:
                if body in names:
                    waiting.append(names[body])
                elif body not in self._fixed or body in running:
                    return None
        return found

    def _pose(self, name: ObjectId) -> tuple[Vector3, Quaternion]:
        return pb.getBasePositionAndOrientation(self._numbers[name], self._client)

    def _set(self, body: int, state: int, stir: float) -> None:
        pb.changeDynamics(body, -1, activationState=state, sleepThreshold=stir, physicsClientId=self._client)
