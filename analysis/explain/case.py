"""Investigation of a run: its failures, and queries on its log for their causes."""

from __future__ import annotations

import math
import tempfile
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeVar, cast

import numpy as np

from picktree.files import PicktreeError
from picktree.logs import BeliefEvent, RunLog, Stamped, log_records, node_visits, series
from picktree.session import CellUnpacking
from picktree.world import Array, JournalEvent, Vector3, event_types, extents, greatest_length, vector3
from picktree.world.robot_model import RobotDescription, fingers_of
from picktree.world.scene import (
    Bin,
    CameraDescription,
    CatalogueEntry,
    Fixture,
    SceneDescription,
    destinations,
)

from .body_tracks import BodyTracks, DeviceState, between
from .explanation import FailureStory, ItemVerdict
from .identities import Identities
from .wording import place

if TYPE_CHECKING:
    from picktree.logs import RunRecord

E = TypeVar("E", bound=JournalEvent)
T = TypeVar("T")
HAND_RANGE = 0.08
"""Distance from an item's centre within which the fingers may touch the item, m."""
ARM_RANGE = 0.15
"""Distance from a link's frame within which the link may touch an obstacle, m."""


def scene_of(log: RunLog) -> SceneDescription | None:
    """Return the scene of the log; None when the log lacks the scene file, or files that it names."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            return CellUnpacking(log, Path(folder)).scene()
        except (PicktreeError, OSError):
            return None


class BodyWorld(Protocol):
    """Bodies of a run from one source: the ground truth, or what the robot saw and felt."""

    is_true: bool
    """Whether the bodies are those of the ground truth."""
    items: BodyTracks
    obstacles: BodyTracks
    devices: tuple[DeviceState, ...]
    """True states of robot and items; empty without truth."""
    sampled: float
    """Maximum interval between two samples, s."""

    # Item of each believed one; None: the places tell.
    @property
    def names(self) -> Mapping[str, str] | None: ...

    # Times between which an item vanished, s; verdict on each item at the end.
    def gone(self, item: str) -> tuple[float, float] | None: ...
    def verdicts(self, case: Investigation) -> Mapping[str, ItemVerdict]: ...


class Investigation:
    """Cached queries on a log for the search for causes. Ground truth is for the analyst only.

    `world`: makes the bodies, those of the ground truth or those that the robot saw and felt.
    """

    def __init__(
        self,
        run: RunRecord,
        family: node_visits.VisitTree,
        failures: Sequence[FailureStory],
        world: Callable[[Investigation], BodyWorld],
    ) -> None:
        self._world = world
        self.run = run
        self.family = family
        self.failures = tuple(failures)
        self._answers: dict[object, object] = {}
        self._by_kind: dict[type[JournalEvent], Sequence[Stamped[JournalEvent]]] = {}

    @cached_property
    def scene(self) -> SceneDescription | None:
        return scene_of(self.run.log)

    @cached_property
    def belief(self) -> BodyTracks:
        return BodyTracks(list(self.run.log.beliefs()))

    @cached_property
    def world(self) -> BodyWorld:
        """Bodies as they truly were, or as the robot saw them."""
        return self._world(self)

    @property
    def bodies(self) -> BodyTracks:
        """Tracks of the items, without obstacles."""
        return self.world.items

    @property
    def obstacles(self) -> BodyTracks:
        """Tracks of the obstacles that the robot did not know from its scene."""
        return self.world.obstacles

    @property
    def devices(self) -> tuple[DeviceState, ...]:
        """True states of robot and items; empty for an older log, or without truth."""
        return self.world.devices

    @property
    def sampled(self) -> float:
        """Maximum interval between two samples of the bodies, s."""
        return self.world.sampled

    @property
    def truly(self) -> str:
        """`truly `, for a sentence about the ground truth; empty without it."""
        return "truly " if self.world.is_true else ""

    @cached_property
    def identities(self) -> Identities:
        return Identities(self.belief, self.bodies, self.world.names)

    @property
    def pairs(self) -> Mapping[str, str]:
        """True item of each believed one."""
        return self.identities.pairs

    @cached_property
    def believed(self) -> Mapping[str, tuple[str, ...]]:
        """Believed items of each true one, the first seen first."""
        found: defaultdict[str, list[str]] = defaultdict(list)
        for item, true in self.pairs.items():
            found[true].append(item)
        return {true: tuple(items) for true, items in found.items()}

    @cached_property
    def departed(self) -> Mapping[str, str]:
        """Bins by true items that were taken away with them: these items count as lying in the bin."""
        exchanges = self.events(event_types.BinExchangedEvent)
        found: dict[str, str] = {}
        for true, track in self.bodies.tracks.items() if exchanges else ():
            gone, lay = self.world.gone(true), self.bin_at(track.last)
            if gone and any(at.record.bin == lay for at in between(exchanges, *gone)):
                found[true] = lay
        return found

    def gone(self, true: str) -> tuple[float, float] | None:
        """Return the times between which a true item vanished, s.

        None when it is there at the end, or when it was taken away with its bin.
        """
        return None if true in self.departed else self.world.gone(true)

    @cached_property
    def end(self) -> float:
        return self.run.last_tick

    @cached_property
    def robot(self) -> RobotDescription | None:
        """Robot by the files in the log; None when they cannot be read here."""
        if "robot.yaml" not in self.run.log.attachments:
            return None
        with tempfile.TemporaryDirectory() as folder:
            try:
                return CellUnpacking(self.run.log, Path(folder)).robot()
            except (PicktreeError, OSError, ValueError):
                return None

    @cached_property
    def gripper(self) -> series.GripperSeries:
        """Opening and force of the fingers, also of those that a linkage moves; empty without them."""
        found, joints = self.run.gripper, self.run.joints
        if len(found.times) or self.robot is None or self.robot.gripper.linkage is None:
            return found
        names = self.robot.gripper.joints
        if not set(names) <= set(joints.names):
            return found
        fingers, columns = fingers_of(self.robot.gripper), [joints.column(name) for name in names]
        widths = [fingers.width(row) for row in joints.positions[:, columns]]
        both = zip(joints.positions[:, columns], joints.efforts[:, columns], strict=True)
        return series.GripperSeries(
            joints.times, np.array(widths), np.array([fingers.force(*each) for each in both])
        )

    @property
    def least_width(self) -> float:
        """Opening of the shut fingers, m: those of some linkages do not meet."""
        return 0.0 if self.robot is None else self.robot.gripper.min_width

    def opens(self, start: float, end: float) -> float:
        """Return the time at which a skill opens the hand between two times, s; else the later one."""
        return min((s.start for s in self.steps("release") if start < s.start <= end + 1e-6), default=end)

    def steps(self, name: str) -> list[node_visits.SkillStep]:
        """Return the steps of skills with this name, such as `close`, in the order of their ends."""
        return [step for step in self.run.steps if step.name == name]

    @cached_property
    def verdicts(self) -> Mapping[str, ItemVerdict]:
        """Verdict on each item at the end; empty when the scene is not known."""
        return self.world.verdicts(self)

    def name_of(self, true: str) -> str:
        """Return the name of a true item for a reader: its believed name, or else a description."""
        names = self.believed.get(true, ())
        if names:
            return names[0]
        track = self.bodies.tracks.get(true)
        return true if track is None else f"the {track.first.colour} {track.first.kind} ({true})"

    def entry(self, item: str) -> CatalogueEntry | None:
        """Return the catalogue entry of a believed item's kind."""
        track = self.belief.tracks.get(item)
        return None if track is None else self._catalogue.get(track.last.kind)

    def entry_of(self, true: str) -> CatalogueEntry | None:
        """Return the catalogue entry of a true item's kind."""
        track = self.bodies.tracks.get(true)
        return None if track is None else self._catalogue.get(track.first.kind)

    @cached_property
    def _catalogue(self) -> Mapping[str, CatalogueEntry]:
        return {entry.kind: entry for entry in self.scene.catalogue} if self.scene else {}

    def once(self, question: Callable[[Investigation], T]) -> T:
        """Return the result of a query on the whole run, computed only once."""
        if question not in self._answers:
            self._answers[question] = question(self)
        return cast("T", self._answers[question])

    @cached_property
    def camera(self) -> str:
        """Name of the camera with the first image; empty without an image."""
        return next(iter(self.run.images.cameras), "")

    def visit(self, failure: FailureStory) -> node_visits.Visit:
        return self.family.visits[failure.visit]

    def halted_with(self, visit: node_visits.Visit) -> list[node_visits.Visit]:
        """Return the visits below a visit that were halted when it ended."""
        halted = (v for v in self.family.visits if v.outcome == node_visits.HALTED and v.last == visit.last)
        return [v for v in halted if self.family.within(v, visit)]

    def events(self, kind: type[E], start: float = 0.0, end: float = math.inf) -> list[Stamped[E]]:
        """Return the events of a kind between two times, both inclusive, s."""
        found = self._by_kind.get(kind)
        if found is None:
            found = self._by_kind[kind] = [at for at in self.run.events if isinstance(at.record, kind)]
        return cast("list[Stamped[E]]", between(found, start, end))

    def changes(self, item: str, start: float = 0.0, end: float = math.inf) -> list[Stamped[BeliefEvent]]:
        return between(self._changes.get(item, ()), start, end)

    @cached_property
    def _changes(self) -> Mapping[str, Sequence[Stamped[BeliefEvent]]]:
        found: dict[str, list[Stamped[BeliefEvent]]] = defaultdict(list)
        for at in self.events(BeliefEvent):
            found[at.record.object].append(at)
        return found

    def hand(self, time: float) -> Vector3 | None:
        """Return the position of the TCP in the world, m; None when the log lacks it."""
        at = self.run.log.transforms_at(time)
        if at is None:
            return None
        if self.robot is not None:
            link, tcp = self.robot.tcp_link, self.robot.tcp_in_link
            poses = [t.pose for t in at.record if t.child == link]
            if poses:
                return vector3((poses[0] @ tcp).position)
        fingers = [t.pose.position for t in at.record if "finger" in t.child and "tip" not in t.child]
        return vector3(np.mean(fingers, axis=0)) if fingers else None

    def something_near(self, time: float) -> bool:
        """Whether an obstacle, or an item that is not believed in the hand, was truly near hand or arm."""
        hand = self.hand(time)
        held = {self.pairs.get(b.id, "") for b in self.believed_at(time) if b.attached}
        items = (body for name, body in self.bodies.there(time) if name not in held)
        return bool(self.obstacles_near(time)) or any(
            hand is not None and math.dist(hand, body.pose.position) < HAND_RANGE for body in items
        )

    def obstacles_near(self, time: float) -> list[str]:
        """Return the obstacles near hand and arm that the robot did not know, the nearest first."""
        links, found = self.links(time), list[tuple[float, str]]()
        for name, body in self.obstacles_at(time) if len(links) else ():
            low, high = extents(body.shape, np.eye(3))
            local = body.pose.inverse().apply(links)
            away = np.linalg.norm(np.maximum(np.maximum(low - local, local - high), 0.0), axis=1)
            found.append((float(away.min()), name))
        return [name for away, name in sorted(found) if away < ARM_RANGE]

    def obstacles_at(self, time: float) -> list[tuple[str, log_records.BodyRecord]]:
        """Return the obstacles at that time. The camera may show one later than it arrived."""
        if self.world.is_true:
            return self.obstacles.there(time)
        return [(name, track.last) for name, track in self.obstacles.tracks.items()]

    def in_the_air(self, body: log_records.BodyRecord) -> bool:
        """Whether a true item is well above the table, and next to no bin, fixture or obstacle."""
        x, y, z = body.pose.position
        size = float(np.linalg.norm(np.subtract(*extents(body.shape, np.eye(3))))) / 2
        solid = (
            *((b.pose, (b.size[0] / 2, b.size[1] / 2)) for b in self.bins.values()),
            *((f.pose, tuple(extents(f.shape, f.pose.rotation())[1][:2])) for f in self.fixtures.values()),
        )
        near = any(
            abs(x - pose.position[0]) < half[0] + size + 0.05
            and abs(y - pose.position[1]) < half[1] + size + 0.05
            for pose, half in solid
        )
        return z > size + 0.03 and not near

    def obstacle_at(self, seen: log_records.BodyRecord) -> str:
        """Return the obstacle at the believed place of a body; empty without one."""
        for name, body in self.obstacles_at(seen.last_seen + 1.0):
            low, high = extents(body.shape, body.pose.rotation())
            away = np.abs(np.subtract(body.pose.position, seen.pose.position))
            if float(away.max()) < float((high - low).max()):
                return name
        return ""

    def links(self, time: float) -> Array:
        """Return the frames' origins of arm and hand and the middles between them, (n, 3), m; none without
        frames in the log."""
        at = self.run.log.transforms_at(time)
        known = {b.id for b in self.believed_at(time)} | set(self.bins) | set(self.fixtures)
        frames = [
            t.pose.position
            for t in (at.record if at is not None else ())
            if t.child not in known and "camera" not in t.child
        ]
        points = np.array(frames).reshape(-1, 3)
        return np.vstack([points, (points[1:] + points[:-1]) / 2])

    @cached_property
    def cameras(self) -> Mapping[str, CameraDescription]:
        """Cameras of the scene by name."""
        return {c.name: c for c in self.scene.cameras} if self.scene else {}

    @cached_property
    def fixed_cameras(self) -> list[CameraDescription]:
        """Cameras of the scene that are mounted in the cell."""
        return [camera for camera in self.cameras.values() if camera.on == "world"]

    @cached_property
    def fixtures(self) -> Mapping[str, Fixture]:
        """Fixtures of the scene by id, without the table."""
        return {str(f.id): f for f in self.scene.fixtures if f.id != "table"} if self.scene else {}

    @cached_property
    def bins(self) -> Mapping[str, Bin]:
        return {str(b.id): b for b in self.scene.bins} if self.scene else {}

    def last_believed(self, failure: FailureStory) -> log_records.BodyRecord | None:
        """Return the last belief about a failure's item before the failure; None without a belief."""
        track = self.belief.tracks.get(failure.item)
        return None if track is None else track.before(failure.time)

    def believed_at(self, time: float) -> list[log_records.BodyRecord]:
        """Return all bodies of the belief at that time."""
        return [body for _, body in self.belief.there(time)]

    def ports(self, path: str) -> Mapping[str, str]:
        """Return the ports that the last version of the mission gives to a node."""
        nothing: Mapping[str, str] = {}
        return next((n.ports for n in self.run.tree_at(self.end).nodes if n.path == path), nothing)

    def destination(self, body: log_records.BodyRecord) -> str:
        """Return the destination by the scene's rules: bin, hole or fixture with holes; empty without one."""
        if self.scene is None:
            return ""
        entry, size = self.scene.find_entry(body.kind), greatest_length(body.shape)
        mass, tag = None if entry is None else entry.mass, None
        if isinstance(body, log_records.ThingRecord):
            mass, size, tag = body.mass, size if body.size is None else body.size, body.tag
        item = destinations.ItemTraits(body.colour, body.form, body.kind, mass, size, tag)
        return str(destinations.destination_rule(self.scene.destinations)(item) or "")

    def container(self, place: str) -> str:
        """Return a believed place when it is a bin or a hole; else an empty text."""
        return place if place in self.bins or place in self.holes else ""

    @cached_property
    def holes(self) -> frozenset[str]:
        """Ids of the holes of all fixtures."""
        return frozenset(str(hole.id) for fixture in self.fixtures.values() for hole in fixture.holes)

    def where(self, body: log_records.BodyRecord) -> str:
        """Return the place of a body in words: `in bin_1` or `at x 0.47, y 0.15 m`."""
        lies = self.bin_at(body)
        return f"in {lies}" if lies else f"at {place(body.pose.position)}"

    def bin_at(self, body: log_records.BodyRecord) -> str:
        """Return the bin or hole in which the body is; empty outside of all."""
        if body.seat is not None and body.seat.over:
            return str(body.seat.hole)
        if not self.world.is_true and (believed := self.container(body.place)):
            return believed
        for each in self.bins.values():
            x, y, _ = (each.pose.inverse() @ body.pose).position
            if abs(x) <= each.size[0] / 2 and abs(y) <= each.size[1] / 2:
                return str(each.id)
        return ""
