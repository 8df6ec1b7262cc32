"""Survey: images of a calibration target, with a hand camera from many places."""

from __future__ import annotations

from typing import TYPE_CHECKING

from picktree.robot.calibration import Viewpoint, calibration_targets, observations, viewpoints
from picktree.robot.planning import NamedGoal, PoseGoal, Request
from picktree.trees import ARM, CAMERA, Doing, In, Skill, Steps, port
from picktree.world import Failure, control, event_types, perception, planning, safety
from picktree.world import world as world_causes

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.world.scene import CameraDescription

PLACES_PER_VIEW = 3
"""Number of tested places for each required view: not all are within reach."""
LEAVE_VIEW_POSES = ("observe", "rest", "home")
"""Named poses in which the arm leaves a fixed camera's view of the target; missing ones are skipped."""
EXTRA_CLEARANCE = 0.01
"""Clearance of motions beyond the usual margins, m: the poses of tool and target are uncertain."""
IMAGES_PER_PLACE = 2
"""Number of images from each place of a hand camera."""


class Survey(Skill):
    """Look at a calibration target, and record exactly where its squares are in the pictures.

    A camera on the hand takes pictures from all around the target, with rotations that differ as much as the
    arm allows. Viewpoints out of reach are skipped. A fixed camera takes many pictures while the arm is out
    of its view, and their mean is used. Nothing is corrected yet: `picktree calibrate` does that.
    """

    example = """
    Survey: {target: target, camera: wrist}
    """

    target: In[str] = port("the fixture with `marker`", default="target", names="fixture")
    camera: In[str] = port("the camera to look through", default="wrist", names="camera")
    views: In[int] = port("number of viewpoints of a camera on the hand", default=12, least=4, most=100)
    pictures: In[int] = port("number of images to average for a fixed camera", default=50, least=1, most=1000)
    causes = (
        perception.NOT_FOUND,
        perception.NO_IMAGE,
        planning.ANY,
        control.ANY,
        safety.ANY,
        world_causes.UNKNOWN_OBJECT,
        world_causes.DISTURBED,
    )
    uses = (ARM, CAMERA)
    limit = 1800.0

    def run(self, world: World) -> Steps:
        target = calibration_targets.target_named(world.scene.fixtures.values(), self.target)
        camera = next((c for c in world.description.cameras if c.name == self.camera), None)
        if camera is None:
            known = [c.name for c in world.description.cameras]
            raise Failure(perception.NOT_FOUND, f"there is no camera {self.camera!r}", known=known)
        if camera.on == "world":
            yield from self._from_afar(world, target, camera)
        else:
            yield from self._from_all_sides(world, target, camera)

    def _from_afar(
        self, world: World, target: calibration_targets.CalibrationTarget, camera: CameraDescription
    ) -> Steps:
        for pose in (name for name in LEAVE_VIEW_POSES if name in world.robot.description.named):
            plan = yield from world.plan.to(
                NamedGoal(pose), scaling=world.handling.scaling(1.0), node=self.path
            )
            yield from world.move.along(plan.trajectory, guard=world.handling.guard, node=self.path)
            seen = yield from self._record_images(world, target, 1)
            if seen:
                shot = yield from self._shot(world, target, camera, self.pictures)
                if shot is not None:
                    self._note(world, shot, "from where it hangs")
                    return
        raise self._unseen(target)

    def _from_all_sides(
        self, world: World, target: calibration_targets.CalibrationTarget, camera: CameraDescription
    ) -> Steps:
        first = yield from world.vision.capture(self.camera)
        offered = viewpoints(target.pose, target.size, first.image.intrinsics, PLACES_PER_VIEW * self.views)
        found = 0
        for place in offered:
            if found == self.views:
                return
            if not (yield from self._go(world, place, camera)):
                continue
            shot = yield from self._shot(world, target, camera, IMAGES_PER_PLACE)
            if shot is None:
                self._skip(world, f"{place.name}: the target is not seen well enough")
                continue
            found += 1
            self._note(world, shot, f"{place.name}, the {found}. of {self.views}")
        if found == 0:
            raise self._unseen(target)

    def _go(self, world: World, place: Viewpoint, camera: CameraDescription) -> Doing[bool]:
        to_tcp = camera.pose.inverse()
        failure: Failure | None = None
        for pose in place.camera_in_world:
            try:
                goal = PoseGoal((pose @ to_tcp,))
                request = Request(goal, scaling=world.handling.scaling(1.0), clearance=EXTRA_CLEARANCE)
                plan = yield from world.plan.solve(request, node=self.path)
            except Failure as refused:
                if not refused.cause.name.startswith("planning."):
                    raise
                failure = refused
                continue
            yield from world.move.along(plan.trajectory, guard=world.handling.guard, node=self.path)
            return True
        self._skip(world, f"{place.name} is out of reach: {failure.message if failure else 'no plan'}")
        return False

    def _shot(
        self,
        world: World,
        target: calibration_targets.CalibrationTarget,
        camera: CameraDescription,
        pictures: int,
    ) -> Doing[observations.TargetImage | None]:
        """Return the average of several images from here; None when they do not show the target."""
        from picktree.robot.calibration import target_detection  # needs OpenCV

        yield from world.control.settle()
        seen: list[tuple[observations.DetectedTile, ...]] = []
        taken = None
        for _ in range(pictures):
            taken = yield from world.vision.capture(self.camera)
            seen.append(target_detection.detect_tiles(taken.image, target.tiles))
        together = target_detection.average_tiles(seen)
        if not together or taken is None:
            return None
        on_hand = camera.on == "hand"
        return observations.TargetImage(
            self.camera, on_hand, taken.image.intrinsics, world.control.tcp, camera.pose, together
        )

    def _record_images(
        self, world: World, target: calibration_targets.CalibrationTarget, pictures: int
    ) -> Doing[bool]:
        from picktree.robot.calibration import target_detection

        yield from world.control.settle()
        for _ in range(pictures):
            taken = yield from world.vision.capture(self.camera)
            if target_detection.detect_tiles(taken.image, target.tiles):
                return True
        return False

    def _note(self, world: World, shot: observations.TargetImage, where: str) -> None:
        message = f"{self.camera}: {len(shot.tiles)} squares of {self.target} {where}"
        world.journal.note(shot.to_event(message, self.path))

    def _skip(self, world: World, message: str) -> None:
        world.journal.note(event_types.CalibrationSkippedEvent(f"{self.camera}: {message}", self.path))

    def _unseen(self, target: calibration_targets.CalibrationTarget) -> Failure:
        return Failure(
            perception.NOT_FOUND, f"{target.name} is not in any view of {self.camera}", object=target.name
        )
