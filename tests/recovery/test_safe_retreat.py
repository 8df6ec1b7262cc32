"""SafeRetreat from states that it may be called in, in a cell without physics."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from picktree.robot.manipulation.retreat import (
    RetreatMotion,
    _free_spots,  # pyright: ignore[reportPrivateUsage]
)
from picktree.robot.planning import ContactPair, MotionPlan, OffsetGoal, PlanService, Request
from picktree.simulation.kinematic import KinematicHardware
from picktree.world import (
    Array,
    Box,
    Cause,
    Failure,
    FailureReport,
    ObjectId,
    Pose,
    Vector3,
    control,
    place,
    planning,
)
from picktree.world.scene import Fixture

from ..skills.cell import Cell, holding, items, looked, mission

if TYPE_CHECKING:
    from picktree.trees import Doing

LOOK = "Observe: {camera: overhead}"


def at(cell: Cell, pose: str) -> bool:
    off = cell.world.control.state.position - cell.world.robot.named(pose)
    return float(np.abs(off).max()) < 2e-3


def block(cell: Cell) -> str:
    return str(next(o.id for o in cell.world.scene.objects if o.role == "item"))


def beside_the_hand(cell: Cell) -> Vector3:
    x, y, z = cell.world.control.tcp.position
    return (x + 0.02, y + 0.06, z + 0.06)


def test_out_of_what_is_believed_about_the_hand_and_to_the_pose() -> None:
    made, _ = looked(block=1)
    made.believe("ghost", (0.08, 0.08, 0.08), beside_the_hand(made))
    assert made.do("GoTo: {pose: rest}").startswith("planning.start_in_collision: ")
    assert made.do("SafeRetreat: {pose: rest}") == ""
    assert at(made, "rest")


def test_with_no_way_out_it_says_what_it_is_in_and_what_was_tried_and_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("picktree.robot.manipulation.retreat.MAX_ESCAPE_LENGTH", 0.03)
    made, _ = looked(block=1)
    x, y, z = made.world.control.tcp.position
    made.believe("ghost", (0.8, 0.8, 0.8), (x, y, z + 0.1))
    before = made.world.control.state.position
    assert made.do("SafeRetreat: {pose: rest}").startswith("safety.no_retreat: ")
    failure = made.failure
    assert failure.message.startswith("there is no safe way to rest; the arm stays where it is: panda_")
    deep, tried = failure.evidence["depth"], failure.evidence["tried"]
    assert isinstance(deep, float)
    assert deep > 0.3
    assert isinstance(tried, list)
    directions = {str(way).partition(" ")[0] for way in tried}
    assert {"out", "back", "up", "inwards", "left", "right", "outwards", "down"} <= directions
    assert np.abs(made.world.control.state.position - before).max() < 1e-6
    assert made.world.control.at_rest


def test_a_held_object_is_kept_dropped_or_put_down_as_asked() -> None:
    for hand, holds, where in (
        ("keep", True, "hand"),
        ("open", False, "table"),
        ("put_down", False, "table"),
    ):
        made, item = holding()
        assert made.do(f"SafeRetreat: {{hand: {hand}}}") == ""
        assert at(made, "home")
        assert made.world.scene.get(item).place == where
        assert (made.world.scene.held is not None) is holds
        (body,) = made.hardware.truth()
        high = body.pose.position[2] > 0.1
        assert high is holds


def test_what_is_put_down_stands_on_a_free_spot_when_the_nearest_is_taken() -> None:
    made, _ = holding()
    x, y, _ = made.world.control.tcp.position
    made.believe("taken", (0.04, 0.04, 0.03), (x, y, 0.015))
    assert made.do("SafeRetreat: {hand: put_down}") == ""
    (body,) = made.hardware.truth()
    assert 0.04 < np.hypot(body.pose.position[0] - x, body.pose.position[1] - y) < 0.3
    assert body.pose.position[2] == pytest.approx(0.02, abs=0.004)


def test_nothing_is_put_down_where_the_arm_has_no_room_on_the_way_down(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made, _ = holding()
    x, y, _ = made.world.control.tcp.position
    solve, lines = PlanService.solve, list[Array]()

    def no_first_line(plans: PlanService, request: Request, *, node: str = "") -> Doing[MotionPlan]:
        if isinstance(request.target, OffsetGoal) and request.start is not None:
            lines.append(request.start)
            if len(lines) == 1:
                raise Failure(planning.NO_PATH, "the forearm is in the way")
        return (yield from solve(plans, request, node=node))

    monkeypatch.setattr(PlanService, "solve", no_first_line)
    assert made.do("SafeRetreat: {hand: put_down}") == ""
    assert len(lines) == 2
    (body,) = made.hardware.truth()
    assert np.hypot(body.pose.position[0] - x, body.pose.position[1] - y) > 0.04
    assert made.world.robot.tcp(lines[1]).position[:2] == pytest.approx(body.pose.position[:2], abs=0.02)


def test_nothing_is_put_down_where_the_hand_has_no_room_next_to_a_fixture() -> None:
    x, y, nearest = 0.5, 0.28, list[float]()
    for high in (0.3, 0.0):
        posts = [
            Fixture(ObjectId(f"post_{k}"), Box((0.02, 0.02, high)), Pose((x + dx, y + dy, high / 2)))
            for k, (dx, dy) in enumerate(((0.05, 0.0), (-0.05, 0.0), (0.0, 0.05), (0.0, -0.05)))
        ]
        scene = items(block=1)
        made = Cell(mission(LOOK), replace(scene, fixtures=(*scene.fixtures, *(posts if high else ()))))
        made.finish()
        item = block(made)
        assert made.do(f"Grasp: {{object: {item}, onward: false}}") == ""
        held = made.world.scene.get(ObjectId(item))
        there = replace(held, pose=Pose((x, y, held.pose.position[2]), held.pose.orientation))
        nearest.append(min(np.hypot(spot[0] - x, spot[1] - y) for spot in _free_spots(made.world, there)))
    assert nearest[0] > 0.09
    assert nearest[1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("touches", [1, 3], ids=["on the way home", "going back and up, too"])
def test_what_is_touched_on_the_way_home_is_left_and_gone_around(
    touches: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first motions meet something that nobody knows of: the arm goes back, and home afterwards. Another
    direction begins where the touch has left the arm."""
    from dataclasses import replace

    from picktree.robot.control import ArmMotion, JointImpedanceResult

    made, _ = looked(block=1)
    assert made.do("GoTo: {pose: rest}") == ""
    followed, met = ArmMotion.softly, list[bool]()

    def meets(self: ArmMotion, *given: object, **more: object) -> Doing[JointImpedanceResult]:
        result: JointImpedanceResult = yield from followed(self, *given, **more)  # type: ignore[arg-type]
        met.append(bool(met) or not result.completed)
        touched = len(met) <= touches
        return replace(result, completed=False, touched=True, force=7.0) if touched else result

    monkeypatch.setattr(ArmMotion, "softly", meets)
    assert made.do("SafeRetreat: {pose: home}") == ""
    assert at(made, "home")
    assert len(met) > touches


