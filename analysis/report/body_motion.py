"""Motion in a run, read once for all panels: frames, belief, ground truth, and pairs of believed and true
bodies.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from picktree.analysis import Run
from picktree.files import library_parts
from picktree.logs import log_records
from picktree.world import Array, Pose, event_types


def row(pose: Pose) -> tuple[float, ...]:
    return (*pose.position, *pose.orientation)


def rotated(q: Array, v: Array) -> Array:
    """Rotate vectors (n, 3) by quaternions (n, 4)."""
    u, w = q[:, :3], q[:, 3:]
    t = 2.0 * np.cross(u, v)
    return v + w * t + np.cross(u, t)


def product(a: Array, b: Array) -> Array:
    """Return the Hamilton product of quaternions (n, 4)."""
    u, s = a[:, :3], a[:, 3:]
    v, t = b[:, :3], b[:, 3:]
    vector = s * v + t * u + np.cross(u, v)
    scalar = s * t - np.sum(u * v, axis=1, keepdims=True)
    return np.hstack([vector, scalar])


def composed(a: Array, b: Array) -> Array:
    """Return the pose `b`, given in frame `a`, in the parent frame of `a`."""
    return np.hstack([rotated(a[:, 3:], b[:, :3]) + a[:, :3], product(a[:, 3:], b[:, 3:])])


def inverse(a: Array) -> Array:
    turned = a[:, 3:] * np.array([-1.0, -1.0, -1.0, 1.0])
    return np.hstack([-rotated(turned, a[:, :3]), turned])


def between(a: Array, b: Array, share: Array) -> Array:
    """Interpolate from `a` (share 0) to `b` (share 1); `share` (n,).

    Quaternions are interpolated along the chord, which is enough for a tick or a small angle.
    """
    s = share[:, None]
    sign = np.where(np.sum(a[:, 3:] * b[:, 3:], axis=1, keepdims=True) < 0, -1.0, 1.0)
    q = (1 - s) * a[:, 3:] + s * sign * b[:, 3:]
    return np.hstack([(1 - s) * a[:, :3] + s * b[:, :3], q / np.linalg.norm(q, axis=1, keepdims=True)])


def continuous(a: Array) -> Array:
    """Return the same poses with quaternions that do not change their sign from row to row."""
    if len(a) < 2:
        return a
    flips = np.sum(a[1:, 3:] * a[:-1, 3:], axis=1) < 0
    signs = np.concatenate([[1.0], np.where(np.cumsum(flips) % 2 == 1, -1.0, 1.0)])
    return np.hstack([a[:, :3], a[:, 3:] * signs[:, None]])


def filled(a: Array) -> Array:
    """Replace rows of NaN by the last valid row before them, or the first one after."""
    known = ~np.isnan(a[:, 0])
    if not known.any():
        return np.tile(np.array(row(Pose())), (len(a), 1))
    places = np.where(known, np.arange(len(a)), -1)
    last = np.maximum.accumulate(places)
    return a[np.where(last < 0, int(np.argmax(known)), last)]


if TYPE_CHECKING:
    from scipy.optimize import linear_sum_assignment
else:
    linear_sum_assignment = library_parts.library_part(
        "scipy.optimize._lsap", "scipy.optimize.linear_sum_assignment"
    )

Flags = NDArray[np.bool_]
Span = tuple[int, int]
"""First and last tick, both inclusive."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Poses of all frames of `/tf` in the world at each tick, (n, 7); NaN where a frame is missing."""

    tracks: Mapping[str, Array]
    ticks: int

    def track(self, name: str) -> Array:
        found = self.tracks.get(name)
        return np.full((self.ticks, 7), np.nan) if found is None else found


@dataclass(frozen=True, slots=True, eq=False)
class BodyAppearance:
    """Believed shape, colour and role of a body from one tick on."""

    tick: int
    body: log_records.BodyRecord


@dataclass(frozen=True, slots=True, eq=False)
class BelievedBody:
    """Body of the belief over the run."""

    id: str
    track: Array
    """Poses in the world, (n, 7); NaN where it is not in the belief."""
    held: Flags
    looks: tuple[BodyAppearance, ...]

    @property
    def present(self) -> Flags:
        return ~np.isnan(self.track[:, 0])


@dataclass(frozen=True, slots=True, eq=False)
class TrueBodySamples:
    """True body at the times of the logged ground truth."""

    body: log_records.BodyRecord
    ticks: NDArray[np.int64]
    poses: Array
    """Poses in the world, (samples, 7)."""


def frames_of(run: Run) -> Frames:
    number = {time: k for k, time in enumerate(run.ticks.times)}
    tracks: dict[str, Array] = {}
    for at in run.log.frame_rows():
        tick = number.get(at.time)
        if tick is None:
            continue
        for name, pose in at.record:
            track = tracks.get(name)
            if track is None:
                track = tracks[name] = np.full((len(number), 7), np.nan)
            track[tick] = pose
    return Frames(tracks, len(number))


