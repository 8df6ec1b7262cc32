"""The belief: versions, attaching, allowed collisions, snapshots that do not change, attempts, thinking."""

from dataclasses import FrozenInstanceError, replace

import pytest

from picktree.files import PicktreeError
from picktree.robot.manipulation.held_object import release_object
from picktree.world import (
    BeliefObject,
    Box,
    Cause,
    ComputeTimeAccount,
    Failure,
    ObjectId,
    PlanningScene,
    Pose,
    RandomStreams,
    all_causes,
    facts,
    grasp,
    internal,
    matches,
    register_cause,
)
from picktree.world.scene import Bin, Fixture
from picktree.world.world_facts import FACTS, AttemptMemory

TABLE = Fixture(ObjectId("table"), Box((1.0, 1.0, 0.04)), Pose((0.5, 0.0, -0.02)))
BIN = Bin(ObjectId("red_bin"), (0.2, 0.2, 0.1), 0.005, Pose((0.5, 0.4, 0.0)))


def block(name: str = "red_block_1") -> BeliefObject:
    return BeliefObject(
        "block",
        "box",
        Box((0.04, 0.04, 0.04)),
        "red",
        Pose((0.5, 0.0, 0.02)),
        0.001,
        0.01,
        1.0,
        0.0,
        id=ObjectId(name),
    )


def scene() -> PlanningScene:
    return PlanningScene([TABLE], [BIN], lambda o: ObjectId(f"{o.colour}_bin"))


def test_a_snapshot_is_immutable_and_does_not_follow() -> None:
    belief = scene()
    belief.put(block(), "seen")
    before = belief.snapshot()
    belief.remove("red_block_1", "gone")
    assert before.of("red_block_1") == block()
    with pytest.raises(FrozenInstanceError):
        before.version = 7  # type: ignore[misc]


def test_allowed_collisions_nest_and_end_with_their_block() -> None:
    belief = scene()
    with belief.allow(("gripper", "a"), ("a", "b")):
        with belief.allow(("a", "gripper")):
            assert belief.allowed("gripper", "a")
        assert belief.allowed("b", "a")
        assert belief.allowed("gripper", "a")
    assert not belief.allowed("gripper", "a")


def test_unknown_objects_are_a_typed_failure() -> None:
    with pytest.raises(Failure) as caught:
        scene().get("blue_can_9")
    assert str(caught.value) == "world.unknown_object: no object 'blue_can_9' in the planning scene"


def test_what_is_let_go_is_believed_straight_below() -> None:
    belief = scene()
    belief.put(block(), "seen")
    belief.attach("red_block_1", Pose())
    belief.carry(Pose((0.45, 0.38, 0.4)))
    release_object(belief, "slipped")
    fallen = belief.get("red_block_1")
    assert fallen.place == "red_bin"
    assert fallen.pose.position == pytest.approx((0.45, 0.38, 0.005 + 0.02))
    assert fallen.confidence < 0.5


def test_patterns_match_families_and_never_hide_a_fault_of_the_program() -> None:
    assert matches("grasp.missed", grasp.MISSED)
    assert matches("grasp.*", grasp.MISSED)
    assert matches("*", grasp.MISSED)
    assert not matches("grasp.slipped", grasp.MISSED)
    assert not matches("*", internal.ERROR)
    assert all(c.sentence.endswith(".") and c.remedy for c in all_causes())


def test_the_name_of_a_cause_is_lower_case_with_dots() -> None:
    with pytest.raises(PicktreeError, match="must be lower-case words with dots"):
        register_cause(Cause("Oops", "It.", "rest"))


def test_each_change_has_a_version_and_is_recorded_once() -> None:
    belief = scene()
    for _ in range(2):
        belief.put(block(), "seen")
        assert (belief.version, belief.snapshot().version) == (1, 1)
    belief.put(replace(block(), colour="blue"), "repainted")
    (first, second) = belief.take_changes()
    assert (first.version, first.before, first.after, first.reason) == (1, None, block(), "seen")
    assert (second.version, second.before, second.after) == (2, block(), replace(block(), colour="blue"))
    for _ in range(2):
        belief.remove("red_block_1", "gone")
    (third,) = belief.take_changes()
    assert (third.version, third.after) == (3, None)
    assert (belief.find("red_block_1"), belief.objects) == (None, ())


def test_ids_are_counted_for_each_stem_and_never_given_twice() -> None:
    belief = scene()
    assert [belief.new_id(stem) for stem in ("can", "can", "block", "can")] == [
        "can_1", "can_2", "block_1", "can_3"
    ]  # fmt: skip


