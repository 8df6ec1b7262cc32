"""Observation: capture an image, run perception on it and update the belief."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from picktree.robot.perception import (
    WORK_PER_TICK,
    BinView,
    HeldView,
    ObservationSummary,
    PerceivedView,
    Perception,
    PictureMemory,
    TrackedSighting,
    depth_noise,
    noise_factor,
    update_belief,
    update_heap,
)
from picktree.world import (
    Array,
    BeliefObject,
    Camera,
    Clock,
    ComputeTimeAccount,
    Failure,
    ImageEntry,
    Journal,
    NoImage,
    NotRecognised,
    PlanningScene,
    RecognisedItem,
    Recogniser,
    RgbdImage,
    Stopwatch,
    event_types,
    heap_geometry,
    perception,
    world_facts,
)

T = TypeVar("T")

MAX_FRAMES = 4
"""Number of frames that an observation waits for before it fails: cameras drop a frame now and then."""
FRAME_TIME = 0.1
"""Time from one frame to the next, s."""
MAX_IMAGE_AGE = 0.2
"""Maximum age of an image, s. A frozen camera returns its last image again, and a hand at 0.25 m/s has moved
by 5 cm in this time."""
LEAST_NOISE = 5e-5
"""Noise of a depth image from which no two images are the same, m. A camera without noise may repeat one."""


@dataclass(frozen=True, slots=True, eq=False)
class CapturedImage:
    """Image with the robot's state at the time of capture: joint angles (n,) rad, gripper opening m."""

    image: RgbdImage
    joints: Array
    width: float
    stamp: float
    """Simulated time of capture, s."""
    held: BeliefObject | None
    """Held object as believed at the time of capture; None: the hand was empty."""
    reported: tuple[RecognisedItem, ...] | None = None
    """Items that the recogniser has found in the image; None: it was not asked."""


class Look:
    """Image whose evaluation is in progress. `advance` it once in each tick until it is `done`, then merge it
    by `Vision.merge`."""

    def __init__(
        self, shot: CapturedImage, work: Generator[int, None, PerceivedView], stopwatch: Stopwatch
    ) -> None:
        self.shot = shot
        self.view: PerceivedView | None = None
        """Result; None while the evaluation is in progress."""
        self._work = work
        self._stopwatch = stopwatch
        self._spent = 0

    @property
    def done(self) -> bool:
        return self.view is not None

    def advance(self, work: float = WORK_PER_TICK) -> None:
        """Evaluate the image further, until so much more work or all of it is done."""
        if self.done:
            return
        until = self._spent + work
        with self._stopwatch.measure("perception"):
            try:
                while self._spent < until:
                    self._spent = next(self._work)
            except StopIteration as done:
                self.view = done.value


