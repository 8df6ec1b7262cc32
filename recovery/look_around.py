"""LookAround and ResetGripper: recovery of the belief, and of the fingers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from picktree.robot.manipulation import held_object, travel_order
from picktree.robot.planning import NamedGoal
from picktree.trees import ARM, CAMERA, GRIPPER, Doing, In, Out, Skill, Steps, port
from picktree.world import Failure, ObjectId, control, event_types, grasp, perception, planning, safety

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.perception import ObservationSummary
    from picktree.world.scene import CameraDescription

VIEW_POSES = ("observe", "rest", "home")
"""Named poses of the robot for looking: the hand camera sees the scene, or the arm leaves the other cameras'
view. Missing ones are skipped."""


class LookAround(Skill):
    """Look again in another way: through each camera of the scene, from each pose that robots look from.

    Fixed cameras look first, from the arm's present pose. Then the arm goes to each pose, and the cameras
    look there. With `expect` the node ends as soon as a camera has seen that object; without it, when every
    camera has looked once. A camera without a picture or a pose out of reach is skipped while another is
    left.
    """

    example = """
    LookAround: {expect: "{item}"}
    """

    expect: In[ObjectId] = port(
        "the object to look for; without it, all cameras look once", default=ObjectId("")
    )
    objects: Out[list[ObjectId]] = port(
        "ids of the items outside their destination, in the order in which to take them"
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
        self.objects = [o.id for o in travel_order(world, world.to_do())]

    def _look(
        self, world: World, cameras: list[CameraDescription]
    ) -> Doing[tuple[bool, list[CameraDescription]]]:
        """Return whether the expected object was seen, and the cameras that gave no image."""
        blind: list[CameraDescription] = []
        for camera in cameras:
            try:
                summary: ObservationSummary = yield from world.vision.observe(camera.name)
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


class ResetGripper(Skill):
    """Open the fingers, close them, open them again, and measure the opening each time.

    For a gripper that did not follow a command. Between two tries it waits, since a jam may clear by itself.
    The hand must be empty; with `drop` it releases a held object first, at its present place.
    """

    example = """
    ResetGripper: {tries: 3, wait: 2 s}
    """

    drop: In[bool] = port("whether a held object is released first, at its present place", default=False)
    tries: In[int] = port("number of times that the fingers close and open", default=3, least=1, most=20)
    wait: In[float] = port("time between two tries", unit="s", default=2.0, least=0)
    force: In[float] = port("grip force of each finger", unit="N", default=10.0, above=0)
    causes = (control.GRIPPER, control.TIMEOUT, grasp.NO_CANDIDATE, safety.ANY)
    uses = (GRIPPER,)
    hand_after = "empty"

    def run(self, world: World) -> Steps:
        held = world.scene.held
        if held is not None and not self.drop:
            raise Failure(
                grasp.NO_CANDIDATE, f"the hand is not free: it holds {held.id}", object=held.id, held=held.id
            )
        yield from world.control.settle()
        problem = ""
        for number in range(1, self.tries + 1):
            problem = yield from self._to_and_fro(world)
            if not problem:
                world.journal.note(
                    event_types.GripperResetEvent(f"the fingers follow again, at try {number}", self.path)
                )
                return
            yield from self._pause(world)
        raise Failure(
            control.GRIPPER,
            f"after {self.tries} tries the fingers still do not follow: {problem}",
            width=world.gripper.width,
            tries=self.tries,
        )

    def _to_and_fro(self, world: World) -> Doing[str]:
        """Open, close and open the fingers; return the error, empty when they follow."""
        most = world.robot.description.gripper.max_width
        for opens in (True, False, True):
            before = world.gripper.width
            try:
                if opens:
                    yield from held_object.open_gripper(world, "let go by ResetGripper")
                else:
                    yield from world.gripper.close(self.force)
            except Failure as failure:
                if failure.cause not in (control.TIMEOUT, control.GRIPPER):
                    raise
                return failure.message
            width = world.gripper.width
            if opens and width < most - MAX_OPENING_ERROR:
                return f"they opened to {width * 1000:.0f} mm of {most * 1000:.0f} mm"
            if not opens and before - width < MIN_CLOSING_SHARE * before:
                return f"they closed from {before * 1000:.0f} mm to {width * 1000:.0f} mm only"
        return ""

    def _pause(self, world: World) -> Steps:
        until = world.clock.now + self.wait
        while world.clock.now < until - 1e-9:
            yield


MAX_OPENING_ERROR = 5e-3
"""Opening error above which open fingers do not follow, m."""
MIN_CLOSING_SHARE = 0.5
"""Share of the opening by which the fingers must close; an object may be between them."""
