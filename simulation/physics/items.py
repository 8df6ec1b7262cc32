"""Items of the physics backend: bodies that arrive, are changed by faults, leave, and sleep at rest
until an awake body comes near.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from picktree.files import PicktreeError
from picktree.simulation import (
    Inventory,
    InventoryState,
    SpawnedItem,
    Sticker,
    TrueBody,
    check_contained,
    checkpoints,
    pile_walls,
)
from picktree.world import ObjectId, Pose, Quaternion, Shape, Vector3, heap_geometry
from picktree.world.scene import SceneDescription

from .bodies import ItemShapes, add_item, add_obstacle, forget_contacts, set_friction, set_mass
from .engine import CONTACT_DISTANCE, pb
from .robot_body import finite

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
        """Place of each awake item at the last restart of each test of rest."""
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

    def add_static(self, body: int) -> None:
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


MAX_SETTLING_STEPS = 600
"""Greatest number of steps before time 0, if an item never comes to rest."""
MAX_POURING_STEPS = 1200
"""The same number for scenes with heaps: layers of items fall for up to a second."""
MIN_SPREADING_STEPS = 120
"""Number of steps after the walls of a pile are gone: an item that leant on them begins to fall slowly."""
CREEP_SPEED, CREEP_SPIN = 0.004, 0.1
"""Speed, m/s, and angular speed, rad/s, below which the items of a heap count as resting before time 0."""


class PhysicsItems:
    """Items of one pybullet client. Their bodies are rebuilt after a reset of the simulation."""

    def __init__(
        self,
        scene: SceneDescription,
        spawned: Iterable[SpawnedItem],
        client: int,
        running: Callable[[], Collection[int]] = tuple,
    ) -> None:
        """`running` returns the body numbers of static bodies that move now: belts."""
        self._client = client
        self.inventory = Inventory(scene, spawned)
        self.sleepers = SleepingItems(client, running)
        self._ledger: list[checkpoints.DynamicsChange] = []
        self._gone: dict[ObjectId, checkpoints.BodyState] = {}
        self._shapes: ItemShapes = {}
        self._numbers: dict[ObjectId, int] = {}
        self._bumps: dict[ObjectId, tuple[Vector3, Vector3]] = {}
        self._slippery: dict[ObjectId, float] = {}
        """Temporary friction of items with a fault."""

    @property
    def ledger(self) -> tuple[checkpoints.DynamicsChange, ...]:
        """Permanent changes by faults of items that are still there."""
        return tuple(self._ledger)

    @property
    def numbers(self) -> Mapping[ObjectId, int]:
        """pybullet's body numbers of the present items; the same mapping until the next rebuild."""
        return self._numbers

    def spawn(self, fixed: Collection[int]) -> None:
        """Add all items of the start; `fixed` bodies wake nothing."""
        self._build({name: item.pose for name, item in self.inventory.here.items()}, fixed)

    def restore(
        self,
        states: Iterable[checkpoints.BodyState],
        ledger: Iterable[checkpoints.DynamicsChange],
        inventory: InventoryState | None,
        fixed: Collection[int],
    ) -> None:
        """Add the items of a checkpoint to an empty simulation, all awake. Raises PicktreeError when they are
        not the scene's."""
        self.inventory.restore(inventory)
        states, ledger = tuple(states), tuple(ledger)
        if (ids := [s.id for s in states]) != (known := list(self.inventory.here)):
            raise PicktreeError(f"the checkpoint's items are {ids}, but the scene spawns {known}")
        for change in ledger:
            if change.scale is not None:
                self.inventory.enlarge(change.item, change.scale)
        present = [s for s in states if s.present]
        self._build({s.id: Pose(s.position, s.orientation) for s in present}, fixed)
        for state in present:
            pb.resetBaseVelocity(self._numbers[state.id], state.velocity, state.spin, self._client)
        self._gone = {s.id: s for s in states if not s.present}
        self._ledger = list(ledger)
        for change in self._ledger:
            self._apply(change)
        self._slippery = {name: f for name, f in self._slippery.items() if name in self._numbers}
        for name, friction in self._slippery.items():
            set_friction(self._numbers[name], friction, self._client)

    def restore_sleep(self, states: Iterable[checkpoints.BodyState]) -> None:
        """Put those items to sleep that slept in the checkpoint."""
        self.sleepers.sleep([s.id for s in states if s.present and s.asleep])

    def _build(self, poses: Mapping[ObjectId, Pose], fixed: Collection[int]) -> None:
        self._shapes = {}
        self._numbers = {
            name: add_item(item, poses[name], self._client, self._shapes)
            for name, item in self.inventory.here.items()
            if name in poses
        }
        self._gone = {}
        self._bumps = {}
        self.sleepers.watch(self._numbers, fixed)

    def settle(self, scene: SceneDescription) -> None:
        """Step the simulation until all items are at rest, before time 0. A heap need not rest wholly.

        Piles come to rest between walls first. Raises PicktreeError when items do not stay in their tote or
        pile.
        """
        heaps = {f"{scene.source or scene.name}: spawn[{n}]": n for n, s in enumerate(scene.spawn) if s.drop}
        around = [
            wall
            for where, n in heaps.items()
            if scene.spawn[n].drop == "pile"
            for wall in pile_walls(scene, scene.spawn[n], where)
        ]
        walls = [add_obstacle(wall, self._client) for wall in around]
        self._settle(MAX_POURING_STEPS if scene.heaped else MAX_SETTLING_STEPS, scene.heaped)
        if walls:
            for wall in walls:
                pb.removeBody(wall, self._client)
            self.sleepers.wake_all()
            for _ in range(MIN_SPREADING_STEPS):
                pb.stepSimulation(self._client)
                self.stepped()
            self._settle(MAX_SETTLING_STEPS, heaped=True)
        regions = heap_geometry.heap_regions(scene)
        for where, n in heaps.items():
            own = [item for item in self.inventory.here.values() if item.heap == n]
            lying = [(item.id, item.entry, self.true(self._state(item.id)).pose) for item in own]
            check_contained(regions[heap_geometry.region_of(scene, scene.spawn[n])], lying, where)

    def _settle(self, steps: int, heaped: bool) -> None:
        """Step the simulation until all items rest, a heap nearly; at most so many steps."""
        for step in range(steps):
            pb.stepSimulation(self._client)
            self.stepped()
            if self.sleepers.quiet or (heaped and step % 24 == 23 and self._nearly_rests()):
                return

    def _nearly_rests(self) -> bool:
        """Return whether no item moves faster than a heap creeps."""
        return all(
            max(map(abs, velocity)) < CREEP_SPEED and max(map(abs, spin)) < CREEP_SPIN
            for velocity, spin in (pb.getBaseVelocity(n, self._client) for n in self._numbers.values())
        )

    def stepped(self) -> None:
        """Apply bumps and update sleep after a step."""
        for name, (velocity, spin) in self._bumps.items():
            pb.resetBaseVelocity(self._numbers[name], velocity, spin, self._client)
        self._bumps.clear()
        self.sleepers.stepped()

    def states(self) -> tuple[checkpoints.BodyState, ...]:
        """Return the states of all items that did not leave with a bin, in the order of their numbers."""
        asleep = self.sleepers.asleep()
        return tuple(self._state(name, asleep=name in asleep) for name in self.inventory.here)

    def truth(self) -> tuple[TrueBody, ...]:
        """Return the ground truth of every item that ever was there."""
        return self.inventory.truth(lambda name: self.true(self._state(name)))

    def recent_truth(self) -> tuple[TrueBody, ...]:
        """Return the ground truth as `Inventory.recent_truth` does."""
        return self.inventory.recent_truth(lambda name: self.true(self._state(name)))

    def here(self) -> tuple[TrueBody, ...]:
        """Return the ground truth of every present item."""
        return tuple(self.true(self._state(name)) for name in self._numbers)

    def places(self, but: str = "") -> Iterator[tuple[Shape, Pose]]:
        """Yield shape and pose in the world of every present item, except of the item `but`."""
        for name, number in self._numbers.items():
            if name == but:
                continue
            pose = Pose(*pb.getBasePositionAndOrientation(number, self._client))
            yield self.inventory.here[name].entry.shape, pose

    def true(self, state: checkpoints.BodyState) -> TrueBody:
        """Return the ground truth of a saved or present state."""
        item = self.inventory.here[state.id]
        entry = item.entry
        return TrueBody(
            entry.kind,
            entry.form,
            entry.shape,
            item.colour,
            Pose(state.position, state.orientation),
            state.velocity,
            state.spin,
            state.present,
            id=state.id,
            brought_by=item.brought_by,
            mass=next((c.mass for c in self._ledger[::-1] if c.item == state.id and c.mass), entry.mass),
            tag=item.tag,
        )

    def stickers(self) -> Iterator[Sticker]:
        """Yield the tags on all present items, at their poses in the world."""
        for name, number in self._numbers.items():
            item = self.inventory.here[name]
            if item.tag is None or item.stickers is None:
                continue
            body = Pose(*pb.getBasePositionAndOrientation(number, self._client))
            for pose in item.stickers.poses:
                yield Sticker(item.tag, item.stickers.size, body @ pose)

    def name(self, body: int) -> str | None:
        """Return the name of the item with a body number; None: it is no item."""
        return next((name for name, number in self._numbers.items() if number == body), None)

    def put(self, item: SpawnedItem) -> None:
        """Add an item at its pose to the running simulation."""
        self._numbers[item.id] = add_item(item, item.pose, self._client, self._shapes)
        self.inventory.add(item)
        self.sleepers.add(item.id)

    def at_rest(self, items: Collection[ObjectId]) -> bool:
        asleep = self.sleepers.asleep()
        return all(name in asleep for name in items if name in self._numbers)

    def take_with(self, bin_id: ObjectId, items: Collection[ObjectId]) -> None:
        """Remove items with their bin; their last truth is recorded as at rest."""
        self.inventory.depart([self.true(self._state(name)) for name in items], bin_id)
        for name in items:
            pb.removeBody(self._numbers.pop(name), self._client)
            self._bumps.pop(name, None)
        self._ledger = [change for change in self._ledger if change.item not in items]
        if items:
            self.sleepers.wake_all()

    def remove(self, item: str) -> None:
        """Carry out a fault: remove the item."""
        name = self._item_id(item)
        self._gone[name] = replace(
            self._state(name), velocity=ZERO_VELOCITY, spin=ZERO_VELOCITY, present=False
        )
        self._bumps.pop(name, None)
        pb.removeBody(self._numbers.pop(name), self._client)
        self.sleepers.wake_all()

    def change_dynamics(self, item: str, friction: float | None = None, mass: float | None = None) -> None:
        """Carry out a fault: change the item's friction, or its mass in kg, for good."""
        change = checkpoints.DynamicsChange(self._item_id(item), friction, mass)
        self._apply(change)
        forget_contacts(self._numbers[change.item], self._client)
        self._ledger.append(change)
        self.sleepers.wake_all()

    def friction_of(self, item: str) -> float:
        """Return the item's present coefficient of friction."""
        name = self._item_id(item)
        return self._slippery.get(name, self._own_friction(name))

    def lubricate(self, item: str, friction: float | None, *, again: bool = False) -> None:
        """Carry out a fault: set the item's friction; None: its own again. `again`: it had that friction
        already when the checkpoint was taken."""
        name = ObjectId(item)
        number = self._numbers.get(name)
        if friction is None:
            self._slippery.pop(name, None)
        elif number is not None:
            self._slippery[name] = friction
        if number is None:
            return
        set_friction(number, self._own_friction(name) if friction is None else friction, self._client)
        if not again:
            forget_contacts(number, self._client)
            self.sleepers.wake_all()

    def _own_friction(self, name: ObjectId) -> float:
        changed = [c.friction for c in self._ledger if c.item == name and c.friction is not None]
        return changed[-1] if changed else self.inventory.here[name].entry.friction

    def enlarge(self, item: str, factor: float, pose: Pose) -> None:
        """Carry out a fault: scale the item by `factor` at `pose`; its velocity is kept."""
        name = self._item_id(item)
        before = self._state(name)
        pb.removeBody(self._numbers[name], self._client)
        self._numbers[name] = add_item(self.inventory.enlarge(name, factor), pose, self._client, self._shapes)
        self._ledger.append(checkpoints.DynamicsChange(name, scale=factor))
        for change in self._ledger:
            if change.item == name:
                self._apply(change)
        if name in self._slippery:
            set_friction(self._numbers[name], self._slippery[name], self._client)
        pb.resetBaseVelocity(self._numbers[name], before.velocity, before.spin, self._client)
        self.sleepers.add(name)
        self.sleepers.wake_all()

    def bump(self, item: str, velocity: Vector3, spin: Vector3) -> None:
        """Carry out a fault: set the item's velocity, m/s, and spin, rad/s, in the world."""
        finite(np.array(velocity, dtype=np.float64), f"{item}: velocity", (3,))
        finite(np.array(spin, dtype=np.float64), f"{item}: spin", (3,))
        # A sleeping item has to be woken first, which takes a step.
        self._bumps[self._item_id(item)] = (velocity, spin)
        self.sleepers.wake_all()

    def _apply(self, change: checkpoints.DynamicsChange) -> None:
        number = self._numbers.get(change.item)
        if number is None:
            return
        if change.friction is not None and change.item not in self._slippery:
            set_friction(number, change.friction, self._client)
        if change.mass is not None:
            shape = self.inventory.here[change.item].entry.shape
            set_mass(number, shape, change.mass, self._client)

    def _state(self, name: ObjectId, *, asleep: bool = False) -> checkpoints.BodyState:
        if name in self._gone:
            return self._gone[name]
        number = self._numbers[name]
        position, orientation = pb.getBasePositionAndOrientation(number, self._client)
        velocity, spin = self._bumps.get(name) or pb.getBaseVelocity(number, self._client)
        return checkpoints.BodyState(name, position, orientation, velocity, spin, present=True, asleep=asleep)

    def _item_id(self, item: str) -> ObjectId:
        name = ObjectId(item)
        if name in self._numbers:
            return name
        if name in self._gone or self.inventory.has_left(item):
            raise PicktreeError(f"item {item!r} was taken away before")
        raise PicktreeError(f"there is no item {item!r}; known: {', '.join(self.inventory.here)}")
