"""Cell session: one robot in one scene without a mission of its own; nodes and missions run one after
another."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from dataclasses import replace as with_changes
from os import PathLike
from pathlib import Path
from typing import Any, Self, TypeVar

from picktree.authoring import check_mission
from picktree.files import FileError, PicktreeError, arithmetic, suggest_name
from picktree.robot import World
from picktree.robot.planning import MotionPlan, Request
from picktree.simulation import Backend, load_faults
from picktree.trees import (
    MAIN,
    AlwaysSuccess,
    Mission,
    MissionSource,
    Node,
    NodeStatus,
    TreeDefinition,
    python_faults,
)
from picktree.trees.loading import NodeRegistry, scene_names
from picktree.world import Evidence, RgbdImage, remedy_of
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene

from .execution import Execution
from .run_recipe import DEFAULT_TIME_LIMIT, Recipe, Recording
from .session import Session

T = TypeVar("T")

_NODE = "cell"
"""Node path of plans and motions outside of a tree: key of the planner's random stream."""
_ANY_OUTCOME = "sorted >= 0"
"""Goal of a recorded node: only its success counts, not the destinations of the scene's items."""


@dataclass(frozen=True, slots=True, repr=False)
class NodeResult:
    """Result of a node or tree that ran in a cell. It is true when the node succeeded."""

    node: str
    """ID of the node."""
    status: str
    """`SUCCESS`, `FAILURE` or `SKIPPED`; `TIMEOUT`, `PAUSED` or `INTERRUPTED` when it was ended."""
    cause: str = ""
    """Cause of a failure, as `grasp.missed`."""
    message: str = ""
    """Sentence about the failure."""
    evidence: Evidence = field(default_factory=dict[str, Any])
    """Measured values of the failure, SI units."""
    remedy: str = ""
    """First thing to try against the cause."""
    failed_at: str = ""
    """Path of the node that failed."""
    outputs: Mapping[str, object] = field(default_factory=dict[str, object])
    """Outputs of the node by port, and keys of the blackboard that were written."""
    seconds: float = 0.0
    """Duration, simulated s."""
    log: Path | None = None
    """Log of the run; None when it was not recorded."""

    def __bool__(self) -> bool:
        return self.status == NodeStatus.SUCCESS

    def __repr__(self) -> str:
        lines = [f"{self.node}: {self.status} after {self.seconds:.2f} s"]
        if self.cause:
            lines += [f"  {self.cause} at {self.failed_at}: {self.message}", f"  to try: {self.remedy}"]
        lines += [f"  {key} = {value!r}" for key, value in self.outputs.items()]
        lines += [f"  log: {self.log}"] if self.log else []
        return "\n".join(lines)


