"""Push: move an object over its table with the finger tips, stroke by stroke, with images in between."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np

from ..manipulation.push.push_stroke import (
    FeasibleStroke,
    PushResult,
    execute_stroke,
    go_looking,
    plan_stroke,
    pose_refusal,
    step_back,
    stroke_refusal,
)
from ..manipulation.push.pushed_object import (
    PlanarEstimate,
    estimate_from_camera,
    estimate_from_contact,
    fuse_estimates,
    observe_closely,
)
from ..manipulation.push.singulation import SingulationPush, has_room, most_crowded_object, singulation_pushes
from ..manipulation.push.stroke_planning import PushGoal, PushStroke, push_strokes, turning_room_strokes
from ..trees.ports import In, port
from ..trees.skill import ARM, CAMERA, GRIPPER, Doing, Skill, Steps
from ..trees.values.port_types import PortProblem, PortValues
from ..world.causes import Failure, control, perception, planning, push, safety
from ..world.causes import world as world_causes
from ..world.events.skill_events import PushEvent
from ..world.planar_geometry import PlanarPose, moved, outline, planar
from ..world.values import ObjectId

if TYPE_CHECKING:
    from ..cell.world import World
    from ..world.belief.planning_scene import BeliefObject

IMAGES_BETWEEN_STROKES = 5
"""Number of images of an object between two strokes."""
MAX_STROKE_LENGTH = 0.06
"""Maximum length of one stroke, m; longer only when few strokes are allowed."""
MIN_BLOCKED_MOTION = 0.004
"""Least motion of a blocked object that counts as motion, m."""
MAX_TESTED_PUSHES = 12
"""Maximum number of singulation pushes that are tested for reachability."""
MAX_FAILED_STROKES = 2
"""Number of consecutive strokes without success (object lost or unmoved) after which the skill fails."""


class Push(Skill):
    """Push an object over the table: to a place (`to`, `yaw`), along a line (`direction`, `distance`), or so
    that it can be grasped (`singulate`).

    The closed fingers push at a flat side, the opened ones hold what is round between them. After each stroke
    the arm goes out of the view and looks; the next stroke begins from what is seen and felt. What is pushed
    stays away from the edge of its table, and from everything else; to make room, what stands around is
    pushed along.
    """

    example = """
    Push: {object: "{item}", to: [0.5, 0.1], yaw: 90 deg}
    """

    object: In[ObjectId] = port(
        "the object to push, or to make room around; with `singulate` and without it the one that stands "
        "closest to others, and what nobody has recognised first",
        default=ObjectId(""),
    )
    to: In[list[float]] = port("where its middle is to be: x, y in the world", unit="m", default=[])
    yaw: In[float | None] = port(
        "its heading there, as seen from above, of what looks the same the nearest one; any unless given",
        unit="rad",
        default=None,
    )
    direction: In[list[float]] = port("of a push along a line: x, y in the world, of any length", default=[])
    distance: In[float] = port("of a push along a line", unit="m", default=0.0, least=0, most=1)
    singulate: In[bool] = port(
        "push it, or what stands around it, until the hand fits around it; nothing is pushed when it does",
        default=False,
    )
    tolerance: In[float] = port("how far off its middle may be in the end", unit="m", default=0.0015, above=0)
    turned: In[float] = port(
        "how far off its heading may be in the end", unit="rad", default=math.radians(1.5), above=0
    )
    strokes: In[int] = port("how many strokes it may take", default=8, least=1, most=50)
    speed: In[float] = port("of the tool while it pushes", unit="m/s", default=0.05, above=0, most=0.2)
    force: In[float] = port("of the object on the tool that stops a stroke", unit="N", default=15.0, above=0)
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
        held = world.scene.held
        if held is not None:
            raise Failure(
                push.NO_STROKE, f"the hand is not free: it holds {held.id}", object=self.object, held=held.id
            )
        if self.singulate:
            yield from self._apart(world)
            return
        world.scene.get(self.object)
        belief = yield from self._seen(world, None)
        aim = self._aim(belief)
        self._check(world, belief, aim)
        yield from self._to(world, belief, aim)

    def _apart(self, world: World) -> Steps:
        """Push until the target can be grasped; an unknown one until it is recognised or isolated."""
        yield from self._look(world)
        name = self.object or most_crowded_object(world)
        if not name:
            return
        world.scene.get(name)
        made: list[str] = []
        for left in range(self.strokes, -1, -1):
            target = world.scene.find(name)
            if target is None or has_room(world, target):
                world.attempts.clear(self.path, name)
                self._parted(world, name, made)
                return
            if not left:
                break
            one, ready_ = self._parting(world, target)
            world.attempts.failed(self.path, name, one.name)
            pushed = yield from execute_stroke(
                world, one.pushed, ready_, self.speed, self.force, self.path, one.there
            )
            made.append(f"{one.name}: {pushed.told}")
            yield from step_back(world, one.there, self.path)
            yield from self._look(world)
        raise Failure(
            push.MISSED,
            f"there is still no room for the hand around {name} after {len(made)} strokes",
            object=name,
            strokes=made,
        )

    def _look(self, world: World) -> Steps:
        yield from world.control.settle()
        yield from world.vision.look(self.camera)

    def _parting(self, world: World, target: BeliefObject) -> tuple[SingulationPush, FeasibleStroke]:
        """Return the best feasible singulation push; pushes that were made before come last."""
        found = singulation_pushes(world, target)
        offered = world.attempts.remaining(self.path, target.id, found)
        why: list[str] = []
        for one in offered[:MAX_TESTED_PUSHES]:
            answer = plan_stroke(world, one.pushed, one.stroke, [n for n in one.there if n != one.pushed.id])
            if isinstance(answer, FeasibleStroke):
                return one, answer
            why.append(f"{one.name}: {answer}")
        told = "; ".join(why[:4]) or "no push that is free would do"
        raise Failure(
            push.NO_STROKE,
            f"no stroke makes room for the hand around {target.id}: {told}",
            object=target.id,
            refused=why,
        )

    def _parted(self, world: World, name: str, made: list[str]) -> None:
        if made:
            text = f"{name}: the hand fits around it after {len(made)} strokes"
            world.journal.note(PushEvent(text, self.path, object=name, strokes=tuple(made)))

    def _to(self, world: World, belief: BeliefObject, aim: PushGoal) -> Steps:
        stalled = lost = 0
        made: list[str] = []
        bad: set[str] = set()
        off = turned = math.inf
        now = estimate_from_camera(planar(belief.shape, belief.pose))
        for left in range(self.strokes, -1, -1):
            off, turned = self._off(belief, aim)
            if off <= self.tolerance and turned <= self.turned:
                self._note(world, belief, aim, made)
                return
            if not left:
                break
            one = self._choice(world, belief, aim, left, bad)
            pushed = yield from execute_stroke(world, belief, one, self.speed, self.force, self.path)
            made.append(f"{one.stroke.name}: {pushed.told}")
            yield from step_back(world, (self.object,), self.path)
            after = yield from self._seen(world, pushed)
            way = now.at.distance(planar(after.shape, after.pose))
            now = self._known(now, after, one.stroke, pushed)
            belief = replace(after, pose=moved(after.shape, after.pose, now.at), sigma_position=now.sigma)
            world.scene.put(belief, "by touch and sight")
            stalled = stalled + 1 if pushed.blocked and way < MIN_BLOCKED_MOTION else 0
            lost = lost + 1 if pushed.lost else 0
            if stalled:
                bad.add(one.stroke.side.name)
            self._judge(stalled, lost, made)
        raise Failure(
            push.MISSED,
            f"{self.object} is {_error_words(off, turned)} off after {len(made)} strokes",
            object=self.object,
            off=off,
            turned=turned,
            strokes=made,
        )

    def _known(
        self, before: PlanarEstimate, after: BeliefObject, stroke: PushStroke, pushed: PushResult
    ) -> PlanarEstimate:
        """Where it is by what was felt and what is seen now."""
        shape, sight = outline(after.shape, after.pose), estimate_from_camera(planar(after.shape, after.pose))
        if pushed.blocked or pushed.lost or not pushed.in_contact or stroke.side.rolls:
            return sight
        return fuse_estimates(estimate_from_contact(before, stroke, pushed.ends, shape), sight, shape.turn)

    def _check(self, world: World, belief: BeliefObject, aim: PushGoal) -> None:
        """Raise Failure when the goal is no possible place for the object."""
        yaw = planar(belief.shape, belief.pose).yaw if aim.yaw is None else aim.yaw
        why = pose_refusal(world, belief, [PlanarPose(aim.x, aim.y, yaw)])
        if why is not None:
            raise Failure(
                push.NO_STROKE,
                f"{self.object} cannot be pushed to ({aim.x:.3f}, {aim.y:.3f}): {why}",
                object=self.object,
                x=aim.x,
                y=aim.y,
            )

    def _off(self, belief: BeliefObject, aim: PushGoal) -> tuple[float, float]:
        shape = outline(belief.shape, belief.pose)
        return aim.off(planar(belief.shape, belief.pose), shape.turn)

    def _seen(self, world: World, after: PushResult | None) -> Doing[BeliefObject]:
        """Return the object as several images show it; the arm moves out of the view if it hides it."""
        belief = yield from observe_closely(world, self.camera, self.object, IMAGES_BETWEEN_STROKES)
        if belief is None:
            yield from go_looking(world, self.path)
            belief = yield from observe_closely(world, self.camera, self.object, IMAGES_BETWEEN_STROKES)
        if belief is not None:
            return belief
        if after is None:
            raise Failure(
                perception.NOT_FOUND,
                f"{self.object} is not in the view of {self.camera}",
                object=self.object,
            )
        raise Failure(
            push.LOST_CONTACT,
            f"{self.object} is not seen where it was pushed ({after.told})",
            object=self.object,
            touched=after.touched,
            reached=after.reached,
        )

    def _aim(self, belief: BeliefObject) -> PushGoal:
        at = planar(belief.shape, belief.pose)
        round_ = outline(belief.shape, belief.pose).round
        if self.to:
            return PushGoal(self.to[0], self.to[1], None if round_ else self.yaw)
        if self.direction:
            way = np.array(self.direction) * (self.distance / max(1e-9, math.hypot(*self.direction)))
            return PushGoal(at.x + float(way[0]), at.y + float(way[1]), None if round_ else at.yaw)
        return PushGoal(at.x, at.y, None if round_ else self.yaw)

    def _choice(
        self, world: World, belief: BeliefObject, aim: PushGoal, left: int, bad: set[str]
    ) -> FeasibleStroke:
        """Return the best stroke that is free and feasible."""
        at = planar(belief.shape, belief.pose)
        longest = max(MAX_STROKE_LENGTH, 2.0 * at.distance(PlanarPose(aim.x, aim.y)) / left)
        why: list[str] = []
        gripper = world.robot.description.gripper
        helping = [s for s in push_strokes(belief, aim, gripper, longest) if self._helps(s, belief, aim)]
        if not helping and aim.yaw is not None:
            helping = list(turning_room_strokes(belief, gripper))
        for stroke in helping:
            if stroke.side.name in bad:
                continue
            with world.plan.checking():
                refusal = stroke_refusal(world, belief, stroke)
            if refusal is None:
                answer = plan_stroke(world, belief, stroke)
                if isinstance(answer, FeasibleStroke):
                    return answer
                refusal = answer
            why.append(f"{stroke.name}: {refusal}")
        told = "; ".join(why[:4]) or "no side can be pushed that way"
        raise Failure(
            push.NO_STROKE,
            f"no stroke brings {self.object} nearer to where it is to be: {told}",
            object=self.object,
            refused=why,
        )

    def _helps(self, stroke: PushStroke, belief: BeliefObject, aim: PushGoal) -> bool:
        """Return whether the stroke reduces the remaining error."""
        shape = outline(belief.shape, belief.pose)
        before = _error(*aim.off(planar(belief.shape, belief.pose), shape.turn))
        return _error(*aim.off(stroke.ends, shape.turn)) < before - 1e-5

    def _judge(self, stalled: int, lost: int, made: list[str]) -> None:
        if stalled >= MAX_FAILED_STROKES:
            raise Failure(
                push.STALLED,
                f"{self.object} does not move: {made[-1]}",
                object=self.object,
                strokes=made,
            )
        if lost >= MAX_FAILED_STROKES:
            raise Failure(
                push.LOST_CONTACT,
                f"{self.object} does not stay at the fingers: {made[-1]}",
                object=self.object,
                strokes=made,
            )

    def _note(self, world: World, belief: BeliefObject, aim: PushGoal, made: list[str]) -> None:
        off, turned = self._off(belief, aim)
        world.journal.note(
            PushEvent(
                f"{self.object}: {len(made)} strokes, {_error_words(off, turned)} off",
                self.path,
                object=self.object,
                form=belief.form,
                off=off,
                turned=turned,
                strokes=tuple(made),
            )
        )


def _error(off: float, turned: float) -> float:
    return off + 0.02 * turned


def _error_words(off: float, turned: float) -> str:
    """Return the errors in words, as `1.2 mm and 0.5 deg`."""
    return f"{off * 1000:.1f} mm and {math.degrees(turned):.1f} deg"
