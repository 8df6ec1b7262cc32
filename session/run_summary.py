"""Run summary: the result of a session at its end, and the wall time of its parts."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

from ..files.errors import PicktreeError
from ..logs.run_result import (
    CrushedItem,
    FeedCount,
    FormCount,
    HoleItem,
    ItemCount,
    PickCount,
    RunResult,
    RunStatus,
    WallSeconds,
)
from ..logs.schema.records import NodeTime, Timing
from ..robot.perception.robot_mask import hidden_shares
from ..simulation.scorer import ItemScore, score
from ..simulation.truth import TrueBody
from ..world.computing_time import Stopwatch
from ..world.scene.description import MAX_HIDDEN_SHARE
from .execution import Execution


class RunTimer:
    """Wall and CPU time of a run from the timer's creation on, and wall time by part of the work."""

    def __init__(self, stopwatch: Stopwatch | None = None) -> None:
        self.stopwatch = stopwatch or Stopwatch()
        self._began = time.perf_counter()
        self._cpu_began = time.process_time()

    @property
    def cpu_seconds(self) -> float:
        """CPU time of this process since the creation, s."""
        return time.process_time() - self._cpu_began

    def tick_timing(self, before: Mapping[str, float], began: float, nodes: Mapping[str, float]) -> Timing:
        """Return the wall times of one tick.

        `before`: the stopwatch's seconds at the start of the tick; `began`: `perf_counter` then; `nodes`:
        seconds by node path.
        """
        now = self.stopwatch.seconds()
        spent = {part: seconds - before.get(part, 0.0) for part, seconds in now.items()}
        return Timing(
            time.perf_counter() - began,
            **{
                part: spent.get(part, 0.0)
                for part in ("physics", "control", "planning", "perception", "rendering")
            },
            recording=spent.get("logging", 0.0),
            nodes=tuple(NodeTime(path, seconds) for path, seconds in nodes.items()),
        )

    def wall_seconds(self) -> WallSeconds:
        """Return the wall time of the run so far by part, s; rendering counts as perception."""
        wall = self.stopwatch.seconds()
        return WallSeconds(
            total=time.perf_counter() - self._began,
            physics=wall.get("physics", 0.0),
            planning=wall.get("planning", 0.0),
            perception=wall.get("perception", 0.0) + wall.get("rendering", 0.0),
            logging=wall.get("logging", 0.0),
        )


def summarise(run: Execution, timer: RunTimer, status: RunStatus, digest: str, log: Path) -> RunResult:
    """Return the result of a run that has ended with `status`, scored against the ground truth.

    A success that misses the goal becomes `incomplete`.
    """
    recipe, tally = run.recipe, run.tally
    scene, desk, now = recipe.scene, run.world.operator, run.world.clock.now
    truth = run.hardware.truth()
    verdict = score(truth, scene)
    goal = run.mission.goal.text if run.mission.goal else scene.goal
    if status == "success" and not verdict.reached(goal):
        status = "incomplete"
    episodes = tally.episodes.so_far(now)
    asked = desk.pending if status == "paused" else None
    return RunResult(
        status=status,
        seed=recipe.seed,
        digest=digest,
        items=ItemCount(
            verdict.total,
            verdict.sorted,
            verdict.misplaced,
            verdict.left,
            {form: FormCount(count.total, count.sorted) for form, count in verdict.by_form.items()},
            verdict.without_destination,
            tally.count("elsewhere"),
            tally.count("aside"),
        ),
        picks=PickCount(tally.tried, tally.held, tally.tried_objects, tally.held_first_try),
        failures=dict(tally.failures),
        recoveries=dict(tally.recovered),
        cures=episodes.cures,
        planted=episodes.planted,
        sim_seconds=now,
        cpu_seconds=timer.cpu_seconds,
        wall_seconds=timer.wall_seconds(),
        log=log.absolute(),
        folder=log.parent.absolute(),
        message=asked.reason if asked else _message(run, status),
        thinking_charged=scene.thinking.collision_check > 0.0 and scene.thinking.image > 0.0,
        disagreements=run.disagreements if recipe.verify else None,
        holes=tuple(
            _at_hole(body, item) for body, item in zip(truth, verdict.items, strict=True) if item.seat
        ),
        crushed=tuple(
            CrushedItem(str(body.id), body.kind, body.colour, round(body.crushed, 2), limit)
            for body in truth
            if body.crushed > 0.0 and (limit := scene.entry(body.kind).force_limit) is not None
        ),
        feed=FeedCount(tally.deliveries, tally.exchanges, tally.set_aside) if scene.deliveries else None,
        asked=asked,
    )


def _message(run: Execution, status: RunStatus) -> str:
    """Return why the run ended as it did: the root's failure, and the arm where it hid the items."""
    failure = run.tree.failure
    return "; ".join(filter(None, (failure.message if failure else "", _hidden(run, status))))


def _hidden(run: Execution, status: RunStatus) -> str:
    """Return a sentence about the arm when nothing was grasped because it hid the items; else nothing."""
    unseen = status == "incomplete" or (status == "failure" and not run.world.scene.objects)
    if not unseen or run.tally.tried:
        return ""
    shares = hidden_shares(run.world.robot, run.world.description, run.world.control.state.position)
    told = [f"{100 * share:.0f} % from {name}" for name, share in shares.items() if share > MAX_HIDDEN_SHARE]
    if not told:
        return ""
    file = Path(run.recipe.robot.source).name
    return (
        f"the arm hides where the items are, {', '.join(told)}, and nothing was grasped; move 'home' under "
        f"'poses:' in {file} out of the cameras' view (`picktree robot test` measures it)"
    )


def write_result(result: RunResult, path: Path) -> None:
    """Write a result as JSON. Raises PicktreeError when the disk refuses."""
    try:
        path.write_text(result.to_json_text(), encoding="utf-8")
    except OSError as error:
        raise PicktreeError(
            f"{path}: the result cannot be written: {error.strerror}; the log holds it, too"
        ) from None


def _at_hole(body: TrueBody, item: ItemScore) -> HoleItem:
    assert item.seat is not None
    seat = item.seat
    return HoleItem(
        str(item.id),
        body.kind,
        str(seat.hole),
        item.verdict,
        round(seat.depth, 6),
        seat.bottom,
        round(seat.tilt, 6),
        round(seat.penetration, 7),
        item.reason,
    )
