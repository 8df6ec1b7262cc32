"""WatchScene: images at intervals while the arm moves."""

from __future__ import annotations

from typing import TYPE_CHECKING

from picktree.robot import World
from picktree.trees import Decorator, In, NodeStatus, Resource, control_flow, port
from picktree.world import Failure, Plain, perception

if TYPE_CHECKING:
    from picktree.robot import Look
    from picktree.trees import TreeWorld

SETTLE_TIME = 0.5
"""Time without images after a release, s: released objects fall and roll."""
TAKING_TIME = 0.25
"""Time without images after a grasp, s: neighbours may have been touched. The fast transfer begins soon
after."""
MIN_FINGER_MOTION = 0.001
"""Finger motion in a tick above which an object in the hand is released or lost, m."""
_TIME_TOLERANCE = 1e-9


class WatchScene(Decorator):
    """Looks through a camera at intervals while its child runs, whether the arm moves or not.

    Each picture updates the belief when the camera's time of thinking is over; the child does not wait for
    it. Objects hidden by the arm or by the held object stay believed. So a motion detects a new obstacle in
    its path, and `Grasp` detects that its object was moved. No picture is taken during a grasp or a release,
    for 0.25 s after a grasp, and for 0.5 s after a release.
    """

    flow = control_flow.ChildFlow(
        own={control_flow.IDLE: control_flow.FAILURE, control_flow.RUNNING: control_flow.FAILURE}
    )
    example = """
    WatchScene:
      every: 250 ms
      do: {Grasp: {object: "{item}"}}
    """

    camera: In[str] = port("the camera to look through", default="overhead", names="camera")
    every: In[float] = port("time between two pictures", unit="s", default=0.5, least=0.05)
    blind: In[float] = port(
        "maximum time without a picture; after it the child is halted, and the node fails with the "
        "camera's failure",
        unit="s",
        default=2.0,
        least=0,
    )
    causes = (perception.NOT_FOUND, perception.NO_IMAGE)
    uses = (Resource.CAMERA,)
    shares = (Resource.CAMERA,)
    remembers = ("_next", "_held", "_width", "_seen")
    _next: float = 0.0
    _held: str = ""
    _width: float = 0.0
    _seen: float = 0.0
    _pending: Look | None = None

    def on_start(self) -> None:
        self._next = self._seen = self.world.clock.now
        self._held = _in_hand(self.world)
        self._pending = None
        if isinstance(self.world, World):
            self._width = self.world.gripper.width

    def on_tick(self) -> NodeStatus:
        # A rehearsal has no images.
        if isinstance(self.world, World):
            self._watch(self.world)
        return self.relay()

    def on_halt(self) -> None:
        self._pending = None

    def save_state(self) -> dict[str, Plain]:
        """Save the state without a picture in processing: the run continues without it, too."""
        self._pending = None
        return super().save_state()

    def _watch(self, world: World) -> None:
        now = world.clock.now
        held, width = _in_hand(world), world.gripper.width
        if held != self._held or (held and abs(width - self._width) > MIN_FINGER_MOTION):
            # Old positions say nothing of the present ones: the objects may be falling.
            self._pending = None
            taken = bool(held) and not self._held
            self._next = max(self._next, now + (TAKING_TIME if taken else SETTLE_TIME))
        self._held, self._width = held, width
        pending = self._pending
        if pending is not None:
            pending.advance()
            if pending.done and now >= pending.shot.stamp + world.vision.cost - _TIME_TOLERANCE:
                self._pending = None
                if pending.shot.stamp > world.vision.newest:
                    for gone in world.vision.merge(pending).removed:
                        world.attempts.forget(gone)
        if self._pending is None and now >= self._next - _TIME_TOLERANCE:
            self._next = now + self.every
            self._look(world, now)

    def _look(self, world: World, now: float) -> None:
        try:
            shot = world.vision.capture_now(self.camera)
            self._pending = world.vision.begin(shot, world.scene.objects)
            self._pending.advance()
        except Failure as failure:
            if failure.cause is not perception.NO_IMAGE or now - self._seen > self.blind:
                self.body.halt()
                raise
            return
        self._seen = now
        world.thinking.add_unowed(world.vision.cost)


def _in_hand(world: TreeWorld) -> str:
    held = world.scene.held
    return "" if held is None else str(held.id)
