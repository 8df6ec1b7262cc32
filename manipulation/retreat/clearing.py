"""Getting clear: out of what presses, out of what the arm is believed to be in, away from what is near."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np

from ...control.joints.soft_contact import ContactThresholds, JointImpedanceResult
from ...planning.requests import DIRECTIONS, ContactPair, Direction, Scaling
from ...world.causes import Failure
from ...world.journal import JournalEvent
from ...world.values import GRAVITY, Array, Vector3

if TYPE_CHECKING:
    from ...cell.world import World
    from ...planning.search.penetration_escape import EscapePath
    from ...world.trajectory import Trajectory


T = TypeVar("T")
Doing: TypeAlias = Generator[None, None, T]

CAREFUL = 0.05
"""Of whatever moves fastest, on a way out, m/s."""
REDUCED = 0.25
"""On free ways: the reduced speed of ISO 10218-1, m/s."""
WARY = 0.10
"""On free ways after something was felt that nobody knows of, m/s."""
FEELING = ContactThresholds(torque=1.2, force=3.0)
"""What counts as a contact on a way out."""
FIRMLY = ContactThresholds(torque=3.0, force=8.0)
"""Likewise, once every way was touched on: what is jammed rubs on its way out."""
ON_THE_WAY = ContactThresholds(torque=2.5, force=6.0)
"""On free ways, which are faster."""
PRESSED = 1.5
"""External torque at rest above which something presses at the arm, Nm."""
REACH = 0.40
"""Of a way out, m of the tool."""
CAME = 0.08
"""Of the way back along which the arm came, m of the tool."""
CLEAR = 0.03
"""What is nearer than this to the arm is left before it goes anywhere else, m."""
UP = 0.10
"""Height to gain then, m."""
WORTH = 0.01
"""A way that gets less far is none, m."""
STOPS = 3
"""Safety stops on the way that are acknowledged: more, and there is no safe way."""
AGAINST = -0.3
"""Cosine to what has pushed below which a direction leads into it."""
GENTLE = Scaling(0.3, 0.3)


class RetreatMotion:
    """One retreat's ways out: what was tried, and what was felt, is remembered.

    All motions are soft: contacts are felt at any part of the arm, and given way to. A direction in which
    something was touched is not tried again.
    """

    def __init__(self, world: World, node: str, deadline: float = float("inf")) -> None:
        """`deadline`: simulated time at which no other way is begun, s."""
        self._world = world
        self._node = node
        self._deadline = deadline
        self._spent: set[str] = set()
        self._feeling = FEELING
        self._stops = 0
        self.tried: list[str] = []
        """Each way that did not get there, in words."""
        self.felt: Vector3 | None = None
        """How the hand was pushed last, N in the world; None: nothing was felt at it."""
        self.pressed = False
        """Something pressed at the arm where it stood."""
        self.touched = False
        """Something was met on the way that should not be there."""

    @property
    def carried(self) -> Vector3:
        """What hangs on the tool, as far as it is known, N in the world."""
        return (0.0, 0.0, -GRAVITY * held_mass(self._world))

    @property
    def late(self) -> bool:
        return self._world.clock.now >= self._deadline

    def relax(self) -> Doing[float]:
        """Where something presses at the arm as it stands: stop pressing, and give way a little. Answers the
        external torque that is left, Nm."""
        world = self._world
        pressed = world.move.pressed(self.carried)
        if pressed <= PRESSED:
            return pressed
        contact = np.array(world.control.wrist.force) - np.array(self.carried)
        if float(np.linalg.norm(contact)) > FEELING.force:
            x, y, z = contact.tolist()
            self.felt = (x, y, z)
        self.pressed = True
        left = pressed
        for _ in range(STOPS):
            left = yield from self._stopping(world.move.give_way(self.carried, node=self._node), pressed)
            if left < pressed:
                break
        self._note(
            f"something pressed at the arm with {pressed:.1f} Nm at its joints; {left:.1f} Nm are left", left
        )
        return left

    def anew(self) -> None:
        """The belief is another one: directions may be tried again, and, where something was touched, a
        little more firmly."""
        self._spent.clear()
        if self.touched:
            self._feeling = FIRMLY

    def out(self) -> Doing[bool]:
        """Out of what the arm is believed to be in or too close to, and away from what has pressed at it.
        False: no way leads out, or none is safe."""
        world = self._world
        if self.pressed or self.touched:
            # Where it came from was free a moment ago, whatever is believed.
            yield from self._back()
        while (contacts := world.plan.contacts()) and not self.late:
            way = self._best(contacts)
            if way is None:
                return False
            if (yield from self._go(way)):
                # There it should be free; where it is not, another way must do better.
                self._spent.add(way.direction)
        yield from world.plan.charge()
        return not contacts

    def up(self, way: float = UP, *, always: bool = False) -> Doing[None]:
        """Away from what is near, upwards or else wherever there is room; nothing when nothing is near,
        unless that is wanted `always`."""
        world = self._world
        with world.plan.checking():
            outward = world.plan.outward()
            nearest = world.plan.solver.collision.nearest(world.control.held_position, CLEAR)
        if nearest is None and not always:
            return
        directions: tuple[Direction, ...] = ("up", "back", "inwards")
        for direction in directions:
            if direction in self._spent or self.late:
                continue
            with world.plan.checking():
                found = outward.way(direction, way, until_free=False)
            yield from world.plan.charge()
            if found.length >= WORTH and (yield from self._go(found)):
                return
            if found.length < WORTH:
                self.tried.append(f"{direction}: {found.ended_by}")

    def touched_on_the_way(self, result: JointImpedanceResult, where: str) -> Doing[None]:
        """Something was met on a free way: remember it, and go back a little the way the arm came."""
        self._felt(result)
        self.tried.append(f"{where}: touched something ({_sizes(result)})")
        yield from self._back()

    def _back(self) -> Doing[None]:
        """A little back the way that the arm came, as far as nothing comes closer to what is believed."""
        world = self._world
        back = world.move.way_back()
        if back is None or "the way it came" in self._spent:
            return
        path = [back.position[0]]
        length = 0.0
        for q in back.position[1:]:
            length += world.robot.tcp(path[-1]).distance(world.robot.tcp(q))
            path.append(q)
            if length >= CAME:
                break
        with world.plan.checking():
            way = world.plan.outward().along("the way it came", np.array(path))
        yield from world.plan.charge()
        if len(way.path) > 1:
            yield from self._go(way)

    def _best(self, contacts: tuple[ContactPair, ...]) -> EscapePath | None:
        """The shortest way that gets out, of those that were not in vain; `out` before others."""
        world = self._world
        names = ", ".join(dict.fromkeys(f"{c.a} at {c.b}" for c in contacts[:3]))
        with world.plan.checking():
            outward = world.plan.outward()
            for direction in self._in_order(outward.heading):
                found = outward.way(direction, REACH)
                if found.free and len(found.path) > 1:
                    return found
                self._spent.add(direction)
                self.tried.append(f"{direction} from {names}: {found.ended_by or 'no way'}")
        return None

    def _in_order(self, heading: Callable[[Direction], Array]) -> list[Direction]:
        """Directions that were not in vain yet, those along what has pushed at the hand before others, and
        none against it."""
        left: list[Direction] = [d for d in DIRECTIONS if d not in self._spent]
        if self.felt is None:
            return left
        push = np.array(self.felt)
        push = push / max(float(np.linalg.norm(push)), 1e-9)
        along = {d: float(heading(d) @ push) for d in left}
        return [d for d in left if along[d] >= AGAINST]

    def _go(self, way: EscapePath) -> Doing[bool]:
        """Slowly along a way; False where something was felt on it."""
        # slow to load, and few retreats have to get out
        from ...planning.timing.time_parameterization import (
            time_corners,
            time_smooth,
        )

        world = self._world
        timed = time_smooth(world.robot, way.path, GENTLE) or time_corners(
            world.robot, way.path, GENTLE, 0.005
        )
        if timed is None:
            self._spent.add(way.direction)
            self.tried.append(f"{way.direction}: the joints cannot follow it")
            return False
        result = yield from self.follow(world.move.slowed(timed, CAREFUL), self._feeling, leaving=True)
        if result.completed:
            return True
        self._felt(result)
        self._spent.add(way.direction)
        self.tried.append(f"{way.direction}: touched something ({_sizes(result)})")
        return False

    def follow(
        self, trajectory: Trajectory, least: ContactThresholds, *, leaving: bool = False
    ) -> Doing[JointImpedanceResult]:
        """A soft motion; a safety stop on it counts as a contact, and is acknowledged a few times."""
        moving = self._world.move.softly(
            trajectory, least, carried=self.carried, node=self._node, leaving=leaving
        )
        stopped = JointImpedanceResult(False, 0.0, True, 0.0, 0.0)
        return (yield from self._stopping(moving, stopped))

    def _stopping(self, doing: Doing[T], otherwise: T) -> Doing[T]:
        """What `doing` comes to, or `otherwise` when a safety stop ends it."""
        world = self._world
        try:
            return (yield from doing)
        except Failure:
            stop = world.control.monitor.stopped
            if stop is None:
                raise
            self._stops += 1
            if self._stops > STOPS:
                raise
        yield from world.move.rest()
        if not world.control.monitor.acknowledge(self._node):
            raise Failure(stop.cause, stop.message, **stop.evidence)
        message = f"{stop.cause}: {stop.message}, on the way out"
        world.journal.note(JournalEvent("safety_acknowledged", message, self._node))
        return otherwise

    def _felt(self, result: JointImpedanceResult) -> None:
        self.touched = True
        if float(np.linalg.norm(result.push)) > FEELING.force / 2:
            self.felt = result.push

    def _note(self, message: str, left: float) -> None:
        self._world.journal.note(JournalEvent("gave_way", message, self._node, {"left": round(left, 2)}))


def held_mass(world: World) -> float:
    """Of what is believed to be in the hand: weighed, else by the catalogue, kg."""
    held = world.scene.held
    if held is None:
        return 0.0
    payload = world.control.wrist.payload
    if payload is not None:
        return payload.mass
    return next((e.mass for e in world.description.catalogue if e.kind == held.kind), 0.0)


def _sizes(result: JointImpedanceResult) -> str:
    return f"{result.torque:.1f} Nm at the joints, {result.force:.0f} N at the wrist"


def escape_contact(world: World, scaling: Scaling, node: str) -> Generator[None, None, None]:
    """Out of what the arm is believed to be in, slowly, the depths shrinking, and up from what is near.

    Nothing happens where there is no way: whoever plans next is told why. `scaling` is no more than is done
    anyway: ways out are slow.
    """
    del scaling
    leaving = RetreatMotion(world, node)
    yield from leaving.relax()
    if (yield from leaving.out()):
        yield from leaving.up()
