"""A ranked stream of whole candidates: each grasp with each place that it leads to, the best one first.

Best first: of each candidate something is known of its cost and the rest is guessed; the one with the least
sum takes its next test, and what passes goes back with what the test has found out. So cheap tests are made
of many, dear ones of few, and planning is asked for the one that has passed all others.
The stages are those of MoveIt's Task Constructor (Görner et al., ICRA 2019): generate, filter, connect.
"""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ...cell.handover import PlaceCandidate
from ...planning.requests import HeldObject, PoseGoal, Request
from ...world.belief.hole_matching import fitting_hole
from ...world.belief.planning_scene import BeliefObject
from ...world.causes import Failure, planning
from ...world.values import Array, Pose
from ..grasp.grasp_candidates import GraspCandidate
from ..insert.insertion import fingertips_too_low, hover_poses
from ..place.bin_spots import SUNK
from ..place.release_poses import BinTarget, ReleaseLevel, bin_target, levels, place_candidates
from . import pick_candidates
from .pick_candidates import (
    CandidateTrail,
    PickPlaceCandidate,
    StageRefusal,
    estimated_travel_time,
    joint_travel_time,
    known_travel_time,
    planned,
    touching,
    unreached,
)
from .transfer_requests import approach

if TYPE_CHECKING:
    from ...cell.world import World
    from ...planning.service.reachability import ReachResult
    from ...world.scene.description import Hole