class Ways:
    """Ways out that end as they are told, with what is believed to be in the way meanwhile."""

    def __init__(
        self, cell: Cell, patch: pytest.MonkeyPatch, *out: bool, touched: bool = False, home: bool = True
    ) -> None:
        self.cell, self.looks = cell, 0
        self.contacts: list[tuple[ContactPair, ...]] = [()]
        """Contacts at each question; the last ones are used again."""
        self.said = list[str]()
        outs, world = list(out), cell.world
        look = world.vision.observe

        def out_(leaving: RetreatMotion) -> Doing[bool]:
            self.said.append("out")
            leaving.touched = touched
            yield
            return outs.pop(0)

        def home_(_: object, leaving: RetreatMotion, *more: object) -> Doing[bool]:
            self.said.append("home")
            leaving.tried.append("to home: no way")
            yield
            return home

        def looking(camera: str) -> Any:
            self.looks += 1
            return look(camera)

        def anew(_: RetreatMotion) -> None:
            self.said.append("anew")

        patch.setattr(RetreatMotion, "out", out_)
        patch.setattr(RetreatMotion, "reset_directions", anew)
        patch.setattr("picktree.robot.manipulation.retreat.go_home", home_)
        patch.setattr(world.plan, "contacts", self._contacts)
        patch.setattr(world.vision, "observe", looking)

    def _contacts(self) -> tuple[ContactPair, ...]:
        return self.contacts.pop(0) if len(self.contacts) > 1 else self.contacts[0]

    def succeed(self, body: str = "SafeRetreat") -> bool:
        return self.cell.do(body) == ""

    def refused(self, body: str = "SafeRetreat") -> FailureReport:
        assert not self.succeed(body)
        return self.cell.failure