class CellSession:
    """Robot, world and simulation of a scene. Time passes only while something runs.

    `scene` is a shipped scene or a scene file; `robot` a robot or robot file instead of the scene's; `faults`
    a faults file. The belief is empty until a camera has looked. Raises PicktreeError (FileError with all
    faults) for files that cannot be used.
    """

    def __init__(
        self,
        scene: str | PathLike[str] = "three_bins",
        *,
        backend: Backend = "physics",
        seed: int = 0,
        robot: str | PathLike[str] | None = None,
        faults: str | PathLike[str] | None = None,
    ) -> None:
        arithmetic.check()
        description = load_scene(str(scene), Path.cwd())
        beside = Path.cwd() if robot else Path(description.source).parent
        arm = load_robot(str(robot or description.robot), beside)
        self.seed = seed
        self._names = scene_names(description, arm)
        idle = MissionSource(TreeDefinition(MAIN, AlwaysSuccess()), "cell")
        planted = load_faults(Path(faults), description, arm) if faults is not None else None
        self._recipe = Recipe(
            self._checked(idle), description, arm, seed, planted, backend=backend, own_scene=False
        )
        self._last: Execution | None = Execution(self._recipe)
        self._used = False
        """Whether anything has run."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the simulation. Nothing can run after it."""
        self._last = None

    @property
    def world(self) -> World:
        """World that skills see: belief, sensors, planner and motions. It contains no ground truth."""
        return self._execution.world

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self.world.clock.now

    def capture(self, camera: str) -> RgbdImage:
        """Take an image with a camera of the scene, now; the belief does not change.

        Raises PicktreeError for a camera that the scene does not have, NoImage when it gives none.
        """
        cameras = self._execution.hardware.cameras
        if camera not in cameras:
            hint = suggest_name(camera, tuple(cameras))
            raise PicktreeError(f"the scene has no camera {camera!r} ({hint})")
        return cameras[camera].capture()

    def run(
        self,
        node: Node,
        *,
        log: str | PathLike[str] | None = None,
        limit: float = DEFAULT_TIME_LIMIT,
    ) -> NodeResult:
        """Run a node, or a tree of nodes, to its end, and return the result; the arm moves.

        `log`: folder in which the run's folder with its log is made; None: it is not recorded. `limit`:
        simulated time after which it is ended, s. Raises FileError with all faults of the tree.
        """
        source = MissionSource(TreeDefinition(MAIN, node), node.description.id, goal=_ANY_OUTCOME)
        before = self._execution
        recipe = with_changes(self._recipe, mission=self._checked(source), limit=limit)
        began = self.time
        self._last = execution = Execution(recipe, after=before)
        where: Path | None = None
        if log is None:
            self._used = True
            ended = _run_to_end(execution)
        else:
            if self._used:
                execution.start_here()
            self._used = True
            result = Session(execution, record=Recording(Path(log))).run()
            ended, where = result.status.upper(), result.log
        return _result(execution, node.description.id, ended, self.time - began, where)

    def solve(self, request: Request) -> MotionPlan:
        """Plan a motion in the present belief; time passes as long as planning takes.

        Raises Failure with the cause when there is no plan.
        """
        return self.perform(self.world.plan.solve(request, node=_NODE))

    def move(self, plan: MotionPlan) -> None:
        """Move the arm along a plan. Raises Failure when something stops it."""
        self.perform(self.world.move.along(plan.trajectory, node=_NODE))

    def perform(self, steps: Generator[None, None, T]) -> T:
        """Run a generator of `world` to its end, and return its value: one tick passes at each step.

        Raises Failure as the generator does.
        """
        self._used = True
        while True:
            try:
                next(steps)
            except StopIteration as end:
                return end.value
            self._execution.pass_time()

    @property
    def _execution(self) -> Execution:
        if self._last is None:
            raise PicktreeError("the cell is closed; build another one")
        return self._last

    def _checked(self, source: MissionSource) -> Mission:
        """Return the checked mission of the run. Raises FileError with all its faults."""
        folder = Path.cwd()
        registry = NodeRegistry(source.local_classes(folder))
        check = check_mission(source.document(folder), registry, self._names)
        errors = [fault for fault in check.faults if fault.severity == "error"]
        if errors or check.mission is None:
            raise FileError(python_faults(errors))
        return check.mission


def _run_to_end(execution: Execution) -> str:
    """Run an execution without a log; return its end."""
    try:
        while True:
            execution.tick()
            status = execution.status
            if status == "timeout":
                execution.tree.halt()
            if status is not None:
                return status.upper()
            if execution.world.operator.pending is not None:
                return "PAUSED"
            execution.pass_time()
    except KeyboardInterrupt:
        execution.come_to_rest()
        return "INTERRUPTED"


def _result(execution: Execution, node: str, ended: str, seconds: float, log: Path | None) -> NodeResult:
    tree, failure = execution.tree, execution.tree.failure
    status = str(tree.status) if tree.status in _ENDS else ended
    prefix = f"{MAIN}/"
    outputs: dict[str, object] = {
        key.removeprefix(prefix): value
        for key, value in tree.blackboard.save().items()
        if key.startswith(prefix) and "/" not in key.removeprefix(prefix)
    }
    root = tree.nodes[1]
    for port in root.declaration.outputs:
        with suppress(AttributeError):  # a failure may come before an output is written
            outputs[port.key] = root.written(port.key)
    if failure is None:
        return NodeResult(node, status, outputs=outputs, seconds=seconds, log=log)
    cause = failure.cause
    return NodeResult(
        node,
        status,
        cause.name,
        failure.message,
        failure.evidence,
        remedy_of(cause, failure.evidence),
        failure.node,
        outputs,
        seconds,
        log,
    )


_ENDS = (NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.SKIPPED)