SCORE = 3.0
"""What one point of a grasp's score is worth as time, s: a tight opening costs as much as 1.5 s of way."""
FURTHER = 0.05
"""How much more a candidate may cost for each stage that it is further than others and still be looked at
first, s: so not all of many that are nearly alike are tested before one is taken."""
TURNS, TAKEN = 3, 36
"""Turns of the hand over one cell, and places in all, at which one grasp finds no room before it gives up."""
PLACES, FEW, BARREN = 16, 3, 3
"""Places of one grasp for which a configuration is looked for: one that fails more often leads nowhere. When
three grasps have led nowhere, a few places of each of the others are asked for."""
LOW = 5.0
"""What it is worth as time that the finger tips stay above the hole into which an item goes, s."""
UNREACHED = 4
"""Turns of the hand over one cell that are not reached, after which the next cell is looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class _Branch:
    """A candidate on its way through the stages."""

    grasp: GraspCandidate
    known: float
    """Cost by what is known, s."""
    test: Callable[[_Branch], Iterator[_Branch]] | None
    """What it has to pass next; None: all that is cheap is passed."""
    guess: float = 0.0
    """Of the cost that is not known yet, s."""
    over: Array | None = None
    at: Array | None = None
    level: ReleaseLevel | None = None
    landing: PlaceCandidate | None = None
    above: Array | None = None
    passed: int = 0
    """Stages that it has passed."""

    @property
    def bound(self) -> float:
        """What says whose turn it is, s."""
        return self.known + self.guess - FURTHER * self.passed

    @property
    def place(self) -> str:
        return "" if self.landing is None else self.landing.name


@dataclass(slots=True)
class _Places:
    """Where one grasp may lead to: what was not looked at yet, and what was asked."""

    levels: Iterator[ReleaseLevel]
    asked: int = 0
    taken: Counter[str] = field(default_factory=Counter[str])
    """How often there was no room, by cell and height."""
    unreached: Counter[str] = field(default_factory=Counter[str])
    """How often the arm did not get there."""


class CandidateSearch:
    """The candidates for one object, as the belief is when it is made. `find` gives one after the other.

    The order depends on the belief, on where the arm is and on the candidates alone.
    """

    def __init__(
        self, world: World, belief: BeliefObject, grasps: Sequence[GraspCandidate], node: str
    ) -> None:
        """`grasps`: those that are offered; `node` keys the planner's randomness and names the purpose."""
        self._world, self._belief, self._node = world, belief, node
        into = world.scene.destination(belief.id)
        self._target: BinTarget | None = None
        """None also for an item that belongs into a hole: that is found by feeling, with the item held as
        `inserting` says."""
        self._hole: Hole | None = None
        if into is not None and into in world.scene.bins:
            self._target = bin_target(world, belief, into)
        elif into is not None:
            self._hole = fitting_hole(world.scene, belief.id)
        self.trail = CandidateTrail(f"grasp by {node}", belief.id, into or "", grasps)
        self.refused: Failure | None = None
        """What the planner said of the last candidate that passed all other tests."""
        self._heap: list[tuple[float, int, _Branch]] = []
        self._number = itertools.count()
        self._places: dict[str, _Places] = {}
        self._barren = 0
        self._start = world.control.held_position
        tcp = world.robot.tcp(self._start)
        for grasp in grasps:
            guess = estimated_travel_time(world.robot, tcp, grasp.tcp_in_world)
            cost = SCORE * grasp.score
            if self._hole is not None and fingertips_too_low(
                self._hole, belief, grasp, world.robot.description.gripper
            ):
                cost += LOW
            self._push(_Branch(grasp, cost, self._hand_fits, guess))

    # ---- the search

    def find(self, *, speed: float = 1.0) -> Generator[None, None, PickPlaceCandidate | None]:
        """The next candidate that passes all tests, with its approach planned; None: there is none left.

        Thinking is charged, and each answer goes to the journal with the trail so far. `speed`: share of the
        joints' speed limits. Fails with planning.start_in_collision: from there no candidate is reached.
        """
        while self._heap:
            branch = heapq.heappop(self._heap)[2]
            if branch.test is not None:
                for other in branch.test(branch):
                    self._push(other)
                continue
            found = yield from self._approach(branch, speed)
            if found is not None:
                self.trail.accept(found.grasp, found.cost, branch.place, pick_candidates.APPROACH)
                self._note()
                return found
        yield from self._world.plan.charge()
        self._note()
        return None

    def refuse(self, pick: PickPlaceCandidate, failure: Failure) -> None:
        """The transfer of a candidate that was given out cannot be planned; `find` goes on with the next."""
        self.refused = failure
        place = "" if pick.landing is None else pick.landing.name
        self.trail.refuse(pick.grasp, pick.cost, planned(pick_candidates.TRANSFER, failure), place)

    def _push(self, branch: _Branch) -> None:
        heapq.heappush(self._heap, (branch.bound, next(self._number), branch))

    def _refuse(self, branch: _Branch, refusal: StageRefusal) -> None:
        self.trail.refuse(branch.grasp, branch.known, refusal, branch.place)

    def _note(self) -> None:
        self._world.journal.note(self.trail.entry())

    # ---- the grasp

    def _hand_fits(self, branch: _Branch) -> Iterator[_Branch]:
        grasp, world = branch.grasp, self._world
        contacts = world.queries.hand_contacts(
            grasp.tcp_in_world, grasp.opening, ignore=(self._belief.id,), margin=grasp.margin
        )
        if contacts:
            self._refuse(branch, touching(pick_candidates.HAND, "the hand", contacts[0]))
            return
        self.trail.passed(grasp, pick_candidates.HAND)
        if self._target is not None and not self._target.cells:
            full = self._target.bin.id
            self._refuse(branch, StageRefusal(pick_candidates.ROOM, f"{full} is full", full))
            return
        yield replace(branch, passed=1, test=self._grasp_reached)

    def _grasp_reached(self, branch: _Branch) -> Iterator[_Branch]:
        grasp = branch.grasp
        tcp = grasp.tcp_in_world
        over = self._reach(tcp.shifted((0.0, 0.0, self._world.handling.approach)), self._start, grasp)
        if over.q is None:
            self._refuse(branch, unreached(pick_candidates.PRE_GRASP, "the pre-grasp", over))
            return
        self.trail.passed(grasp, pick_candidates.PRE_GRASP)
        at = self._reach(tcp, over.q, grasp)
        if at.q is None:
            self._refuse(branch, unreached(pick_candidates.GRASP, "the grasp", at))
            return
        self.trail.passed(grasp, pick_candidates.GRASP)
        known = branch.known + joint_travel_time(self._world.robot, self._start, over.q)
        held = replace(branch, known=known, guess=0.0, over=over.q, at=at.q, passed=3, test=None)
        if self._target is None:
            if self._hole is None or self._over_hole(held, self._hole):
                yield held
            return
        self._places[grasp.name] = _Places(levels(self._target))
        yield from self._next_level(held)

    def _reach(self, tcp: Pose, near: Array, grasp: GraspCandidate) -> ReachResult:
        pair = (("gripper", str(self._belief.id)),)
        request = Request(PoseGoal((tcp,)), start=near, width=grasp.opening, allowed=pair)
        return self._world.plan.reached(request)

    # ---- the place

    def _next_level(self, branch: _Branch) -> Iterator[_Branch]:
        """The same grasp with its next cell of the bin, which waits with its own cost."""
        level = next(self._places[branch.grasp.name].levels, None)
        if level is not None:
            way = known_travel_time(self._world.robot, branch.grasp.tcp_in_world, *level.spot.centre)
            yield replace(branch, level=level, guess=level.cost + way, passed=3, test=self._lands)

    def _lands(self, branch: _Branch) -> Iterator[_Branch]:
        """The landings over one cell, and behind them the next cell."""
        level, target, grasp = branch.level, self._target, branch.grasp
        assert level is not None and target is not None
        if self._leads_nowhere(grasp):
            return
        for landing in place_candidates(self._world, target, level, self._belief.shape, self._in_tcp(grasp)):
            guess = estimated_travel_time(self._world.robot, grasp.tcp_in_world, landing.above)
            known = branch.known + level.cost
            yield replace(branch, known=known, guess=guess, landing=landing, passed=3, test=self._has_room)
        yield from self._next_level(branch)

    def _has_room(self, branch: _Branch) -> Iterator[_Branch]:
        landing, level, places = branch.landing, branch.level, self._places[branch.grasp.name]
        assert landing is not None and level is not None
        if places.taken[level.name] >= TURNS or self._leads_nowhere(branch.grasp):
            return
        there = landing.above @ self._in_tcp(branch.grasp)
        contacts = self._world.queries.free(
            self._belief.shape, there, ignore=(self._belief.id,), margin=-SUNK
        )
        if contacts:
            places.taken[level.name] += 1
            subject = f"over {landing.into} {self._belief.id}"
            self._refuse(branch, touching(pick_candidates.ROOM, subject, contacts[0]))
            return
        self.trail.passed(branch.grasp, pick_candidates.ROOM)
        yield replace(branch, passed=4, test=self._place_reached)

    def _place_reached(self, branch: _Branch) -> Iterator[_Branch]:
        landing, level, grasp, at = branch.landing, branch.level, branch.grasp, branch.at
        assert landing is not None and level is not None and at is not None
        places = self._places[grasp.name]
        if places.unreached[level.name] >= UNREACHED or self._leads_nowhere(grasp):
            return
        places.asked += 1
        request = Request(
            PoseGoal((landing.above,)),
            start=at,
            width=grasp.expected_width,
            holding=HeldObject(self._belief.id, self._in_tcp(grasp)),
        )
        found = self._world.plan.reached(request)
        if found.q is None:
            places.unreached[level.name] += 1
            self._barren += places.asked == PLACES
            self._refuse(branch, unreached(pick_candidates.PLACE, f"the place over {landing.into}", found))
            return
        self.trail.passed(grasp, pick_candidates.PLACE)
        known = branch.known + joint_travel_time(self._world.robot, at, found.q)
        yield replace(branch, known=known, guess=0.0, above=found.q, passed=5, test=None)

    def _over_hole(self, branch: _Branch, hole: Hole) -> bool:
        """Whether the arm gets over the hole with the item, at any of its turns."""
        in_tcp, at = self._in_tcp(branch.grasp), branch.at
        assert at is not None
        found: ReachResult | None = None
        for tcp in hover_poses(self._world, hole.id, self._belief.shape, in_tcp):
            found = self._world.plan.reached(
                Request(
                    PoseGoal((tcp,)),
                    start=at,
                    width=branch.grasp.expected_width,
                    holding=HeldObject(self._belief.id, in_tcp),
                )
            )
            if found.q is not None:
                self.trail.passed(branch.grasp, pick_candidates.PLACE)
                return True
        if found is None:
            subject = f"so held {self._belief.id} does not stand over {hole.id}"
            self._refuse(branch, StageRefusal(pick_candidates.PLACE, subject, hole.id))
        else:
            self._refuse(branch, unreached(pick_candidates.PLACE, f"the place over {hole.id}", found))
        return False

    def _leads_nowhere(self, grasp: GraspCandidate) -> bool:
        """Whether enough of a grasp's places were asked for."""
        places = self._places[grasp.name]
        most = PLACES if self._barren < BARREN else FEW
        return places.asked >= most or places.taken.total() >= TAKEN

    def _in_tcp(self, grasp: GraspCandidate) -> Pose:
        """How the object will be held, if all is as believed."""
        return grasp.tcp_in_world.inverse() @ self._belief.pose

    # ---- planning

    def _approach(self, branch: _Branch, speed: float) -> Generator[None, None, PickPlaceCandidate | None]:
        assert branch.over is not None and branch.at is not None
        world, grasp = self._world, branch.grasp
        legs = approach(world, self._belief.id, grasp, branch.over, speed)
        try:
            plan = yield from world.plan.through(legs, node=self._node)
        except Failure as failure:
            if failure.cause is planning.START_IN_COLLISION:
                raise
            self.refused = failure
            self._refuse(branch, planned(pick_candidates.APPROACH, failure))
            self._drop(grasp)
            return None
        self.trail.passed(grasp, pick_candidates.APPROACH)
        return PickPlaceCandidate(
            self._belief.id,
            grasp,
            branch.landing,
            self._in_tcp(grasp),
            branch.over,
            plan.trajectory.end,
            branch.above,
            branch.known,
            plan,
        )

    def _drop(self, grasp: GraspCandidate) -> None:
        """The way to a grasp is not free: none of its places is of use."""
        self._heap = [entry for entry in self._heap if entry[2].grasp.name != grasp.name]
        heapq.heapify(self._heap)
