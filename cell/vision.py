"""Looking: take a picture, let perception work on it, bring the belief up to date."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from ..perception.data_association import ObservationSummary, update_belief
from ..perception.fitting.known_object_fitting import TrackedSighting
from ..perception.fitting.view import PerceivedView
from ..perception.pipeline import BinView, Perception
from ..world.belief.planning_scene import BeliefObject, PlanningScene
from ..world.causes import Failure, perception
from ..world.journal import ImageEntry, Journal, JournalEvent
from ..world.protocols import Camera, Clock, NoImage, RgbdImage
from ..world.stopwatch import Stopwatch
from ..world.thinking_time import ComputeTimeAccount
from ..world.values import Array, Pose

T = TypeVar("T")

FRAMES = 4
"""How many images a look waits for before it says that none comes: cameras drop one now and then."""
FRAME = 0.1
"""From one to the next, s."""
OLDEST = 0.2
"""Age of an image from which it does not show what is there now, s: a camera that hangs gives its last one
again, and a hand at 0.25 m/s has moved by 5 cm."""


@dataclass(frozen=True, slots=True, eq=False)
class CapturedImage:
    """A picture, and how the robot stood when it was taken: joints (n,) rad, opening m."""

    image: RgbdImage
    joints: Array
    width: float


@dataclass(frozen=True, slots=True, eq=False)
class PendingView:
    """A picture with what perception made of it; the belief does not know of it yet."""

    image: RgbdImage
    view: PerceivedView
    stamp: float
    """Simulated seconds."""
    held: Pose | None
    """Where the object in the hand was in the world when it was taken; None: the hand was empty."""


class Vision:
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
        thinking: ComputeTimeAccount,
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
        self.cost = cost
        """Simulated seconds that it takes to work on a picture."""
        self._joints = joints
        self._width = width
        self._stopwatch = stopwatch or Stopwatch()
        self._still = frozenset(cameras) - perceive.moving
        self.bins: dict[str, BinView] = {}
        """What was last seen in each bin; part of the state."""
        self.looks = 0
        """How often it was looked; part of the state."""
        self.newest = 0.0
        """When the newest picture was taken that the belief knows of, s. Only compared with pictures that are
        under way, of which a checkpoint knows none."""

    @property
    def hand(self) -> str | None:
        """Name of the camera on the hand; None: there is none."""
        return next((name for name in self._cameras if name not in self._still), None)

    def shoot(self, camera: str) -> Generator[None, None, CapturedImage]:
        """One picture through `camera`, charged as a look is; nothing is recognised, no belief changes."""
        shot = yield from self._patiently(lambda: self._shot(camera))
        yield from self._charge()
        self._journal.note(ImageEntry(shot.image, ()))
        return shot

    def follow(
        self, camera: str, objects: Sequence[BeliefObject]
    ) -> Generator[None, None, tuple[TrackedSighting, ...]]:
        """Where a picture through `camera` shows objects that are believed to be in it. Charged as a look is;
        the belief does not change."""
        shot = yield from self._patiently(lambda: self._shot(camera))
        with self._stopwatch.measure("perception"):
            found = self._perceive.follow(shot.image, shot.joints, shot.width, self._scene, objects)
        yield from self._charge()
        seen = sorted({str(s.object) for s in found if math.isfinite(s.misfit)})
        self._journal.note(ImageEntry(shot.image, tuple(seen)))
        return found

    def look(self, camera: str) -> Generator[None, None, ObservationSummary]:
        """Observe through `camera`; the belief changes when the thinking is over.

        Raises Failure: perception.not_found when there is no such camera, perception.no_image when none comes
        within a few frames, or only old ones.
        """
        glance = yield from self._patiently(lambda: self.glance(camera))
        yield from self._charge()
        return self.take_in(glance)

    def glance(self, camera: str) -> PendingView:
        """A picture through `camera`, and what perception makes of it: nothing is charged, and the belief
        does not change before `take_in`, which the caller defers until the thinking is over.

        Raises Failure: perception.not_found when there is no such camera, perception.no_image when this frame
        does not come, or is old.
        """
        stamp = self._clock.now
        shot = self._shot(camera)
        with self._stopwatch.measure("perception"):
            view = self._perceive.detect(shot.image, shot.joints, shot.width, self._scene)
        held = self._scene.held
        return PendingView(shot.image, view, stamp, None if held is None else held.pose)

    def take_in(self, glance: PendingView) -> ObservationSummary:
        """Bring the belief up to date with a picture, as it was when it was taken."""
        view, image = glance.view, glance.image
        summary = update_belief(self._scene, view, glance.stamp, glance.held)
        for name, seen in view.bins.items():
            still = image.camera in self._still
            self.bins[str(name)] = seen if still else seen.over(self.bins.get(str(name)))
        self.looks += 1
        self.newest = max(self.newest, glance.stamp)
        findings = tuple(f"{d.colour} {d.kind}" for d in view.detections)
        self._journal.note(ImageEntry(image, findings))
        return summary

    def _shot(self, camera: str) -> CapturedImage:
        if camera not in self._cameras:
            raise Failure(
                perception.NOT_FOUND, f"there is no camera {camera!r}", known=[str(c) for c in self._cameras]
            )
        try:
            with self._stopwatch.measure("rendering"):
                image = self._cameras[camera].capture()
        except NoImage:
            raise Failure(perception.NO_IMAGE, f"{camera} gives no image", camera=camera) from None
        age = self._clock.now - image.stamp
        if age > OLDEST:
            message = f"{camera} gives no new image: the last one is {age:.2f} s old"
            raise Failure(perception.NO_IMAGE, message, camera=camera, age=round(age, 3))
        return CapturedImage(image, self._joints(), self._width())

    def _patiently(self, take: Callable[[], T]) -> Generator[None, None, T]:
        """What `take` comes to, which takes a picture: at the next frames, too, where none comes."""
        begun, missed = self._clock.now, 0
        while True:
            try:
                taken = take()
            except Failure as failure:
                if failure.cause is not perception.NO_IMAGE:
                    raise
                missed += 1
                if missed == FRAMES:
                    waited = self._clock.now - begun
                    message = f"{failure.message} ({FRAMES} frames in {waited:.2f} s)"
                    evidence = {**failure.evidence, "frames": FRAMES, "waited": round(waited, 3)}
                    raise Failure(perception.NO_IMAGE, message, **evidence) from None
                until = self._clock.now + FRAME
                while self._clock.now < until - 1e-9:
                    yield
                continue
            if missed:
                words = f"{missed} of {missed + 1} frames did not come"
                self._journal.note(JournalEvent("frames_missed", words, data={"missed": missed}))
            return taken

    def _charge(self) -> Generator[None, None, None]:
        self._thinking.spend(self.cost)
        yield from self._thinking.charge()
