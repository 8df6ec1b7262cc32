"""What moved in a run, read once for all panels: frames, belief, truth, and which of both belong together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from ..records import Body
from ..run import Run
from .bodies import Believed, Frames, Sampled, believed_of, frames_of, truths_of
from .matching import matched


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    frames: Frames
    believed: list[Believed]
    truths: list[Sampled]
    partners: list[int | None]
    """For each true body the number of the believed one, if any."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """How far the truth was from the belief, at a tick at which the log tells the truth."""

    tick: int
    object: str
    """Id of the believed object; empty where the robot believed in none then."""
    body: Body
    """The true one."""
    distance: float
    """Between both positions, m; NaN where one of both is not there."""


_MOTIONS: WeakKeyDictionary[Run, Motion] = WeakKeyDictionary()


def motion_of(run: Run) -> Motion:
    motion = _MOTIONS.get(run)
    if motion is None:
        frames = frames_of(run)
        believed, truths = believed_of(run, frames), truths_of(run)
        motion = _MOTIONS[run] = Motion(frames, believed, truths, matched(believed, truths))
    return motion


def deviations(motion: Motion) -> Iterator[Deviation]:
    """At every sample of the truth, body by body."""
    for truth, partner in zip(motion.truths, motion.partners, strict=True):
        one = None if partner is None else motion.believed[partner]
        for tick, pose in zip(truth.ticks.tolist(), truth.poses, strict=True):
            there = one is not None and bool(one.present[tick])
            if one is None or not there:
                yield Deviation(tick, "", truth.body, float("nan"))
            else:
                apart = float(np.linalg.norm(one.track[tick, :3] - pose[:3]))
                yield Deviation(tick, one.id, truth.body, apart)
