"""Run record: one run with its ticks, visits, events and readings, read from its log."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from picktree.files import PicktreeError
from picktree.world import Candidates, JournalEvent, Plan, Tree, TreeNode

from . import topics
from .log_records import LogLine, RunInfo, Scene
from .node_visits import Pick, SkillStep, Visit, picks_of, steps_of
from .operator_figures import CellMotion, FigureCounts, OperatorFigures
from .run_account import RunAccount, account_of, figures_during, motions_of
from .run_log import RunLog, Stamped
from .run_result import RunResult
from .series import (
    ControlSeries,
    GripperSeries,
    ImageSequence,
    JointSeries,
    TickAt,
    TickSequence,
    WrenchSeries,
    control_series,
    gripper_series,
    joint_series,
    wrench_series,
)


@dataclass(frozen=True, slots=True, repr=False)
class Moment:
    """State at one tick: tree, belief, ground truth and blackboard."""

    tick: TickAt
    belief: Scene | None
    """Belief of the robot, poses in the world; None before its first message."""
    truth: Scene | None
    """Ground truth of at most a second earlier, which the robot did not know; None before its first
    message."""
    blackboard: Mapping[str, object]
    """All values by their full keys, such as `Main/items`."""

    def __repr__(self) -> str:
        bodies = len(self.belief.bodies) if self.belief else 0
        return f"<{self.tick!r} with {bodies} believed bodies, {len(self.blackboard)} blackboard keys>"


class RunRecord:
    """Run, read from its log, also when it was cut off.

    `where` is a log file, a run's folder, or `last`. Times are simulated seconds, lengths m, angles rad,
    forces N; poses are in the world. Everything is read on the first request, and then kept; `ticks` and
    `images` read each time, so that a long log needs little memory. Use it as a context manager, or close it.

    Raises PicktreeError when `where` is no log, or the file is damaged.
    """

    def __init__(self, where: str | Path) -> None:
        self.log = RunLog(where)
        """Log of the run, record by record."""
        self.path = self.log.path
        self.recovered = self.log.recovered
        """Sentence about losses when the file was not finished, else empty."""
        self.info: RunInfo = self.log.run
        """Settings of the run: mission, scene, seed, parameters, versions."""

    def __repr__(self) -> str:
        result = self.result
        parts = [self.info.mission, self.info.seed_text, f"{self.duration:.1f} s"]
        if result is not None:
            items = result.items
            parts += [result.status, f"{items.sorted} of {items.total} items sorted" if items.total else ""]
        else:
            parts.append(
                "no result: the result was left out of the log"
                if self.status == "unknown"
                else "no result: the log was cut off"
            )
        return f"<{type(self).__name__} {self.path}: {', '.join(part for part in parts if part)}>"

    def close(self) -> None:
        self.log.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def end(self) -> float:
        """Time of the last message, simulated s."""
        return self.log.end

    @property
    def duration(self) -> float:
        """Simulated time of the run, s, as its result has it; without one, that of the last message."""
        return self.end if self.result is None else self.result.sim_seconds

    @property
    def last_tick(self) -> float:
        """Time of the last tick, simulated s; that of the last message when the log holds no tick."""
        return self.ticks.times[-1] if self.ticks.times else self.end

    @cached_property
    def result(self) -> RunResult | None:
        """Result of the run; None when it was killed, or ended by an exception."""
        words = self.log.result
        return RunResult.from_json_text(words["json"], self.path) if "json" in words else None

    @property
    def status(self) -> str:
        """Status of the result; without one `killed`, or `unknown` when another program has left it out."""
        if self.result is not None:
            return self.result.status
        return "unknown" if self.log.lacks_result else "killed"

    @cached_property
    def trees(self) -> tuple[Stamped[Tree], ...]:
        """Trees with the time of their first tick; several when the mission was edited during the run."""
        return tuple(self.log.trees())

    def tree_at(self, time: float) -> Tree:
        """Return the tree that was ticked at `time`."""
        trees = self.trees
        if not trees:
            raise PicktreeError(f"{self.path}: the log has no message on {topics.TREE.name}")
        return next((at.record for at in reversed(trees) if at.time <= time + 1e-9), trees[0].record)

    @cached_property
    def nodes(self) -> tuple[TreeNode, ...]:
        """Nodes of all trees of the run, each in its first form, parents before their children."""
        found: dict[str, TreeNode] = {}
        for at in self.trees:
            for node in at.record.nodes:
                found.setdefault(node.path, node)
        return tuple(found.values())

    @cached_property
    def events(self) -> tuple[Stamped[JournalEvent], ...]:
        """Journal entries: `item_done`, `pick`, `fault`, `recovery`, `belief`, `checkpoint`, …"""
        return tuple(self.log.events())

    @cached_property
    def ticks(self) -> TickSequence:
        """Whole tree after each tick, by number; `ticks.number_at(time)` finds one by its time."""
        return TickSequence(self.log)

    @cached_property
    def visits(self) -> tuple[Visit, ...]:
        """Activations of nodes from start to end, in order of their starts."""
        return self.account.visits

    @cached_property
    def steps(self) -> tuple[SkillStep, ...]:
        """Steps of skills, such as `approach`, `close` and `lift` of a grasp, in the order of their ends."""
        return steps_of(self.events, self.visits)

    @cached_property
    def account(self) -> RunAccount:
        """Account of the run: visits, failures and their outcomes, episodes with cures and time lost."""
        return account_of(self.log, self.events)

    @cached_property
    def motions(self) -> Mapping[float, CellMotion]:
        """Motion of arm and fingers by the time of the tick, simulated s; empty in older logs."""
        return motions_of(self.log, self.joint_names[0])

    @cached_property
    def operator_figures(self) -> OperatorFigures:
        """Operators' figures, as the result has them; without it, as the ticks show them."""
        counts = None if self.result is None else self.result.figures
        if counts is None:
            (counts,) = figures_during(self.log, self.events, self.motions)
        return OperatorFigures((counts,))

    def operator_figures_by(self, period: float) -> tuple[OperatorFigures, ...]:
        """Return the operators' figures of each period, simulated s, the last one up to the end of the log.

        They are the robot's: units and failures as it believes. Raises ValueError for a period of 0 or less.
        """
        if period <= 0.0:
            raise ValueError(f"the period is {period:g} s; it must be above 0")
        moments = [period * n for n in range(1, math.ceil(self.end / period - 1e-9))]
        counts = figures_during(self.log, self.events, self.motions, moments)
        before = (FigureCounts(), *counts)
        return tuple(OperatorFigures((now.minus(then),)) for then, now in zip(before, counts, strict=False))

    @cached_property
    def plans(self) -> tuple[Stamped[Plan], ...]:
        """Planning requests and their answers; paths in rad, `tool_path` in m in the world."""
        return tuple(self.log.plans())

    @cached_property
    def candidates(self) -> tuple[Stamped[Candidates], ...]:
        """Candidate searches for grasps and places: number of candidates at each stage, and rejections."""
        return tuple(self.log.candidates())

    @cached_property
    def lines(self) -> tuple[Stamped[LogLine], ...]:
        """Log lines for people."""
        return tuple(self.log.lines())

    @cached_property
    def picks(self) -> tuple[Pick, ...]:
        """Closings of the fingers on objects."""
        return picks_of(self.events)

    @cached_property
    def joints(self) -> JointSeries:
        """Joint readings, one a tick."""
        return joint_series(self.log)

    @cached_property
    def gripper(self) -> GripperSeries:
        """Gripper readings, one a tick; empty for a robot without sliding fingers."""
        return gripper_series(self.joints, self.joint_names[1])

    @cached_property
    def joint_names(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Recorded joints of the arm, and those of the fingers, whose positions add up to the opening.

        Both are those of the robot file in the log; the hinges of a linkage are neither. Where the file does
        not tell, names with "finger" in them do, and without such names the waypoints of a plan.
        """
        first = next(self.log.joints(), None)
        names = first.record.names if first is not None else ()
        arm, fingers, linked = self._robot_joints()
        if not fingers and not linked:
            fingers = {name for name in names if "finger" in name}
        if not fingers and not linked and "robot.yaml" not in self.log.attachments:
            count = next((len(at.record.path[0]) for at in self.plans if at.record.path), len(names))
            fingers = set(names[count:])
        return (
            tuple(name for name in names if name not in fingers and (not arm or name in arm)),
            tuple(name for name in names if name in fingers),
        )

    def _robot_joints(self) -> tuple[set[str], set[str], bool]:
        """Return the arm's joints, the gripper's sliders, and whether it has a linkage, by the robot file.

        Empty for what the file does not tell.
        """
        if "robot.yaml" not in self.log.attachments:
            return set(), set(), False
        import yaml  # most readers of a log do without

        try:
            robot: Any = yaml.safe_load(self.log.attachment("robot.yaml"))
            gripper: Any = robot.get("gripper") or {}
            arm: Any = robot.get("joints") or ()
            sliders: Any = gripper.get("joints") or ()
            return {str(name) for name in arm}, {str(name) for name in sliders}, "linkage" in gripper
        except (yaml.YAMLError, AttributeError, TypeError):
            return set(), set(), False

    @cached_property
    def wrenches(self) -> WrenchSeries:
        """External wrench at the wrist, one reading a tick."""
        return wrench_series(self.log)

    @cached_property
    def controls(self) -> ControlSeries:
        """Set points of the servo, one a tick; empty for a log without them."""
        return control_series(self.log)

    @cached_property
    def images(self) -> ImageSequence:
        """Images of the cameras; `images.before(time)` finds one by its time."""
        return ImageSequence(self.log)

    def at(self, time: float) -> Moment:
        """Return the state at the last tick at `time` (simulated s) or before."""
        tick = self.ticks[self.ticks.number_at(time)]
        belief, truth = self.log.belief_at(tick.time), self.log.truth_at(tick.time)
        return Moment(
            tick,
            belief.record if belief else None,
            truth.record if truth else None,
            self.blackboard_at(tick.time),
        )

    def blackboard_at(self, time: float) -> Mapping[str, object]:
        """Return all values by their full keys, after the last tick at `time` or before."""
        before = itertools.takewhile(lambda write: write[0] <= time + 1e-9, self._writes)
        return {key: value for _, key, value in before}

    @cached_property
    def _writes(self) -> tuple[tuple[float, str, object], ...]:
        return tuple((at.time, w.key, w.value) for at in self.log.ticks() for w in at.record.writes)
