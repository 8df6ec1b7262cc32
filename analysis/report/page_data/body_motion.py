"""Motion in a run, read once for all panels: frames, belief, ground truth, and pairs of believed and true
bodies."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from ....logs.schema.records import BodyRecord
from ...run import Run
from .body_frames import BelievedBody, Frames, TrueBodySamples, believed_of, frames_of, truths_of
from .truth_matching import match_bodies, true_poses


@dataclass(frozen=True, slots=True, eq=False)
class SceneMotion:
    frames: Frames
    believed: list[BelievedBody]
    truths: list[TrueBodySamples]
    partners: list[int | None]
    """Number of the believed body for each true one; None: there is none."""


@dataclass(frozen=True, slots=True)
class BeliefDeviation:
    """Distance between truth and belief, from a tick on."""

    tick: int
    object: str
    """Id of the believed object; empty where the robot believed in none at that time."""
    body: BodyRecord
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
    for truth, partner in zip(motion.truths, motion.partners, strict=True):
        samples = frozenset(truth.ticks.tolist())
        one = None if partner is None else motion.believed[partner]
        if one is None:
            yield from (BeliefDeviation(tick, "", truth.body, math.nan) for tick in sorted(samples))
            continue
        poses = true_poses(truth, one, motion.frames.ticks)
        apart = np.linalg.norm(one.track[:, :3] - poses[:, :3], axis=1).tolist()
        present = one.present.tolist()
        told = math.nan
        for tick in range(min(samples), max(samples) + 1):
            if (
                tick in samples
                or math.isnan(apart[tick]) != math.isnan(told)
                or abs(apart[tick] - told) > _MIN_DISTANCE_CHANGE
            ):
                told = apart[tick]
                yield BeliefDeviation(tick, one.id if present[tick] else "", truth.body, told)
