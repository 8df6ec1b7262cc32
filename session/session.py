"""Session: one run of a mission, from a checked recipe to its result. Command line, batches, re-simulation
and tests use it."""

from __future__ import annotations

import os
import signal
import time
from functools import cache
from pathlib import Path
from typing import Any, Unpack

from pydantic import TypeAdapter

from .. import arithmetic
from ..errors import PicktreeError
from ..logs.recording.recorder import Listener
from ..logs.recording.rotation import FEED_ROTATION, NO_ROTATION, Rotation
from ..logs.run_result import RunResult, RunStatus
from ..recovery.belief_restart import ResyncReport, resync_belief
from ..simulation.backends import build_hardware
from ..simulation.faults.injector import FaultInjector, FaultState
from ..trees.loading.scene_names import scene_names
from ..trees.mission import MAIN, Mission
from ..trees.running.builder import build
from ..trees.running.debugger import Debugger
from ..trees.running.runner import TickReport
from ..trees.running.tree_adoption import StateTransfer
from ..trees.status import NodeStatus
from ..world.causes import Failure
from ..world.events.run_events import CheckpointEvent, MissionEditedEvent
from ..world.journal import JournalEvent
from ..world.values import Vector3
from .assembly import TICK_LENGTH, assemble_world
from .checkpoints import RunState, restore_checkpoint, take_checkpoint
from .mission_edits import (
    EditSource,
    FileWatch,
    MissionReload,
    Revisions,
    adoption_summary,
    mission_changed,
)
from .observer import Operator, SessionWatcher, answer_pending
from .recipe import DEFAULT_TIME_LIMIT, Recipe, RunOptions, RunRequest, make_folder, read_recipe
from .run_summary import LOG_FILE_NAME, RunTimer, items_expected, summarise, write_result
from .run_tally import RunCounters
from .session_recording import SessionRecorder, Tap

__all__ = [
    "DEFAULT_TIME_LIMIT",
    "LOG_FILE_NAME",
    "RESULT_FILE_NAME",
    "RunOptions",
    "RunRequest",
    "Session",
    "SessionWatcher",
    "run",
]

RESULT_FILE_NAME = "result.json"
_MAX_BRAKING_TICKS = 40
"""Upper bound of the number of ticks in which any motion comes to rest."""


