"""Scorer: compares the items' true places at the end with the scene's destinations."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from picktree.files import Expression
from picktree.world import FormCount, ItemCount, ObjectId, bottom
from picktree.world.scene import Bin, Delivery, SceneDescription, destinations

from .truth import HoleSeating, TrueBody

Verdict: TypeAlias = Literal["sorted", "misplaced", "left", "no destination"]

MAX_REST_SPEED = 0.02
"""Greatest speed of an item at rest, m/s."""
MAX_REST_SPIN = 1.0
"""Greatest spin of an item at rest, rad/s."""
MIN_SEATED_DEPTH_SHARE = 0.8
"""Share of a hole's depth that the lowest point of a seated item has reached."""
MAX_SEATED_TILT = math.radians(5.0)
"""Greatest tilt of an item that is seated in a hole, rad."""
MAX_PENETRATION = 0.15e-3
"""Penetration of an item and a fixture above which they have passed through each other, m."""


@dataclass(frozen=True, slots=True)
class ItemScore:
    """Destination and place of one item: a bin, a hole, or none."""

    id: ObjectId
    form: str
    destination: ObjectId | None
    bin: ObjectId | None
    """Bin or hole in which it rests."""
    verdict: Verdict
    seat: HoleSeating | None = None
    """Measured seating at a hole; None when the item is at none."""
    reason: str = ""
    """Reason why an item at a hole is not in it, or may not be."""

    @property
    def is_in_place(self) -> bool:
        """Whether the item is where it belongs, or lies in no bin and belongs into none."""
        return self.verdict in ("sorted", "no destination")


@dataclass(frozen=True, slots=True)
class Score:
    """Score of a run."""

    count: ItemCount
    """Counts of all items that ever came, those taken away with their bins included."""
    items: tuple[ItemScore, ...]
    outstanding: int = 0
    """Items that the scene's feed has not brought yet; endless entries count 0."""

    def reached(self, goal: str | None = None) -> bool:
        """Return whether an expression over the counts holds. Without one: whether every item is sorted, and
        none is outstanding."""
        count = self.count
        if goal is None:
            return count.sorted == count.total and self.outstanding == 0
        counts = {
            "total": count.total,
            "sorted": count.sorted,
            "misplaced": count.misplaced,
            "left": count.left,
            "outstanding": self.outstanding,
        }
        return bool(Expression.parse(goal).evaluate(counts))


def score(truth: Iterable[TrueBody], scene: SceneDescription) -> Score:
    """Score all items against the scene's destinations.

    An item is sorted when it rests in the bin of its destination. In another bin it is misplaced. Without a
    destination it does not count, unless it is in a bin. Anywhere else it is left: on the table, on the
    floor, in a tote, in the hand, or removed by a fault. An item that was taken away with a bin stays in it
    for good.

    An item rests in a hole of its form when it is deep enough, upright and in no wall. Where the destination
    is a fixture, any of its holes is right. An item inside a wall is misplaced.
    """
    truth = tuple(truth)
    destination = destinations.destination_rule(scene.destinations)
    items = tuple(_item_score(body, destination(body), scene.bins) for body in truth)
    verdicts = Counter(item.verdict for item in items)
    forms: dict[str, list[ItemScore]] = {}
    for item in items:
        forms.setdefault(item.form, []).append(item)
    count = ItemCount(
        len(items) - verdicts["no destination"],
        verdicts["sorted"],
        verdicts["misplaced"],
        verdicts["left"],
        {form: _form_count(same) for form, same in forms.items()},
        verdicts["no destination"],
    )
    return Score(count, items, _outstanding(truth, scene.deliveries))


def _form_count(items: Iterable[ItemScore]) -> FormCount:
    verdicts = Counter(item.verdict for item in items)
    return FormCount(verdicts.total() - verdicts["no destination"], verdicts["sorted"])


