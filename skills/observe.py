"""Observe and Present: look through a camera at the scene, or at the thing in the hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

from picktree.robot.manipulation import bin_belief, travel_order
from picktree.trees import ARM, CAMERA, In, Out, Skill, Steps, control_flow, port
from picktree.world import Failure, ObjectId, control, grasp, perception, planning, safety
from picktree.world import world as world_causes

if TYPE_CHECKING:
    from picktree.robot import World


class Observe(Skill):
    """Look through a camera; list the items that are to be taken somewhere.

    A held object comes first, since the hand can grasp nothing else before. The other items follow in an
    order that keeps the travel of the empty hand short.
    """

    flow = control_flow.LeafFlow(fails_with="expect")
    example = """
    Observe: {camera: overhead, objects: "{items}"}
    """

    camera: In[str] = port("the camera to look through", default="overhead", names="camera")
    expect: In[ObjectId] = port(
        "object that must be in view, else the node fails; without it, any view will do", default=ObjectId("")
    )
    fresh: In[bool] = port(
        "whether everything in the image is recognised anew; otherwise objects without a change in the image "
        "are only confirmed",
        default=False,
    )
    objects: Out[list[ObjectId]] = port(
        "ids of the items outside their destination, in the order in which to take them"
    )
    causes = (perception.NOT_FOUND, perception.NO_IMAGE)
    uses = (CAMERA,)

    def run(self, world: World) -> Steps:
        yield from world.control.settle()
        bin_belief.apply_bin_exchanges(world, self.path)
        world.noticed.deliveries = world.feed.read().deliveries
        summary = yield from world.vision.observe(self.camera, fresh=self.fresh)
        for gone in summary.removed:
            world.attempts.forget(gone)
        if self.expect and self.expect not in summary.seen:
            raise Failure(
                perception.NOT_FOUND,
                f"{self.expect} is not in the view of {self.camera}",
                object=self.expect,
                seen=[str(o) for o in summary.seen],
            )
        self.objects = [o.id for o in travel_order(world, world.to_do())]


class Present(Skill):
    """Hold the thing in the hand before a fixed camera, and learn its hull, colour, size and tag.

    The camera sees it from both sides of the hand, as far as the arm gets there. The pose follows from the
    camera's place and field of view; the fingers are beside the thing, so that they do not hide it. Two
    different tags, or surfaces of two colours, show that more than one thing is in the hand: the skill fails
    with `grasp.double`, and the hand still holds them. The result is stored only for a thing that is not in
    the catalogue; an object of a known kind is only looked at.
    """

    example = """
    Present: {object: "{thing}", until_classified: true}
    """

    object: In[ObjectId] = port("the object to present, which the hand holds")
    camera: In[str] = port(
        "the fixed camera in front of which the hand holds the object", default="overhead", names="camera"
    )
    looks: In[int] = port("maximum number of looks: 2 for both sides of the hand", default=2, least=1, most=2)
    until_classified: In[bool] = port(
        "whether the node ends as soon as the properties in the scene's `destinations` are known; it does "
        "not look when they are already known",
        default=False,
    )
    speed: In[float] = port(
        "share of the joints' speed limits: 1 for the full limits", default=0.5, above=0, most=1
    )
    causes = (
        grasp.DOUBLE,
        grasp.SLIPPED,
        perception.NOT_FOUND,
        perception.NO_IMAGE,
        planning.ANY,
        control.ANY,
        safety.ANY,
        world_causes.UNKNOWN_OBJECT,
    )
    uses = (ARM, CAMERA)
    hand_before = "full"
    hand_after = "full"
    limit = 120.0

    def run(self, world: World) -> Steps:
        # Perception of what is held is slow to load, and a check does without.
        from picktree.robot.manipulation import PresentTask, present

        world.handover.drop()
        yield from world.move.rest()
        task = PresentTask(self.object, self.path, self.camera, self.looks, self.until_classified, self.speed)
        yield from present(world, task)
