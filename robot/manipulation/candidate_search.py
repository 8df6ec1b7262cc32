"""Ranked stream of pick-place candidates: each grasp with each of its places, the best one first.

Best-first search: a part of each candidate's cost is known, the rest is estimated. The candidate with the
least sum takes its next test; when it passes, it goes back with the new cost. So cheap tests are made of many
candidates, costly ones of few. Planning comes last, for the candidate that has passed all others. The stages
are those of MoveIt's Task Constructor (Görner et al., ICRA 2019): generate, filter, connect.
"""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from picktree.robot import PlaceCandidate
from picktree.robot.planning import HeldObject, PoseGoal, Request
from picktree.world import Array, BeliefObject, Failure, Pose, hole_geometry, planning

from . import pick_candidates
from .grasps import GraspCandidate, widened
from .insertion import fingertips_too_low, hover_poses
from .pick_candidates import CandidateTrail, PickPlaceCandidate, StageRefusal, planned, touching, unreached
from .pick_place_motions import SLOW_DESCENT_COST, approach, touchable
from .release_poses import (
    MAX_PLACE_PENETRATION,
    BinTarget,
    ReleaseLevel,
    bin_target,
    levels,
    opens_freely,
    place_candidates,
)
from .travel_time import estimated_travel_time, joint_travel_time, known_travel_time

if TYPE_CHECKING:
    from picktree.robot import World
    from picktree.robot.control import Doing
    from picktree.robot.planning import ReachResult
    from picktree.world.scene import Hole

GRASP_SCORE_WEIGHT = 3.0
"""Weight of one point of a grasp's score, s: a tight opening costs as much as 1.5 s of travel."""
STAGE_BONUS = 0.05
"""Bonus for each stage that a candidate has passed, s. It keeps the search from testing many similar
candidates before it accepts one."""
MAX_TAKEN_TURNS, MAX_TAKEN_PLACES = 3, 36
"""Failures of the room test at which a grasp skips a cell, and at which it gives up."""
MAX_TESTED_PLACES, FEW_TESTED_PLACES, MAX_BARREN_GRASPS = 16, 3, 3
"""Tested places at which a grasp gives up; the lower number once `MAX_BARREN_GRASPS` grasps have given up;
`MAX_BARREN_GRASPS` itself."""
LOW_TIPS_COST = 5.0
"""Cost of a grasp whose finger tips do not stay above the hole, s."""
PRESSING_RELEASE_COST = 4.0
"""Cost of a place where the opening fingers would press against a neighbour, s."""
MAX_TURNED_GRASPS = 4
"""Number of grasps whose approach is tried from other configurations at the pre-grasp."""
MIN_POSTURE_DIFFERENCE = 0.1
"""Difference of a joint at which two configurations are different ones, rad."""
MAX_UNREACHED_TURNS = 4
"""Unreached rotations over one cell after which the next cell is tried."""


@dataclass(frozen=True, slots=True, eq=False)
class _Branch:
    """Candidate with its state in the search."""

    grasp: GraspCandidate
    known: float
    """Known cost, s."""
    test: Callable[[_Branch], Iterator[_Branch]] | None
    """Next test. None: all cheap tests are passed."""
    guess: float = 0.0
    """Estimate of the unknown cost, s."""
    q_pre_grasp: Array | None = None
    """Configuration at the pre-grasp (n,), rad; None: not tested yet. `q_grasp` and `q_place` likewise."""
    q_grasp: Array | None = None
    level: ReleaseLevel | None = None
    landing: PlaceCandidate | None = None
    q_place: Array | None = None
    stages_passed: int = 0
    """Number of passed stages."""

    @property
    def bound(self) -> float:
        """Priority in the search, s; the least comes first."""
        return self.known + self.guess - STAGE_BONUS * self.stages_passed

    @property
    def place(self) -> str:
        return "" if self.landing is None else self.landing.name


@dataclass(slots=True)
class _Places:
    """Places of one grasp: those not tried yet, and counts of the tests."""

    levels: Iterator[ReleaseLevel]
    asked: int = 0
    taken: Counter[str] = field(default_factory=Counter[str])
    """Number of failed room tests, by cell and height."""
    unreached: Counter[str] = field(default_factory=Counter[str])
    """Number of places out of reach, by cell and height."""