def _outstanding(truth: Iterable[TrueBody], deliveries: Iterable[Delivery]) -> int:
    brought = Counter(body.brought_by for body in truth)
    return sum(max(0, d.total - brought[n]) for n, d in enumerate(deliveries) if d.total is not None)


def _item_score(body: TrueBody, destination: ObjectId | None, bins: Iterable[Bin]) -> ItemScore:
    """Return the score of an item; a crushed item is misplaced wherever it is."""
    place = _score_by_place(body, destination, bins)
    if body.crushed <= 0.0:
        return place
    reason = f"it was crushed: a finger pressed with {body.crushed:.1f} N"
    return replace(place, verdict="misplaced", reason=reason)


def _score_by_place(body: TrueBody, destination: ObjectId | None, bins: Iterable[Bin]) -> ItemScore:
    if body.seat is not None:
        return _score_in_hole(body, body.seat, destination)
    left = body.taken_with
    around = next((b for b in bins if (rests_in(b, body) if left is None else b.id == left)), None)
    within = around.id if around is not None else left
    in_tote = around is not None and around.is_tote
    verdict: Verdict = "left"
    if destination is None and (within is None or in_tote) and body.present:
        verdict = "no destination"
    elif destination is not None and within == destination:
        verdict = "sorted"
    elif within is not None and not in_tote:
        verdict = "misplaced"
    return ItemScore(body.id, body.form, destination, within, verdict)


def _score_in_hole(body: TrueBody, seat: HoleSeating, destination: ObjectId | None) -> ItemScore:
    reason = why_not_seated(body, seat)
    within, verdict = (None if reason else seat.hole), "left"
    if seat.penetration > MAX_PENETRATION:
        verdict = "misplaced"
    elif within is not None:
        verdict = (
            "misplaced" if destination is None or not destinations.is_at(within, destination) else "sorted"
        )
    elif destination is None:
        verdict = "no destination"
    if verdict == "misplaced" and not reason:
        reason = f"it belongs into {destination}" if destination else "it belongs into no hole"
    return ItemScore(body.id, body.form, destination, within, verdict, seat, reason)


def why_not_seated(body: TrueBody, seat: HoleSeating) -> str:
    """Return why an item at a hole does not rest in it; empty when it does."""
    if seat.penetration > MAX_PENETRATION:
        return f"it is {1000 * seat.penetration:.2f} mm deep in a wall of {seat.hole}"
    if not seat.fits:
        return f"{seat.hole} is no hole for it"
    if not seat.over:
        return f"it is {1000 * seat.off:.1f} mm beside {seat.hole}"
    if seat.depth < MIN_SEATED_DEPTH_SHARE * seat.bottom:
        depth, wanted = 1000 * seat.depth, 1000 * seat.bottom
        return f"it is {depth:.1f} mm deep in {seat.hole}, which is {wanted:.1f} mm deep"
    if seat.tilt > MAX_SEATED_TILT:
        return f"it leans by {math.degrees(seat.tilt):.1f} deg in {seat.hole}"
    if not rests(body):
        return f"it still moves in {seat.hole}"
    return ""


def rests(body: TrueBody) -> bool:
    """Return whether the item neither moves nor turns."""
    return math.hypot(*body.velocity) <= MAX_REST_SPEED and math.hypot(*body.spin) <= MAX_REST_SPIN


def rests_in(each: Bin, body: TrueBody) -> bool:
    """Return whether the item is inside the bin (see `is_inside`) and at rest."""
    return is_inside(each, body) and rests(body)


def is_inside(each: Bin, body: TrueBody) -> bool:
    """Return whether the item's centre is in the bin's inside, and its lowest point below the rim."""
    if not body.present:
        return False
    item_in_bin = each.pose.inverse() @ body.pose
    (x_low, y_low, _), (x_high, y_high, rim) = each.inside()
    x, y, z = item_in_bin.position
    return x_low < x < x_high and y_low < y < y_high and z > 0.0 and bottom(body.shape, item_in_bin) < rim
