"""SafeRetreat: brake, acknowledge a safety stop, retreat, and move home."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from picktree.robot.manipulation import held_object, retreat
from picktree.trees import ARM, GRIPPER, Doing, In, Skill, Steps, control_flow, port
from picktree.world import Failure, control, event_types, grasp, place, safety

if TYPE_CHECKING:
    from picktree.robot import World

RETREAT_TIME_LIMIT = 90.0
"""Simulated time after which no other escape path is started, s."""


class SafeRetreat(Skill):
    """Brake, acknowledge a latched safety stop, stop pressing, get clear, then go to a safe pose.

    Where the arm is believed to be in contact, it moves slowly in the direction that reduces the depth
    fastest, the whole arm considered. It gives way to contact at any part of the arm, and tries another
    direction. Without a safe path it fails with the list of attempts, and the arm stays in place.
    """

    flow = control_flow.LeafFlow(hand_by=("hand", {"open": "empty", "put_down": "empty"}))
    example = """
    SafeRetreat: {pose: home, hand: open}
    """

    pose: In[str] = port("named pose of the robot to end in", default="home", names="pose")
    hand: In[Literal["keep", "open", "put_down"]] = port(
        "treatment of a held object: keep it, open the hand and drop it here, or put it down on a "
        "free spot on the way to the pose",
        default="keep",
    )
    speed: In[float] = port(
        "share of the joints' speed limits: 1 for the full limits; no part moves faster than 0.25 m/s",
        default=0.4,
        above=0,
        most=1,
    )
    causes = (safety.ANY, control.ANY, grasp.SLIPPED, place.OCCUPIED)
    uses = (ARM, GRIPPER)
    limit = 240.0
    sees_to_stops = True
    hand_after = "kept"

    def run(self, world: World) -> Steps:
        yield from world.move.rest()
        self._acknowledge(world)
        self._not_held(world)
        leaving = retreat.RetreatMotion(world, self.path, world.clock.now + RETREAT_TIME_LIMIT)
        left = yield from leaving.relax()
        to_open = self.hand == "open"
        if to_open and self._room_to_open(world):
            try:
                yield from self._open(world)
                to_open = False
            except Failure as failure:
                if failure.cause is not control.GRIPPER:
                    raise
                # An unknown body is next to the fingers; further away they may have room.
                leaving.tried.append(failure.message)
        if not (yield from self._out(world, leaving)):
            raise self._retreat_failure(world, leaving, left)
        yield from leaving.up()
        if to_open:
            yield from self._open(world)
        scaling = world.handling.scaling(self.speed)
        refused: Failure | None = None
        if self.hand == "put_down":
            try:
                yield from retreat.put_down(world, leaving, scaling, self.path)
            except Failure as failure:
                # The object is kept, and the failure is reported from home.
                refused = self._not_put_down(world, failure)
                self._acknowledge(world)
        if not (yield from retreat.go_home(world, leaving, self.pose, scaling, self.path)):
            raise self._retreat_failure(world, leaving, left)
        yield from self._still_held(world)
        if refused is not None:
            raise refused

    def _acknowledge(self, world: World) -> None:
        stop = world.control.monitor.stopped
        if stop is not None and world.control.monitor.acknowledge(self.path):
            world.journal.note(
                event_types.SafetyAcknowledgedEvent(f"{stop.cause}: {stop.message}", self.path)
            )

    @staticmethod
    def _not_held(world: World) -> None:
        """Release the believed object when the fingers have met: they hold nothing."""
        if world.scene.held is not None and world.gripper.width <= held_object.MAX_EMPTY_WIDTH:
            held_object.release_object(world.scene, "the fingers have met: nothing is between them")
            world.control.wrist.carry(None)

    @staticmethod
    def _room_to_open(world: World) -> bool:
        """Return whether the fingers can open without contact with believed bodies next to them."""
        held = world.scene.held
        ignored = () if held is None else (str(held.id),)
        wide = world.robot.description.gripper.max_width
        return not world.queries.hand_contacts(world.control.tcp, wide, ignore=ignored)

    @staticmethod
    def _open(world: World) -> Steps:
        yield from held_object.open_gripper(world, "let go by SafeRetreat")
        world.control.wrist.carry(None)

    @staticmethod
    def _not_put_down(world: World, failure: Failure) -> Failure:
        held = world.scene.held
        if held is None or failure.cause is place.OCCUPIED:
            return failure
        message = f"{held.id} cannot be put down: {failure.message}; it is still in the hand"
        return Failure(place.OCCUPIED, message, object=held.id, because=failure.cause.name)

    def _out(self, world: World, leaving: retreat.RetreatMotion) -> Doing[bool]:
        """Move out of believed contacts. Without an escape path, look whether those bodies are really
        there."""
        if (yield from leaving.out()):
            return True
        believed = world.plan.contacts()
        yield from retreat.observe_with_fixed_cameras(world)
        if world.plan.contacts() == believed and not leaving.touched:
            return False
        leaving.reset_directions()
        return (yield from leaving.out())

    def _still_held(self, world: World) -> Steps:
        """Raise grasp.slipped when an object to be kept is not measured in the hand."""
        held = world.scene.held
        if held is None:
            return
        hold = yield from held_object.measure_grip(world)
        if hold.held:
            return
        held_object.release_object(world.scene, "no longer felt in the hand")
        world.control.wrist.carry(None)
        raise Failure(
            grasp.SLIPPED,
            f"{held.id} was to be kept and is gone: {hold}",
            object=held.id,
            width=hold.width,
            load=hold.load,
        )

    def _retreat_failure(self, world: World, leaving: retreat.RetreatMotion, left: float) -> Failure:
        """Return the failure with the obstacles and the attempts; the arm holds its position."""
        contacts = world.plan.contacts()
        named = [f"{c.a} at {c.b} ({-c.distance * 1000:.0f} mm deep)" for c in contacts if c.distance < 0.0]
        last = leaving.tried[-1] if leaving.tried else "nothing could be tried"
        what = f"{', '.join(named[:3])} in the way" if named else last
        late = " in time" if leaving.is_overdue else ""
        return Failure(
            safety.NO_RETREAT,
            f"there is no safe way to {self.pose}{late}; the arm stays where it is: {what}",
            in_the_way=named,
            depth=max((-c.distance for c in contacts), default=0.0),
            tried=leaving.tried,
            pressed=left,
        )
