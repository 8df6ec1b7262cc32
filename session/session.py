"""Session: one run of a mission, from a checked recipe to its result. Command line, batches, re-simulation
and tests use it.

A session runs an `Execution` of a recipe and writes a `Recording`. Observers watch; interrupters also answer,
edit and stop.
"""

from __future__ import annotations

import gc
import os
import signal
import time
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path

from picktree.files import PicktreeError, arithmetic
from picktree.logs import (
    CrushedItem,
    FeedCount,
    FigureCounts,
    HoleItem,
    PickCount,
    RunResult,
    RunStatus,
    WallSeconds,
    episode_counts,
    log_files,
    log_records,
)
from picktree.robot import operator_desk
from picktree.robot.perception import hidden_shares
from picktree.simulation import ItemScore, Score, TrueBody, score
from picktree.trees import Mission
from picktree.world import ItemCount, RobotStopped, Stopwatch, Tick, event_types
from picktree.world.scene import MAX_HIDDEN_SHARE

from .believed_score import believed_count
from .execution import Execution
from .mission_edits import FileWatch, MissionReload, adoption_summary, mission_changed
from .observer import Interrupter, Observer, answer_pending
from .run_recipe import Recipe, Recording, RunRequest, make_folder, read_recipe
from .session_recording import LOG_FILE_NAME, SessionRecorder


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

    def tick_timing(
        self, before: Mapping[str, float], began: float, nodes: Mapping[str, float]
    ) -> log_records.Timing:
        """Return the wall times of one tick.

        `before`: the stopwatch's seconds at the start of the tick; `began`: `perf_counter` then; `nodes`:
        seconds by node path.
        """
        now = self.stopwatch.seconds()
        spent = {part: seconds - before.get(part, 0.0) for part, seconds in now.items()}
        return log_records.Timing(
            time.perf_counter() - began,
            **{
                part: spent.get(part, 0.0)
                for part in ("physics", "control", "planning", "perception", "rendering")
            },
            recording=spent.get("logging", 0.0),
            nodes=tuple(log_records.NodeTime(path, seconds) for path, seconds in nodes.items()),
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


def summarise(
    run: Execution, timer: RunTimer, status: RunStatus, digest: str, log: Path, reason: str = ""
) -> RunResult:
    """Return the result of a run that has ended with `status`, scored against the ground truth.

    A success that misses the goal becomes `incomplete`. `reason`: the sentence on the end, where it is not
    the tree's.
    """
    recipe, tally = run.recipe, run.tally
    scene, desk, now = recipe.scene, run.world.operator, run.world.clock.now
    truth = run.stage.simulation.truth() if run.stage else ()
    verdict = score(truth, scene) if run.stage else Score(believed_count(run.world.scene.objects, scene), ())
    goal = run.mission.goal.text if run.mission.goal else scene.goal
    if status == "success" and not verdict.reached(goal):
        status = "incomplete"
    tally.finish(now)
    crushed = tuple(_crushed(run, truth))
    question = desk.pending if status == "paused" else None
    return RunResult(
        status=status,
        seed=recipe.seed,
        digest=digest,
        items=replace(verdict.count, elsewhere=tally.count("elsewhere"), set_aside=tally.count("aside")),
        picks=PickCount(tally.tried, tally.held, tally.tried_objects, tally.held_first_try),
        failures=dict(tally.failures),
        recoveries=dict(tally.recovered),
        cures=tally.cures,
        planted=(
            *tally.planted,
            *(episode_counts.never_due(run.stage.injector.never_due) if run.stage else ()),
        ),
        sim_seconds=now,
        cpu_seconds=timer.cpu_seconds,
        wall_seconds=timer.wall_seconds(),
        log=log.absolute(),
        folder=log.parent.absolute(),
        message=reason or (question.reason if question else _message(run, status)),
        thinking_charged=scene.thinking.collision_check > 0.0 and scene.thinking.image > 0.0,
        disagreements=run.disagreements if recipe.verify else None,
        holes=tuple(
            _at_hole(body, item) for body, item in zip(truth, verdict.items, strict=True) if item.seat
        ),
        crushed=crushed,
        feed=FeedCount(tally.deliveries, tally.exchanges, tally.set_aside) if scene.deliveries else None,
        asked=question,
        as_believed=run.stage is None,
        figures=_figures(run, verdict.count, len(crushed), asks=question is not None),
    )


def _crushed(run: Execution, truth: Iterable[TrueBody]) -> Iterator[CrushedItem]:
    for body in truth:
        limit = run.recipe.scene.entry(body.kind).force_limit if body.crushed > 0.0 else None
        if limit is not None:
            yield CrushedItem(str(body.id), body.kind, body.colour, round(body.crushed, 2), limit)


def _figures(run: Execution, items: ItemCount, crushed: int, *, asks: bool) -> FigureCounts:
    """Return the counts of the operators' figures: the robot's, with the scorer's units and misplaced items.

    `asks`: the run waits for an answer, for which a person must come.
    """
    counts = run.tally.figures.counts(run.world.clock.now)
    if asks:
        counts = replace(counts, assists={**counts.assists, "answer": counts.assists.get("answer", 0) + 1})
    if run.stage is None:
        return counts
    return replace(
        counts,
        units=items.sorted,
        first_pass=min(counts.first_pass, items.sorted),
        misplaced=max(items.misplaced - crushed, 0),
        crushed=crushed,
    )


def _message(run: Execution, status: RunStatus) -> str:
    """Return the reason of the run's end: the root's failure, and the arm when it hid the items."""
    failure = run.tree.failure
    return "; ".join(filter(None, (failure.message if failure else "", _hidden(run, status))))


def _hidden(run: Execution, status: RunStatus) -> str:
    """Return a sentence about the arm when nothing was grasped because it hid the items; else nothing."""
    unseen = status == "incomplete" or (status == "failure" and not run.world.scene.objects)
    if not unseen or run.tally.tried:
        return ""
    shares = hidden_shares(run.world.robot, run.world.description, run.world.control.state.position)
    parts = [f"{100 * share:.0f} % from {name}" for name, share in shares.items() if share > MAX_HIDDEN_SHARE]
    if not parts:
        return ""
    file = Path(run.recipe.robot.source).name
    return (
        f"the arm hides the place of the items, {', '.join(parts)}, and nothing was grasped; move "
        "'home' under "
        f"'poses:' in {file} out of the cameras' view (`picktree robot test` measures the hidden share)"
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


RESULT_FILE_NAME = "result.json"
MOVE = "move", "end the run"
"""Answers to the question before a motion."""


class Session:
    """Run of a mission. The constructor checks and builds everything before anything moves.

    Raises PicktreeError (FileError with all faults) for bad input, and on a processor below x86-64-v3.
    """

    def __init__(
        self,
        recipe: RunRequest | Recipe | Execution,
        *,
        record: Recording | None = None,
        observers: Sequence[Observer] = (),
        planning_worker: bool = False,
    ) -> None:
        """Build the world, the tree and the run's folder.

        `recipe` is what is run; an execution was built from one before. `record`: where the run is recorded;
        None: as the request says, else in `runs`. `observers` are called in their order; the interrupters
        among them may also answer questions, edit the mission and end the run. `planning_worker`: whether a
        second process plans ahead, for which a second core is needed.
        """
        arithmetic.check()
        self._observers: list[Observer] = list(observers)
        self._owns_hardware = not isinstance(recipe, Execution)
        self.timer = RunTimer(recipe.stopwatch if isinstance(recipe, Execution) else None)
        confirm = isinstance(recipe, RunRequest) and recipe.confirm
        if isinstance(recipe, RunRequest):
            record = record or Recording(recipe.out, recipe.rotation)
            if recipe.watch:
                self._observers.append(MissionReload(FileWatch()))
            # Only a first run is killed: its repetition must show what came before the kill.
            recipe = Execution(
                read_recipe(recipe),
                stopwatch=self.timer.stopwatch,
                planning_worker=planning_worker,
                kill=_kill,
            )
        elif isinstance(recipe, Recipe):
            recipe = Execution(recipe, stopwatch=self.timer.stopwatch, planning_worker=planning_worker)
        self.execution = recipe
        self._interrupters = [each for each in self._observers if isinstance(each, Interrupter)]
        if recipe.recipe.shadow:
            from .shadow_report import ShadowReport

            self._observers.append(ShadowReport(self._tell))
        if confirm:
            recipe.world.control.confirm = self._confirm
        record = record or Recording()
        self._rotation = record.rotation or (
            log_files.FEED_ROTATION if recipe.recipe.scene.deliveries else log_files.NO_ROTATION
        )
        self.folder = make_folder(record.out, recipe.mission.document.path.stem, recipe.recipe.seed)

    def run(self) -> RunResult:
        """Run the mission to its end and return the result.

        The log is finished on every exit. An interrupt (SIGINT, SIGTERM) ends the run with the status
        `interrupted`; a stop by the robot's own side ends it with `stopped`.
        """
        execution, log, reason = self.execution, self.folder / LOG_FILE_NAME, ""
        with (
            self._released_robot(),
            _without_old_garbage(),
            SessionRecorder(log, execution, self._rotation, self._observers) as recorder,
        ):
            for observer in self._observers:
                observer.started(execution, self.folder)
            try:
                status = self._loop(recorder)
                if status in ("success", "failure", "timeout"):
                    execution.let_items_rest()
                    self._look_last(recorder)
            except KeyboardInterrupt as end:
                recorder.settle()
                status, reason = "interrupted", str(end)
            except RobotStopped as stop:
                status, reason = "stopped", str(stop)
            except PicktreeError as error:
                if recorder.failed:
                    execution.come_to_rest()  # Nothing after this is recorded.
                    raise PicktreeError(
                        f"{error}; the run is stopped at {execution.world.clock.now:.2f} s"
                    ) from None
                raise
            recorder.last()
            result = summarise(execution, self.timer, status, recorder.digest, log, reason)
            recorder.finish(result)
        write_result(result, self.folder / RESULT_FILE_NAME)
        for observer in self._observers:
            observer.finished(result)
        return result

    @contextmanager
    def _released_robot(self) -> Generator[None]:
        """Release a robot of this session's own at the end of the block."""
        try:
            yield
        finally:
            if self._owns_hardware and self.execution.stage is None:
                self.execution.hardware.close()

    def _loop(self, recorder: SessionRecorder) -> RunStatus:
        execution, stopwatch = self.execution, self.timer.stopwatch
        if execution.recipe.start is not None:
            self._begin_again(recorder)
        while True:
            self._follow_edits(recorder)
            before, began = stopwatch.seconds(), time.perf_counter()
            report, entries = execution.tick()
            with stopwatch.measure("logging"):
                recorder.tick(report, entries)
            self._show(report)
            status = execution.status or self._stopped(recorder)
            if status is not None:
                if status == "timeout":
                    execution.tree.halt()
                return status
            if execution.checkpoint_due:
                self._checkpoint(recorder)
            execution.pass_time()
            with stopwatch.measure("logging"):
                recorder.timing(self.timer.tick_timing(before, began, execution.tree.seconds()))

    def _look_last(self, recorder: SessionRecorder) -> None:
        """Look once more where there is no ground truth to score."""
        if self.execution.stage is not None:
            return
        for report, entries in self.execution.last_look():
            recorder.tick(report, entries)
            self._show(report)

    def _show(self, report: Tick) -> None:
        execution = self.execution
        now, done, total = execution.world.clock.now, execution.tally.done, execution.items_total
        for observer in self._observers:
            observer.ticked(now, report, done, total)

    def _stopped(self, recorder: SessionRecorder) -> RunStatus | None:
        """Return the status with which an interrupter, or an unanswered question, ends the run; else None."""
        if any(each.stops() for each in self._interrupters):
            return "interrupted"
        if any(each.halts() for each in self._interrupters):
            self.execution.come_to_rest()
            return "interrupted"
        world = self.execution.world
        if answer_pending(world.operator, world.journal, self._interrupters):
            return None
        if self.execution.quiet and self.execution.stage is not None:
            self._checkpoint(recorder)
        return "paused"

    def _begin_again(self, recorder: SessionRecorder) -> None:
        """Complete the tick after which the checkpoint was taken."""
        execution = self.execution
        if execution.adoption is not None:
            execution.world.journal.note(mission_changed(execution.adoption))
        recorder.begin_again(execution.tree.look(), execution.world.journal.take())
        self._note_checkpoint()
        execution.pass_time()

    def _checkpoint(self, recorder: SessionRecorder) -> None:
        state = self.execution.checkpoint(recorder.state())
        with self.timer.stopwatch.measure("logging"):
            recorder.checkpoint(state)
        self._note_checkpoint()

    def _note_checkpoint(self) -> None:
        done = self.execution.tally.done
        self.execution.world.journal.note(event_types.CheckpointEvent(f"after {done} items", items_done=done))

    def _confirm(self, owner: str, motion: str) -> None:
        """Ask whether the arm may make a motion. Raises KeyboardInterrupt without a yes; no node may turn a
        no into a failure and go on."""
        situation = f"the arm is at rest or on its way, and {owner or 'the mission'} wants to move it"
        question = operator_desk.OperatorQuestion(owner, f"may the arm move? {motion}", MOVE, "", situation)
        answers = (operator.answer(question) for operator in self._interrupters)
        answer = next((each for each in answers if each is not None), "no answer")
        if answer != MOVE[0]:
            raise KeyboardInterrupt(f"a motion of {owner or 'the mission'} was not confirmed: {answer}")

    def _follow_edits(self, recorder: SessionRecorder) -> None:
        execution = self.execution
        for editor in self._interrupters:
            for news in editor.look(execution.mission, execution.world.clock.now):
                self._tell(news.text)
                if news.refused:
                    recorder.refused(news.text)
            if editor.pending is not None and execution.quiet:
                self._take_over(editor.pending, recorder)
                editor.pending = None

    def _take_over(self, mission: Mission, recorder: SessionRecorder) -> None:
        """Resume with another version of the mission."""
        adoption = self.execution.adopt(mission)
        message = f"the edited mission takes over: {adoption_summary(adoption)}"
        files, fresh, gone = recorder.edited(mission), tuple(adoption.fresh), tuple(adoption.gone)
        self.execution.world.journal.note(
            event_types.MissionEditedEvent(message, files=files, fresh=fresh, gone=gone)
        )
        for observer in self._observers:
            observer.edited(self.execution)
        self._tell(message)

    def _tell(self, text: str) -> None:
        for observer in self._observers:
            observer.notified(self.execution.world.clock.now, text)


@contextmanager
def _without_old_garbage() -> Generator[None]:
    """Exclude the objects that exist before the run from garbage collection: libraries, world and tree.

    A process that froze its libraries itself keeps that: thawing would lose it, and freezing more would keep
    the world and tree of each run for good."""
    if frozen_before_runs():
        yield
        return
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@cache
def frozen_before_runs() -> bool:
    """Whether this process, or the one that it was forked from, had frozen objects before its first run.

    The count takes 14 ms where there are many.
    """
    return gc.get_freeze_count() > 0


def _kill() -> None:
    """Kill this process as a power failure would: nothing is flushed or closed."""
    os.kill(os.getpid(), signal.SIGKILL)
