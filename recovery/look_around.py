"""LookAround: look through every camera until one shows the expected object."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..planning.requests import NamedGoal
from ..trees.ports import In, Out, port
from ..trees.skill import ARM, CAMERA, Doing, Skill, Steps
from ..world.causes import Failure, control, perception, planning, safety
from ..world.values import ObjectId

if TYPE_CHECKING:
    from ..perception.data_association import ObservationSummary
    from ..skill_world.world import World
    from ..world.scene.description import CameraDescription

VIEW_POSES = ("observe", "rest", "home")
"""Named poses of the robot for looking: the hand camera sees the scene, or the arm leaves the other cameras'
view. Missing ones are skipped."""


class LookAround(Skill):
    """Look again in another way: through each camera of the scene, from each pose that robots look from.

    First through those that hang still, from where the arm is; then from each pose, through all. With
    `expect` it ends as soon as that object was seen; without it, when every camera has looked once. A camera
    that gives no picture, or a pose that cannot be reached, is passed over while another is left.
    """

    example = """
    LookAround: {expect: "{item}"}
    """

    expect: In[ObjectId] = port("what is looked for; without it, all cameras look once", default=ObjectId(""))
    objects: Out[list[ObjectId]] = port(
        "ids of the items that do not lie where they belong, in the order to take them"
    )
    causes = (perception.NOT_FOUND, perception.NO_IMAGE, planning.ANY, control.ANY, safety.ANY)
    uses = (ARM, CAMERA)

    def run(self, world: World) -> Steps:
        yield from world.control.settle()
        self._failure: Failure | None = None
        left = [camera for camera in world.description.cameras if camera.on == "world"]
        on_hand = [camera for camera in world.description.cameras if camera.on != "world"]
        seen, blind = yield from self._look(world, left)
        poses = [pose for pose in VIEW_POSES if pose in world.robot.description.named]
        wanted = [*blind, *on_hand]
        for pose in poses:
            if seen or not (self.expect or wanted):
                break
            if not (yield from self._go(world, pose)):
                continue
            seen, wanted = yield from self._look(world, [*left, *on_hand] if self.expect else wanted)
        if not seen and (self.expect or len(wanted) == len(world.description.cameras)):
            raise self._failure or Failure(
                perception.NOT_FOUND,
                f"{self.expect or 'nothing'} is not in the view of any camera",
                object=self.expect,
            )
        items = sorted(world.to_do(), key=lambda o: (not o.attached, o.pose.position[0], o.id))
        self.objects = [o.id for o in items]

    def _look(
        self, world: World, cameras: list[CameraDescription]
    ) -> Doing[tuple[bool, list[CameraDescription]]]:
        """Return whether the expected object was seen, and the cameras that gave no image."""
        blind: list[CameraDescription] = []
        for camera in cameras:
            try:
                summary: ObservationSummary = yield from world.vision.look(camera.name)
            except Failure as failure:
                if failure.cause is not perception.NO_IMAGE:
                    raise
                self._failure = failure
                blind.append(camera)
                continue
            for gone in summary.removed:
                world.attempts.forget(gone)
            if self.expect and self.expect in summary.seen:
                return True, blind
        return False, blind

    def _go(self, world: World, pose: str) -> Doing[bool]:
        scaling = world.handling.scaling(1.0)
        try:
            plan = yield from world.plan.to(NamedGoal(pose), scaling=scaling, node=self.path)
        except Failure as failure:
            self._failure = failure
            return False
        yield from world.move.along(plan.trajectory, guard=world.handling.guard, node=self.path)
        yield from world.control.settle()
        return True
