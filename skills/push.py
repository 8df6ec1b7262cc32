"""Push: move an object over its table with the finger tips, stroke by stroke, with images in between."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

from picktree.robot.manipulation import closed_loop_pushing
from picktree.trees import ARM, CAMERA, GRIPPER, In, PortProblem, PortValues, Skill, Steps, port
from picktree.world import ObjectId, control, perception, planning, push, safety
from picktree.world import world as world_causes

if TYPE_CHECKING:
    from picktree.robot import World


class Push(Skill):
    """Push an object over the table: to a place (`to`, `yaw`), along a line (`direction`, `distance`), or so
    that it can be grasped (`singulate`).

    The closed fingers push at a flat side; the opened ones hold a round object between them. After each
    stroke the arm leaves the view and the camera looks; the next stroke starts from the pose that image and
    contact gave. A pushed object keeps away from the edge of its table and from other bodies. With
    `singulate`, its neighbours may be pushed along.
    """

    example = """
    Push: {object: "{item}", to: [0.5, 0.1], yaw: 90 deg}
    """

    object: In[ObjectId] = port(
        "the object to push, or to make room around; by default, with `singulate`, the object closest to "
        "others, unrecognised objects first",
        default=ObjectId(""),
    )
    to: In[list[float]] = port("goal of the object's middle: x, y in the world", unit="m", default=[])
    yaw: In[float | None] = port(
        "goal of the object's heading, as seen from above; a symmetric object takes the nearest "
        "equal heading; by default any heading",
        unit="rad",
        default=None,
    )
    direction: In[list[float]] = port(
        "direction of a push along a line: x, y in the world, of any length", default=[]
    )
    distance: In[float] = port("length of a push along a line", unit="m", default=0.0, least=0, most=1)
    singulate: In[bool] = port(
        "whether to push the object or its neighbours until the hand fits around the object; no push when "
        "the hand already fits",
        default=False,
    )
    tolerance: In[float] = port(
        "maximum distance of the object's middle from the goal", unit="m", default=0.0015, above=0
    )
    turned: In[float] = port(
        "maximum angle of the object's heading from the goal", unit="rad", default=math.radians(1.5), above=0
    )
    strokes: In[int] = port("maximum number of strokes", default=8, least=1, most=50)
    speed: In[float] = port("speed of the tool during a push", unit="m/s", default=0.05, above=0, most=0.2)
    force: In[float] = port("contact force on the tool that stops a stroke", unit="N", default=15.0, above=0)
    camera: In[str] = port("the camera to look through", default="overhead", names="camera")
    causes = (
        push.LOST_CONTACT,
        push.STALLED,
        push.MISSED,
        push.NO_STROKE,
        perception.NOT_FOUND,
        perception.NO_IMAGE,
        planning.ANY,
        control.ANY,
        safety.ANY,
        world_causes.UNKNOWN_OBJECT,
        world_causes.DISTURBED,
    )
    uses = (ARM, GRIPPER, CAMERA)
    limit = 300.0

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        wrong: list[str | PortProblem] = []
        placed, lined = given.any_of("to", "yaw"), given.any_of("direction", "distance")
        parted = given.any_of("singulate") and given.constants.get("singulate") is not False
        if placed + lined + parted != 1:
            wrong.append("one of 'to' (or 'yaw' alone), 'direction' and 'singulate' must be given")
        elif lined and not (given.any_of("direction") and given.any_of("distance")):
            wrong.append("'direction' and 'distance' belong together")
        if not parted and not given.any_of("object"):
            wrong.append("'object' must be given: only with 'singulate' it may be left out")
        for key in ("to", "direction"):
            value = given.constants.get(key)
            if isinstance(value, list) and len(cast("list[object]", value)) != 2:
                wrong.append(
                    PortProblem(key, f"two numbers x, y are wanted, not {len(cast('list[object]', value))}")
                )
        return tuple(wrong)

    def run(self, world: World) -> Steps:
        world.handover.drop()
        closed_loop_pushing.check_hand_is_free(world, self.object)
        task = closed_loop_pushing.PushTask(
            self.object, self.path, self.camera, self.strokes, self.speed, self.force
        )
        if self.singulate:
            yield from closed_loop_pushing.make_room(world, task)
            return
        world.scene.get(self.object)
        belief = yield from closed_loop_pushing.observe_pushed_object(world, task)
        goal = closed_loop_pushing.push_goal(belief, self.to, self.yaw, self.direction, self.distance)
        closed_loop_pushing.check_goal(world, belief, goal)
        tolerance = closed_loop_pushing.PushTolerance(self.tolerance, self.turned)
        yield from closed_loop_pushing.push_to_goal(world, task, belief, goal, tolerance)