def believed_of(run: Run, frames: Frames) -> list[BelievedBody]:
    """Return the believed bodies in the order in which they entered the belief."""
    ticks = len(run.ticks)
    looks: dict[str, list[BodyAppearance]] = {}
    held: dict[str, Flags] = {}
    for at in run.log.beliefs():
        tick = run.ticks.number_at(at.time)
        for flags in held.values():
            flags[tick:] = False
        for body in at.record.bodies:
            seen = looks.setdefault(body.id, [])
            if not seen or _appearance_key(seen[-1].body) != _appearance_key(body):
                seen.append(BodyAppearance(tick, body))
            held.setdefault(body.id, np.zeros(ticks, dtype=np.bool_))[tick:] = body.attached
    return [BelievedBody(name, frames.track(name), held[name], tuple(found)) for name, found in looks.items()]


def truths_of(run: Run) -> list[TrueBodySamples]:
    """Return the true bodies, each up to the tick at which a fault removed it."""
    bodies: dict[str, log_records.BodyRecord] = {}
    found: dict[str, list[tuple[int, tuple[float, ...]]]] = {}
    taken = _removal_ticks(run)
    for at in run.log.truths():
        tick = run.ticks.number_at(at.time)
        for body in at.record.bodies:
            if tick > taken.get(body.id, tick):
                continue
            bodies[body.id] = body
            samples = found.setdefault(body.id, [])
            if samples and samples[-1][0] == tick:
                samples.pop()
            samples.append((tick, row(body.pose)))
    for name, tick in taken.items():
        if name in found and found[name][-1][0] < tick:
            found[name].append((tick, found[name][-1][1]))
    return [
        TrueBodySamples(
            bodies[name], np.array([tick for tick, _ in samples]), np.array([pose for _, pose in samples])
        )
        for name, samples in found.items()
    ]


def _removal_ticks(run: Run) -> dict[str, int]:
    """Return the tick of the removal by a fault, by the true body's id."""
    taken: dict[str, int] = {}
    for at in run.events:
        fault = at.record
        if isinstance(fault, event_types.FaultEvent) and (fault.fault == "remove" or fault.gone):
            taken[fault.item or fault.obstacle or ""] = run.ticks.number_at(at.time)
    return taken


