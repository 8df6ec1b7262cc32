"""Recorder: writes each tick's values into one log, and computes the digest of everything simulated; the
log's file on disk, or several by rotation.
"""

from __future__ import annotations

import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, TypeAlias

from picktree.files import PicktreeError
from picktree.logs import Digest, ImageEvent, Topic, event_record, log_files, log_records, topics
from picktree.logs.mcap import McapFile, require_free_space
from picktree.simulation import TrueBody, TrueObstacle
from picktree.world import (
    BeliefChange,
    BeliefObject,
    BlackboardWrite,
    Candidates,
    Entry,
    GripperState,
    ImageEntry,
    JointState,
    JournalEvent,
    NodeState,
    Plan,
    Pose,
    RgbdImage,
    Tick,
    Transition,
    Tree,
    Wrench,
)
from picktree.world.scene import Bin, Fixture

from . import foxglove_messages, journal_records
from .foxglove_messages import encode_colour, encode_depth, with_stamp
from .interrupts import Interrupts
from .true_state import StateWriter

_STATE_TOPICS = (topics.TREE, topics.ROBOT, topics.OBJECTS, topics.TRUTH)
"""Topics whose last message holds until the next one."""
_TICK_TOPICS = (topics.JOINTS, topics.TF, topics.WRENCH, topics.CONTROL)
_CARRIED_TOPICS = frozenset(topic.name for topic in (*_STATE_TOPICS, *_TICK_TOPICS))


@dataclass(frozen=True, slots=True)
class CarriedFile:
    name: str
    media_type: str
    data: bytes


class RotationState:
    """Content that the next file of a rotated log must begin with.

    The next file begins at the last tick. It repeats that tick with every running node as beginning and with
    the whole blackboard, and the state of all other topics at its time.
    """

    def __init__(self) -> None:
        self._metadata: dict[str, Mapping[str, str]] = {}
        self.files: dict[str, CarriedFile] = {}
        self._messages: dict[str, tuple[int, bytes]] = {}
        self._writes: dict[str, BlackboardWrite] = {}
        self._running: dict[str, Transition] = {}
        self._tick: Tick | None = None
        self.time = -1
        """Time of the last tick, simulated ns; negative before the first."""

    def metadata(self, name: str, words: Mapping[str, str]) -> None:
        self._metadata[name] = dict(words)

    def file(self, file: CarriedFile, slot: str) -> None:
        """Keep an attached file, in place of an earlier one with the same slot."""
        self.files.pop(slot, None)
        self.files[slot] = file

    def message(self, topic: Topic, time: int, data: bytes) -> None:
        if topic.name in _CARRIED_TOPICS:
            self._messages[topic.name] = (time, data)

    def tick(self, time: int, tick: Tick) -> None:
        self.time, self._tick = time, tick
        for write in tick.writes:
            self._writes.pop(write.key, None)
            self._writes[write.key] = write
        for transition in tick.edges:
            self._running.pop(transition.path, None)
            if transition.starts:
                self._running[transition.path] = transition

    def all_metadata(self) -> dict[str, Mapping[str, str]]:
        tree = self._messages.get(topics.TREE.name)
        now = {"picktree.tree": {"json": tree[1].decode()}} if tree else {}
        return {**self._metadata, **now}

    def all_messages(self) -> list[tuple[Topic, bytes]]:
        """Return the messages that hold at `time`, with their topics."""
        found: list[tuple[Topic, bytes]] = []
        for topic in _STATE_TOPICS:
            if topic.name in self._messages:
                data = self._messages[topic.name][1]
                found.append((topic, data if topic is topics.TREE else with_stamp(data, self.time)))
        for topic in _TICK_TOPICS:
            time, data = self._messages.get(topic.name, (-1, b""))
            if time == self.time:
                found.append((topic, data))
        if self._tick is not None:
            tick, now = self._tick, {node.path: node for node in self._tick.nodes}
            starts = tuple(
                replace(start, message=now[start.path].message, ticked=now[start.path].ticked)
                for start in self._running.values()
            )
            whole = replace(tick, writes=tuple(self._writes.values()), transitions=starts)
            found.append((topics.NODES, log_records.nodes_json(whole)))
            found.append((topics.TICK, log_records.tick_json(whole)))
        return found


