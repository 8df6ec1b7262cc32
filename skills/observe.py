"""Observe: look through a camera and update the planning scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..manipulation.pick.travel_order import travel_order
from ..manipulation.place.dropped_objects import apply_bin_exchanges
from ..trees.flow import LeafFlow
from ..trees.ports import In, Out, port
from ..trees.skill import CAMERA, Skill, Steps
from ..world.causes import Failure, perception
from ..world.values import ObjectId

if TYPE_CHECKING:
    from ..skill_world.world import World


class Observe(Skill):
    """Look through a camera; list the items that are to be taken somewhere.

    What the hand holds comes first: nothing else can be grasped before. The others follow in an order that
    keeps the travel of the empty hand short.
    """

    flow = LeafFlow(fails_with="expect")
    example = """
    Observe: {camera: overhead, objects: "{items}"}
    """

    camera: In[str] = port("the camera to look through", default="overhead", names="camera")
    expect: In[ObjectId] = port(
        "fail when this object is not in view; without it, whatever is seen will do", default=ObjectId("")
    )
    objects: Out[list[ObjectId]] = port(
        "ids of the items that do not lie where they belong, in the order to take them"
    )
    causes = (perception.NOT_FOUND, perception.NO_IMAGE)
    uses = (CAMERA,)

    def run(self, world: World) -> Steps:
        yield from world.control.settle()
        apply_bin_exchanges(world, self.path)
        world.noticed.deliveries = world.feed.read().deliveries
        summary = yield from world.vision.look(self.camera)
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
