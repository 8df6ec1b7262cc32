"""Looking: take a picture, let perception work on it, bring the belief up to date."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass

from .causes import Failure, perception
from .journal import ImageTaken, Journal
from .perception.association import ObservationSummary, update_belief
from .perception.following import Sighting
from .perception.pipeline import BinView, Perception
from .protocols import Camera, Clock, RgbdImage
from .scene.planning_scene import BeliefObject, PlanningScene
from .stopwatch import Stopwatch
from .thinking import ThinkingAccount
from .values import Array


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """A picture, and how the robot stood when it was taken: joints (n,) rad, opening m."""

    image: RgbdImage
    joints: Array
    width: float


class Eyes:
    """The cameras and what was last seen of the bins.

    `joints` and `width` give the arm's configuration (n,) rad and the opening m: the robot masks itself.
    """

    def __init__(
        self,
        cameras: Mapping[str, Camera],
        perceive: Perception,
        scene: PlanningScene,
        clock: Clock,
        journal: Journal,
        thinking: ThinkingAccount,
        cost: float,
        joints: Callable[[], Array],
        width: Callable[[], float],
        stopwatch: Stopwatch | None = None,
    ) -> None:
        self._cameras = cameras
        self._perceive = perceive
        self._scene = scene
        self._clock = clock
        self._journal = journal
        self._thinking = thinking
        self._cost = cost
        self._joints = joints
        self._width = width
        self._stopwatch = stopwatch or Stopwatch()
        self._still = frozenset(cameras) - perceive.moving
        self.bins: dict[str, BinView] = {}
        """What was last seen in each bin; part of the state."""
        self.looks = 0
        """How often it was looked; part of the state."""

    @property
    def hand(self) -> str | None:
        """Name of the camera on the hand; None: there is none."""
        return next((name for name in self._cameras if name not in self._still), None)

    def shoot(self, camera: str) -> Generator[None, None, Shot]:
        """One picture through `camera`, charged as a look is; nothing is recognised, no belief changes."""
        shot = self._shot(camera)
        yield from self._charge()
        self._journal.note(ImageTaken(shot.image, ()))
        return shot

    def follow(
        self, camera: str, objects: Sequence[BeliefObject]
    ) -> Generator[None, None, tuple[Sighting, ...]]:
        """Where a picture through `camera` shows objects that are believed to be in it. Charged as a look is;
        the belief does not change."""
        shot = self._shot(camera)
        with self._stopwatch.measure("perception"):
            found = self._perceive.follow(shot.image, shot.joints, shot.width, self._scene, objects)
        yield from self._charge()
        seen = sorted({str(s.object) for s in found if math.isfinite(s.misfit)})
        self._journal.note(ImageTaken(shot.image, tuple(seen)))
        return found

    def look(self, camera: str) -> Generator[None, None, ObservationSummary]:
        """Observe through `camera`; the belief changes when the thinking is over.

        Raises Failure(perception.not_found) when there is no such camera.
        """
        stamp = self._clock.now
        shot = self._shot(camera)
        image = shot.image
        with self._stopwatch.measure("perception"):
            view = self._perceive.detect(image, shot.joints, shot.width, self._scene)
        yield from self._charge()
        summary = update_belief(self._scene, view, stamp)
        for name, seen in view.bins.items():
            self.bins[str(name)] = seen if camera in self._still else seen.over(self.bins.get(str(name)))
        self.looks += 1
        findings = tuple(f"{d.colour} {d.kind}" for d in view.detections)
        self._journal.note(ImageTaken(image, findings))
        return summary

    def _shot(self, camera: str) -> Shot:
        if camera not in self._cameras:
            raise Failure(
                perception.NOT_FOUND, f"there is no camera {camera!r}", known=[str(c) for c in self._cameras]
            )
        with self._stopwatch.measure("rendering"):
            image = self._cameras[camera].capture()
        return Shot(image, self._joints(), self._width())

    def _charge(self) -> Generator[None, None, None]:
        self._thinking.spend(self._cost)
        yield from self._thinking.charge()