class Heartbeat:
    """Thread that calls `beat` every `interval` wall seconds until it is stopped or `beat` returns False."""

    def __init__(self, beat: Callable[[], bool], interval: float, name: str) -> None:
        self._beat = beat
        self._interval = interval
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread. Returns when the last beat is over."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while not self._stopped.wait(self._interval):
            if not self._beat():
                return


_HEARTBEAT_PERIOD = 0.2
_MAX_MESSAGE_AGE = 0.3
"""Wall seconds of `_HEARTBEAT_PERIOD`, the period of the heartbeat, and `_MAX_MESSAGE_AGE`, the longest
wait of a message.

Together with the time that a checkpoint takes they stay below a second.
"""


class LogFile:
    """Writer of topics, files and metadata of one run. Times are ns and never decrease.

    All methods raise PicktreeError when the disk refuses or has refused.
    """

    def __init__(
        self,
        path: Path,
        *,
        rotation: log_files.Rotation,
        checkpoint: float = 1.0,
        chunk_bytes: int = 4 << 20,
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        require_free_space(path)
        self._first = path
        self._rotation = rotation
        self._carried = RotationState() if rotation else None
        self._number = 1
        self._start = 0
        """Time of the first tick that is new in the present file, simulated ns."""
        self._heartbeat: Heartbeat | None = None
        self._checkpoint, self._chunk_bytes, self._wall = checkpoint, chunk_bytes, wall
        self._channels: dict[str, int] = {}
        self._file = self._new_file(path, self._channels)

    def start_heartbeat(self) -> None:
        """Start the thread that brings each message to disk within a second, even when no further one
        follows."""
        self._heartbeat = Heartbeat(self._beat, _HEARTBEAT_PERIOD, "log")
        self._heartbeat.start()

    def stop_heartbeat(self) -> None:
        if self._heartbeat is not None:
            self._heartbeat.stop()

    @property
    def closed(self) -> bool:
        """Whether the file is finished, or given up because the disk refused."""
        return self._file.closed

    @property
    def failed(self) -> bool:
        """Whether the disk has refused a write."""
        return self._file.failed

    @property
    def part(self) -> int:
        """Number of the present file, from 1 on."""
        return self._number

    def message(self, topic: Topic, at: int, data: bytes) -> None:
        channel = self._channels.get(topic.name)
        if channel is None:
            channel = self._channels[topic.name] = self._file.channel(topic)
        self._file.message(channel, at, data)
        if self._carried is not None:
            self._carried.message(topic, at, data)

    def lacks(self, topic: Topic, at: int) -> bool:
        """Whether a reader that begins at the chunk of a message at this time finds none of the topic."""
        return self._file.lacks(self._channels[topic.name], at)

    def tick(self, at: int, tick: Tick) -> None:
        """Keep the content of a tick's message for the beginning of a further file."""
        if self._carried is not None:
            self._carried.tick(at, tick)

    def attachment(self, name: str, media_type: str, data: bytes, slot: str = "") -> None:
        """Write an attachment. A further part of the log repeats only the last one of each slot."""
        self._file.attachment(name, media_type, data)
        if self._carried is not None:
            self._carried.file(CarriedFile(name, media_type, data), slot or name)

    def metadata(self, name: str, words: Mapping[str, str]) -> None:
        self._file.metadata(name, words)
        if self._carried is not None:
            self._carried.metadata(name, words)

    def checkpoint(self) -> None:
        self._file.checkpoint()

    def finish(self) -> None:
        self._file.finish()

    def rotate_if_due(self, at: int, digest: str) -> None:
        """Continue in a further file when the present one has reached its limit. Call it between two
        ticks."""
        carried = self._carried
        if carried is None:
            return
        if carried.time < 0:
            self._check_limit()
            self._start = at
        elif at > carried.time >= self._start and self._full(at):
            self._rotate(carried, digest)
            self._start = at

    def _full(self, at: int) -> bool:
        size, seconds = self._rotation.size, self._rotation.seconds
        return bool((size and self._file.size >= size) or (seconds and at - self._start >= seconds * 1e9))

    def _check_limit(self) -> None:
        limit, begun = self._rotation.size, self._file.size
        if 0 < limit < 2 * begun:
            raise PicktreeError(
                f"{self._first}: each part of this log begins with {begun / 1e6:.1f} MB that it needs to "
                f"open by itself; rotate it at {-(-2 * begun // 10**6)} MB or more"
            )

    def _rotate(self, carried: RotationState, digest: str) -> None:
        self._file.checkpoint()
        path = log_files.part_path(self._first, self._number + 1)
        channels: dict[str, int] = {}
        file = self._new_file(path, channels)
        again = carried.all_messages()
        repeated = Counter(topic.name for topic, _ in again)
        part = log_files.PartInfo(self._number + 1, carried.time, digest, repeated)
        for name, words in carried.all_metadata().items():
            file.metadata(name, words)
        file.metadata(log_files.PART_METADATA, part.words())
        for carry in carried.files.values():
            file.attachment(carry.name, carry.media_type, carry.data)
        for topic, data in again:
            file.message(channels[topic.name], carried.time, data)
        file.checkpoint()
        before = self._file
        self._file, self._channels = file, channels
        self._number += 1
        before.metadata(log_files.NEXT_METADATA, {"part": path.name, "digest": digest})
        before.finish()

    def _new_file(self, path: Path, channels: dict[str, int]) -> McapFile:
        file = McapFile(path, checkpoint=self._checkpoint, chunk_bytes=self._chunk_bytes, wall=self._wall)
        channels.update((topic.name, file.channel(topic)) for topic in topics.FIXED)
        return file

    def _beat(self) -> bool:
        try:
            self._file.keep_up(_MAX_MESSAGE_AGE)
        except PicktreeError:
            return False  # the next write raises the error
        return not self._file.failed


SCENE_PERIOD = 1.0
"""Period after which belief and truth are written again even without a change, simulated s."""
_WARNING_KINDS = frozenset({"recovery", "safety_stop", "fault"})
"""Kinds of event that are repeated as warnings on the topic of log lines, for people."""
Listener: TypeAlias = Callable[[Topic, int, bytes, bool], None]
"""Receiver of messages: topic, simulated ns, payload, whether the message is part of the digest."""


@dataclass(frozen=True, slots=True)
class RecordingState:
    """State of a recorder in a checkpoint, as far as the following messages depend on it."""

    believed: float
    """Time of the last message of the belief, simulated s."""
    true: float
    """Time of the last message of the ground truth, simulated s."""
    failing: tuple[str, ...]
    """Paths of the nodes that failed in the last tick."""
    cameras: tuple[tuple[str, Pose], ...]
    """Frames of the cameras that have taken an image, with their poses in the world."""
    digest: str
    """Digest of everything simulated so far, in hex."""


class Recorder:
    """Writer of one run's log. Times are simulated seconds and never decrease.

    Use it as a context manager: however the run ends (an exception, SIGINT, SIGTERM), the file is finished.
    All methods raise PicktreeError when the disk refuses.
    """

    def __init__(
        self,
        path: Path,
        run: log_records.RunInfo,
        *,
        checkpoint: float = 1.0,
        chunk_bytes: int = 4 << 20,
        wall: Callable[[], float] = time.monotonic,
        rotation: log_files.Rotation = log_files.NO_ROTATION,
        resumed: RecordingState | None = None,
        listener: Listener | None = None,
        measured: bool = False,
    ) -> None:
        """Open the log and write its metadata.

        `resumed`: the run resumes from a checkpoint, and its digest continues. `listener` receives every
        message after it is written. `measured`: rules of destinations ask for measures of items, which are
        then recorded.
        """
        self._measured = measured
        self.path = path.absolute()
        self._file = LogFile(
            self.path, rotation=rotation, checkpoint=checkpoint, chunk_bytes=chunk_bytes, wall=wall
        )
        self._interrupts = Interrupts()
        self._resumed = resumed
        self._listener = listener
        self._preamble = False
        self._digest = Digest(bytes.fromhex(resumed.digest)) if resumed else Digest()
        self._joints = foxglove_messages.JointMessages()
        self._transforms = foxglove_messages.TransformMessages()
        self._beliefs = foxglove_messages.SceneMessages(locked=True)
        self._truths = foxglove_messages.SceneMessages(locked=False)
        self._states = StateWriter()
        self._part = 0
        """Number of the log's file that holds the last state of the simulation."""
        self._fixed: tuple[log_records.PartRecord, ...] = ()
        self._standing: tuple[log_records.PartRecord, ...] = ()
        self._cameras: dict[str, Pose] = {}  # by frame
        self._believed = self._true = -SCENE_PERIOD
        self._failing: frozenset[str] = frozenset()
        self._nodes: tuple[NodeState, ...] = ()
        """States of the nodes after the last tick."""
        self._tree_is_new = True
        if resumed is not None:
            self._take_up(resumed)
        self._file.metadata("picktree", journal_records.run_metadata(run))
        self._file.metadata("picktree.parameters", run.parameters)
        self._file.metadata("picktree.physics", run.physics)
        self._file.metadata("picktree.versions", run.versions)
        self._file.metadata("picktree.machine", run.machine)
        self._file.metadata("picktree.arithmetic", run.arithmetic.words())
        self._file.metadata("picktree.files", run.files)
        if run.continues is not None:
            self._file.metadata("picktree.continues", run.continues.words())

    def __enter__(self) -> Recorder:
        self._interrupts.__enter__()
        self._file.start_heartbeat()
        return self

    def settle(self) -> None:
        """Acknowledge an interrupt, which is then no longer raised."""
        self._interrupts.settle()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.settle()
        try:
            self._file.stop_heartbeat()
            # that error has already been raised
            if not (self._file.failed and isinstance(error, PicktreeError)):
                self.finish({"ended": "orderly" if kind is None else kind.__name__})
        finally:
            self._interrupts.__exit__(kind, error, trace)

    @property
    def digest(self) -> str:
        """SHA-256 over everything simulated so far, in hex."""
        return self._digest.hex

    @property
    def failed(self) -> bool:
        """Whether the disk has refused a write."""
        return self._file.failed

    def state(self) -> RecordingState:
        return RecordingState(
            self._believed,
            self._true,
            tuple(sorted(self._failing)),
            tuple(self._cameras.items()),
            self.digest,
        )

    @contextmanager
    def preamble(self) -> Generator[None]:
        """Mark the messages written inside as the state from which a resumed run continues.

        They make its log complete by itself. They are no part of the digest, because the first run has
        written the same.
        """
        assert self._resumed is not None
        self._preamble = True
        self._believed = self._true = -math.inf
        try:
            yield
        finally:
            self._preamble = False
            self._take_up(self._resumed)

    def _take_up(self, state: RecordingState) -> None:
        self._believed, self._true = state.believed, state.true
        self._failing, self._cameras = frozenset(state.failing), dict(state.cameras)

    def checkpoint(self) -> None:
        """Write everything so far into the file. This also happens by itself each second."""
        with self._interrupts.held():
            self._file.checkpoint()

    def finish(self, result: Mapping[str, str] | None = None) -> None:
        """Add the run's result and the digest to the metadata, and close the file, once."""
        if self._file.closed and not self._file.failed:
            return
        with self._interrupts.held():
            self._file.checkpoint()
            self._file.metadata("picktree.result", {"digest": self.digest, **(result or {})})
            self._file.finish()

    # At the start of a run

    def attach(
        self, name: str, content: str | bytes, media_type: str = "text/plain", *, slot: str = ""
    ) -> None:
        """Write a file of the recipe: mission, scene, robot, URDF, faults.

        Of the files with the same `slot`, only the last is needed to resume: a further part of a rotated log
        repeats no other.
        """
        data = content.encode() if isinstance(content, str) else content
        with self._interrupts.held():
            self._file.attachment(name, media_type, data, slot)

    def tree(self, tree: Tree, now: float = 0.0) -> None:
        """Write the loaded tree: a message, and a metadata record for readers that seek."""
        data = log_records.encode(tree)
        self._write(topics.TREE, now, data)
        with self._interrupts.held():
            self._file.metadata("picktree.tree", {"json": data.decode()})
            self._file.checkpoint()  # The log of a run that dies at once then still holds its tree.

    def edited_tree(self, now: float, tree: Tree) -> None:
        """Write the tree of an edited mission, which is ticked from the next tick on."""
        self._tree_is_new = True
        self._write(topics.TREE, now, log_records.encode(tree))

    def robot_model(self, meshes: Iterable[log_records.LinkMesh], now: float = 0.0) -> None:
        """Write the visual meshes of the links, from `link_meshes`."""
        self._write(topics.ROBOT, now, foxglove_messages.encode_robot(_ns(now), meshes))
        self.checkpoint()

    def fixed(
        self, fixtures: Iterable[Fixture], bins: Iterable[Bin], really: Iterable[Fixture] | None = None
    ) -> None:
        """Set the bodies that never move; each message of the belief and of the truth contains them from now
        on.

        `really`: the fixtures at their true poses; None: at the believed ones.
        """
        walls = tuple(journal_records.bin_parts(bins))
        self._fixed = (*journal_records.fixture_parts(fixtures), *walls)
        self._standing = self._fixed if really is None else (*journal_records.fixture_parts(really), *walls)

    # At each tick

    def rotate_if_due(self, now: float) -> None:
        """Continue in a further file when the present one is full. Call it before the first message of a
        tick."""
        with self._interrupts.held():
            self._file.rotate_if_due(_ns(now), self.digest)

    def tick(self, now: float, tick: Tick) -> None:
        """Write the changes of a tick. A failure that begins in this tick also becomes a log line.

        Before the first tick of each chunk, and of an edited tree, the state of all nodes is written.
        """
        if self._tree_is_new or self._file.lacks(topics.NODES, _ns(now)):
            self._tree_is_new = False
            self._write(topics.NODES, now, log_records.nodes_json(tick))
        self._write(topics.TICK, now, log_records.tick_json(tick))
        self._file.tick(_ns(now), tick)
        if tick.nodes is self._nodes:
            return
        self._nodes = tick.nodes
        failing = [n for n in tick.nodes if n.status == "FAILURE" and n.cause and n.ticked]
        for node in journal_records.failure_origins(failing):
            if node.path not in self._failing:
                self.log(now, "ERROR", f"{node.cause}: {node.message}", node.path)
        self._failing = frozenset(n.path for n in failing)

    def timing(self, now: float, timing: log_records.Timing) -> None:
        self._write(topics.TIMING, now, log_records.encode(timing))

    def joints(
        self,
        now: float,
        names: Sequence[str],
        state: JointState,
        fingers: Sequence[str] = (),
        gripper: GripperState | None = None,
        fingers_at: Sequence[float] = (),
    ) -> None:
        """Write the joints of arm and fingers; see `joints_record`."""
        joints = journal_records.joints_record(names, state, fingers, gripper, fingers_at)
        self._write(topics.JOINTS, now, self._joints.encode(_ns(now), joints))

    def transforms(
        self,
        now: float,
        links: Mapping[str, Pose],
        objects: Iterable[BeliefObject] = (),
        moving: Mapping[str, Pose] | None = None,
    ) -> None:
        """Write the poses of all links, believed objects and cameras in the world, by name.

        A camera in `moving` has its present pose, any other the pose of its last image.
        """
        frames = dict(links)
        for o in objects:
            frames[o.id] = o.pose
        frames.update(self._cameras)
        frames.update((_camera_frame(camera), pose) for camera, pose in (moving or {}).items())
        self._write(topics.TF, now, self._transforms.encode(_ns(now), frames))

    def wrench(self, now: float, wrench: Wrench) -> None:
        """Write the external wrench at the wrist, in world axes."""
        reading = log_records.WrenchReading(
            log_records.Vector(*wrench.force), log_records.Vector(*wrench.torque), wrench.magnitude()
        )
        self._write(topics.WRENCH, now, log_records.encode(reading))

    def control(self, now: float, control: log_records.Control) -> None:
        """Write the set point of the arm's servo."""
        self._write(topics.CONTROL, now, log_records.encode(control))

    def belief(
        self, now: float, objects: Iterable[BeliefObject], changes: Iterable[BeliefChange] = ()
    ) -> None:
        """Write the belief when something changed or a second has passed. Each change is an event."""
        changed = False
        for change in changes:
            changed = True
            self._event(now, journal_records.belief_event(change))
        if changed or now - self._believed >= SCENE_PERIOD - 1e-6:
            self._believed = now
            bodies = tuple(journal_records.belief_record(o, measured=self._measured) for o in objects)
            scene = log_records.Scene(bodies, self._fixed)
            self._write(topics.OBJECTS, now, self._beliefs.encode(_ns(now), scene))

    def truth_due(self, now: float) -> bool:
        """Whether a second has passed since the last ground truth."""
        return now - self._true >= SCENE_PERIOD - 1e-6

    def truth(self, now: float, bodies: Iterable[TrueBody | TrueObstacle]) -> None:
        """Write the ground truth, which only the analyst sees."""
        self._true = now
        scene = log_records.Scene(
            tuple(journal_records.truth_record(body, measured=self._measured) for body in bodies),
            self._standing,
        )
        self._write(topics.TRUTH, now, self._truths.encode(_ns(now), scene))

    def state_due(self, now: float) -> bool:
        """Whether the simulation's own state is due."""
        return self._states.due(now)

    def true_state(self, now: float, state: Callable[[int], Mapping[str, Any]]) -> None:
        """Write the simulation's own state as plain values, from which it can be rebuilt.

        `state` returns it without the first so many items that left.
        """
        anew, self._part = self._part != self._file.part, self._file.part
        self._write(topics.STATE, now, self._states.encode(now, state, anew=anew))

    # As they happen

    def entry(self, now: float, entry: Entry) -> None:
        """Write an entry of the journal."""
        match entry:
            case Plan():
                self._write(topics.PLAN, now, log_records.encode(entry))
            case Candidates():
                self._write(topics.CANDIDATES, now, log_records.encode(entry))
            case ImageEntry(image, findings):
                self.image(now, image)
                self._event(now, ImageEvent(f"image from {image.camera}", findings=findings))
            case JournalEvent():
                self._event(now, entry)
                if entry.kind in _WARNING_KINDS:
                    self.log(now, "WARNING", entry.message, entry.node)

    def image(self, now: float, image: RgbdImage) -> None:
        """Write colour, depth and calibration of a camera image."""
        camera, frame, at = image.camera, _camera_frame(image.camera), _ns(now)
        self._cameras[frame] = image.camera_in_world
        calibration = foxglove_messages.encode_calibration(at, frame, image.intrinsics)
        colour = foxglove_messages.encode_image(at, frame, "jpeg", encode_colour(image.colour))
        depth = foxglove_messages.encode_image(at, frame, "png", encode_depth(image.depth))
        self._write(topics.calibration_topic(camera), now, calibration)
        self._write(topics.colour_topic(camera), now, colour)
        self._write(topics.depth_topic(camera), now, depth)

    def log(self, now: float, level: str, message: str, name: str = "") -> None:
        """Write a log line for people; `level` is DEBUG, INFO, WARNING, ERROR or FATAL."""
        self._write(
            topics.LOG, now, foxglove_messages.encode_log(_ns(now), log_records.LogLine(level, message, name))
        )

    def _event(self, now: float, event: JournalEvent) -> None:
        self._write(topics.EVENTS, now, log_records.encode(event_record(event)))

    def _write(self, topic: Topic, now: float, data: bytes) -> None:
        at, in_digest = _ns(now), topic.simulated and not self._preamble
        with self._interrupts.held():
            if in_digest:
                self._digest.add(topic.name, at, data)
            self._file.message(topic, at, data)
        if self._listener is not None:
            self._listener(topic, at, data, in_digest)


def _ns(seconds: float) -> int:
    return round(seconds * 1e9)


def _camera_frame(camera: str) -> str:
    return f"camera/{camera}"
