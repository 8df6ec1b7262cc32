"""SetAside: give up an item, so that the mission no longer waits for it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, cast

from ..trees.flow.default_flow import leaf
from ..trees.node import Node
from ..trees.ports import In, port
from ..trees.status import NodeStatus
from ..world.belief.facts import ASIDE
from ..world.causes import Failure, place
from ..world.events.skill_events import SetAsideEvent
from ..world.values import ObjectId

if TYPE_CHECKING:
    from ..cell.world import World
    from ..trees.flow import FlowState, NodeOutcomes
    from ..trees.flow.flow_walk import FlowAnalysis
    from ..trees.mission import NodeSpec

_GIVEN_UP_ENTRY = "given up"
"""Entry in the memory of attempts for each time that an item was given up."""


class SetAside(Node):
    """Give an item up where it lies: it is among the items to be done no longer, until it is put elsewhere.

    With `after: 2` the first time only counts, for the item may be had when others are out of its way.
    Nothing moves: the belief alone changes. An item that is gone needs no giving up: SUCCESS.
    """

    example = """
    Fallback:
      - Grasp: {object: "{item}"}
      - SetAside: {object: "{item}", after: 2}
    """

    kind = "action"
    played = False
    gives_up = True
    object: In[ObjectId] = port("the item to give up, which is not in the hand")
    after: In[int] = port("which time it is given up indeed; before that it is counted", default=1, least=1)
    causes = (place.MISSED,)

    def on_tick(self) -> NodeStatus:
        world = cast("World", self.world)
        belief = world.scene.find(self.object)
        if belief is None:
            return NodeStatus.SUCCESS
        if belief.attached:
            raise Failure(
                place.MISSED, f"{self.object} is in the hand: let go of it first", object=self.object
            )
        world.attempts.failed(self.path, self.object, _GIVEN_UP_ENTRY)
        times = world.attempts.count(self.path, self.object)
        self.feedback_message = f"{self.object} was given up {times} of {self.after} times"
        if times < self.after:
            return NodeStatus.SUCCESS
        world.attempts.forget(self.object)
        world.scene.put(replace(belief, place=ASIDE), "set aside: it is left where it lies")
        x, y, _ = belief.pose.position
        world.journal.note(
            SetAsideEvent(
                f"{self.object} is left where it lies",
                self.path,
                object=self.object,
                form=belief.form,
                x=x,
                y=y,
                times=times,
            )
        )
        return NodeStatus.SUCCESS

    @classmethod
    def flow(cls, spec: NodeSpec, entry: FlowState, walk: FlowAnalysis) -> NodeOutcomes:
        return leaf(cls, spec, entry, walk, takes_time=False)
