"""Session recorder: converts the state of a running session into records of its log, tick by tick."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Final

from picktree.logs import RunResult, Topic, binary_gltf, log_files, log_records, topics
from picktree.logs.recording import Listener, Recorder, RecordingState
from picktree.trees import Mission
from picktree.world import (
    Array,
    BlackboardWrite,
    Entry,
    JournalEvent,
    Tick,
    Tree,
    event_types,
)
from picktree.world.scene import destinations

from . import environment
from .arithmetic_probe import arithmetic
from .checkpoints import RunState
from .execution import Execution
from .observer import Observer
from .run_recipe import ROBOT_BACKEND, fingerprints, mission_files, plugin_versions, recipe_files

_MOMENTARY_TOPICS: Final = frozenset(
    topic.name
    for topic in (topics.TIMING, topics.WRENCH, topics.PLAN, topics.CANDIDATES, topics.LOG, topics.EVENTS)
)
"""Topics of momentary events. The last message of any other topic still holds when a viewer comes."""


class LastMessages(dict[str, list[tuple[int, bytes]]]):
    """Messages that describe the present state, by the topic's name: simulated ns and payload of each.

    Of a topic that holds a state it is the last message. Of ticks it is each since the last snapshot of all
    nodes.
    """

    def keep(self, topic: Topic, at: int, data: bytes) -> None:
        """Keep a message, if the topic holds a state."""
        if topic is topics.NODES:
            self.pop(topics.TICK.name, None)
        if topic is topics.TICK:
            self.setdefault(topic.name, []).append((at, data))
        elif topic.name not in _MOMENTARY_TOPICS:
            self[topic.name] = [(at, data)]


START_ATTACHMENT: Final = "start.json"
"""Name of the attachment with the checkpoint from which a run resumes, with the tree of this run."""

LOG_FILE_NAME: Final = "log.mcap"
"""Name of the log file in the run's folder."""


