"""What a skill notices while its arm is on the way: its object is elsewhere, its place is taken."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ...cell.handover import PlaceCandidate
from ...world.belief.planning_scene import BeliefObject
from ...world.causes import Failure, place
from ...world.causes import world as world_causes
from ...world.values import Pose
from ..place.bin_spots import blocked
from ..place.release_poses import bin_target, free_drop_height

if TYPE_CHECKING:
    from ...cell.world import World

MOVED, TURNED = 0.008, math.radians(12.0)
"""Another place, or heading, of an object than it was to be grasped at, m and rad; less is within the
camera's errors, and the fingers allow for it."""
SIGMAS = 4.0
"""What is less certain than that has to be seen further off, in standard deviations."""
SURE = 0.7
"""A look at what the arm half hides, with less than this share of the former confidence, tells of no move."""
HIGHER = 0.01
"""By so much the heap may grow where something is to be let go, m."""


class TargetWatch:
    """Asked each tick while the arm approaches an object: is it still there, and where it was?

    A move is told as world.disturbed, and the caller looks for other candidates; world.unknown_object says
    that it is gone.
    """

    def __init__(self, world: World, target: BeliefObject) -> None:
        self._scene, self._target = world.scene, target
        self._version = world.scene.version
        self.noticed: Failure | None = None
        """What it has stopped the arm for."""

    def __call__(self) -> Failure | None:
        """A failure when the arm should stop."""
        if self._scene.version != self._version:
            self._version = self._scene.version
            self.noticed = self._judged()
        return self.noticed

    def _judged(self) -> Failure | None:
        target, now = self._target, self._scene.find(self._target.id)
        if now is None:
            return Failure(
                world_causes.UNKNOWN_OBJECT,
                f"{target.id} is gone: its place was seen empty while the arm was on the way",
                object=target.id,
            )
        off, turn = displacement(target, now)
        if now.confidence < SURE * target.confidence or (off, turn) == (0.0, 0.0):
            return None
        return Failure(
            world_causes.DISTURBED,
            f"{target.id} is seen {off * 1000:.0f} mm and {math.degrees(turn):.0f}° from where it was when "
            "the arm set out",
            object=target.id,
            by=target.id,
            distance=off,
            turn=turn,
        )


def displacement(before: BeliefObject, now: BeliefObject) -> tuple[float, float]:
    """By how much an object is believed to be elsewhere, m and rad; nothing where that may be an error of
    sight."""
    off, turn = before.pose.distance(now.pose), before.pose.angle(now.pose)
    unsure = math.hypot(before.sigma_position, now.sigma_position)
    unsure_turn = math.hypot(before.sigma_angle, now.sigma_angle)
    if off > max(MOVED, SIGMAS * unsure) or turn > max(TURNED, SIGMAS * unsure_turn):
        return off, turn
    return 0.0, 0.0


class PlaceWatch:
    """Asked each tick while the arm carries an object over a bin: is there still room where it is let go?

    What was put there meanwhile is told as place.occupied: the caller looks for another spot.
    """

    def __init__(self, world: World, held: BeliefObject, landing: PlaceCandidate) -> None:
        assert held.object_in_tcp is not None
        self._world, self._landing = world, landing
        self._held, self._in_tcp = held.id, held.object_in_tcp
        self._looks = world.eyes.looks
        self.noticed: Failure | None = None
        """What it has stopped the arm for."""

    def __call__(self) -> Failure | None:
        """A failure when the arm should stop."""
        if self._world.eyes.looks != self._looks:
            self._looks = self._world.eyes.looks
            self.noticed = self.judged()
        return self.noticed

    def judged(self) -> Failure | None:
        """Why it cannot be let go there, as the bin is believed to be filled now."""
        world, landing = self._world, self._landing
        held = world.scene.find(self._held)
        if held is None:
            return None
        target = bin_target(world, held, landing.into)
        if any(cell.name == landing.spot for cell in target.cells):
            drop = free_drop_height(world, target, landing.above, held.shape, self._in_tcp)
            if drop >= landing.drop - HIGHER:
                return None
        height = float(target.heights.max())
        return Failure(
            place.OCCUPIED,
            f"something was put into {landing.into} meanwhile: its heap is {height * 1000:.0f} mm high",
            object=self._held,
            by=landing.into,
            height=height,
        )


class PutDownWatch:
    """The same for a point where it is put down with the TCP at `pose`: nothing may stand there."""

    def __init__(self, world: World, held: BeliefObject, pose: Pose) -> None:
        self._world, self._held, self._pose = world, held, pose
        self._version = world.scene.version
        self.noticed: Failure | None = None
        """What it has stopped the arm for."""

    def __call__(self) -> Failure | None:
        """A failure when the arm should stop."""
        if self._world.scene.version != self._version:
            self._version = self._world.scene.version
            self.noticed = self._judged()
        return self.noticed

    def _judged(self) -> Failure | None:
        by = blocked(self._world.queries, self._held, self._pose)
        if by is None:
            return None
        return Failure(
            place.OCCUPIED,
            f"{by} stands where {self._held.id} should go",
            object=self._held.id,
            by=by,
        )
