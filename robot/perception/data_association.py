"""Data association: detections of a view are matched to believed objects; objects are added, moved, kept as
hidden or removed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from picktree.files import library_parts
from picktree.world import FALLEN_SIGMA, BeliefObject, ObjectId, PlanningScene, Pose, inside, world_facts

from .obstacle_volumes import (
    Keys,
    bodies_near,
    cell_centres,
    cells_in_body,
    cells_of,
    points_of,
    retained_cells,
    update_volumes,
)
from .view import CERTAIN_CONFIDENCE, Detection, PerceivedView, UnexplainedPatch

if TYPE_CHECKING:
    from scipy.optimize import linear_sum_assignment
else:
    linear_sum_assignment = library_parts.library_part(
        "scipy.optimize._lsap", "scipy.optimize.linear_sum_assignment"
    )

MATCH_DISTANCE = 0.04
"""Distance within which a detection is matched to a believed object of its colour, m. Uncertain positions
widen it."""
MATCH_DISTANCE_IN_BIN = 0.10
"""The same distance inside one bin, m: heaps settle."""
MAX_DISPLACEMENT = 0.50
"""Distance within which an object whose place is seen empty is matched to another detection of its kind, m.
"""
KIND_MISMATCH_COST = 0.02
"""Cost of a difference in kind, as a distance, m. A half hidden object may have been misjudged before."""
MIN_CONFIDENCE_SHARE = 0.8
"""Share of the belief's confidence below which a detection sees the object worse than before."""
SAME_PLACE_DISTANCE = 0.02
"""Distance within which a reported detection of another kind or colour is the believed object, m. Two items
are not so near each other. Uncertain positions widen it."""
MAX_REPORTED_CONFIDENCE = 0.99
"""Greatest confidence in a reported kind and colour."""
MIN_LEAD = 1e-6
"""Least lead of a reported kind and colour over the believed ones, in log-odds. Even odds change nothing."""
HELD_DISTANCE = 0.06
"""Distance from the held object within which a detection of its colour is the held object, m."""
MIN_SHARE_IN_VOLUME = 0.6
"""Least share of a detection's cells in those of an obstacle for which it may be a part of that obstacle. An
item that leans on an obstacle or is close to it has a smaller share."""
VOLUME_MARGIN = 0.02
"""Distance beside a detection within which an obstacle's cells may be due to the same item, m: cells reach
beyond the true surface."""
MAX_UNEXPLAINED_SHARE = 0.25
"""Share of an obstacle's cells, beside those of all detections in it, above which it is still there."""
MAX_SUPPOSED_TIME = 60.0
"""Simulated time for which a given-up item is believed at its unseen place, s."""
MIN_SHARE_IN_ITEMS = 0.9
"""Share of a patch's points at unrecognised items from which the patch belongs to them. The others are noise
at its outline."""

Cost: TypeAlias = Callable[[BeliefObject, Detection], float]


@dataclass(frozen=True, slots=True)
class ObservationSummary:
    """Changes of the belief by one view, as ids of objects."""

    seen: tuple[ObjectId, ...]
    """Items in the view, whether known before or new."""
    new: tuple[ObjectId, ...]
    removed: tuple[ObjectId, ...]
    hidden: tuple[ObjectId, ...]
    """Believed items that were neither recognised nor seen missing."""
    unexplained: int
    """Number of obstacles in the view."""
    objects: Mapping[int, ObjectId] = field(default_factory=dict[int, ObjectId], compare=False)
    """Object of each detection that is one, by the detection's index in the view."""


