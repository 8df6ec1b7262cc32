"""Base class of all acting leaves: typed ports, and a body that is a generator."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Generator, Mapping
from typing import TYPE_CHECKING, ClassVar, Final, TypeAlias, TypeVar, cast

from picktree.world import Failure, FailureReport, event_types, internal, tree

from .control_flow import LeafFlow, NodeStatus
from .declaration import Resource
from .node import Node
from .runtime import Runtime, Wiring

if TYPE_CHECKING:
    from picktree.robot import World

T = TypeVar("T")

Steps: TypeAlias = Generator[None, None, None]
"""Body of a skill: each `yield` is one tick RUNNING."""
Doing: TypeAlias = Generator[None, None, T]
"""Part of a body that returns a value: `value = yield from part()`."""

ARM: Final = Resource.ARM
"""The arm, as a resource that a skill uses."""
GRIPPER: Final = Resource.GRIPPER
"""The gripper, as a resource that a skill uses."""
CAMERA: Final = Resource.CAMERA
"""The cameras, as a resource that a skill uses."""

_MAX_CLOSE_CALLS = 3
"""Maximum number of `close()` calls for a body that yields while it is closed."""
SLOW_SPEED_SHARE = 0.25
"""Share of the joints' speed limits below which a skill gets proportionally more time."""


class Skill(Node, abstract=True):
    """An action that takes time.

    Write `run`: each `yield` is one tick RUNNING, `return` is SUCCESS, `raise Failure(cause, …)` is FAILURE.
    Being halted closes the generator, so `finally` runs, but must not yield: braking is the controller's.
    """

    flow = LeafFlow()
    kind = "action"
    takes_over: ClassVar[bool] = False
    """Whether the skill can start while the arm still moves, as `Place` can after `Grasp`. Before any other
    skill that uses robot or camera the arm is stopped."""
    sees_to_stops: ClassVar[bool] = False
    """Whether the skill continues after a latched safety stop, as `SafeRetreat` must. Any other skill that
    uses the arm fails with the stop's cause, even at rest."""
    limit: ClassVar[float] = 120.0
    """Simulated time after which the skill fails with tree.timeout, s: many times its longest duration. See
    `time_limit`."""
    waits_for: ClassVar[str] = ""
    """Port with the allowed waiting time, s, which is added to `limit`."""

    def bind(self, wiring: Wiring, runtime: Runtime) -> None:
        super().bind(wiring, runtime)
        self._steps: Steps | None = None
        self._began = 0.0
        self._known_stop: FailureReport | None = None
        self._step = ""
        """Step that the message shows."""

    @abstractmethod
    def run(self, world: World) -> Steps:
        """Run the body. Inputs are read before it starts; every output is assigned before it returns."""
        ...

    def on_start(self) -> None:
        self._steps = None
        self._step = ""
        self._began = self.world.clock.now
        self._known_stop = self._stop()

    def time_limit(self) -> float:
        """Return the simulated time of this activation, s.

        It is `limit`, divided by the share when `speed` is below a quarter, plus the waiting time of
        `waits_for`.
        """
        time = self.limit
        speed = self.input("speed") if self.declaration.port("speed") is not None else None
        if isinstance(speed, int | float) and 0.0 < speed < SLOW_SPEED_SHARE:
            time *= SLOW_SPEED_SHARE / speed
        waits = self.input(self.waits_for) if self.waits_for else 0.0
        return time + (waits if isinstance(waits, int | float) else 0.0)

    @classmethod
    def limit_words(cls) -> str:
        """Return the time limit as a sentence, for the reference."""
        beyond = f" beyond `{cls.waits_for}`" if cls.waits_for else ""
        slow = (
            f", longer at a `speed` below {SLOW_SPEED_SHARE:g}"
            if cls.declaration.port("speed") is not None
            else ""
        )
        return f"It is stopped with tree.timeout after {cls.limit:g} s{beyond}{slow}."

    def on_tick(self) -> NodeStatus:
        if self._runtime.stand_ins:
            self._replace_body()
        if self._steps is None:
            self._steps = self._body(cast("World", self.world))
        elif self.world.clock.now - self._began > self.time_limit() + 1e-9:
            return self._timed_out()
        stop = self._stop()
        fresh, self._known_stop = stop is not None and stop is not self._known_stop, stop
        try:
            if fresh and stop is not None:
                self._steps.throw(Failure(stop.cause, stop.message, **stop.evidence))
            else:
                next(self._steps)
        except StopIteration:
            return self._finished()
        finally:
            self._show_step()
        return NodeStatus.RUNNING

    def _show_step(self) -> None:
        """Show the step that the body is in as the message. A rehearsal's world has no steps."""
        running: Mapping[str, str] = getattr(self.world, "running_steps", {})
        step = running.get(self.path, "")
        if step != self._step:
            self._step = self.feedback_message = step

    def _stop(self) -> FailureReport | None:
        """Return the latched safety stop if it concerns this skill. None in a rehearsal, which has no
        monitor."""
        control = getattr(self.world, "control", None)
        if control is None or ARM not in self.uses or self.sees_to_stops:
            return None
        return cast("World", self.world).control.monitor.stopped

    def _body(self, world: World) -> Steps:
        if self.uses and not self.takes_over and world.move.ongoing is not None:
            yield from world.move.rest()
        yield from self.run(world)

    def on_halt(self) -> None:
        steps, self._steps = self._steps, None
        if steps is None:
            return
        refused = 0
        for _ in range(_MAX_CLOSE_CALLS):
            try:
                steps.close()
                break
            except RuntimeError as error:
                if "ignored GeneratorExit" not in str(error):
                    raise
                refused += 1
        if refused:
            message = f"{self.wiring.id} yields while it is halted: a finally cannot wait"
            self.world.journal.note(event_types.InternalErrorEvent(message, self.path))

    def _replace_body(self) -> None:
        """Replace the skill's body with the runtime's replacement for it, if there is one."""
        body = self._runtime.stand_ins.pop(self.path, None)
        if body is not None:
            self.on_halt()
            self._steps = body()

    def _timed_out(self) -> NodeStatus:
        """Stop the body as a halt does and fail: leases are released, and the arm brakes."""
        seconds, limit = self.world.clock.now - self._began, self.time_limit()
        self.on_halt()
        message = f"{self.wiring.id} still ran after {limit:g} s, its longest time, and was stopped"
        evidence = {"seconds": round(seconds, 3), "limit": limit}
        return self.fail_with(FailureReport(tree.TIMEOUT, message, evidence, self.path))

    def _finished(self) -> NodeStatus:
        self._steps = None
        forgotten = [p.key for p in self.declaration.outputs if p.key not in self._outputs]
        if not forgotten:
            return NodeStatus.SUCCESS
        message = f"{self.wiring.id} ended without writing its output {', '.join(map(repr, forgotten))}"
        self.world.journal.note(event_types.InternalErrorEvent(message, self.path))
        return self.fail(internal.ERROR, message)