def spans(flags: Flags) -> list[Span]:
    """Return the spans in which the flags are true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(first), int(after) - 1) for first, after in zip(edges[::2], edges[1::2], strict=True)]


def _appearance_key(body: log_records.BodyRecord) -> tuple[object, ...]:
    return body.shape, body.colour, body.kind, body.role, body.place, body.blocks


@dataclass(frozen=True, eq=False)
class SceneMotion:
    frames: Frames
    believed: list[BelievedBody]
    truths: list[TrueBodySamples]
    partners: list[int | None]
    """Index of the believed body of each true body; None: no match."""

    @cached_property
    def true(self) -> list[Array]:
        """Poses of each true body at each tick, as of `true_poses`."""
        return [
            true_poses(truth, None if partner is None else self.believed[partner], self.frames.ticks)
            for truth, partner in zip(self.truths, self.partners, strict=True)
        ]


@dataclass(frozen=True, slots=True)
class BeliefDeviation:
    """Distance between truth and belief, from a tick on."""

    tick: int
    object: str
    """Id of the believed object; empty where the robot believed in none at that time."""
    body: log_records.BodyRecord
    """True body."""
    distance: float
    """Distance between both positions, m; NaN where one of them is missing."""


_MIN_DISTANCE_CHANGE = 5e-4
"""Smallest change of a distance that counts, m."""
_MOTIONS: WeakKeyDictionary[Run, SceneMotion] = WeakKeyDictionary()


def motion_of(run: Run) -> SceneMotion:
    motion = _MOTIONS.get(run)
    if motion is None:
        frames = frames_of(run)
        believed, truths = believed_of(run, frames), truths_of(run)
        motion = _MOTIONS[run] = SceneMotion(frames, believed, truths, match_bodies(believed, truths))
    return motion


def deviations(motion: SceneMotion) -> Iterator[BeliefDeviation]:
    """Yield the deviations body by body.

    There is one at every sample of the ground truth. Between two samples, where the scene interpolates, there
    is one at each change of the distance.
    """
    for number, (truth, partner) in enumerate(zip(motion.truths, motion.partners, strict=True)):
        samples = frozenset(truth.ticks.tolist())
        one = None if partner is None else motion.believed[partner]
        if one is None:
            yield from (BeliefDeviation(tick, "", truth.body, math.nan) for tick in sorted(samples))
            continue
        apart = np.linalg.norm(one.track[:, :3] - motion.true[number][:, :3], axis=1).tolist()
        present = one.present.tolist()
        last = math.nan
        for tick in range(min(samples), max(samples) + 1):
            if (
                tick in samples
                or math.isnan(apart[tick]) != math.isnan(last)
                or abs(apart[tick] - last) > _MIN_DISTANCE_CHANGE
            ):
                last = apart[tick]
                yield BeliefDeviation(tick, one.id if present[tick] else "", truth.body, last)


MAX_HELD_OFFSET = 0.03
"""Maximum distance between truth and belief of a held body that moves with the hand, m."""
MAX_MATCH_DISTANCE = 0.3
"""Distance above which two bodies match equally badly, m."""
OTHER_ROLE_COST = 10.0
"""Cost of a pair of an item and an obstacle, m."""
OTHER_LOOK_COST = 0.1
"""Cost of a different kind, and of a different colour, in a match, m each."""


def match_bodies(believed: Sequence[BelievedBody], truths: Sequence[TrueBodySamples]) -> list[int | None]:
    """Return for each true body the number of the believed one, or None.

    The sum of mean distances is minimal.
    """
    costs = np.array([[_cost(one, truth) for one in believed] for truth in truths])
    found: list[int | None] = [None] * len(truths)
    if not costs.size:
        return found
    for truth, column in zip(*linear_sum_assignment(costs), strict=True):
        if costs[truth, column] < MAX_MATCH_DISTANCE + OTHER_LOOK_COST:
            found[int(truth)] = int(column)
    return found


def _cost(one: BelievedBody, truth: TrueBodySamples) -> float:
    poses = one.track[truth.ticks]
    there = ~np.isnan(poses[:, 0])
    body = one.looks[-1].body
    if body.role != truth.body.role:
        return OTHER_ROLE_COST
    unlike = OTHER_LOOK_COST * ((body.kind != truth.body.kind) + (body.colour != truth.body.colour))
    if not there.any():
        return MAX_MATCH_DISTANCE + OTHER_LOOK_COST + unlike
    apart = np.linalg.norm(poses[there, :3] - truth.poses[there, :3], axis=1)
    return float(np.median(np.minimum(apart, MAX_MATCH_DISTANCE))) + unlike


def true_poses(truth: TrueBodySamples, one: BelievedBody | None, ticks: int) -> Array:
    """Return the poses of a true body at each tick, (n, 7); NaN before its first and after its last
    sample.

    Between two samples it moves with the believed body while both agree that it is in the hand. Otherwise it
    moves straight from one sample to the other, since nothing was recorded between them.
    """
    found = np.full((ticks, 7), np.nan)
    samples = truth.ticks
    found[samples[-1]] = truth.poses[-1]
    # Straight from sample to sample; a tick with a sample begins the stretch behind it.
    straight = np.arange(int(samples[0]), int(samples[-1]))
    k = np.searchsorted(samples, straight, side="right") - 1
    share = (straight - samples[k]) / (samples[k + 1] - samples[k])
    found[straight] = between(truth.poses[k], truth.poses[k + 1], share)
    if one is None or not one.held.any():
        return found
    poses = filled(one.track)
    for k, (first, last) in enumerate(itertools.pairwise(map(int, samples))):
        held = one.held[first : last + 1]
        if held.any():
            start, end = (np.tile(truth.poses[n], (len(held), 1)) for n in (k, k + 1))
            share = np.arange(len(held)) / (last - first)
            found[first:last] = _in_hand(poses[first : last + 1], held, start, end, share)[:-1]
    return found


def _in_hand(poses: Array, held: np.ndarray, start: Array, end: Array, share: Array) -> Array:
    """Interpolate between two samples during which the robot holds the body for some time."""
    before = composed(inverse(poses[:1]), start[:1])
    after = composed(inverse(poses[-1:]), end[-1:])
    rides_before = held[0] and np.linalg.norm(before[0, :3]) < MAX_HELD_OFFSET
    rides_after = held[-1] and np.linalg.norm(after[0, :3]) < MAX_HELD_OFFSET
    ones = np.ones((len(poses), 1))
    if rides_before and rides_after:
        return composed(poses, between(ones * before, ones * after, share))
    if rides_after:  # gripped between the samples
        taken = int(np.argmax(held))
        riding = composed(poses, ones * after)
        return np.where(np.arange(len(poses))[:, None] < taken, start, riding)
    if rides_before:  # released or lost between the samples
        let_go = int(np.argmin(held)) if not held.all() else 0
        riding = composed(poses, ones * before)
        rest = np.clip((np.arange(len(poses)) - let_go) / max(len(poses) - 1 - let_go, 1), 0.0, 1.0)
        return between(riding, end, rest)
    return between(start, end, share)