def update_belief(
    scene: PlanningScene, view: PerceivedView, now: float, held_at: Pose | None = None
) -> ObservationSummary:
    """Update the items and obstacles of `scene` with the `view` at time `now`, s.

    `held_at` is the held object's pose in the world at that time; None: it has not moved since.

    Objects keep their ids: they are matched first by place, then by kind for objects that left their place.
    An attached object is not touched. An item is removed only when its place is clearly seen to be empty, or
    when it was given up at a merely supposed place. A detection at the place of a given-up item is that item
    in any colour: a camera may mistake the colour. Confirmed objects are seen where they are believed. Kind
    and colour that another process reports are weighed against the believed ones.
    """
    held = scene.held
    if held is not None and held_at is not None:
        held = replace(held, pose=held_at)
    detections = [d for d in view.detections if held is None or not _shows_held(held, d)]
    items = [o for o in scene.objects if o.role == "item" and not o.attached]
    unchanged = set(view.confirmed)
    confirmed = [o.id for o in items if o.id in unchanged]
    items = [o for o in items if o.id not in unchanged]
    scene.confirm(confirmed, now)
    volumes = [o for o in scene.objects if o.role == "obstacle" and not o.attached]
    detections = _outside_volumes(detections, items, volumes, view)
    matched = _assignment(items, detections, _nearness)
    unmatched = [o for o in items if o.id not in matched]
    missing = [o for o in unmatched if view.look(o.shape, o.pose, o.colour).is_empty]
    matched |= _assignment(missing, _unmatched(detections, matched), _displacement)

    removed: list[ObjectId] = []
    hidden: list[BeliefObject] = []
    for item in items:
        if item.id in matched:
            scene.put(_updated_belief(item, matched[item.id], view, now), "seen")
        elif item in missing:
            scene.remove(item.id, "its place was seen empty")
            removed.append(item.id)
        elif _is_lost(item, now):
            scene.remove(item.id, "nobody has seen it since it fell")
            removed.append(item.id)
        else:
            hidden.append(item)
    new: list[ObjectId] = []
    for detection in _unmatched(detections, matched):
        if not _part_of_known(detection, hidden):
            belief = _belief_from(scene.new_id(f"{detection.colour}_{detection.kind}"), detection, now)
            scene.put(belief, "seen for the first time")
            new.append(belief.id)
            matched[belief.id] = detection
    unrecognised = [*hidden, *([held] if held else [])]
    obstacles = [patch for patch in view.unexplained if not _part_of_items(patch, view, unrecognised)]
    seen = (*confirmed, *(o.id for o in items if o.id in matched), *new)
    removed += update_volumes(scene, view, obstacles, [scene.get(name) for name in seen], now)
    index = {id(d): n for n, d in enumerate(view.detections)}
    objects = {index[id(d)]: name for name, d in matched.items()}
    return ObservationSummary(
        seen, tuple(new), tuple(removed), tuple(o.id for o in hidden), len(obstacles), objects
    )


def _assignment(
    items: Sequence[BeliefObject], detections: Sequence[Detection], cost: Cost
) -> dict[ObjectId, Detection]:
    """Assign detections to items at the least total cost, among the pairs whose cost is finite."""
    if not items or not detections:
        return {}
    costs = np.array([[cost(o, d) for d in detections] for o in items])
    possible = np.isfinite(costs)
    rows, columns = linear_sum_assignment(np.where(possible, costs, 1e3))
    pairs = zip((int(r) for r in rows), (int(c) for c in columns), strict=True)
    return {items[r].id: detections[c] for r, c in pairs if possible[r, c]}


def _unmatched(detections: Sequence[Detection], matched: dict[ObjectId, Detection]) -> list[Detection]:
    taken = {id(d) for d in matched.values()}
    return [d for d in detections if id(d) not in taken]


def _nearness(item: BeliefObject, detection: Detection) -> float:
    """Return the distance on the table or in the same bin, m; inf beyond the gate or for another colour."""
    if item.colour != detection.colour and not _contradicts(item, detection):
        return math.inf
    same_bin = detection.place != "table" and item.place == detection.place
    gate = _gate(item, MATCH_DISTANCE_IN_BIN if same_bin else MATCH_DISTANCE)
    distance = item.pose.distance(detection.pose)
    return (
        distance + (0.0 if _is_alike(item, detection) else KIND_MISMATCH_COST)
        if distance < gate
        else math.inf
    )


def _is_alike(item: BeliefObject, detection: Detection) -> bool:
    return (item.colour, item.kind) == (detection.colour, detection.kind)


def _contradicts(item: BeliefObject, detection: Detection) -> bool:
    """Return whether a reported detection is so near that it is the item, by another name."""
    spread = 3.0 * math.hypot(item.sigma_position, detection.sigma_position)
    reach = min(max(SAME_PLACE_DISTANCE, spread), MATCH_DISTANCE)
    return detection.reported and item.pose.distance(detection.pose) < reach


def _shows_held(held: BeliefObject, detection: Detection) -> bool:
    alike = detection.colour == held.colour and held.pose.distance(detection.pose) < HELD_DISTANCE
    return alike or _contradicts(held, detection)


def _gate(item: BeliefObject, distance: float = MATCH_DISTANCE) -> float:
    """Return the distance, widened by the uncertainty of the item's position, m."""
    return distance + 3.0 * min(item.sigma_position, 0.03)


def _displacement(item: BeliefObject, detection: Detection) -> float:
    """Return the distance to a detection of the same kind and colour, m; for a given-up item to any
    detection.

    It is inf for other detections, and beyond `MAX_DISPLACEMENT`.
    """
    distance = item.pose.distance(detection.pose)
    alike = _is_alike(item, detection) and distance < MAX_DISPLACEMENT
    return distance if alike or _is_given_up(item, detection) else math.inf


def _outside_volumes(
    detections: Sequence[Detection],
    items: Sequence[BeliefObject],
    volumes: Sequence[BeliefObject],
    view: PerceivedView,
) -> list[Detection]:
    """Leave out the detections that are parts of a believed obstacle, unless a believed item may be there.

    An obstacle whose cells the detections explain, or rays clear, turns out to be items.
    """
    parts: set[int] = set()
    for volume in volumes:
        cells = cells_of(volume)
        within = [
            d
            for d in bodies_near(cells, detections, VOLUME_MARGIN)
            if _share_within(cells_in_body(d.shape, d.pose), cells) > MIN_SHARE_IN_VOLUME
            and not any(math.isfinite(_nearness(o, d)) for o in items)
        ]
        rest = retained_cells(view, cells) if within else cells
        for d in within:
            rest = rest[~inside(d.shape, d.pose, cell_centres(rest), VOLUME_MARGIN)]
        if len(rest) > MAX_UNEXPLAINED_SHARE * len(cells):
            parts |= {id(d) for d in within}
    return [d for d in detections if id(d) not in parts]


