"""Out of the narrow: the first metres of a retreat, before planning is possible again."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING

from ..causes import Failure
from ..motion.requests import Offset, Scaling

if TYPE_CHECKING:
    from ..world import World

UP = 0.10
"""Height to gain, m."""
NEAR = 0.01
"""What is nearer to the hand than this counts as touched, m."""
LEAST = 0.25
"""Share of it that is worth having."""


def escape(world: World, scaling: Scaling, node: str) -> Generator[None, None, None]:
    """Straight up as far as that is free; when nothing is, back along the way that the arm came.

    What touches the arm or the hand already may be touched on the way out; nothing else may.
    """
    near = world.queries.hand_contacts(world.control.tcp, world.grip.width, margin=NEAR)
    touched = sorted({c.b for c in (*near, *world.plan.contacts())})
    with world.scene.allow(*((part, name) for name in touched for part in ("gripper", "arm"))):
        try:
            up = Offset((0.0, 0.0, UP), least_fraction=LEAST)
            plan = yield from world.plan.line(up, scaling=scaling, node=node)
        except Failure as failure:
            if not failure.cause.name.startswith("planning."):
                raise
            back = world.move.way_back()
            if back is None:
                return
            yield from world.move.along(back, guard=world.handling.guard, node=node)
            return
        yield from world.move.along(plan.trajectory, guard=world.handling.guard, node=node)