def test_what_is_attached_moves_with_the_tcp_until_it_is_released() -> None:
    belief = scene()
    belief.put(block("one"), "seen")
    belief.put(block("other"), "seen")
    belief.carry(Pose((0.3, 0.2, 0.5)))
    belief.attach("other", Pose((0.0, 0.0, 0.01)))
    version = belief.version
    belief.carry(Pose((0.3, 0.2, 0.5)))
    held = belief.get("other")
    assert (held.attached, held.place, belief.held) == (True, "hand", held)
    assert held.pose.position == (0.3, 0.2, 0.51)
    assert (belief.version, belief.get("one")) == (version, block("one"))
    belief.detach("other", Pose((0.5, 0.4, 0.03)), "red_bin")
    now = belief.get("other")
    assert (now.attached, now.place, now.pose) == (False, "red_bin", Pose((0.5, 0.4, 0.03)))
    assert belief.held is None
    assert [c.reason for c in belief.take_changes()][2:] == ["attached to the gripper", "released"]
    with pytest.raises(Failure, match="no object 'third'"):
        belief.attach("third", Pose())


def test_a_destination_is_the_rule_s_and_none_without_one() -> None:
    belief, without = scene(), PlanningScene([TABLE], [BIN])
    for each in (belief, without):
        each.put(block(), "seen")
    assert belief.destination("red_block_1") == "red_bin"
    assert without.destination("red_block_1") is None
    assert belief.supposing().destination("red_block_1") == "red_bin"


def test_a_supposition_is_a_copy_with_one_thing_in_the_hand() -> None:
    belief = scene()
    for name in ("held", "cup"):
        belief.put(block(name), "seen")
    belief.attach("held", Pose())
    in_hand = Pose((0.0, 0.0, 0.01))
    with belief.allow(("held", "cup")):
        supposed = belief.supposing(ObjectId("cup"), in_hand, allowed=[("gripper", "table")])
        alike = belief.supposing()
    assert supposed.allowed("held", "cup") and supposed.allowed("table", "gripper")
    assert (supposed.version, supposed.fixtures, supposed.bins) == (
        belief.version, belief.fixtures, belief.bins
    )  # fmt: skip
    assert [(o.id, o.object_in_tcp, o.place) for o in supposed.objects if o.attached] == [
        ("cup", in_hand, "hand")
    ]
    assert alike.objects == belief.objects
    supposed.remove("held", "supposed")
    assert belief.held is not None and belief.held.id == "held"
    assert not belief.allowed("held", "cup") and not belief.allowed("table", "gripper")
    with pytest.raises(Failure, match="no object 'third'"):
        belief.supposing(ObjectId("third"), Pose())


def test_a_saved_belief_is_a_copy_and_comes_back_as_it_was() -> None:
    belief = scene()
    belief.put(block(), "seen")
    assert belief.new_id("red_block") == "red_block_1"
    snapshot, numbers = belief.state()
    belief.new_id("can")
    belief.put(block("other"), "seen")
    other = scene()
    for each in (belief, other):
        each.restore(snapshot, numbers)
        assert each.snapshot() == snapshot
        assert each.take_changes() == ()
        assert [each.new_id(stem) for stem in ("can", "red_block")] == ["can_1", "red_block_2"]
    other.put(replace(block(), colour="blue"), "repainted")
    assert belief.get("red_block_1").colour == "red"
    assert numbers == {"red_block": 1}
    assert snapshot.of("nothing") is None


class Named:
    def __init__(self, name: str) -> None:
        self.name = name


def test_attempts_are_remembered_for_each_node_and_object() -> None:
    attempts = AttemptMemory()
    a, b = Named("a"), Named("b")
    attempts.failed("Main/Grasp", "can_1", "a")
    assert attempts.remaining("Main/Grasp", "can_1", [a, b]) == [b]
    assert attempts.remaining("Main/Grasp", "can_2", [a, b]) == [a, b]
    attempts.failed("Main/Grasp", "can_1", "b")
    restored = AttemptMemory()
    restored.restore(attempts.state())
    assert restored.remaining("Main/Grasp", "can_1", [a, b]) == [a, b]
    assert restored.count("Main/Grasp", "can_1") == 0


def test_streams_do_not_shift_each_other() -> None:
    one, two = RandomStreams(5), RandomStreams(5)
    one.take("camera")
    assert one.number("planner") == two.number("planner")
    assert one.number("planner") != one.number("planner")
    assert RandomStreams(6).number("planner") != RandomStreams(5).number("planner")
    three = RandomStreams(5)
    three.restore(one.state())
    assert three.number("planner") == one.number("planner")


def test_small_thoughts_add_up_to_whole_ticks() -> None:
    account = ComputeTimeAccount(0.05)
    ticks = 0
    for _ in range(10):
        account.spend(0.02)
        ticks += len(list(account.charge()))
    assert ticks * 0.05 + account.owed == pytest.approx(0.2)
    assert account.owed < 0.05
    assert account.total == pytest.approx(0.2)


@pytest.mark.parametrize("looked", [True, False])
def test_names_and_types_are_as_declared(looked: bool) -> None:
    found = facts(PlanningScene((), ()), looked=looked, stopped=False, exhausted=True, done=3, now=1.5)
    assert {name: type(value) for name, value in found.items()} == FACTS
    assert found["items_left"] is not looked
