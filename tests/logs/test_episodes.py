"""Episodes of recovery in made-up trees, tick by tick: causes, tries and outcomes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import pytest
from pydantic import TypeAdapter

from picktree.logs.episode_counts import cause_lines, counted
from picktree.logs.item_episodes import Decision, EpisodeTracker, EpisodeTrackerState
from picktree.world import JournalEvent, Transition, Tree
from picktree.world.event_types import (
    EpisodeEvent,
    FailureDecidedEvent,
    FaultEvent,
    FaultOutcomeEvent,
    ItemDoneEvent,
    PickEvent,
    RecoveryEvent,
)

from .scripted_log import begins, ends, tree

Script = Mapping[float, Sequence[Transition | JournalEvent]]


def fails(path: str, cause: str, *above: str) -> list[Transition]:
    """A node fails, and those above fail with it."""
    return [ends(path, "FAILURE", cause), *(ends(each, "FAILURE", cause, path) for each in above)]


def tries(node: str, cause: str, handler: str, failed: str = "") -> JournalEvent:
    return RecoveryEvent("", node, cause=cause, handler=handler, failed=failed)


def follow(
    nodes: Tree, script: Script, end: float = 100.0
) -> tuple[list[EpisodeEvent], list[FaultOutcomeEvent]]:
    return of_kinds(decisions(nodes, script, end))


def decisions(nodes: Tree, script: Script, end: float) -> list[Decision]:
    following = EpisodeTracker()
    following.follow(nodes.nodes)
    return [*_take(following, script), *following.finish(end)]


def of_kinds(decided: Sequence[Decision]) -> tuple[list[EpisodeEvent], list[FaultOutcomeEvent]]:
    return (
        [each for each in decided if isinstance(each, EpisodeEvent)],
        [each for each in decided if isinstance(each, FaultOutcomeEvent)],
    )


def _take(following: EpisodeTracker, script: Script) -> list[Decision]:
    found: list[Decision] = []
    for time, said in sorted(script.items()):
        changes = [each for each in said if isinstance(each, Transition)]
        found += following.take(time, changes, [each for each in said if isinstance(each, JournalEvent)])
    return found


def told(episodes: Sequence[EpisodeEvent]) -> list[tuple[str, str, str, int, float]]:
    return [(e.cause, e.end, " > ".join(e.tried), e.tries, e.seconds) for e in episodes]


GRASP, LOOK = "Main/Recover/Grasp", "Main/Recover/LookAgain"
RECOVER = tree("Main", "Main/Recover", GRASP, LOOK, f"{LOOK}/Observe")
SLIPPED = {
    0.0: [begins("Main"), begins("Main/Recover"), begins(GRASP, "ball_1")],
    2.0: [*fails(GRASP, "grasp.slipped"), tries("Main/Recover", "grasp.slipped", "grasp.*")],
    2.1: [begins(LOOK), begins(f"{LOOK}/Observe")],
    3.0: [ends(f"{LOOK}/Observe"), ends(LOOK)],
    3.1: [begins(GRASP, "ball_1")],
}


def test_what_is_done_instead_is_neither_cured_nor_given_up() -> None:
    """What the node had handled before is cured. To set the item aside changes nothing."""
    recover, weigh, aside = "Main/Recover", "Main/Recover/Do/Weigh", "Main/Recover/Reject/SetAside"
    grasp, reject = "Main/Recover/Do/Grasp", "Main/Recover/Reject"
    nodes = tree("Main", recover, "Main/Recover/Do", grasp, weigh, LOOK, reject, aside)
    instead = RecoveryEvent("", recover, cause="weigh.heavy", handler="weigh.*", ends=True)
    script = {
        0.0: [begins("Main"), begins(recover), begins("Main/Recover/Do"), begins(grasp, "can_1")],
        1.0: [*fails(grasp, "grasp.missed", "Main/Recover/Do"), tries(recover, "grasp.missed", "grasp.*")],
        1.1: [begins(LOOK)],
        2.0: [ends(LOOK)],
        2.1: [begins("Main/Recover/Do"), begins(grasp, "can_1")],
        3.0: [ends(grasp), begins(weigh)],
        4.0: [*fails(weigh, "weigh.heavy", "Main/Recover/Do"), instead],
        4.1: [begins(reject), begins(aside)],
        5.0: [ends(aside), ends(reject), ends(recover), ends("Main")],
    }
    episodes, _ = follow(nodes, script)
    assert sorted(told(episodes)) == [
        ("grasp.missed", "cured", "LookAgain", 1, 2.1),
        ("weigh.heavy", "done_instead", "Reject", 1, 0.0),
    ]
    assert fates(nodes, script) == [(grasp, 1.0, "cured", recover)]
    assert list(cause_lines(counted(episodes)))[1] == "weigh.heavy   1 seen, 1 done instead (Reject)"


def test_time_up_to_the_last_done_item_is_not_lost() -> None:
    pick, rest = "Main/Repeat/Pick", "Main/SafeRetreat"
    nodes = tree("Main:Fallback", "Main/Repeat", pick, rest)
    script: dict[float, list[Transition | JournalEvent]] = {
        0.0: [begins("Main"), begins("Main/Repeat"), begins(pick, "tote")],
        20.0: [ends(pick), ItemDoneEvent("", pick, object="thing_1"), begins(pick, "tote")],
        23.0: [*fails(pick, "grasp.no_candidate", "Main/Repeat"), begins(rest)],
        25.0: [ends(rest), ends("Main")],
    }
    episodes, _ = follow(nodes, script)
    assert [(e.cause, e.seconds) for e in episodes] == [("grasp.no_candidate", 3.0)]


def test_a_cure_helps_at_the_second_try() -> None:
    again = {
        5.0: [*fails(GRASP, "grasp.slipped"), tries("Main/Recover", "grasp.slipped", "grasp.*")],
        5.1: [begins(LOOK), ends(LOOK)],
        6.0: [begins(GRASP, "ball_1")],
        8.0: [ends(GRASP), ends("Main/Recover"), ends("Main")],
    }
    (episode,), _ = follow(RECOVER, SLIPPED | again)
    assert episode == EpisodeEvent(
        "grasp.slipped: cured by LookAgain, 6.0 s lost",
        GRASP,
        cause="grasp.slipped",
        item="ball_1",
        times=(2.0, 5.0),
        end="cured",
        ended=8.0,
        by="Main/Recover",
        handler="grasp.*",
        tried=("LookAgain", "LookAgain"),
        tries=2,
        seconds=6.0,  # from the beginning of the first run to that of the last
    )
    assert list(cause_lines(counted([episode]))) == [
        "grasp.slipped  1 seen, 1 cured by LookAgain after 2 tries, 6.0 s lost"
    ]


def test_each_cause_bears_its_own_runs() -> None:
    other = {
        5.0: [*fails(GRASP, "planning.no_path"), tries("Main/Recover", "planning.no_path", "otherwise")],
        5.1: [begins(LOOK), ends(LOOK)],
        6.0: [begins(GRASP, "ball_1")],
        8.0: [ends(GRASP), ends("Main/Recover"), ends("Main")],
    }
    episodes, _ = follow(RECOVER, SLIPPED | other)
    assert told(episodes) == [
        ("grasp.slipped", "cured", "LookAgain", 1, 3.1),
        ("planning.no_path", "cured", "LookAgain", 1, 2.9),
    ]


def test_given_up_when_the_tries_are_used_up() -> None:
    """The branch that runs before the final failure adds to the cost, and is no try."""
    last = {
        4.0: [*fails(GRASP, "grasp.slipped"), begins(LOOK)],  # as its give_up
        5.0: [
            ends(LOOK),
            ends("Main/Recover", "FAILURE", "grasp.slipped", GRASP),
            ends("Main", "FAILURE", "grasp.slipped", GRASP),
        ],
    }
    episodes, _ = follow(RECOVER, SLIPPED | last)
    assert told(episodes) == [("grasp.slipped", "given_up", "LookAgain", 1, 5.0)]
    assert list(cause_lines(counted(episodes))) == [
        "grasp.slipped  1 seen, none cured (tried: LookAgain), 5.0 s lost"
    ]


def test_a_cure_that_fails_is_seen_too_and_costs_nothing_of_its_own() -> None:
    failed = {
        2.0: [*fails(GRASP, "grasp.slipped"), tries("Main/Recover", "grasp.slipped", "grasp.*")],
        2.1: [begins(LOOK), begins(f"{LOOK}/Observe")],
        3.0: [
            *fails(f"{LOOK}/Observe", "perception.no_image", LOOK),
            ends("Main/Recover", "FAILURE", "grasp.slipped", GRASP),
            ends("Main", "FAILURE", "grasp.slipped", GRASP),
        ],
    }
    episodes, _ = follow(RECOVER, {0.0: SLIPPED[0.0]} | failed)
    assert sorted(told(episodes)) == [
        ("grasp.slipped", "given_up", "LookAgain", 1, 3.0),
        ("perception.no_image", "unhandled", "", 0, 0.0),
    ]


def test_open_when_the_log_ends_before() -> None:
    episodes, _ = follow(RECOVER, {time: SLIPPED[time] for time in (0.0, 2.0, 2.1)}, end=2.5)
    assert told(episodes) == [("grasp.slipped", "open", "LookAgain", 1, 2.5)]


def test_nobody_handles_it() -> None:
    loop = tree("Main", "Main/ForEach", "Main/ForEach/Grasp")
    grasp = "Main/ForEach/Grasp"
    script = {
        0.0: [begins("Main"), begins("Main/ForEach"), begins(grasp, "a")],
        1.5: fails(grasp, "grasp.missed"),
        1.6: [begins(grasp, "b")],
        3.0: [ends(grasp), ends("Main/ForEach"), ends("Main")],
    }
    (episode,), _ = follow(loop, script)
    assert told([episode]) == [("grasp.missed", "unhandled", "", 0, 1.5)]
    assert (episode.item, episode.by, episode.ended) == ("a", "", 1.5)
    assert list(cause_lines(counted([episode]))) == ["grasp.missed  1 seen, nobody handled it, 1.5 s lost"]


OUTER = "Main/Recover"
INNER = f"{OUTER}/Retry"
NESTED = tree(
    "Main", OUTER, f"{INNER}:RetryUntilSuccessful", f"{INNER}/Place", f"{OUTER}/SafeRetreat"
)  # fmt: skip


def test_a_trouble_that_goes_through_several_hands_is_seen_once() -> None:
    place = f"{INNER}/Place"
    script = {
        0.0: [begins("Main"), begins(OUTER), begins(INNER), begins(place)],
        1.0: fails(place, "place.full"),
        1.1: [begins(place)],
        2.0: [*fails(place, "place.full", INNER), tries(OUTER, "place.full", "place.*")],
        2.1: [begins(f"{OUTER}/SafeRetreat")],
        4.0: [ends(f"{OUTER}/SafeRetreat")],
        4.1: [begins(INNER), begins(place)],
        6.0: [ends(place), ends(INNER), ends(OUTER), ends("Main")],
    }
    (episode,), _ = follow(NESTED, script)
    assert told([episode]) == [("place.full", "cured", "Place again > SafeRetreat", 2, 4.1)]
    assert (episode.by, episode.handler) == (OUTER, "place.*")


def test_times_of_nested_episodes_add_up() -> None:
    """One that was cured within a run that failed later on bears its part of the time."""
    place = f"{INNER}/Place"
    script = {
        0.0: [begins("Main"), begins(OUTER), begins(INNER), begins(place)],
        1.0: fails(place, "place.occupied"),
        1.5: [begins(place)],
        3.0: [*fails(place, "place.full", INNER), tries(OUTER, "place.full", "place.*")],
        3.1: [begins(f"{OUTER}/SafeRetreat")],
        4.0: [ends(f"{OUTER}/SafeRetreat")],
        4.1: [begins(INNER), begins(place)],
        5.0: [*fails(place, "place.occupied")],
        5.1: [begins(place)],
        6.0: [ends(place), ends(INNER), ends(OUTER), ends("Main")],
    }
    episodes, _ = follow(NESTED, script)
    assert told(episodes) == [
        ("place.occupied", "cured", "Place again", 1, 1.0),
        ("place.occupied", "cured", "Place again", 1, 1.5),
        ("place.full", "cured", "SafeRetreat", 1, 2.6),
    ]
    assert sum(e.seconds for e in episodes) == pytest.approx(4.1 + 1.0)


FALLBACK = tree(
    "Main", "Main/Fallback", "Main/Fallback/Grasp", "Main/Fallback/PushFree", "Main/Fallback/SetAside"
)


@pytest.mark.parametrize(
    ("last", "expected"),
    [
        ("PushFree", ("grasp.no_candidate", "cured", "PushFree", 1, 1.0)),
        ("SetAside", ("grasp.no_candidate", "given_up", "PushFree", 1, 2.0)),
    ],
)
def test_the_next_branch_of_a_fallback_cures_but_not_by_giving_the_item_up(
    last: str, expected: tuple[str, str, str, int, float]
) -> None:
    path = "Main/Fallback"
    script: dict[float, Sequence[Transition | JournalEvent]] = {
        0.0: [begins("Main"), begins(path), begins(f"{path}/Grasp")],
        1.0: [*fails(f"{path}/Grasp", "grasp.no_candidate"), begins(f"{path}/PushFree")],
    }
    if last == "SetAside":
        script[2.0] = [ends(f"{path}/PushFree", "FAILURE"), begins(f"{path}/SetAside")]
    script[3.0] = [ends(f"{path}/{last}"), ends(path), ends("Main")]
    episodes, _ = follow(FALLBACK, script)
    assert told(episodes) == [expected]


CHOICE = "Main/Fallback"


@pytest.mark.parametrize(
    ("skill", "item", "event", "end"),
    [
        ("GraspSlowly", "ball_1", None, "cured"),
        ("Place", "ball_1", ItemDoneEvent("", "", object="ball_1", into="red_bin"), "cured"),
        ("Place", "ball_1", ItemDoneEvent("", "", object="ball_1"), "given_up"),
        ("Grasp", "ball_2", None, "given_up"),
        ("SafeRetreat", "", None, "given_up"),
        ("LookAround", "ball_1", None, "given_up"),
    ],
)
def test_the_next_branch_cures_only_with_work_on_the_item(
    skill: str, item: str, event: JournalEvent | None, end: str
) -> None:
    """Without it the item is left where it is, and the branch is as little a cure as a `SetAside`."""
    grasp, other = f"{CHOICE}/Grasp", f"{CHOICE}/Or:{skill}"
    nodes, path = tree("Main", CHOICE, grasp, other), f"{CHOICE}/Or"
    script: Script = {
        0.0: [begins("Main"), begins(CHOICE), begins(grasp, "ball_1")],
        1.0: [*fails(grasp, "grasp.missed"), begins(path, item)],
        2.0: [ends(path), ends(CHOICE), ends("Main"), *([event] if event else [])],
    }
    episodes, _ = follow(nodes, script)
    assert told(episodes) == [("grasp.missed", end, episodes[0].cure, 1, 1.0)]
    assert fates(nodes, script) == [(grasp, 1.0, "cured" if end == "cured" else "branched", CHOICE)]


def test_an_item_that_is_held_again_after_it_was_put_down_is_not_left_elsewhere() -> None:
    grasp, regrasp = f"{CHOICE}/Grasp", f"{CHOICE}/Regrasp"
    put, again = f"{regrasp}/Place", f"{regrasp}/Grasp"
    script: Script = {
        0.0: [begins("Main"), begins(CHOICE), begins(grasp, "ball_1")],
        1.0: [*fails(grasp, "grasp.slipped"), begins(regrasp), begins(put, "ball_1")],
        2.0: [ends(put), ItemDoneEvent("", put, object="ball_1"), begins(again, "ball_1")],
        3.0: [PickEvent("", again, object="ball_1", held=True)],
        4.0: [ends(again), ends(regrasp), ends(CHOICE), ends("Main")],
    }
    (episode,), _ = follow(tree("Main", CHOICE, grasp, regrasp, put, again), script)
    assert episode.end == "cured"


@pytest.mark.parametrize("end", ["cured", "given_up"])
def test_a_failure_within_a_cure_ends_as_what_the_cure_is_for(end: str) -> None:
    """The item could not be pushed free, and a look was enough; or it was not."""
    either = f"{OUTER}/Either"
    grasp, push, look = f"{OUTER}/Grasp", f"{either}/PushFree/Push", f"{either}/LookAgain"
    nodes = tree("Main", OUTER, grasp, f"{either}:Fallback", f"{either}/PushFree", push, look)
    above = [(OUTER, "FAILURE"), ("Main", "FAILURE")]
    over = [ends(path, status, "grasp.no_candidate", grasp) for path, status in above]
    script: Script = {
        0.0: [begins("Main"), begins(OUTER), begins(grasp, "ball_1")],
        1.0: [*fails(grasp, "grasp.no_candidate"), tries(OUTER, "grasp.no_candidate", "grasp.*")],
        1.1: [begins(either), begins(f"{either}/PushFree", "ball_1"), begins(push, "ball_1")],
        2.0: [*fails(push, "push.blocked", f"{either}/PushFree"), begins(look)],
        3.0: [ends(look), ends(either)],
        3.1: [begins(grasp, "ball_1")],
        4.0: [ends(grasp), ends(OUTER), ends("Main")]
        if end == "cured"
        else [*fails(grasp, "grasp.no_candidate"), *over],
    }
    episodes, _ = follow(nodes, script)
    assert {(e.cause, e.end) for e in episodes} == {("grasp.no_candidate", end), ("push.blocked", end)}


@pytest.mark.parametrize("nothing", ["AlwaysSuccess", "Log", "Sequence"])
def test_a_branch_that_does_nothing_cures_nothing(nothing: str) -> None:
    below = ("Main/Choose/Or/Said:Log", "Main/Choose/Or/Done:AlwaysSuccess") if nothing == "Sequence" else ()
    nodes = tree("Main", "Main/Choose:Fallback", "Main/Choose/Grasp", f"Main/Choose/Or:{nothing}", *below)
    script: Script = {
        0.0: [begins("Main"), begins("Main/Choose"), begins("Main/Choose/Grasp", "ball_1")],
        2.0: [*fails("Main/Choose/Grasp", "grasp.missed"), begins("Main/Choose/Or")],
        2.05: [ends("Main/Choose/Or"), ends("Main/Choose"), ends("Main")],
    }
    (episode,) = follow(nodes, script)[0]
    assert (episode.cause, episode.end, episode.cure, episode.tries) == ("grasp.missed", "given_up", "", 0)


def test_a_branch_with_nothing_to_do_is_no_try() -> None:
    path = "Main/Fallback"
    script = {
        0.0: [begins("Main"), begins(path), begins(f"{path}/Grasp")],
        1.0: [
            *fails(f"{path}/Grasp", "grasp.missed"),
            begins(f"{path}/PushFree"),
            ends(f"{path}/PushFree", "SKIPPED"),
            ends(path, "FAILURE", "grasp.missed", f"{path}/Grasp"),
            ends("Main", "FAILURE", "grasp.missed", f"{path}/Grasp"),
        ],
    }
    episodes, _ = follow(FALLBACK, script)
    assert [(e.end, e.tries) for e in episodes] == [("unhandled", 0)]


def test_a_condition_that_is_answered_counts_as_attempts() -> None:
    nodes = tree("Main", "Main/Recover", "Main/Recover/Condition", LOOK)
    condition = "Main/Recover/Condition"
    script = {
        0.0: [begins("Main"), begins("Main/Recover"), begins(condition), ends(condition, "FAILURE")],
        0.01: [tries("Main/Recover", "tree.attempts", "otherwise", condition)],
        0.1: [begins(LOOK)],
        1.0: [ends(LOOK)],
        1.1: [begins(condition), ends(condition), ends("Main/Recover"), ends("Main")],
    }
    episodes, _ = follow(nodes, script)
    assert told(episodes) == [("tree.attempts", "cured", "LookAgain", 1, 1.1)]


def test_what_is_halted_goes_up_to_whoever_stopped_it() -> None:
    nodes = tree(
        "Main", "Main/RecoveryNode", "Main/RecoveryNode/Timeout", "Main/RecoveryNode/Timeout/Recover",
        "Main/RecoveryNode/Timeout/Recover/Grasp", "Main/RecoveryNode/Timeout/Recover/SafeRetreat",
        "Main/RecoveryNode/Observe",
    )  # fmt: skip
    outer, limit = "Main/RecoveryNode", "Main/RecoveryNode/Timeout"
    inner = f"{limit}/Recover"
    script = {
        0.0: [begins(p) for p in ("Main", outer, limit, inner, f"{inner}/Grasp")],
        1.0: [*fails(f"{inner}/Grasp", "grasp.missed"), tries(inner, "grasp.missed", "grasp.*")],
        1.1: [begins(f"{inner}/SafeRetreat")],
        2.0: [
            ends(f"{inner}/SafeRetreat", "IDLE"),
            ends(inner, "IDLE"),
            *fails(limit, "tree.timeout"),
            tries(outer, "tree.timeout", "recovery"),
        ],
        2.1: [begins(f"{outer}/Observe")],
        3.0: [ends(f"{outer}/Observe")],
        3.1: [begins(p) for p in (limit, inner, f"{inner}/Grasp")],
        4.0: [ends(p) for p in (f"{inner}/Grasp", inner, limit, outer, "Main")],
    }
    episodes, _ = follow(nodes, script)
    assert sorted(told(episodes)) == [
        ("grasp.missed", "cured", "SafeRetreat", 1, 2.0),
        ("tree.timeout", "cured", "Observe", 1, 1.1),
    ]


def test_planted_faults_stand_beside_what_failed_first_after_them() -> None:
    slip = FaultEvent("it slips", fault="slip", item="item_00")
    jam = FaultEvent("the gripper jams", fault="gripper_jam")
    waits = FaultEvent("it waits", fault="obstacle", waits=True)
    done = {8.0: [ends(GRASP), ends("Main/Recover"), ends("Main")]}
    episodes, planted = follow(RECOVER, SLIPPED | {1.0: [slip, waits], 7.0: [jam]} | done)
    assert [e.end for e in episodes] == ["cured"]
    assert planted == [
        FaultOutcomeEvent(
            "it slips", fault="slip", time=1.0, item="item_00", cause="grasp.slipped", after=1.0, end="cured"
        ),
        FaultOutcomeEvent("the gripper jams", fault="gripper_jam", time=7.0, item="", cause=""),
    ]


def test_following_goes_on_from_any_moment() -> None:
    """Undecided episodes survive a checkpoint, as JSON."""
    rest = {8.0: [ends(GRASP), ends("Main/Recover"), ends("Main")]}
    script = SLIPPED | {1.0: [FaultEvent("it slips", fault="slip")]} | rest
    whole = follow(RECOVER, script)
    states = TypeAdapter(EpisodeTrackerState)
    for cut in sorted(script):
        before = EpisodeTracker()
        before.follow(RECOVER.nodes)
        decided = _take(before, {time: said for time, said in script.items() if time <= cut})
        state = states.validate_python(json.loads(states.dump_json(before.state())))
        after = EpisodeTracker(state)
        after.follow(RECOVER.nodes)
        decided += _take(after, {time: said for time, said in script.items() if time > cut})
        assert of_kinds([*decided, *after.finish(100.0)]) == whole


def test_a_state_is_a_copy() -> None:
    following = EpisodeTracker()
    following.follow(RECOVER.nodes)
    _take(following, {0.0: SLIPPED[0.0]})
    state = following.state()
    _take(following, {2.0: SLIPPED[2.0]})
    assert not state.troubles
    assert all(not node.arrived and not node.taken for node in state.nodes)


def test_the_same_cause_within_the_next_branch_of_a_fallback_is_the_same_trouble() -> None:
    path, retry = "Main/Fallback", "Main/Fallback/RetryUntilSuccessful"
    nodes = tree("Main", path, f"{path}/Observe", retry, f"{retry}/Again:Observe")
    again = f"{retry}/Again"
    script = {
        0.0: [begins("Main"), begins(path), begins(f"{path}/Observe")],
        1.0: [*fails(f"{path}/Observe", "perception.no_image"), begins(retry), begins(again)],
        2.0: fails(again, "perception.no_image"),
        2.1: [begins(again)],
        3.0: [ends(again), ends(retry), ends(path), ends("Main")],
    }
    (episode,), _ = follow(nodes, script)
    assert told([episode]) == [
        ("perception.no_image", "cured", "Observe (Again) > Observe (Again) again", 2, 2.1)
    ]
    assert episode.times == (1.0, 2.0)


def fates(nodes: Tree, script: Script, end: float = 100.0) -> list[tuple[str, float, str, str]]:
    """Each failure of its own, with its outcome and the node that decided it."""
    found = [each for each in decisions(nodes, script, end) if isinstance(each, FailureDecidedEvent)]
    return [(each.node, each.time, each.fate, each.by) for each in found if each.node.endswith("Grasp")]


CURED = {
    5.0: [ends(GRASP), ends("Main/Recover"), ends("Main")],
}
GIVEN_UP = {
    5.0: [
        *fails(GRASP, "grasp.slipped"),
        *(ends(each, "FAILURE", "grasp.slipped", GRASP) for each in ("Main/Recover", "Main")),
    ]
}


@pytest.mark.parametrize(
    ("last", "expected"),
    [
        (CURED, [(GRASP, 2.0, "cured", "Main/Recover")]),
        (GIVEN_UP, [(GRASP, 2.0, "ended", "Main"), (GRASP, 5.0, "ended", "Main")]),
        ({}, [(GRASP, 2.0, "open", "")]),
    ],
)
def test_each_failure_has_the_outcome_of_its_episode(
    last: Script, expected: list[tuple[str, float, str, str]]
) -> None:
    assert fates(RECOVER, {**SLIPPED, **last}) == expected


@pytest.mark.parametrize(
    ("parent", "expected"),
    [("ForEach", "passed_over"), ("WhileDoElse", "branched"), ("Fallback", "cured")],
)
def test_a_failure_that_a_node_goes_on_without(parent: str, expected: str) -> None:
    path, grasp = f"Main/{parent}", f"Main/{parent}/Grasp"
    again = begins(grasp if parent == "ForEach" else f"{path}/Hold")
    script = {
        0.0: [begins("Main"), begins(path), begins(grasp)],
        1.0: [*fails(grasp, "grasp.missed"), again],
        2.0: [ends(again.path), ends(path), ends("Main")],
    }
    assert fates(tree("Main", path, grasp, f"{path}/Hold"), script) == [(grasp, 1.0, expected, path)]


def test_a_node_of_a_plugin_that_runs_its_child_again_cures() -> None:
    path, grasp = "Main/TryTwice", "Main/TryTwice/Grasp"
    script = {
        0.0: [begins("Main"), begins(path), begins(grasp)],
        1.0: [*fails(grasp, "grasp.missed"), begins(grasp)],
        2.0: [ends(grasp), ends(path), ends("Main")],
    }
    nodes = tree("Main", path, grasp)
    assert fates(nodes, script) == [(grasp, 1.0, "cured", path)]
    assert told(follow(nodes, script)[0]) == [("grasp.missed", "cured", "Grasp again", 1, 1.0)]


def test_the_next_branch_of_a_round_robin_cures_too() -> None:
    path = "Main/RoundRobin"
    script = {
        0.0: [begins("Main"), begins(path), begins(f"{path}/Grasp")],
        1.0: [*fails(f"{path}/Grasp", "grasp.missed"), begins(f"{path}/PushFree")],
        2.0: [ends(f"{path}/PushFree"), ends(path), ends("Main")],
    }
    nodes = tree("Main", path, f"{path}/Grasp", f"{path}/PushFree")
    assert told(follow(nodes, script)[0]) == [("grasp.missed", "cured", "PushFree", 1, 1.0)]
    assert fates(nodes, script) == [(f"{path}/Grasp", 1.0, "cured", path)]


def test_a_parallel_decides_at_its_own_end() -> None:
    """A child that begins after another one has failed does not mean that the failure is survived."""
    path, grasp = "Main/Recover/Parallel", "Main/Recover/Parallel/Grasp"
    script = {
        0.0: [begins("Main"), begins("Main/Recover"), begins(path), begins(grasp)],
        1.0: [*fails(grasp, "grasp.missed"), begins(f"{path}/Watch")],
        2.0: [
            ends(f"{path}/Watch", "IDLE"),
            ends(path, "FAILURE", "grasp.missed", grasp),
            tries("Main/Recover", "grasp.missed", "grasp.*"),
        ],
        2.1: [begins(LOOK)],
        3.0: [ends(LOOK), begins(path), begins(grasp)],
        4.0: [ends(grasp), ends(path), ends("Main/Recover"), ends("Main")],
    }
    nodes = tree("Main", "Main/Recover", path, grasp, f"{path}/Watch", LOOK)
    assert fates(nodes, script) == [(grasp, 1.0, "cured", "Main/Recover")]
    assert told(follow(nodes, script)[0]) == [("grasp.missed", "cured", "LookAgain", 1, 3.0)]
