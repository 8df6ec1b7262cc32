"""Bins into which an item could not be put: full, crowded, covered, or out of reach."""

from __future__ import annotations

import numpy as np

from ....logs.schema.records import Body
from ....manipulation.place.bin_spots import heap, spots
from ....world.belief.planning_scene import BeliefObject
from ....world.values import ObjectId, Pose
from ..investigation.case import Case, Finding
from ..investigation.explanation import FailureStory
from ..investigation.number_wording import counted, listed, seconds
from ..investigation.reachability import reachable
from .standing_fixtures import fixture_above

NOWHERE = "cannot be put where it belongs"
APPROACH = 0.08
"""Height over a grasp, or a bin, from which the hand comes down, m."""


def no_way_to_bin(case: Case, failure: FailureStory, refused: int, total: int) -> Finding | None:
    """No grasp leads to the item's bin: because that is full, covered, or too far away."""
    lies = (
        case.belief.tracks[failure.item].before(failure.time) if failure.item in case.belief.tracks else None
    )
    target = case.bins.get(case.destination(lies)) if lies else None
    reasons = (f"from {refused} of {total} grasps {failure.item} {NOWHERE}",)
    if lies is None or target is None:
        return None
    full = full_bin(case, failure, str(target.id), reasons)
    if full is not None:
        return full
    over = fixture_above(case, target)
    if over:
        title = f"{over} stands in the way over {target.id}: {failure.item} cannot be put there"
        return Finding("scene.blocked", over, title, reasons, failure.item, failure.time)
    arm = case.arm
    x, y, z = target.pose.position
    down = [
        Pose.from_rpy((x, y, z + target.size[2] + APPROACH), (np.pi, 0.0, yaw))
        for yaw in np.linspace(0.0, 2 * np.pi, 8, endpoint=False)
    ]
    if arm is not None and not reachable(arm, down):
        title = (
            f"{target.id} stands where the arm does not reach it from above: {failure.item} cannot go there"
        )
        return Finding("bin.out_of_reach", str(target.id), title, reasons, failure.item, failure.time)
    inside = [b.id for b in case.believed_at(failure.time) if b.place == target.id]
    if inside:
        title = f"{target.id} is too crowded for {failure.item}: nowhere over it can the hand let go"
        reasons = (*reasons, f"in it lie {listed(inside)}")
        return Finding("bin.crowded", str(target.id), title, reasons, failure.item, failure.time)
    title = f"{failure.item} cannot be let go over {target.id} without touching something"
    return Finding("bin.hemmed_in", str(target.id), title, reasons, failure.item, failure.time)


def full_bin(case: Case, failure: FailureStory, bin_id: str, reasons: tuple[str, ...] = ()) -> Finding | None:
    """Whether what is believed to lie in the bin leaves no spot in it."""
    target = case.bins.get(bin_id)
    if target is None:
        return None
    inside = [b for b in case.believed_at(failure.time) if b.place == bin_id]
    item = case.belief.at(failure.item, failure.time)
    if failure.cause != "place.full":
        heights = heap(target, [_object(b) for b in inside], None)
        if item is None or spots(target, heights, item.shape, item.pose.rotation()):
            return None
    size = " × ".join(f"{s * 100:.0f}" for s in target.size)
    title = (
        f"{bin_id} was full when {failure.item} was to go there: {counted(len(inside), 'item')} "
        f"{'lies' if len(inside) == 1 else 'lie'} in it, and it measures {size} cm"
    )
    told = (*reasons, f"in it at {seconds(failure.time)}: {listed([b.id for b in inside], 8) or 'nothing'}")
    return Finding("bin.full", bin_id, title, told, failure.item, failure.time)


def _object(body: Body) -> BeliefObject:
    return BeliefObject(
        ObjectId(body.id), "item", body.kind, body.form, body.shape, body.colour, body.pose,
        body.sigma_position, body.sigma_angle, body.confidence, body.last_seen, place=body.place,
    )  # fmt: skip