def pairs(*depths: float) -> tuple[ContactPair, ...]:
    return tuple(ContactPair(f"link_{n}", f"ghost_{n}", -depth) for n, depth in enumerate(depths))


def test_where_no_way_leads_out_it_looks_and_stays_if_all_is_as_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ways = Ways(looked(block=1)[0], monkeypatch, False)
    ways.contacts = [pairs(0.02)]
    failure = ways.refused()
    assert str(failure.cause) == "safety.no_retreat"
    assert (ways.said, ways.looks) == (["out"], 1)


@pytest.mark.parametrize("why", ["it has touched something", "it sees otherwise"])
def test_where_something_is_otherwise_it_tries_to_get_out_anew(
    why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for second in (True, False):
        ways = Ways(looked(block=1)[0], monkeypatch, False, second, touched="touched" in why)
        ways.contacts = [pairs(0.02)] if "touched" in why else [pairs(0.02), ()]
        assert ways.succeed() is second
        assert ways.said == ["out", "anew", "out", *(["home"] if second else [])]


def test_without_a_way_home_it_says_what_was_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    ways = Ways(looked(block=1)[0], monkeypatch, True, home=False)
    failure = ways.refused("SafeRetreat: {pose: rest}")
    assert failure.message == "there is no safe way to rest; the arm stays where it is: to home: no way"
    assert failure.evidence == {
        "in_the_way": [], "depth": 0.0, "tried": ["to home: no way"], "pressed": failure.evidence["pressed"]
    }  # fmt: skip
    assert failure.evidence["pressed"] == pytest.approx(0.0, abs=1.5)


def test_the_first_three_things_in_the_way_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    ways = Ways(looked(block=1)[0], monkeypatch, False)
    ways.contacts = [pairs(0.004, -0.001, 0.0, 0.0307, 0.002, 0.001)]
    failure = ways.refused()
    named = [f"link_{n} at ghost_{n} ({deep} mm deep)" for n, deep in ((0, 4), (3, 31), (4, 2), (5, 1))]
    assert failure.message == (
        f"there is no safe way to home; the arm stays where it is: {', '.join(named[:3])} in the way"
    )
    assert failure.evidence["in_the_way"] == named
    assert failure.evidence["depth"] == 0.0307


def test_what_is_near_is_not_in_the_way_and_the_time_may_be_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("picktree.recovery.safe_retreat.RETREAT_TIME_LIMIT", 0.0)
    ways = Ways(looked(block=1)[0], monkeypatch, False)
    ways.contacts = [pairs(-0.001)]
    failure = ways.refused()
    assert failure.message == (
        "there is no safe way to home in time; the arm stays where it is: nothing could be tried"
    )
    assert (failure.evidence["in_the_way"], failure.evidence["depth"]) == ([], -0.001)


def test_a_minute_and_a_half_is_enough_to_look_for_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    deadlines, init = list[float](), RetreatMotion.__init__

    def noting(self: RetreatMotion, world: Any, node: str, deadline: float) -> None:
        deadlines.append(deadline - world.clock.now)
        init(self, world, node, deadline)

    monkeypatch.setattr(RetreatMotion, "__init__", noting)
    assert looked(block=1)[0].do("SafeRetreat") == ""
    assert deadlines == [pytest.approx(90.0)]


@pytest.mark.parametrize("drops", [False, True])
@pytest.mark.parametrize("cause", [control.TIMEOUT, place.OCCUPIED])
def test_what_cannot_be_put_down_is_told_at_home(
    cause: Cause, drops: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stop that kept it from being put down is acknowledged before the arm goes home."""
    made, item = holding()
    told = Failure(cause, "it did not go", object=item)

    def refuses(world: Any, *more: object) -> Doing[None]:
        yield
        world.control.monitor.check_tool((2.0, 0.0, 0.5))
        if drops:
            world.scene.detach(ObjectId(item), Pose(), "table", "test")
        raise told

    monkeypatch.setattr("picktree.robot.manipulation.retreat.put_down", refuses)
    made.events.clear()
    told_at_home = made.do("SafeRetreat: {hand: put_down}")
    assert at(made, "home")
    assert len(made.happened("safety_acknowledged")) == 1
    if drops or cause is place.OCCUPIED:
        assert told_at_home == f"{cause.name}: it did not go"
        assert made.failure.evidence == {"object": item}
    else:
        still = f"place.occupied: {item} cannot be put down: it did not go; it is still in the hand"
        assert told_at_home == still
        assert made.failure.evidence == {"object": item, "because": "control.timeout"}


@pytest.mark.parametrize("room", [True, False])
def test_fingers_open_where_they_have_room(room: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    made, item = holding()
    ways = Ways(made, monkeypatch, True)
    asked = list[tuple[float, tuple[str, ...]]]()

    def contacts(_: Pose, width: float, ignore: tuple[str, ...]) -> tuple[str, ...]:
        asked.append((width, ignore))
        return () if room else ("ghost",)

    monkeypatch.setattr(made.world.queries, "hand_contacts", contacts)
    opens = made.world.gripper.open

    def opening(*given: Any) -> Any:
        ways.said.append("open")
        return opens(*given)

    monkeypatch.setattr(made.world.gripper, "open", opening)
    assert ways.succeed("SafeRetreat: {hand: open}")
    assert ways.said == (["open", "out", "home"] if room else ["out", "open", "home"])
    assert asked == [(0.08, (item,))]
    assert made.world.scene.held is None
    assert made.world.control.wrist.payload is None


@pytest.mark.parametrize("cause", [control.GRIPPER, control.TIMEOUT])
def test_fingers_that_do_not_open_may_do_so_further_away(
    cause: Cause, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, _ = holding()
    ways = Ways(made, monkeypatch, True, home=False)
    refused, opens = list[Failure](), made.world.gripper.open

    def opening(*given: Any) -> Any:
        if not refused:
            refused.append(Failure(cause, "they opened by half"))
            raise refused[0]
        return opens(*given)

    monkeypatch.setattr(made.world.gripper, "open", opening)
    failure = ways.refused("SafeRetreat: {hand: open}")
    if cause is control.TIMEOUT:
        assert str(failure.cause) == "control.timeout"
        assert ways.said == []
    else:
        assert failure.evidence["tried"] == ["they opened by half", "to home: no way"]
        assert made.world.scene.held is None


def test_fingers_that_have_met_hold_nothing_whatever_is_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    made, _ = holding()
    Ways(made, monkeypatch, True)
    assert isinstance(made.hardware, KinematicHardware)
    made.hardware.remove(made.hardware.truth()[0].id)
    made.hardware.gripper.width = made.hardware.gripper.target = 0.0
    made.wait()
    assert made.do("SafeRetreat") == ""  # and not grasp.slipped: it was not to be kept
    assert made.world.scene.held is None
    assert made.world.control.wrist.payload is None


def test_what_was_to_be_kept_and_slipped_on_the_way_weighs_nothing_any_more() -> None:
    made, item = holding()
    made.hardware.remove(str(made.hardware.truth()[0].id))
    told = f"grasp.slipped: {item} was to be kept and is gone: opening 0.0 mm, load "
    assert made.do("SafeRetreat").startswith(told)
    assert set(made.failure.evidence) == {"object", "width", "load"}
    assert at(made, "home")
    assert made.world.scene.held is None
    assert made.world.control.wrist.payload is None
