"""What is measured of one run of the fault campaign, from its row in the batch and its log."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from picktree.world.event_types import FaultEvent, SafetyStopEvent

import numpy as np

if TYPE_CHECKING:
    from picktree.analysis import Run
    from picktree.world.robot_model import RobotModel
    from picktree.world.scene import SafetyLimits

Numbers: TypeAlias = "np.ndarray[Any, np.dtype[np.float64]]"
TICK = 0.05
"""s; how often a log tells of joints and forces."""
FLOOR = -0.05
"""Whatever lies lower than this, m, lies beside the table."""


@dataclass(frozen=True, slots=True)
class Beyond:
    """Amount by which a limit of the monitor was exceeded at worst."""

    limit: str
    """joint_limit (rad), workspace (m)"""
    most: float
    allowed: float
    """What braking needs from the speed at which the limit was crossed."""


@dataclass(frozen=True, slots=True)
class Failed:
    """A failure as it was reported."""

    time: float
    node: str
    cause: str
    fate: str


@dataclass(frozen=True, slots=True)
class Measure:
    """One run."""

    job: str
    fault: str
    """Stem of its fault file; `none` without."""
    recovery: bool
    seed: int
    status: str
    """As the batch has it; of a killed run that was taken up, as that ended."""
    message: str = ""
    fault_at: float | None = None
    """When a fault first took effect, simulated s; None: none did."""
    killed: bool = False
    """A fault of the kind `kill` ended its process."""
    resumed: bool = False
    """It was killed, and taken up."""
    failures: tuple[Failed, ...] = ()
    roots: tuple[str, ...] = ()
    """Root causes by `explain`, in its order, from a log without the events of faults."""
    explains: str = ""
    """Hash of the sources that explained it."""
    total: int | None = None
    sorted: int | None = None
    misplaced: int | None = None
    on_floor: int = 0
    """Items that lie beside the table in the end."""
    seconds: float | None = None
    """Simulated."""
    force: float = 0.0
    """Worst at the wrist, N, as the robot felt it: the mean over 50 ms at each tick, or of a stop."""
    speed: float = 0.0
    """Worst of a joint, as a share of its limit."""
    beyond: tuple[Beyond, ...] = ()
    folder: str = ""

    @property
    def took_effect(self) -> bool:
        return self.fault_at is not None or self.killed

    @property
    def after(self) -> tuple[Failed, ...]:
        """Failures at or after the moment at which the fault took effect."""
        if self.fault_at is None:
            return ()
        return tuple(failure for failure in self.failures if failure.time >= self.fault_at - 1e-9)

    @property
    def to_explain(self) -> bool:
        """A fault took effect, and after it something failed or an item is not where it belongs."""
        missed = self.total is not None and self.sorted != self.total
        return self.took_effect and (bool(self.after) or missed)

    @property
    def finished(self) -> bool:
        """The tree came to its end in SUCCESS."""
        return self.status in ("success", "incomplete")

    @property
    def crashed(self) -> bool:
        """Its process came to no result, and no fault had killed it."""
        return self.status == "crashed" and not self.killed

    @property
    def hung(self) -> bool:
        """It came to no end within its limit of simulated time."""
        return self.status == "timeout"

    @property
    def lasting(self) -> tuple[Beyond, ...]:
        """Limits that were exceeded by more than braking explains."""
        return tuple(each for each in self.beyond if each.most > each.allowed)

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Measure:
        told = dict(data)
        told["failures"] = tuple(Failed(**each) for each in told["failures"])
        told["roots"] = tuple(told.get("roots", ()))
        told["beyond"] = tuple(Beyond(**each) for each in told["beyond"])
        return cls(**told)


@dataclass
class Measured:
    """Measures that were taken already, in a file beside the batch: a line each."""

    path: Path
    by_job: dict[str, Measure] = field(default_factory=dict[str, Measure])

    @classmethod
    def read(cls, path: Path) -> Measured:
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        measures = (Measure.from_json(json.loads(line)) for line in lines)
        return cls(path, {measure.job: measure for measure in measures})

    def add(self, measure: Measure) -> None:
        self.by_job[measure.job] = measure
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(measure.to_json()) + "\n")


@dataclass(frozen=True)
class Cell:
    """The robot and the limits that the runs had."""

    model: RobotModel
    limits: SafetyLimits

    @classmethod
    def of(cls, scene: str) -> Cell:
        from picktree.world.robot_model import RobotModel, load_robot
        from picktree.world.scene import load_scene

        described = load_scene(scene, Path.cwd())
        robot = load_robot(described.robot, Path(described.source).parent)
        return cls(RobotModel(replace(robot, tool=described.tool)), described.limits)


def measured(measure: Measure, run: Run, cell: Cell) -> Measure:
    """Return the measure with what the log tells: when the fault struck, failures, forces, limits."""
    wrenches = np.linalg.norm(run.wrenches.forces, axis=1)
    stops = [at.record.extra for at in run.events if isinstance(at.record, SafetyStopEvent)]
    stopped = [math.hypot(*force) for stop in stops if (force := _force(stop))]
    joints = run.joints
    columns = [joints.column(name) for name in cell.model.description.joints]
    positions, velocities = joints.positions[:, columns], joints.velocities[:, columns]
    truth = run.log.truth_at(run.log.end)
    bodies = truth.record.bodies if truth else ()
    return replace(
        measure,
        fault_at=struck_at(run) if measure.fault_at is None else measure.fault_at,
        failures=(*measure.failures, *(Failed(f.time, f.node, f.cause, f.fate) for f in run.failures)),
        on_floor=sum(body.role == "item" and body.pose.position[2] < FLOOR for body in bodies),
        force=max(measure.force, round(float(max([*wrenches, *stopped], default=0.0)), 2)),
        speed=max(
            measure.speed,
            round(float(np.max(np.abs(velocities) / cell.model.velocity_limit, initial=0.0)), 4),
        ),
        beyond=(*measure.beyond, *exceeded(cell.model, cell.limits, positions, velocities)),
        seconds=measure.seconds if measure.seconds is not None else run.log.end,
    )


def struck_at(run: Run) -> float | None:
    """When a fault first did something; one that waits, or finds no item, has not."""
    for at in run.events:
        fault = at.record
        if isinstance(fault, FaultEvent) and not fault.waits and not fault.missed:
            return at.time
    return None


def exceeded(
    model: RobotModel, limits: SafetyLimits, positions: Numbers, velocities: Numbers
) -> Iterable[Beyond]:
    """Yield the monitor's limits on places that were exceeded, and what braking allows for.

    positions, velocities: (ticks, joints), rad, rad/s. A joint that crosses a limit at speed v stands after
    v²/2a; for the tool the time that the slowest joint needs, v/a, at the tool's speed. Both get one tick's
    way on top, because a log tells no more often.
    """
    from picktree.robot.control.safety_monitor import JOINT_TOLERANCE

    over = np.maximum(positions - model.upper, model.lower - positions) - JOINT_TOLERANCE
    if over.size and over.max() > 0.0:
        tick, joint = np.unravel_index(int(over.argmax()), over.shape)
        first = int(np.argmax(over[:, joint] > 0.0))
        speed = float(np.abs(velocities[max(0, first - 1) : first + 1, joint]).max())
        allowed = speed**2 / (2 * float(model.acceleration_limit[joint])) + speed * TICK
        yield Beyond("joint_limit", float(over[tick, joint]), allowed)
    low, high = np.array(limits.workspace.min), np.array(limits.workspace.max)
    outside = np.array([_outside(model, q, low, high) for q in positions])
    if outside.size and outside.max() > 0.0:
        first = int(np.argmax(outside > 0.0))
        before = max(0, first - 1)
        tool = [model.jacobian(positions[n])[:3] @ velocities[n] for n in (before, first)]
        braking = float(np.max(np.abs(velocities[[before, first]]) / model.acceleration_limit))
        fastest = max(float(np.linalg.norm(each)) for each in tool)
        yield Beyond("workspace", float(outside.max()), fastest * (braking + TICK))


def _outside(model: RobotModel, q: Numbers, low: Numbers, high: Numbers) -> float:
    at = np.array(model.tcp(q).position)
    return float(np.maximum(low - at, at - high).max())


def _force(stop: Mapping[str, object]) -> list[float]:
    force = stop.get("force")
    return [float(each) for each in cast("list[float]", force)] if isinstance(force, list) else []
