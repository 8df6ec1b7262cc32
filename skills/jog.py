"""Jog: move the tool with a velocity, slower near limits, until a stop."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal, cast

from picktree.files import PicktreeError
from picktree.robot.control import MAX_TWIST_ANGULAR_SPEED, MAX_TWIST_SPEED, Twist
from picktree.trees import ARM, In, Out, PortProblem, PortValues, Skill, Steps, port
from picktree.world import control, planning, safety
from picktree.world import world as world_causes

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.world import Vector3


class Jog(Skill):
    """Move the tool with a velocity and turn it, for a time, a distance, or until something stops it.

    Nothing is planned. The arm slows down towards joint limits, singularities, the edge of the workspace and
    believed bodies, and stops before contact. A force above `guard` N stops it, too. With `when_stopped:
    succeed` a stop is a success, and `stopped_by` names its reason.
    """

    example = """
    Jog: {velocity: [0, 0, -0.05], distance: 30 mm, when_stopped: succeed, stopped_by: "{end}"}
    """

    velocity: In[list[float]] = port(
        "velocity of the tool's centre point along x, y, z", unit="m/s", default=[0, 0, 0]
    )
    turn: In[list[float]] = port(
        "angular velocity of the tool about x, y, z", unit="rad/s", default=[0, 0, 0]
    )
    frame: In[Literal["world", "tool"]] = port("frame of these axes", default="world")
    duration: In[float] = port("duration of the jog; 0 for no limit", unit="s", default=0.0, least=0)
    distance: In[float] = port("distance of the jog; 0 for no limit", unit="m", default=0.0, least=0)
    guard: In[float] = port("contact force that stops the jog", unit="N", default=25.0, above=0)
    when_stopped: In[Literal["fail", "succeed"]] = port(
        "result when the jog is stopped before its time or distance is over", default="fail"
    )
    stopped_by: Out[str] = port(
        "reason of the end: `done`, `contact`, `collision`, `joint_limit`, `singularity` or `workspace`"
    )
    travelled: Out[float] = port("path length of the tool's centre point", unit="m")
    causes = (planning.BLOCKED, world_causes.DISTURBED, control.ANY, safety.ANY)
    uses = (ARM,)
    limit = 600.0
    waits_for = "duration"

    @classmethod
    def check_ports(cls, given: PortValues) -> tuple[str | PortProblem, ...]:
        if not given.any_of("velocity", "turn"):
            return ("'velocity' or 'turn' must be given",)
        return tuple(
            misfit
            for key, most, unit in (
                ("velocity", MAX_TWIST_SPEED, "m/s"),
                ("turn", MAX_TWIST_ANGULAR_SPEED, "rad/s"),
            )
            if (misfit := _misfit(key, given.constants.get(key), most, unit)) is not None
        )

    def run(self, world: World) -> Steps:
        twist = Twist(_vector(self.velocity), _vector(self.turn), self.frame)
        result = yield from world.move.jog(
            twist,
            node=self.path,
            guard=self.guard,
            duration=self.duration or math.inf,
            distance=self.distance or math.inf,
        )
        self.stopped_by, self.travelled = result.stopped_by, result.travelled
        failure = result.failure()
        if failure is not None and self.when_stopped == "fail":
            raise failure


def _vector(numbers: list[float]) -> Vector3:
    if len(numbers) != 3:
        raise PicktreeError(f"a jog needs three numbers x, y, z, not {numbers}")
    x, y, z = numbers
    return x, y, z


def _misfit(key: str, value: object, most: float, unit: str) -> PortProblem | None:
    if not isinstance(value, list):
        return None
    numbers = cast("list[float]", value)
    if len(numbers) != 3:
        return PortProblem(key, f"three numbers x, y, z are wanted, not {len(numbers)}")
    if math.hypot(*numbers) > most:
        return PortProblem(key, f"a jog does at most {most:g} {unit}, not {math.hypot(*numbers):.3g}")
    return None
