"""Looking: take a picture, let perception work on it, bring the belief up to date."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping

from .causes import Failure, perception
from .journal import ImageTaken, Journal
from .perception.association import ObservationSummary, update_belief
from .perception.pipeline import BinView, Perception
from .protocols import Camera, Clock
from .scene.planning_scene import PlanningScene
from .stopwatch import Stopwatch
from .thinking import ThinkingAccount
from .values import Array


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
        self.bins: dict[str, BinView] = {}
        """What was last seen in each bin; part of the state."""
        self.looks = 0
        """How often it was looked; part of the state."""

    def look(self, camera: str) -> Generator[None, None, ObservationSummary]:
        """Observe through `camera`; the belief changes when the thinking is over.

        Raises Failure(perception.not_found) when there is no such camera.
        """
        if camera not in self._cameras:
            raise Failure(
                perception.NOT_FOUND, f"there is no camera {camera!r}", known=[str(c) for c in self._cameras]
            )
        stamp = self._clock.now
        with self._stopwatch.measure("rendering"):
            image = self._cameras[camera].capture()
        with self._stopwatch.measure("perception"):
            view = self._perceive.detect(image, self._joints(), self._width(), self._scene)
        self._thinking.spend(self._cost)
        yield from self._thinking.charge()
        summary = update_belief(self._scene, view, stamp)
        self.bins.update((str(name), seen) for name, seen in view.bins.items())
        self.looks += 1
        findings = tuple(f"{d.colour} {d.kind}" for d in view.detections)
        self._journal.note(ImageTaken(image, findings))
        return summary