class SessionRecorder:
    """Writer of one run's log; a context manager, so that the log is finished on every exit."""

    def __init__(
        self,
        path: Path,
        run: Execution,
        rotation: log_files.Rotation = log_files.NO_ROTATION,
        observers: Sequence[Observer] = (),
    ) -> None:
        """Open the log. Each written message goes to `observers`."""
        self._run = run
        self._world = run.world
        self._gripper = run.hardware.gripper
        self._checkpoints = self._edits = self._refused = 0
        self._stage = run.stage.simulation if run.stage else None
        present = self._stage.recent_truth() if self._stage else ()
        self._there = {body.id for body in present if body.present}
        """Ids of the items in the last message about the ground truth."""
        recipe = run.recipe
        start = recipe.start
        self._files = list(recipe_files(recipe))
        info = log_records.RunInfo(
            mission=recipe.mission.name,
            scene=recipe.scene.name,
            robot=recipe.robot.name,
            seed=recipe.seed,
            backend=recipe.backend if self._stage else ROBOT_BACKEND,
            tick=run.world.tick,
            parameters=recipe.parameters,
            physics={
                **run.hardware.settings(),
                "thinking.collision_check": repr(recipe.scene.thinking.collision_check),
                "thinking.image": repr(recipe.scene.thinking.image),
            },
            versions=environment.versions() | plugin_versions(recipe.mission),
            revision=environment.revision(),
            verify=recipe.verify,
            limit=recipe.limit,
            own_scene=recipe.own_scene,
            variant=recipe.variant,
            nominal=tuple(each.words() for each in recipe.nominal),
            machine=environment.machine(),
            arithmetic=arithmetic(),
            files=fingerprints(recipe, self._files),
            continues=start.continues if start else None,
        )
        self._recorder = Recorder(
            path,
            info,
            rotation=rotation,
            resumed=start.state.recording if start else None,
            listener=_listener(observers),
            measured=any(
                destinations.asks_for(recipe.scene.destinations, name) for name in destinations.MEASURES
            ),
        )

    def __enter__(self) -> SessionRecorder:
        with ExitStack() as stack:
            stack.enter_context(self._recorder)
            self._begin()
            stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._recorder.__exit__(kind, error, trace)

    def _begin(self) -> None:
        """Write the recipe's files, the tree and the robot model."""
        recorder, run = self._recorder, self._run
        recipe, tree, start = run.recipe, Tree(run.tree.structure()), run.recipe.start
        for file in self._files:
            recorder.attach(file.name, file.content, file.media_type)
        recorder.attach(environment.SOURCES_ATTACHMENT, environment.sources_to_text(environment.sources()))
        really = self._stage.true_fixtures() if self._stage else None
        recorder.fixed(recipe.scene.fixtures, recipe.scene.bins, really)
        if start is None:
            recorder.tree(tree)
            recorder.robot_model(binary_gltf.link_meshes(recipe.robot.urdf))
            return
        state = replace(start.state, tree=run.tree.save())
        recorder.attach(START_ATTACHMENT, state.to_json(), "application/json")
        with recorder.preamble():
            recorder.tree(tree, state.time)
            recorder.robot_model(binary_gltf.link_meshes(recipe.robot.urdf), state.time)

    @property
    def digest(self) -> str:
        return self._recorder.digest

    @property
    def failed(self) -> bool:
        """Whether the disk has refused a write."""
        return self._recorder.failed

    def state(self) -> RecordingState:
        """Return the state of the recording for a checkpoint."""
        return self._recorder.state()

    def begin_again(self, report: Tick, entries: tuple[Entry, ...]) -> None:
        """Write the state at the checkpoint from which the run resumes, so that its log is complete by
        itself.

        It contains the tree with the whole blackboard as writes, the belief and the ground truth.
        """
        board = self._run.tree.blackboard.save()
        writes = tuple(BlackboardWrite(key, value, "") for key, value in board.items())
        with self._recorder.preamble():
            self.tick(replace(report, writes=writes), entries)

    def tick(self, report: Tick, entries: tuple[Entry, ...]) -> None:
        """Write everything about the tick that has just ended, before time advances."""
        world, recorder = self._world, self._recorder
        now = world.clock.now
        recorder.rotate_if_due(now)
        for entry in entries:
            recorder.entry(now, entry)
        recorder.tick(now, report)
        robot = world.robot.description
        state, gripper = world.control.state, self._gripper.read()
        fingers_at = world.robot.fingers.positions(gripper.width)
        recorder.joints(now, robot.joints, state, robot.gripper.joints, gripper, fingers_at)
        objects = world.scene.objects
        links = world.robot.link_poses(state.position, gripper.width)
        tcp, cameras = world.control.tcp, world.description.cameras
        on_hand = {camera.name: tcp @ camera.pose for camera in cameras if camera.on == "hand"}
        recorder.transforms(now, links, objects, on_hand)
        recorder.belief(now, objects, world.scene.take_changes())
        recorder.wrench(now, world.control.wrench_external())
        recorder.control(now, _control(world.control.controller, world.control.reference, state.position))
        moved = any(isinstance(entry, JournalEvent) and _moves_bodies(entry) for entry in entries)
        if self._stage is None:
            return
        if moved or recorder.truth_due(now):
            self._truth(now)
        if recorder.state_due(now):
            recorder.true_state(now, self._run.true_state)

    def timing(self, timing: log_records.Timing) -> None:
        self._recorder.timing(self._world.clock.now, timing)

    def edited(self, mission: Mission) -> str:
        """Write the files and the tree of an edited mission that has taken over. Return the folder of its
        attachments."""
        self._edits += 1
        folder = f"edit-{self._edits:04d}"
        for file in mission_files(mission):
            self._recorder.attach(f"{folder}/{file.name}", file.content, file.media_type)
        self._recorder.edited_tree(self._world.clock.now, Tree(self._run.tree.structure()))
        return folder

    def refused(self, text: str) -> None:
        """Write the reason why an edit was not taken over. It changed nothing, so it is no part of the
        digest."""
        self._refused += 1
        self._recorder.attach(f"refused-{self._refused:04d}.txt", text)

    def checkpoint(self, state: RunState) -> None:
        """Write a state from which the run can be resumed."""
        self._checkpoints += 1
        name = f"checkpoint-{self._checkpoints:04d}.json"
        self._recorder.attach(name, state.to_json(), "application/json", slot="checkpoint")

    def settle(self) -> None:
        """Acknowledge an interrupt: the following records are the run's end."""
        self._recorder.settle()

    def last(self) -> None:
        """Write the ground truth at the end."""
        if self._stage is None:
            return
        now = self._world.clock.now
        self._truth(now)
        self._recorder.true_state(now, self._run.true_state)

    def _truth(self, now: float) -> None:
        """Write the ground truth.

        An item that a fault has removed is left out. One that left with its bin is written once more, at its
        last pose.
        """
        hardware = self._stage
        assert hardware is not None
        bodies = [
            body
            for body in hardware.recent_truth()
            if body.present or (body.taken_with is not None and body.id in self._there)
        ]
        self._there = {body.id for body in bodies if body.present}
        self._recorder.truth(now, (*bodies, *hardware.obstacles()))

    def finish(self, result: RunResult) -> None:
        self._recorder.finish({"status": result.status, "json": result.to_json_text()})


def _listener(observers: Sequence[Observer]) -> Listener | None:
    """Return a listener that calls the observers of messages in turn; None without observers."""
    hearing = [each.recorded for each in observers if type(each).recorded is not Observer.recorded]
    if not hearing:
        return None

    def call(topic: Topic, at: int, data: bytes, in_digest: bool) -> None:
        for hear in hearing:
            hear(topic, at, data, in_digest)

    return call


def _moves_bodies(event: JournalEvent) -> bool:
    """Whether bodies have moved at once with this event."""
    if isinstance(event, event_types.FaultEvent):
        return event.fault == "obstacle"
    return isinstance(
        event, event_types.DeliveryEvent | event_types.BeltStopsEvent | event_types.BinExchangedEvent
    )


def _control(controller: str, reference: Array | None, position: Array) -> log_records.Control:
    if reference is None:
        return log_records.Control(controller)
    return log_records.Control(controller, tuple(reference.tolist()), tuple((reference - position).tolist()))