def _share_within(part: Keys, whole: Keys) -> float:
    """Return the share of cells that are among others; 0 of a body too flat to hold the middle of a cell."""
    return float(np.isin(part, whole).mean()) if len(part) else 0.0


def _part_of_known(detection: Detection, hidden: Sequence[BeliefObject]) -> bool:
    """Whether the detection may be a badly seen piece of a hidden object."""
    in_bin = detection.place != "table"
    if detection.confidence >= CERTAIN_CONFIDENCE and not in_bin:
        return False
    reach = MATCH_DISTANCE_IN_BIN if in_bin else 2 * MATCH_DISTANCE
    near = any(o.colour == detection.colour and o.pose.distance(detection.pose) < reach for o in hidden)
    return near or (in_bin and detection.confidence < CERTAIN_CONFIDENCE)


def _part_of_items(patch: UnexplainedPatch, view: PerceivedView, items: Sequence[BeliefObject]) -> bool:
    """Whether the patch may show nothing but believed items of its colour that were not recognised.

    Its points then lie where a detection would be matched to these items.
    """
    points = points_of(view, patch.rows, patch.columns)
    there = np.zeros(len(points), dtype=np.bool_)
    for o in items:
        if o.colour == patch.colour:
            there |= inside(o.shape, o.pose, points, HELD_DISTANCE if o.attached else _gate(o))
    return float(there.mean()) >= MIN_SHARE_IN_ITEMS


def _belief_from(object_id: ObjectId, d: Detection, now: float) -> BeliefObject:
    return BeliefObject(
        d.kind,
        d.form,
        d.shape,
        d.colour,
        d.pose,
        d.sigma_position,
        d.sigma_angle,
        d.confidence,
        now,
        id=object_id,
        place=d.place,
    )


def _updated_belief(
    item: BeliefObject, detection: Detection, view: PerceivedView, now: float
) -> BeliefObject:
    """Return the belief after its object was seen.

    A better earlier estimate is kept while the view bears it out: of a half hidden object only the visible
    half counts. An item that was given up stays so where it lay. Found elsewhere, it may be handled again.
    """
    if detection.reported:
        # The pictures count as independent of each other.
        believed, reported = _log_odds(item.confidence), _log_odds(detection.confidence)
        if _is_alike(item, detection):
            reported += believed
        elif reported < believed + MIN_LEAD:
            return replace(item, confidence=_share_of_odds(max(believed - reported, 0.0)), last_seen=now)
        else:
            reported -= believed
        detection = replace(detection, confidence=min(_share_of_odds(reported), MAX_REPORTED_CONFIDENCE))
    worse = detection.confidence < MIN_CONFIDENCE_SHARE * item.confidence
    if worse and view.look(item.shape, item.pose, item.colour).is_confirmed:
        return replace(item, last_seen=now)
    belief = replace(_belief_from(item.id, detection, now), pose=_nearest_orientation(detection, item.pose))
    return replace(belief, place=item.place) if _is_given_up(item, detection) else belief


def _log_odds(confidence: float) -> float:
    least = 1.0 - MAX_REPORTED_CONFIDENCE
    bounded = min(max(confidence, least), MAX_REPORTED_CONFIDENCE)
    return math.log(bounded / (1.0 - bounded))


def _share_of_odds(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-log_odds))


def _is_given_up(item: BeliefObject, detection: Detection) -> bool:
    """Whether the detection shows an item that was given up, where it lay."""
    stayed = item.pose.distance(detection.pose) < _gate(item)
    return item.place == world_facts.ASIDE and detection.place == "table" and stayed


def _is_lost(item: BeliefObject, now: float) -> bool:
    """Whether the item was given up where it is merely supposed to lie, and did not show up for a while."""
    unseen = item.sigma_position == FALLEN_SIGMA and now - item.last_seen > MAX_SUPPOSED_TIME
    return item.place == world_facts.ASIDE and unseen


def _nearest_orientation(detection: Detection, before: Pose) -> Pose:
    """Return the detection's pose, or one that looks the same, with the orientation nearest to `before`."""
    if not detection.turn:
        return detection.pose
    position, pose = detection.pose.position, detection.pose
    count = max(1, round(2 * math.pi / detection.turn))
    turns = (Pose.from_rpy((0, 0, 0), (0, 0, k * detection.turn)) for k in range(1, count))
    alike = [pose, *(Pose(position, (turn @ pose).orientation) for turn in turns)]
    return min(alike, key=lambda pose: round(pose.angle(before), 6))