class Vision:
    """Cameras of the cell, and the latest view of each bin.

    `joints` and `width` give the arm's configuration (n,) rad and the opening m: the robot masks itself.
    While the arm is not `at_rest`, the evaluation of an image is spread over several ticks. Objects that are
    `doubted`, as after a failed grasp, are recognised again in each image. With a `recogniser` items are
    recognised by another process, not by their colour.
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
        at_rest: Callable[[], bool] = lambda: True,
        doubted: Callable[[], Collection[str]] = tuple,
        stopwatch: Stopwatch | None = None,
        recogniser: Recogniser | None = None,
    ) -> None:
        self._cameras = cameras
        self._perceive = perceive
        self._scene = scene
        self._clock = clock
        self._journal = journal
        self._thinking = thinking
        self.cost = cost
        """Simulated time charged for the processing of one image, s."""
        self._joints = joints
        self._width = width
        self._at_rest = at_rest
        self._doubted = doubted
        self._stopwatch = stopwatch or Stopwatch()
        self._recogniser = recogniser
        self._still = frozenset(cameras) - perceive.moving
        self.memories = {name: PictureMemory() for name in self._still}
        """Memory of the pictures of each fixed camera; part of the state."""
        self._last: dict[str, RgbdImage] = {}
        """Last image of each camera; of one that repeats itself, the first of these. No part of the state."""
        self.bins: dict[str, BinView] = {}
        """Latest view of each bin; part of the state."""
        self.heaps: dict[str, heap_geometry.Heap] = {}
        """Heap of each tote or fixture that was seen; part of the state."""
        self.observations = 0
        """Number of observations merged into the belief; part of the state."""
        self.newest = 0.0
        """Time of the newest image in the belief, s. It is compared only with images still in processing,
        which no checkpoint contains."""

    @property
    def hand(self) -> str | None:
        """Name of the camera on the hand; None without one."""
        return next((name for name in self._cameras if name not in self._still), None)

    def capture(self, camera: str) -> Generator[None, None, CapturedImage]:
        """Capture one image with `camera`, at the cost of an observation. Perception does not run and the
        belief does not change."""
        shot = yield from self._patiently(lambda: self.capture_now(camera, recognise=False))
        yield from self._charge()
        self._journal.note(ImageEntry(shot.image, ()))
        return shot

    def track(
        self, camera: str, objects: Sequence[BeliefObject]
    ) -> Generator[None, None, tuple[TrackedSighting, ...]]:
        """Capture an image with `camera` and locate objects that are believed to be in it. The cost is
        that of an observation; the belief does not change."""
        shot = yield from self._patiently(lambda: self.capture_now(camera))
        with self._stopwatch.measure("perception"):
            found = self._perceive.track(
                shot.image, shot.joints, shot.width, shot.held, objects, shot.reported
            )
        yield from self._charge()
        seen = sorted({str(s.object) for s in found if math.isfinite(s.misfit)})
        self._journal.note(ImageEntry(shot.image, tuple(seen)))
        return found

    def inspect(self, camera: str) -> Generator[None, None, HeldView]:
        """Capture an image with a fixed `camera`, and return the view of the hand. The cost is that of an
        observation; the belief does not change. Raises as `observe`."""
        shot = yield from self._patiently(lambda: self.capture_now(camera, recognise=False))
        with self._stopwatch.measure("perception"):
            seen = self._perceive.held(shot.image, shot.joints, shot.width)
        yield from self._charge()
        held = () if shot.held is None or not len(seen.points) else (str(shot.held.id),)
        self._journal.note(ImageEntry(shot.image, held))
        return seen

    def observe(self, camera: str, *, fresh: bool = False) -> Generator[None, None, ObservationSummary]:
        """Observe with `camera`; the belief changes after the charged time. Objects are recognised where
        the image has changed; with `fresh` everywhere.

        Raises Failure: perception.not_found for an unknown camera, perception.no_image when a few frames
        bring no new image.
        """
        shot = yield from self._patiently(lambda: self.capture_now(camera))
        if fresh and camera in self.memories:
            self.memories[camera].forget()
        look = self.begin(shot, [o for o in self._scene.objects if o.place == world_facts.ASIDE])
        self._thinking.spend(self.cost)
        for _ in self._thinking.charge():
            look.advance()
            yield
        while not look.done:
            if self._at_rest():
                look.advance(math.inf)
            else:
                look.advance()
                yield
        return self.merge(look)

    def begin(self, shot: CapturedImage, known: Sequence[BeliefObject]) -> Look:
        """Begin to evaluate an image in the present belief. Objects that are `known` are looked for where
        they are believed, and recognised only where they do not fit."""
        memory, doubted = self.memories.get(shot.image.camera), self._doubted()
        believed = [o for o in self._scene.objects if o.place == world_facts.ASIDE or o.id not in doubted]
        work = self._perceive.understand(
            shot.image, shot.joints, shot.width, shot.held, known, memory, believed, shot.reported
        )
        return Look(shot, work, self._stopwatch)

    def capture_now(self, camera: str, *, recognise: bool = True) -> CapturedImage:
        """Capture an image with `camera`; with `recognise`, let the recogniser find the items in it, if there
        is one. Nothing is charged, and the belief does not change before
        `merge`; the caller defers that until the charged time has passed.

        Raises Failure(perception.not_found) for an unknown camera, and Failure(perception.no_image) for a
        frame that is missing, old, repeated, or far noisier than usual, and for a recogniser without a usable
        answer.
        """
        if camera not in self._cameras:
            raise Failure(
                perception.NOT_FOUND, f"there is no camera {camera!r}", known=[str(c) for c in self._cameras]
            )
        try:
            with self._stopwatch.measure("rendering"):
                image = self._cameras[camera].capture()
        except NoImage:
            raise Failure(perception.NO_IMAGE, f"{camera} gives no image", camera=camera) from None
        now = self._clock.now
        age = now - image.stamp
        if age > MAX_IMAGE_AGE:
            message = f"{camera} gives no new image: the last one is {age:.2f} s old"
            raise Failure(perception.NO_IMAGE, message, camera=camera, age=round(age, 3))
        if self._is_repeated(image):
            frozen = now - self._last[camera].stamp
            message = f"{camera} stands still: it has given the same image for {frozen:.2f} s"
            raise Failure(perception.NO_IMAGE, message, camera=camera, frozen=round(frozen, 3))
        if factor := noise_factor(image.depth, self._perceive.noise[camera]):
            self._journal.note(ImageEntry(image, ()))
            message = (
                f"the depth of {camera} is {factor:.0f} times as noisy as it should be: no image can be used"
            )
            raise Failure(perception.NO_IMAGE, message, camera=camera, noise=round(factor, 1))
        reported = self._recognised(image) if recognise else None
        return CapturedImage(image, self._joints(), self._width(), now, self._scene.held, reported)

    def _recognised(self, image: RgbdImage) -> tuple[RecognisedItem, ...] | None:
        """Return the items that the recogniser finds; None without one."""
        if self._recogniser is None:
            return None
        try:
            return self._recogniser.recognise(image)
        except NotRecognised as error:
            self._journal.note(ImageEntry(image, ()))
            message = f"the image of {image.camera} was not evaluated: {error}"
            raise Failure(perception.NO_IMAGE, message, camera=image.camera, reason=str(error)) from None

    def _is_repeated(self, image: RgbdImage) -> bool:
        """Return whether an image with noise equals the camera's last one; keep it as the last if not."""
        last = self._last.setdefault(image.camera, image)
        if (
            image.stamp > last.stamp
            and np.array_equal(image.depth[::16, ::16], last.depth[::16, ::16])
            and np.array_equal(image.depth, last.depth)
            and np.array_equal(image.colour, last.colour)
            and depth_noise(image.depth)[0] > LEAST_NOISE
        ):
            return True
        self._last[image.camera] = image
        return False

    def merge(self, look: Look) -> ObservationSummary:
        """Merge the result of a look into the belief, for the time of its capture."""
        shot, view = look.shot, look.view
        assert view is not None
        image = shot.image
        with self._stopwatch.measure("perception"):
            held = None if shot.held is None else shot.held.pose
            summary = update_belief(self._scene, view, shot.stamp, held)
            memory = self.memories.get(image.camera)
            if memory is not None:
                memory.keep(view, {n: self._scene.get(name) for n, name in summary.objects.items()})
        for name, seen in view.bins.items():
            still = image.camera in self._still
            self.bins[str(name)] = seen if still else seen.over(self.bins.get(str(name)))
        for name, heap in view.heaps.items():
            region, former = self._scene.regions[name], self.heaps.get(str(name))
            self.heaps[str(name)] = update_heap(self._scene, region, heap, former, shot.stamp)
        self.observations += 1
        self.newest = max(self.newest, shot.stamp)
        confirmed = (o for o in self._scene.objects if o.id in view.confirmed)
        findings = tuple(f"{d.colour} {d.kind}" for d in (*confirmed, *view.detections))
        self._journal.note(ImageEntry(image, findings))
        return summary

    def _patiently(self, take: Callable[[], T]) -> Generator[None, None, T]:
        """Run `take`, which captures an image, and return its result; repeat it for the next frames when
        no image comes."""
        begun, missed = self._clock.now, 0
        while True:
            try:
                taken = take()
            except Failure as failure:
                if failure.cause is not perception.NO_IMAGE:
                    raise
                missed += 1
                if missed == MAX_FRAMES:
                    waited = self._clock.now - begun
                    message = f"{failure.message} ({MAX_FRAMES} frames in {waited:.2f} s)"
                    evidence = {**failure.evidence, "frames": MAX_FRAMES, "waited": round(waited, 3)}
                    raise Failure(perception.NO_IMAGE, message, **evidence) from None
                until = self._clock.now + FRAME_TIME
                while self._clock.now < until - 1e-9:
                    yield
                continue
            if missed:
                words = f"{missed} of {missed + 1} frames did not come"
                self._journal.note(event_types.FramesMissedEvent(words, missed=missed))
            return taken

    def _charge(self) -> Generator[None, None, None]:
        self._thinking.spend(self.cost)
        yield from self._thinking.charge()