class Session:
    """One run of a mission. The constructor checks and builds everything before anything moves.

    Raises PicktreeError (FileError with all faults) for bad input, and on a processor below x86-64-v3.
    """

    def __init__(
        self,
        request: RunRequest | Recipe,
        watcher: SessionWatcher | None = None,
        debugger: Debugger | None = None,
        edits: EditSource | None = None,
        *,
        out: Path | None = None,
        revisions: Revisions | None = None,
        tap: Tap | None = None,
        listener: Listener | None = None,
        operator: Operator | None = None,
        rotation: Rotation = NO_ROTATION,
    ) -> None:
        """Build the world, the tree and the run's folder.

        `out` and `rotation` count only for a recipe; a request has its own. `edits` reports edited files; by
        default it is the disk when the request is to watch them. `revisions` gives other versions of the
        mission itself, as a log has them.

        `tap` receives every message that is part of the digest, `listener` every message after it is written.
        `operator` answers requests for help; without one, or without an answer, the run ends `paused`.
        """
        arithmetic.check()
        # The repetition of a killed run must show what came before the kill, and must not be killed itself.
        asked_for = isinstance(request, RunRequest)
        if isinstance(request, RunRequest):
            out, rotation = request.out, request.rotation
            edits = FileWatch() if edits is None and request.watch else edits
            request = read_recipe(request)
        self.recipe = recipe = request
        self.mission, self.scene, self.robot = recipe.mission, recipe.scene, recipe.robot
        self.rotation = rotation or (FEED_ROTATION if self.scene.deliveries else NO_ROTATION)
        self._watcher = watcher
        self._debugger = debugger
        self.timer = RunTimer()
        self._stopwatch = self.timer.stopwatch
        state = recipe.start.state if recipe.start else None
        self.hardware = build_hardware(
            recipe.backend, self.scene, self.robot, recipe.seed, state.simulation if state else None
        )
        self.world = assemble_world(
            self.hardware,
            self.scene,
            self.robot,
            recipe.seed,
            verify=recipe.verify,
            stopwatch=self._stopwatch,
        )
        self.tree = build(self.mission, self.world, recipe.parameters)
        self._injector = FaultInjector(
            recipe.faults,
            self.hardware,
            self._object_place,
            seed=recipe.seed,
            program=lambda: self.tree,
            kill=_kill if asked_for else None,
        )
        self.world.plan.finds_nothing = self._injector.no_plan
        self.tally = RunCounters()
        self._disagreed = 0
        self.adoption: StateTransfer | None = None
        """Transfer of node states from a checkpoint of another mission; None: the mission is the same."""
        if state is not None:
            self._take_up(state)
        self._first = (
            resync_belief(self.world) if recipe.start and recipe.start.continues.as_it_stands else None
        )
        """Resynchronisation of the belief before the tree resumes; None: not needed, or over."""
        self._checkpointed = self.tally.done
        if debugger is not None:
            debugger.attach(self.tree)
        self.tree.on_start.append(self._injector.node_started)
        self._revisions = self._follow(edits) if edits is not None else revisions
        self._tap = tap
        self._listener = listener
        self._operator = operator
        self._stopping = False
        self._total = 0
        self.folder = make_folder(out, recipe.mission.document.path.stem, recipe.seed)

    def stop(self) -> None:
        """End the run after the present tick, as an interrupt does."""
        self._stopping = True

    def run(self) -> RunResult:
        """Run the mission to its end and return the result.

        The log is finished on every exit. An interrupt (SIGINT, SIGTERM) ends the run with the status
        `interrupted`.
        """
        structure = self.tree.structure()
        self.tally.follow(structure)
        self._total = items_expected(self.scene, self.hardware.truth())
        with SessionRecorder(
            self.folder / LOG_FILE_NAME, self, structure, self._tap, self._listener
        ) as scribe:
            if self._watcher:
                self._watcher.started(structure, self.folder)
            try:
                status = self._loop(scribe)
            except KeyboardInterrupt:
                scribe.settle()
                status = "interrupted"
            except PicktreeError as error:
                if scribe.failed:
                    self._come_to_rest()
                    raise PicktreeError(
                        f"{error}; the run is stopped at {self.world.clock.now:.2f} s"
                    ) from None
                raise
            scribe.last(self.hardware)
            result = summarise(self, status, scribe.digest)
            scribe.finish(result)
        write_result(result, self.folder / RESULT_FILE_NAME)
        if self._watcher:
            self._watcher.finished(result)
        return result

    def _loop(self, scribe: SessionRecorder) -> RunStatus:
        world = self.world
        if self.recipe.start is not None:
            self._begin_again(scribe)
        while True:
            self._follow_edits(scribe)
            tree = self.tree
            before, began = self._stopwatch.seconds(), time.perf_counter()
            with self._stopwatch.measure("tree"):
                report = self._look_first() or tree.tick()
            for happened in (*self._injector.tick(), *self._brought()):
                world.journal.note(happened)
            entries = world.journal.take()
            self.tally.take(world.clock.now, entries, report.nodes, tree.leaves, report.transitions)
            with self._stopwatch.measure("logging"):
                scribe.tick(report, entries, self.hardware)
            if self._watcher:
                self._watcher.ticked(world.clock.now, report, self.tally.done, self._total)
            if self._debugger:
                self._debugger.ticked()
            if self._first is None and tree.status is not NodeStatus.RUNNING:
                return "success" if tree.status is NodeStatus.SUCCESS else "failure"
            if world.clock.now >= self.recipe.limit:
                tree.halt()
                return "timeout"
            if self._stopping:
                return "interrupted"
            if not answer_pending(world.operator, world.journal, self._operator):
                if self._quiet:
                    self._checkpoint(scribe)
                return "paused"
            if self._checkpoint_due():
                self._checkpoint(scribe)
            self._pass_time()
            with self._stopwatch.measure("logging"):
                scribe.timing(self.timer.tick_timing(before, began, self.tree.seconds()))

    def _look_first(self) -> TickReport | None:
        """Run one step of the resynchronisation and return the report of an idle tick; None when it is
        over."""
        if self._first is None:
            return None
        try:
            next(self._first)
        except StopIteration as end:
            stock: ResyncReport = end.value
            self._first = None
            self.tree.pass_over({*stock.done, *stock.gone})
            self._checkpointed = self.tally.done = self.world.journal.items_done
            return None
        return self.tree.look()

    def _brought(self) -> tuple[JournalEvent, ...]:
        """Return the events of the feed since the last tick, crushed items included."""
        events = self.hardware.take_events()
        if events:
            self._total = items_expected(self.scene, self.hardware.truth())
        return events

    def true_state(self) -> dict[str, Any]:
        """Return the present state of the simulation with its faults and the wrist sensor's learnt bias, as
        plain values.

        The call does not change the simulation.
        """
        faults: list[Any] = _fault_adapter().dump_python(self._injector.state(), mode="json")
        bias = list(self.world.control.wrist.learnt)
        return {**self.hardware.snapshot().to_plain(), "faults": faults, "wrist_bias": bias}

    def _come_to_rest(self) -> None:
        """Halt the tree and pass time until the arm rests, because nothing after this is recorded."""
        self.tree.halt()
        for _ in range(_MAX_BRAKING_TICKS):
            if self.world.control.at_rest:
                break
            self._pass_time()

    def _pass_time(self) -> None:
        world = self.world
        world.control.step_tick(TICK_LENGTH)
        world.scene.carry(world.control.tcp)

    def _take_up(self, state: RunState) -> None:
        """Restore world, tree, faults and counters from a checkpoint."""
        start = self.recipe.start
        assert start is not None
        restore_checkpoint(self.world, state)
        if start.adopt:
            self.adoption = self.tree.adopt(state.tree)
            self._read_parameters(start.changed)
        else:
            self.tree.restore(state.tree)
        self._injector.restore(state.faults)
        if state.tally is not None:
            self.tally = RunCounters.resumed(state.tally)
        self._disagreed = state.disagreements

    def _read_parameters(self, names: tuple[str, ...]) -> None:
        try:
            self.tree.read_again({f"{MAIN}/{name}" for name in names})
        except Failure as failure:
            raise PicktreeError(
                f"the running mission does not take what was set: {failure.message}"
            ) from None

    def _begin_again(self, scribe: SessionRecorder) -> None:
        """Complete the tick after which the checkpoint was taken."""
        if self.adoption is not None:
            self.world.journal.note(mission_changed(self.adoption))
        scribe.begin_again(self.tree.look(), self.world.journal.take(), self.hardware)
        self._note_checkpoint()
        self._pass_time()

    def _object_place(self, path: str) -> Vector3 | None:
        """Return the believed position of the object that a node's port `object` names, in the world, m.

        None when the node has no such port, or the belief has no such object.
        """
        node = self.tree.find(path)
        if node.declaration.port("object") is None:
            return None
        belief = self.world.scene.find(str(node.input("object")))
        return belief.pose.position if belief else None

    def _checkpoint_due(self) -> bool:
        """Whether enough items are done for a checkpoint and the run is quiescent."""
        return self.tally.done - self._checkpointed >= self.scene.checkpoint_every and self._quiet

    @property
    def _quiet(self) -> bool:
        """Whether no skill runs, the arm is at rest, the hand is empty and no answer waits to be read."""
        world = self.world
        free = world.scene.held is None and not world.operator.answered
        return self._first is None and self.tree.quiescent and world.control.at_rest and free

    def _checkpoint(self, scribe: SessionRecorder) -> None:
        self._checkpointed = self.tally.done
        with self._stopwatch.measure("physics"):
            state = take_checkpoint(
                self.world,
                self.tree,
                self.hardware,
                self._injector,
                self.tally,
                scribe.state(),
                self.disagreements,
            )
        with self._stopwatch.measure("logging"):
            scribe.checkpoint(state)
        self._note_checkpoint()

    def _note_checkpoint(self) -> None:
        done = self.tally.done
        self.world.journal.note(CheckpointEvent(f"after {done} items", items_done=done))

    @property
    def disagreements(self) -> int:
        """Number of trajectories that the verifier has rejected, earlier sessions of the run included."""
        return self._disagreed + len(self.world.plan.disagreements)

    def _follow(self, edits: EditSource) -> MissionReload:
        known = scene_names(self.scene, self.robot)
        return MissionReload(edits, self.scene, known, own_scene=self.recipe.own_scene)

    def _follow_edits(self, scribe: SessionRecorder) -> None:
        revisions = self._revisions
        if revisions is None:
            return
        for news in revisions.look(self.mission, self.world.clock.now):
            self._tell(news.text)
            if news.refused:
                scribe.refused(news.text)
        if revisions.pending is not None and self._quiet:
            self._take_over(revisions.pending, scribe)
            revisions.pending = None

    def _take_over(self, mission: Mission, scribe: SessionRecorder) -> None:
        """Resume with another version of the mission; belief, blackboard and attempts stay as they are."""
        tree = build(mission, self.world, self.recipe.parameters)
        adoption = tree.adopt(self.tree.save())
        tree.on_start.extend(self.tree.on_start)
        tree.on_end.extend(self.tree.on_end)
        self.mission, self.tree = mission, tree
        structure = tree.structure()
        self.tally.follow(structure)
        message = f"the edited mission takes over: {adoption_summary(adoption)}"
        files, fresh, gone = scribe.edited(mission, structure), tuple(adoption.fresh), tuple(adoption.gone)
        self.world.journal.note(MissionEditedEvent(message, files=files, fresh=fresh, gone=gone))
        if self._debugger:
            self._debugger.follow(tree)
        if self._watcher:
            self._watcher.edited(structure)
        self._tell(message)

    def _tell(self, text: str) -> None:
        if self._watcher:
            self._watcher.told(self.world.clock.now, text)


@cache
def _fault_adapter() -> TypeAdapter[tuple[FaultState, ...]]:
    return TypeAdapter(tuple[FaultState, ...])


def _kill() -> None:
    """Kill this process as a power failure would: nothing is flushed or closed."""
    os.kill(os.getpid(), signal.SIGKILL)


def run(mission: Path | str, **options: Unpack[RunOptions]) -> RunResult:
    """Run a mission in one call; the options are those of `RunRequest`."""
    return Session(RunRequest(mission=Path(mission), **options)).run()
