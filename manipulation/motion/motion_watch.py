"""Monitors of a motion: the object has moved, or its place is taken."""

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

MIN_TARGET_DISPLACEMENT, MIN_TARGET_ROTATION = 0.008, math.radians(12.0)
"""Distance, m, and rotation, rad, from which an object counts as moved. Less is within the camera's errors,
and the fingers allow for it."""
DISPLACEMENT_SIGMAS = 4.0
"""Displacement of an uncertain object that counts as a move, in standard deviations."""
MIN_CONFIDENCE_SHARE = 0.7
"""Share of the former confidence below which a look shows no move: the arm half hides the object."""
MAX_HEAP_GROWTH = 0.01
"""Growth of the heap that is allowed at the place of the release, m."""


class TargetMoved(Failure):
    """Failure of an approach whose object has moved (world.disturbed) or is gone (world.unknown_object)."""


class TargetWatch:
    """Monitor of an approach, for each tick: whether the object is where it was."""

    def __init__(self, world: World, target: BeliefObject) -> None:
        self._scene, self._target = world.scene, target
        self._version = world.scene.version

    def __call__(self) -> Failure | None:
        """Return the failure that stops the arm. None: the arm goes on."""
        if self._scene.version == self._version:
            return None
        self._version = self._scene.version
        return self._judged()

    def _judged(self) -> Failure | None:
        target, now = self._target, self._scene.find(self._target.id)
        if now is None:
            return TargetMoved(
                world_causes.UNKNOWN_OBJECT,
                f"{target.id} is gone: its place was seen empty while the arm was on the way",
                object=target.id,
            )
        off, turn = displacement(target, now)
        if now.confidence < MIN_CONFIDENCE_SHARE * target.confidence or (off, turn) == (0.0, 0.0):
            return None
        return TargetMoved(
            world_causes.DISTURBED,
            f"{target.id} is seen {off * 1000:.0f} mm and {math.degrees(turn):.0f}° from where it was when "
            "the arm set out",
            object=target.id,
            by=target.id,
            distance=off,
            turn=turn,
        )


def displacement(before: BeliefObject, now: BeliefObject) -> tuple[float, float]:
    """Return the displacement of an object, m and rad; zero when it may be an error of perception."""
    off, turn = before.pose.distance(now.pose), before.pose.angle(now.pose)
    unsure = math.hypot(before.sigma_position, now.sigma_position)
    unsure_turn = math.hypot(before.sigma_angle, now.sigma_angle)
    if off > max(MIN_TARGET_DISPLACEMENT, DISPLACEMENT_SIGMAS * unsure) or turn > max(
        MIN_TARGET_ROTATION, DISPLACEMENT_SIGMAS * unsure_turn
    ):
        return off, turn
    return 0.0, 0.0


class PlaceWatch:
    """Monitor of a transfer to a bin, for each tick: whether there is still room at the place of the release.

    It reports place.occupied when the heap has grown, and the caller looks for another spot.
    """

    def __init__(self, world: World, held: BeliefObject, landing: PlaceCandidate) -> None:
        assert held.object_in_tcp is not None
        self._world, self._landing = world, landing
        self._held, self._in_tcp = held.id, held.object_in_tcp
        self._looks = world.vision.looks

    def __call__(self) -> Failure | None:
        """Return the failure that stops the arm. None: the arm goes on."""
        if self._world.vision.looks == self._looks:
            return None
        self._looks = self._world.vision.looks
        return self.judged()

    def judged(self) -> Failure | None:
        """Return why the object cannot be released there, by the believed contents of the bin. None: it
        can."""
        world, landing = self._world, self._landing
        held = world.scene.find(self._held)
        if held is None:
            return None
        target = bin_target(world, held, landing.into)
        if any(cell.name == landing.spot for cell in target.cells):
            drop = free_drop_height(world, target, landing.above, held.shape, self._in_tcp)
            if drop >= landing.drop - MAX_HEAP_GROWTH:
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
    """Monitor of a transfer to a point with the TCP at `pose`, for each tick: whether it is still free."""

    def __init__(self, world: World, held: BeliefObject, pose: Pose) -> None:
        self._world, self._held, self._pose = world, held, pose
        self._version = world.scene.version

    def __call__(self) -> Failure | None:
        """Return the failure that stops the arm. None: the arm goes on."""
        if self._world.scene.version == self._version:
            return None
        self._version = self._world.scene.version
        return self._judged()

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
