"""Run log: settings, files and records of a run by topic and time."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Final, Generic, TypeVar

import numpy as np
import orjson
from numpy.typing import NDArray

from picktree.files import PicktreeError, listed
from picktree.logs.mcap import RawMessage, is_written
from picktree.logs.recording import decode_colour, decode_depth, foxglove_messages
from picktree.world import Candidates, Intrinsics, JournalEvent, Plan, StreamVariant, Tick, Tree

from . import topics
from .arithmetic_record import Arithmetic
from .event_records import decode_event
from .log_files import JoinedLog, find_log, part_paths
from .log_records import (
    FORMAT,
    Control,
    Joints,
    LinkMesh,
    LogLine,
    NodesMessage,
    ResumedFrom,
    RunInfo,
    Scene,
    TickMessage,
    Timing,
    Transform,
    WrenchReading,
    decode,
)
from .node_states import NodeStates, with_updates
from .topics import Digest

SETTINGS: Final = "picktree"
"""Name of the metadata record with the settings of the run."""
UNKNOWN: Final = "unknown"
"""Value of a setting that the log does not state."""
_TIME_TOLERANCE: Final = 1e-6
_MAX_NAMED_TOPICS: Final = 5
"""Maximum number of topics that a message names."""
_MIN_GAP_TICKS: Final = 2.9
"""Distance of two ticks from which on there is a gap, in ticks. Clocks of two computers may jitter by one."""
_ALWAYS_RECORDED: Final = (topics.TREE, topics.NODES, topics.TICK, topics.JOINTS, topics.TF, topics.OBJECTS)


def run_settings(metadata: Mapping[str, Mapping[str, str]], tick: float, path: Path) -> RunInfo:
    """Return the settings of the run. `tick`: length of a tick (s) where the metadata do not state it.

    Raises PicktreeError when the metadata are incomplete.
    """
    words = metadata.get(SETTINGS)
    if words is None:
        return RunInfo(f"{UNKNOWN} mission", UNKNOWN, UNKNOWN, None, f"{UNKNOWN} backend", tick)
    continues = metadata.get("picktree.continues")
    try:
        return RunInfo(
            mission=words["mission"],
            scene=words["scene"],
            robot=words["robot"],
            seed=int(words["seed"]),
            backend=words["backend"],
            tick=float(words["tick"]),
            parameters=metadata.get("picktree.parameters", {}),
            physics=metadata.get("picktree.physics", {}),
            versions=metadata.get("picktree.versions", {}),
            revision=words["revision"],
            verify=words["verify"] == "true",
            limit=float(words["limit"]) if "limit" in words else None,
            own_scene=words.get("own_scene", "true") == "true",
            machine=metadata.get("picktree.machine", {}),
            arithmetic=Arithmetic.from_words(metadata.get("picktree.arithmetic", {})),
            files=metadata.get("picktree.files", {}),
            continues=ResumedFrom.from_words(continues) if continues else None,
            variant=StreamVariant.from_words(words["variant"]) if "variant" in words else None,
            nominal=tuple(words.get("nominal", "").splitlines()),
        )
    except (KeyError, ValueError) as error:
        raise PicktreeError(f"{path}: the log's metadata are incomplete: {error}") from None


def log_format(metadata: Mapping[str, Mapping[str, str]], first_tick: bytes | None, path: Path) -> int:
    """Return the number of the log's format; without metadata as the first tick shows it.

    Raises PicktreeError for a format that this picktree does not read.
    """
    words = metadata.get(SETTINGS)
    if words is None:
        return FORMAT if first_tick is None or b'"nodes":' not in first_tick else FORMAT - 1
    stated = words.get("format", "")
    if not stated.isdigit():
        raise PicktreeError(f"{path}: the log's metadata are incomplete: they state no format")
    if int(stated) > FORMAT:
        raise PicktreeError(
            f"{path}: the log has format {stated}, and this picktree reads up to {FORMAT}; "
            "upgrade picktree to read it"
        )
    if int(stated) < FORMAT - 1:
        raise PicktreeError(
            f"{path}: the log has format {stated}, and this picktree reads formats {FORMAT - 1} and "
            f"{FORMAT}; read it with the version of picktree that wrote it"
        )
    return int(stated)


@dataclass(frozen=True, slots=True)
class Gap:
    """Span that a log lacks, simulated s: from the last tick before it to the first tick after it."""

    start: float | None
    """None: the beginning of the run."""
    end: float | None
    """None: the end of the run."""

    def contains(self, time: float) -> bool:
        """Whether this time (simulated s) is in the gap, or at the tick before or after it.

        The last tick before the end of a log is outside.
        """
        if self.end is None:
            return self.start is not None and time > self.start + _TIME_TOLERANCE
        start = -math.inf if self.start is None else self.start
        return start - _TIME_TOLERANCE < time < self.end + _TIME_TOLERANCE

    def text(self) -> str:
        if self.start is None:
            return f"the log begins at {self.end:.2f} s: everything before is missing"
        if self.end is None:
            return f"the log ends at {self.start:.2f} s, before its run: everything after is missing"
        return f"{self.start:.2f} s to {self.end:.2f} s are missing"


def gaps_between(ticks: Sequence[float], begin: float, end: float | None) -> tuple[Gap, ...]:
    """Return the gaps of a log with these times of ticks, simulated s.

    `begin`: time of the run's first tick; `end`: that of its last one, None when it is unknown.
    """
    if not ticks:
        return ()
    longest = _MIN_GAP_TICKS * tick_length(ticks)
    gaps = [Gap(None, ticks[0])] if ticks[0] - begin > longest else []
    gaps += [Gap(a, b) for a, b in pairwise(ticks) if b - a > longest]
    gaps += [Gap(ticks[-1], None)] if end is not None and end - ticks[-1] > longest else []
    return tuple(gaps)


def tick_length(ticks: Sequence[float]) -> float:
    """Return the length of a tick, s, from the times of ticks."""
    return round(median(b - a for a, b in pairwise(ticks)), 6) if len(ticks) > 1 else 0.05


def stated_end(result: Mapping[str, str]) -> float | None:
    """Return the end of the run by its result, simulated s; None without a result."""
    try:
        return float(orjson.loads(result["json"])["sim_seconds"])
    except (KeyError, ValueError, TypeError):
        return None


def require_run(file: JoinedLog, metadata: Mapping[str, object]) -> None:
    """Raise PicktreeError for the file of another program, and for a log without ticks.

    The log of a run that was killed at its start has no ticks, and no message at a later time.
    """
    channels = file.channels
    known = [channel.topic for channel in channels if channel.messages]
    there = f"it has {listed(known, _MAX_NAMED_TOPICS)}" if known else "it has no messages"
    by = f", written by {file.writers}" if file.writers else ""
    if SETTINGS not in metadata and not any(c.schema.startswith("picktree.") for c in channels):
        raise PicktreeError(
            f"{file.path}: an MCAP file, but not a log of picktree{by}: {there}; `picktree run MISSION` "
            "records one"
        )
    if topics.TICK.name not in known and file.end > file.start:
        raise PicktreeError(
            f"{file.path}: a log without ticks{by}: {there}; keep {topics.TICK.name} when a log is filtered"
        )


def lacking_topics(names: Sequence[str]) -> str:
    """
    >>> lacking_topics(["/tf", "/bt/tree"])
    'it lacks the topics /tf and /bt/tree'
    """
    return f"it lacks the topic{'s' if len(names) > 1 else ''} {listed(names)}"


def lacks(file: JoinedLog, metadata: Mapping[str, object], gaps: Sequence[Gap]) -> str:
    """Return the content that another program has left out of a log, as clauses; empty when none is known."""
    clauses = [gap.text() for gap in gaps]
    known = {channel.topic for channel in file.channels if channel.messages}
    dropped = [topic.name for topic in _ALWAYS_RECORDED if topic.name not in known]
    if dropped and file.end > file.start:
        clauses.append(lacking_topics(dropped))
    if SETTINGS not in metadata:
        clauses.append("it lacks its metadata: settings and result of the run are unknown")
    if not file.attachments:
        clauses.append("it lacks its files: mission, scene and robot are unknown")
    return "; ".join(clauses)


R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class Stamped(Generic[R]):
    """Record with its time, simulated s."""

    time: float
    record: R


@dataclass(frozen=True, slots=True)
class TopicInfo:
    schema: str
    encoding: str
    messages: int


@dataclass(frozen=True, slots=True, eq=False)
class CameraImage:
    """Image of a camera: RGB (h, w, 3), depth (h, w) in m with 0 where unknown."""

    camera: str
    colour: NDArray[np.uint8]
    depth: NDArray[np.float32]
    intrinsics: Intrinsics


class RunLog:
    """Log of one run, in all its files.

    `recovered` is a sentence when the log was not finished, or when something is damaged or missing: it names
    the losses. Else it is empty. Iterators yield in order of time; `start` and `end` are simulated seconds,
    both inclusive. All methods raise PicktreeError, with the offset in the file, where it is damaged.
    """

    def __init__(self, where: str | Path) -> None:
        self.path = find_log(where)
        self._file = JoinedLog(self.path)
        self.recovered = self._file.recovered
        self.metadata: Mapping[str, Mapping[str, str]] = self._file.metadata
        self.gaps: tuple[Gap, ...] = ()
        """Spans that the log lacks, in order of time: they are damaged, or another program left them out."""
        self.lacks_something = False
        """Whether the log is known to lack messages, files or metadata."""
        self.part = self._file.continued_part.number if self._file.continued_part else 1
        """Number of the log's first file: 1, or another for a later file of a rotated log, opened by its own
        name.

        A log that begins with a later file begins in the middle of the run.
        """
        try:
            if SETTINGS not in self.metadata or self._file.is_rewritten:
                require_run(self._file, self.metadata)
            first = None if SETTINGS in self.metadata else next(self.messages([topics.TICK.name]), None)
            self.format = log_format(self.metadata, first.data if first else None, self.path)
            if self._file.is_rewritten:
                self.gaps = self._gaps()
                losses = lacks(self._file, self.metadata, () if self.recovered else self.gaps)
                self.lacks_something = bool(self.recovered or losses)
                losses = losses if self.recovered or not losses else f"{self.path}: {losses}"
                self.recovered = "; ".join(filter(None, (self.recovered, losses)))
        except PicktreeError:
            self._file.close()
            raise

    def close(self) -> None:
        self._file.close()

    @property
    def paths(self) -> tuple[Path, ...]:
        """Files of the log."""
        return self._file.paths

    @property
    def is_rewritten(self) -> bool:
        """Whether a file is damaged or missing, or another program wrote it, perhaps without some topics."""
        return self._file.is_rewritten

    @property
    def in_progress(self) -> bool:
        """Whether the run's process still writes this log."""
        return any(is_written(path) for path in (self.path, *part_paths(self.path).values()))

    def require_repeatable(self) -> None:
        """Raise PicktreeError when this version cannot run the recorded run again.

        The log is of an older format, or lacks the state with which it begins.
        """
        if self.format < FORMAT:
            revision = f", revision {self.run.revision[:8]}" if self.run.revision else ""
            raise PicktreeError(
                f"{self.path}: the log has format {self.format}, and this version repeats format {FORMAT}; "
                f"repeat it with the version of picktree that recorded it{revision}"
            )
        self.require_beginning()

    def require_beginning(self) -> None:
        """Raise PicktreeError when the log lacks the state with which it begins.

        It is a later file of a rotated log, opened by its own name, or of a cell that was busy before.
        """
        if self.part > 1:
            raise PicktreeError(
                f"{self.path}: part {self.part} of a log in several files, which begins in the middle of the "
                "run; give the run's folder"
            )
        first = next(self.ticks(), None)
        if first is not None and first.time > 0 and not self.run.continues and not self.recovered:
            raise PicktreeError(
                f"{self.path}: the log begins at {first.time:.2f} s, after the arm had moved or the hand had "
                "taken something, and it does not contain these actions; record all of them as one tree, "
                "`cell.run(pt.Sequence(…), log=…)`"
            )

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def run(self) -> RunInfo:
        """Settings with which the run was started."""
        stated = SETTINGS in self.metadata
        tick = 0.0 if stated else tick_length(self.times(topics.TICK.name))
        return run_settings(self.metadata, tick, self.path)

    @property
    def result(self) -> Mapping[str, str]:
        """Metadata of the run's end; empty when it was killed."""
        return self.metadata.get("picktree.result", {})

    @property
    def lacks_result(self) -> bool:
        """Whether the run has ended, and another program has left out its result."""
        if self.result or not self.is_rewritten:
            return False
        return self._has_ended or SETTINGS not in self.metadata

    @property
    def topics(self) -> Mapping[str, TopicInfo]:
        return {
            channel.topic: TopicInfo(channel.schema, channel.encoding, channel.messages)
            for channel in self._file.channels
        }

    @property
    def end(self) -> float:
        """Time of the last message, simulated s."""
        return self._file.end / 1e9

    @property
    def attachments(self) -> tuple[str, ...]:
        return self._file.attachments

    def attachment(self, name: str) -> bytes:
        """Return an attachment's content. Raises PicktreeError without one of that name."""
        data = self._file.attachment(name)
        if data is not None:
            return data
        held = ", ".join(self.attachments) or "none; keep the attachments when a log is filtered"
        raise PicktreeError(f"{self.path}: no file {name!r} in the log; it holds: {held}")

    @property
    def cameras(self) -> tuple[str, ...]:
        return tuple(
            t.split("/")[2] for t in self.topics if t.startswith("/camera/") and t.endswith("/depth")
        )

    def tree(self) -> Tree:
        """Return the tree with which the run began. `trees` also has those of a mission that was edited
        during the run."""
        found = next(self.trees(), None)
        if found is None:
            raise PicktreeError(f"{self.path}: the log has no message on {topics.TREE.name}")
        return found.record

    def trees(self) -> Iterator[Stamped[Tree]]:
        """Yield every tree of the run, with the time of its first tick.

        The metadata have the first one, too, which is read where the topic was left out.
        """
        words = self.metadata.get("picktree.tree", {})
        if "json" in words and topics.TREE.name not in self.topics:
            spare = RawMessage(topics.TREE.name, 0, words["json"].encode())
            return iter([Stamped(0.0, self._read(spare, lambda data: decode(Tree, data)))])
        return self._records(topics.TREE.name, lambda data: decode(Tree, data), None, None)

    def robot_model(self) -> tuple[LinkMesh, ...]:
        """Return the visual meshes of the links; empty when the log holds none."""
        found = self.last(topics.ROBOT.name, self.end)
        return () if found is None else self._read(found, foxglove_messages.read_robot)

    def ticks(self, start: float | None = None, end: float | None = None) -> Iterator[Stamped[Tick]]:
        """Yield the ticks with the states of all nodes."""
        if self.format == 2:
            before = None if start is None else self.last(topics.TICK.name, start - 2 * _TIME_TOLERANCE)
            begin = None if before is None else before.time / 1e9
            old = self._records(topics.TICK.name, lambda data: decode(Tick, data), begin, end)
            ticks = with_updates((at.time, at.record) for at in old)
        else:
            nodes = None if start is None else self.last(topics.NODES.name, start)
            ticks = self._rebuilt(None if nodes is None else nodes.time / 1e9, end)
        for time, tick in ticks:
            if start is None or time >= start - _TIME_TOLERANCE:
                yield Stamped(time, tick)

    def _rebuilt(self, start: float | None, end: float | None) -> Iterator[tuple[float, Tick]]:
        """Yield ticks with states that are rebuilt from the messages from `start` on."""
        states = NodeStates(node for at in self.trees() for node in at.record.nodes)
        for message in self.messages([topics.NODES.name, topics.TICK.name], start, end):
            if message.topic == topics.NODES.name:
                states.take(self._read(message, lambda data: decode(NodesMessage, data)).nodes)
                continue
            tick = self._read(message, lambda data: decode(TickMessage, data))
            nodes = states.after(tick.transitions)
            yield (
                message.time / 1e9,
                Tick(tick.root_status, tick.tip, nodes, tick.writes, tick.transitions),
            )

    def timings(self, start: float | None = None, end: float | None = None) -> Iterator[Stamped[Timing]]:
        return self._records(topics.TIMING.name, lambda data: decode(Timing, data), start, end)

    def joints(self, start: float | None = None, end: float | None = None) -> Iterator[Stamped[Joints]]:
        return self._records(topics.JOINTS.name, foxglove_messages.read_joints, start, end)

    def transforms(
        self, start: float | None = None, end: float | None = None
    ) -> Iterator[Stamped[tuple[Transform, ...]]]:
        return self._records(topics.TF.name, foxglove_messages.read_transforms, start, end)

    def frame_rows(self) -> Iterator[Stamped[list[tuple[str, tuple[float, ...]]]]]:
        """Yield each frame's name, and its pose in the world as position (m) and quaternion xyzw."""
        return self._records(topics.TF.name, foxglove_messages.read_rows, None, None)

    def wrenches(
        self, start: float | None = None, end: float | None = None
    ) -> Iterator[Stamped[WrenchReading]]:
        return self._records(topics.WRENCH.name, lambda data: decode(WrenchReading, data), start, end)

    def controls(self, start: float | None = None, end: float | None = None) -> Iterator[Stamped[Control]]:
        """Yield the servo's set points; none in logs from before this topic."""
        return self._records(topics.CONTROL.name, lambda data: decode(Control, data), start, end)

    def beliefs(self, start: float | None = None, end: float | None = None) -> Iterator[Stamped[Scene]]:
        return self._records(topics.OBJECTS.name, foxglove_messages.read_scene, start, end)

    def truths(self, start: float | None = None, end: float | None = None) -> Iterator[Stamped[Scene]]:
        return self._records(topics.TRUTH.name, foxglove_messages.read_scene, start, end)

    def plans(self, start: float | None = None, end: float | None = None) -> Iterator[Stamped[Plan]]:
        return self._records(topics.PLAN.name, lambda data: decode(Plan, data), start, end)

    def candidates(
        self, start: float | None = None, end: float | None = None
    ) -> Iterator[Stamped[Candidates]]:
        return self._records(topics.CANDIDATES.name, lambda data: decode(Candidates, data), start, end)

    def events(self, start: float | None = None, end: float | None = None) -> Iterator[Stamped[JournalEvent]]:
        return self._records(topics.EVENTS.name, decode_event, start, end)

    def lines(self, start: float | None = None, end: float | None = None) -> Iterator[Stamped[LogLine]]:
        return self._records(topics.LOG.name, foxglove_messages.read_log, start, end)

    def images(
        self, camera: str, start: float | None = None, end: float | None = None
    ) -> Iterator[Stamped[CameraImage]]:
        kinds = (topics.calibration_topic, topics.colour_topic, topics.depth_topic)
        names = [topic_of(camera).name for topic_of in kinds]
        parts: dict[str, RawMessage] = {}
        for message in self.messages(names, start, end):
            if parts and next(iter(parts.values())).time != message.time:
                parts = {}
            parts[message.topic] = message
            if len(parts) == len(names):  # the three messages of an image have one time
                calibration, colour, depth = (parts.pop(name) for name in names)
                yield Stamped(
                    message.time / 1e9,
                    CameraImage(
                        camera,
                        self._read(colour, lambda data: decode_colour(foxglove_messages.read_image(data))),
                        self._read(depth, lambda data: decode_depth(foxglove_messages.read_image(data))),
                        self._read(calibration, foxglove_messages.read_calibration),
                    ),
                )

    def messages(
        self,
        wanted: Collection[str] | None = None,
        start: float | None = None,
        end: float | None = None,
        *,
        newest_first: bool = False,
    ) -> Iterator[RawMessage]:
        """Yield undecoded messages of these topics."""
        return self._file.messages(wanted, _ns(start), _ns(end), newest_first=newest_first)

    def times(self, topic: str) -> list[float]:
        """Return the times of a topic's messages, simulated s."""
        return [time / 1e9 for time in self._file.times(topic)]

    def last(self, topic: str, at: float) -> RawMessage | None:
        """Return the last message of the topic at `at` (simulated s) or before; None without one."""
        return next(self._file.messages([topic], None, _ns(at), newest_first=True), None)

    def tick_at(self, at: float) -> Stamped[Tick] | None:
        """Return the last tick at `at` (simulated s) or before; None without one."""
        last = self.last(topics.TICK.name, at)
        if last is None:
            return None
        *_, found = self.ticks(last.time / 1e9, last.time / 1e9)
        return found

    def transforms_at(self, at: float) -> Stamped[tuple[Transform, ...]] | None:
        return self._last(topics.TF.name, foxglove_messages.read_transforms, at)

    def belief_at(self, at: float) -> Stamped[Scene] | None:
        return self._last(topics.OBJECTS.name, foxglove_messages.read_scene, at)

    def truth_at(self, at: float) -> Stamped[Scene] | None:
        return self._last(topics.TRUTH.name, foxglove_messages.read_scene, at)

    def digest(self) -> str:
        """Compute the digest of everything simulated in the log. It equals the recorded one when the log is
        whole."""
        digest, start = Digest(), None
        before, continues = self._file.continued_part, self.run.continues
        if before is not None:
            digest, start = Digest(bytes.fromhex(before.digest)), before.start + 1
        elif continues is not None:
            digest, start = Digest(bytes.fromhex(continues.digest)), _ns(continues.time + 1e-6)
        for message in self._file.messages(start=start):
            if topics.is_simulated(message.topic):
                digest.add(message.topic, message.time, message.data)
        return digest.hex

    def _gaps(self) -> tuple[Gap, ...]:
        ticks = self.times(topics.TICK.name)
        continues = self.run.continues
        begin = continues.time if continues else 0.0 if self.part == 1 or not ticks else ticks[0]
        return gaps_between(ticks, begin, None if self._has_ended else stated_end(self.result))

    @property
    def _has_ended(self) -> bool:
        """Whether the last tick is that of the run: the arm may still come to rest after it."""
        last = self._last(topics.TICK.name, lambda data: decode(TickMessage, data), self.end)
        return last is not None and last.record.root_status in ("SUCCESS", "FAILURE")

    def _records(
        self, topic: str, read: Callable[[bytes], R], start: float | None, end: float | None
    ) -> Iterator[Stamped[R]]:
        for message in self.messages([topic], start, end):
            yield Stamped(message.time / 1e9, self._read(message, read))

    def _last(self, topic: str, read: Callable[[bytes], R], at: float) -> Stamped[R] | None:
        message = self.last(topic, at)
        return None if message is None else Stamped(message.time / 1e9, self._read(message, read))

    def _read(self, message: RawMessage, read: Callable[[bytes], R]) -> R:
        from google.protobuf.message import DecodeError

        try:
            return read(message.data)
        except (ValueError, DecodeError) as error:
            raise PicktreeError(
                f"{self.path}: {message.topic} at {message.time / 1e9:.2f} s: unreadable message: {error}"
            ) from None


def _ns(seconds: float | None) -> int | None:
    return None if seconds is None else round(seconds * 1e9)