class CandidateSearch:
    """Search for candidates of one object, in the belief at its creation. `find` returns one after the other.

    The order depends only on the belief, the arm's configuration and the grasps.
    """

    def __init__(
        self, world: World, belief: BeliefObject, grasps: Sequence[GraspCandidate], node: str
    ) -> None:
        """`grasps`: grasps to choose from. `node`: key of the planner's randomness, and name of the
        purpose."""
        self._world, self._belief, self._node = world, belief, node
        # Nobody knows where a thing of a heap belongs before it is in the hand.
        into = None if belief.role == "heap" else world.scene.destination(belief.id)
        self._target: BinTarget | None = None
        """Destination bin. None: no destination, or a hole, which the insertion finds by contact with the
        item held."""
        self._hole: Hole | None = None
        if into is not None and into in world.scene.bins:
            self._target = bin_target(world, belief, into)
        elif into is not None:
            self._hole = hole_geometry.fitting_hole(world.scene, belief.id)
        self.trail = CandidateTrail(f"grasp by {node}", belief.id, into or "")
        self.refused: Failure | None = None
        """Failure of the planner for the last candidate that passed all other tests; None without one."""
        self._heap: list[tuple[float, int, _Branch]] = []
        self._number = itertools.count()
        self._places: dict[str, _Places] = {}
        self._barren = 0
        self._turned: set[str] = set()
        """Names of the grasps whose approach is tried from other configurations, too."""
        self._start = world.control.held_position
        self.add(grasps)

    def add(self, grasps: Iterable[GraspCandidate]) -> None:
        """Add grasps to choose from."""
        world, belief = self._world, self._belief
        tcp = world.robot.tcp(self._start)
        for grasp in grasps:
            self.trail.passed(grasp, pick_candidates.RANKED_STAGE)
            guess = estimated_travel_time(world.robot, tcp, grasp.tcp_in_world)
            cost = GRASP_SCORE_WEIGHT * grasp.score
            if self._hole is not None and fingertips_too_low(
                self._hole, belief, grasp, world.robot.description.gripper
            ):
                cost += LOW_TIPS_COST
            self._push(_Branch(grasp, cost, self._hand_fits, guess))

    # ---- search

    @property
    def cramped(self) -> bool:
        """Whether the hand fits around the object at no grasp, and may lean: over a hole it may not."""
        return self._hole is None and not self.trail.count(pick_candidates.HAND_STAGE)

    def find(self, *, speed: float = 1.0, gently: bool = False) -> Doing[PickPlaceCandidate | None]:
        """Return the next candidate that passes all tests, with its approach planned; None when none is left.

        Thinking is charged: owed ticks pass between the tests. Each result is written to the journal with the
        trail so far. `speed`: share
        of the joints' speed limits; `gently`: the approach is slow. Fails with planning.start_in_collision
        when the arm starts in collision.
        """
        while self._heap:
            branch = heapq.heappop(self._heap)[2]
            if branch.test is not None:
                for other in branch.test(branch):
                    self._push(other)
                yield from self._world.plan.charge()
                continue
            found = yield from self._approach(branch, speed, gently=gently)
            if found is not None:
                self.trail.accept(found.grasp, found.cost, branch.place, pick_candidates.APPROACH_STAGE)
                self._note()
                return found
        yield from self._world.plan.charge()
        self._note()
        return None

    def refuse(self, pick: PickPlaceCandidate, failure: Failure) -> None:
        """Record that the transfer of a returned candidate cannot be planned; `find` continues with the
        next."""
        self.refused = failure
        place = "" if pick.landing is None else pick.landing.name
        self.trail.refuse(pick.grasp, pick.cost, planned(pick_candidates.TRANSFER_STAGE, failure), place)

    def _push(self, branch: _Branch) -> None:
        heapq.heappush(self._heap, (branch.bound, next(self._number), branch))

    def _refuse(self, branch: _Branch, refusal: StageRefusal) -> None:
        self.trail.refuse(branch.grasp, branch.known, refusal, branch.place)

    def _note(self) -> None:
        self._world.journal.note(self.trail.entry())

    # ---- grasp

    def _hand_fits(self, branch: _Branch) -> Iterator[_Branch]:
        grasp, world = branch.grasp, self._world
        around = touchable(world, self._belief.id)
        contacts = world.queries.hand_contacts(grasp.tcp_in_world, grasp.opening, around, grasp.margin)
        if contacts:
            self._refuse(branch, touching(pick_candidates.HAND_STAGE, "the hand", contacts[0]))
            return
        self.trail.passed(grasp, pick_candidates.HAND_STAGE)
        if self._target is not None and not self._target.cells:
            full = self._target.bin.id
            self._refuse(branch, StageRefusal(pick_candidates.ROOM_STAGE, f"{full} is full", full))
            return
        grasp = widened(world.queries, self._belief, grasp, world.robot.description.gripper)
        known = branch.known + (SLOW_DESCENT_COST if grasp.narrow else 0.0)
        yield replace(branch, grasp=grasp, known=known, stages_passed=1, test=self._grasp_reached)

    def _grasp_reached(self, branch: _Branch) -> Iterator[_Branch]:
        grasp = branch.grasp
        over = self._reach(grasp.pre_grasp(self._world.handling.approach), self._start, grasp)
        if over.q is None:
            self._refuse(branch, unreached(pick_candidates.PRE_GRASP_STAGE, "the pre-grasp", over))
            return
        self.trail.passed(grasp, pick_candidates.PRE_GRASP_STAGE)
        at = self._reach(grasp.tcp_in_world, over.q, grasp)
        if at.q is None:
            self._refuse(branch, unreached(pick_candidates.GRASP_STAGE, "the grasp", at))
            return
        self.trail.passed(grasp, pick_candidates.GRASP_STAGE)
        known = branch.known + joint_travel_time(self._world.robot, self._start, over.q)
        held = replace(
            branch, known=known, guess=0.0, q_pre_grasp=over.q, q_grasp=at.q, stages_passed=3, test=None
        )
        if self._target is None:
            if self._hole is None or self._over_hole(held, self._hole):
                yield held
            return
        self._places[grasp.name] = _Places(levels(self._target))
        yield from self._next_level(held)

    def _reach(self, tcp: Pose, near: Array, grasp: GraspCandidate) -> ReachResult:
        return self._world.plan.reached(self._request(tcp, near, grasp))

    def _request(self, tcp: Pose, near: Array, grasp: GraspCandidate) -> Request:
        pairs = tuple(("gripper", name) for name in touchable(self._world, self._belief.id))
        return Request(PoseGoal((tcp,)), start=near, width=grasp.opening, allowed=pairs)

    # ---- place

    def _next_level(self, branch: _Branch) -> Iterator[_Branch]:
        """Yield the same grasp with its next cell of the bin, at that cell's cost."""
        level = next(self._places[branch.grasp.name].levels, None)
        if level is not None:
            way = known_travel_time(self._world.robot, branch.grasp.tcp_in_world, *level.spot.centre)
            yield replace(branch, level=level, guess=level.cost + way, stages_passed=3, test=self._lands)

    def _lands(self, branch: _Branch) -> Iterator[_Branch]:
        """Yield the places over one cell, and after them the next cell."""
        level, target, grasp = branch.level, self._target, branch.grasp
        assert level is not None and target is not None
        if self._is_exhausted(grasp):
            return
        for landing in place_candidates(self._world, target, level, self._belief.shape, self._in_tcp(grasp)):
            guess = estimated_travel_time(self._world.robot, grasp.tcp_in_world, landing.above)
            known = branch.known + level.cost
            yield replace(
                branch, known=known, guess=guess, landing=landing, stages_passed=3, test=self._has_room
            )
        yield from self._next_level(branch)

    def _has_room(self, branch: _Branch) -> Iterator[_Branch]:
        landing, level, places = branch.landing, branch.level, self._places[branch.grasp.name]
        assert landing is not None and level is not None
        if places.taken[level.name] >= MAX_TAKEN_TURNS or self._is_exhausted(branch.grasp):
            return
        there = landing.above @ self._in_tcp(branch.grasp)
        contacts = self._world.queries.free(
            self._belief.shape, there, ignore=(self._belief.id,), margin=-MAX_PLACE_PENETRATION
        )
        if contacts:
            places.taken[level.name] += 1
            subject = f"over {landing.into} {self._belief.id}"
            self._refuse(branch, touching(pick_candidates.ROOM_STAGE, subject, contacts[0]))
            return
        self.trail.passed(branch.grasp, pick_candidates.ROOM_STAGE)
        in_tcp, width = self._in_tcp(branch.grasp), branch.grasp.expected_width
        free = opens_freely(self._world, landing, self._belief, in_tcp, width)
        known = branch.known + (0.0 if free else PRESSING_RELEASE_COST)
        yield replace(branch, known=known, stages_passed=4, test=self._place_reached)

    def _place_reached(self, branch: _Branch) -> Iterator[_Branch]:
        landing, level, grasp, at = branch.landing, branch.level, branch.grasp, branch.q_grasp
        assert landing is not None and level is not None and at is not None
        places = self._places[grasp.name]
        if places.unreached[level.name] >= MAX_UNREACHED_TURNS or self._is_exhausted(grasp):
            return
        places.asked += 1
        found = self._reach_holding(landing.above, at, grasp)
        if found.q is None:
            places.unreached[level.name] += 1
            self._barren += places.asked == MAX_TESTED_PLACES
            self._refuse(
                branch, unreached(pick_candidates.PLACE_STAGE, f"the place over {landing.into}", found)
            )
            return
        self.trail.passed(grasp, pick_candidates.PLACE_STAGE)
        known = branch.known + joint_travel_time(self._world.robot, at, found.q)
        yield replace(branch, known=known, guess=0.0, q_place=found.q, stages_passed=5, test=None)

    def _over_hole(self, branch: _Branch, hole: Hole) -> bool:
        """Return whether the arm reaches a pose over the hole with the item, at any of its rotations."""
        in_tcp, at = self._in_tcp(branch.grasp), branch.q_grasp
        assert at is not None
        found: ReachResult | None = None
        for tcp in hover_poses(self._world, hole.id, self._belief.shape, in_tcp):
            found = self._reach_holding(tcp, at, branch.grasp)
            if found.q is not None:
                self.trail.passed(branch.grasp, pick_candidates.PLACE_STAGE)
                return True
        if found is None:
            subject = f"so held {self._belief.id} does not stand over {hole.id}"
            self._refuse(branch, StageRefusal(pick_candidates.PLACE_STAGE, subject, hole.id))
        else:
            self._refuse(branch, unreached(pick_candidates.PLACE_STAGE, f"the place over {hole.id}", found))
        return False

    def _reach_holding(self, tcp: Pose, near: Array, grasp: GraspCandidate) -> ReachResult:
        holding = HeldObject(self._belief.id, self._in_tcp(grasp))
        return self._world.plan.reached(
            Request(PoseGoal((tcp,)), start=near, width=grasp.expected_width, holding=holding)
        )

    def _is_exhausted(self, grasp: GraspCandidate) -> bool:
        """Return whether enough places of a grasp were tested."""
        places = self._places[grasp.name]
        most = MAX_TESTED_PLACES if self._barren < MAX_BARREN_GRASPS else FEW_TESTED_PLACES
        return places.asked >= most or places.taken.total() >= MAX_TAKEN_PLACES

    def _in_tcp(self, grasp: GraspCandidate) -> Pose:
        """Return the expected pose of the held object in the TCP frame."""
        return grasp.tcp_in_world.inverse() @ self._belief.pose

    # ---- planning

    def _approach(self, branch: _Branch, speed: float, *, gently: bool) -> Doing[PickPlaceCandidate | None]:
        assert branch.q_pre_grasp is not None and branch.q_grasp is not None
        world, grasp = self._world, branch.grasp
        legs = approach(world, self._belief.id, grasp, branch.q_pre_grasp, speed, gently=gently)
        try:
            rounded = grasp.rounded(world.handling.approach, world.handling.rounded)
            plan = yield from world.plan.through(legs, node=self._node, rounded=rounded)
        except Failure as failure:
            if failure.cause is planning.START_IN_COLLISION:
                raise
            self.refused = failure
            self._refuse(branch, planned(pick_candidates.APPROACH_STAGE, failure))
            self._drop(grasp)
            for other in self._other_postures(branch):
                self._push(other)
            return None
        self.trail.passed(grasp, pick_candidates.APPROACH_STAGE)
        return PickPlaceCandidate(
            self._belief.id,
            grasp,
            branch.landing,
            self._in_tcp(grasp),
            branch.q_pre_grasp,
            plan.trajectory.end,
            branch.q_place,
            branch.known,
            plan,
        )

    def _other_postures(self, branch: _Branch) -> Iterator[_Branch]:
        """Yield the candidate with other configurations at the pre-grasp, after the nearest one has failed.

        From another one the arm may go straight down where its elbow would touch something before.
        """
        assert branch.q_pre_grasp is not None
        if branch.grasp.name in self._turned or len(self._turned) == MAX_TURNED_GRASPS:
            return
        self._turned.add(branch.grasp.name)
        tcp = branch.grasp.pre_grasp(self._world.handling.approach)
        for over in self._world.plan.postures(self._request(tcp, self._start, branch.grasp)):
            if np.abs(over - branch.q_pre_grasp).max() > MIN_POSTURE_DIFFERENCE:
                longer = joint_travel_time(self._world.robot, self._start, over)
                yield replace(branch, q_pre_grasp=over, known=branch.known + longer)

    def _drop(self, grasp: GraspCandidate) -> None:
        """Remove all candidates of a grasp whose approach cannot be planned."""
        self._heap = [entry for entry in self._heap if entry[2].grasp.name != grasp.name]
        heapq.heapify(self._heap)
