"""Run: a recorded run with everything that can be derived from it, for analysts."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..logs.grip_closings import Pick, picks_of
from ..logs.run_log import At
from ..logs.run_record import RunRecord
from ..logs.schema.records import Candidates, LogLine, Plan, Scene
from ..logs.sequences import Shots, TickAt, Ticks
from ..logs.series import (
    ControlSeries,
    GripperSeries,
    JointSeries,
    WrenchSeries,
    control_series,
    gripper_series,
    joint_series,
    wrench_series,
)
from ..logs.visits import Visit, visits_of
from .explain.investigation.explanation import Explanation, FailureStory, ItemStory


@dataclass(frozen=True, slots=True, repr=False)
class Moment:
    """What was at one tick."""

    tick: TickAt
    belief: Scene | None
    """What the robot believed, poses in the world."""
    truth: Scene | None
    """Of the second before; the robot did not know it."""
    blackboard: Mapping[str, object]
    """All values by their full keys, such as `Main/items`."""

    def __repr__(self) -> str:
        bodies = len(self.belief.bodies) if self.belief else 0
        return f"<{self.tick!r} with {bodies} believed bodies, {len(self.blackboard)} blackboard keys>"


class Run(RunRecord):
    """One run, from its log alone: also from one that was cut off.

    `where` is a log file, a run's folder, or `last`. Times are simulated seconds, lengths m, angles rad,
    forces N; poses are in the world. Everything is read when it is first asked for, and then kept; `ticks`
    and `shots` read each time, so that a long log needs little memory. Use it as a context manager, or
    `close` it.

    Raises PicktreeError for what is no log, and where the file is damaged.

    ```python
    with Run("runs/sort_by_colour-3-20261121-083249") as run:
        print(run)                            # mission, seed, how long, what came of it
        for failure in run.failures:          # every failure, and what became of it
            print(failure.time, failure.cause, failure.item, failure.fate)
        moment = run.at(17.0)                 # tick, belief, truth, blackboard
        picture = run.picture(17.0)           # as an array, for imshow
    ```
    """

    def __repr__(self) -> str:
        result = self.result
        parts = [self.info.mission, f"seed {self.info.seed}", f"{self.end:.1f} s"]
        if result is not None:
            items = result.items
            parts += [result.status, f"{items.sorted} of {items.total} items sorted" if items.total else ""]
        else:
            parts.append("no result: it was cut off")
        return f"<Run {self.path}: {', '.join(part for part in parts if part)}>"

    @cached_property
    def ticks(self) -> Ticks:
        """The whole tree after each tick, by number; `ticks.number_at(time)` finds one by its time."""
        return Ticks(self.log)

    @cached_property
    def visits(self) -> tuple[Visit, ...]:
        """What each node did, from its beginning to its end; in the order of the beginnings."""
        return visits_of(self.log)

    @cached_property
    def plans(self) -> tuple[At[Plan], ...]:
        """Every request to the planner and its answer; paths in rad, `tool_path` in m in the world."""
        return tuple(self.log.plans())

    @cached_property
    def candidates(self) -> tuple[At[Candidates], ...]:
        """The trail of every choice of a grasp or a place: how many reached each stage, who was rejected."""
        return tuple(self.log.candidates())

    @cached_property
    def lines(self) -> tuple[At[LogLine], ...]:
        """The lines for people, as they were logged."""
        return tuple(self.log.lines())

    @cached_property
    def picks(self) -> tuple[Pick, ...]:
        """Every closing of the fingers on an object."""
        return picks_of(self.events)

    @cached_property
    def explanation(self) -> Explanation:
        """Why it ended as it did: failures, root causes, items, what to look at."""
        from .explain.explain import explain

        return explain(self)

    @property
    def failures(self) -> tuple[FailureStory, ...]:
        """Every failure with a cause, and what became of it; in the order of time."""
        return self.explanation.failures

    @property
    def items(self) -> tuple[ItemStory, ...]:
        """What happened to each item, as the robot believed, and where it truly is in the end."""
        return self.explanation.items

    @cached_property
    def joints(self) -> JointSeries:
        """A reading a tick."""
        return joint_series(self.log)

    @cached_property
    def gripper(self) -> GripperSeries:
        """A reading a tick; empty for a robot without fingers."""
        return gripper_series(self.joints, [name for name in self.joints.names if "finger" in name])

    @cached_property
    def wrenches(self) -> WrenchSeries:
        """A reading a tick."""
        return wrench_series(self.log)

    @cached_property
    def controls(self) -> ControlSeries:
        """A reading a tick; empty for a log that does not tell."""
        return control_series(self.log)

    @cached_property
    def shots(self) -> Shots:
        """The cameras' images; `shots.before(time)` finds one by its time."""
        return Shots(self.log)

    def picture(
        self,
        time: float,
        size: tuple[int, int] = (960, 600),
        *,
        view: str = "corner",
        show: Literal["belief", "truth", "both"] = "belief",
        caption: bool = True,
    ) -> NDArray[np.uint8]:
        """The scene at that time as RGB (h, w, 3).

        `size` is in pixels; `view` a name such as `top`, or `AZIMUTH,ELEVATION,DISTANCE` in degrees and m;
        `both` draws the belief with outlines of the truth. Raises PicktreeError for a time that never was.
        """
        from .render.snapshot import draw
        from .render.viewpoint import parse_view

        return draw(self.log, time, size, parse_view(view), show=show, caption=caption)

    def at(self, time: float) -> Moment:
        """What was then: at the last tick at `time` or before."""
        tick = self.ticks[self.ticks.number_at(time)]
        belief, truth = self.log.belief_at(tick.time), self.log.truth_at(tick.time)
        return Moment(
            tick,
            belief.record if belief else None,
            truth.record if truth else None,
            self.blackboard_at(tick.time),
        )

    def blackboard_at(self, time: float) -> Mapping[str, object]:
        """All values by their full keys, after the last tick at `time` or before."""
        before = itertools.takewhile(lambda write: write[0] <= time + 1e-9, self._writes)
        return {key: value for _, key, value in before}

    @cached_property
    def _writes(self) -> tuple[tuple[float, str, object], ...]:
        busy = ((at.time, at.record) for at in self.log.busy_ticks() if at.record is not None)
        return tuple((time, w.key, w.value) for time, tick in busy for w in tick.writes)
