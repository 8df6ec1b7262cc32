"""Episodes of recovery in made-up trees, tick by tick: causes, tries and outcomes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TypeAlias

import pytest
from pydantic import TypeAdapter

from picktree.logs.episode_counts import cause_lines, counted
from picktree.logs.item_episodes import CureNames, Decision, EpisodeTracker, EpisodeTrackerState
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

Script: TypeAlias = Mapping[float, Sequence[Transition | JournalEvent]]
Told: TypeAlias = tuple[str, str, str, int, float]
"""Cause, end, tried cures, number of tries and lost seconds of an episode."""


def starts(*paths: str) -> list[Transition]:
    return [begins(path) for path in paths]


def succeed(*paths: str) -> list[Transition]:
    return [ends(path) for path in paths]


def pass_on(origin: str, cause: str, *above: str) -> list[Transition]:
    """Those above a node fail with it."""
    return [ends(each, "FAILURE", cause, origin) for each in above]


def fails(path: str, cause: str, *above: str) -> list[Transition]:
    """A node fails, and those above fail with it."""
    return [ends(path, "FAILURE", cause), *pass_on(path, cause, *above)]


def tries(node: str, cause: str, handler: str, failed: str = "") -> JournalEvent:
    return RecoveryEvent("", node, cause=cause, handler=handler, failed=failed)


def take(following: EpisodeTracker, script: Script) -> list[Decision]:
    found: list[Decision] = []
    for time, said in sorted(script.items()):
        changes = [each for each in said if isinstance(each, Transition)]
        found += following.take(time, changes, [each for each in said if isinstance(each, JournalEvent)])
    return found


def tracker(nodes: Tree, state: EpisodeTrackerState | None = None) -> EpisodeTracker:
    following = EpisodeTracker() if state is None else EpisodeTracker(state)
    following.follow(nodes.nodes)
    return following


def decisions(nodes: Tree, script: Script, end: float = 100.0) -> list[Decision]:
    following = tracker(nodes)
    return [*take(following, script), *following.finish(end)]


def episodes(nodes: Tree, script: Script, end: float = 100.0) -> list[EpisodeEvent]:
    return [each for each in decisions(nodes, script, end) if isinstance(each, EpisodeEvent)]


def fates(nodes: Tree, script: Script) -> list[tuple[str, float, str, str]]:
    """Each failure of a grasp of its own, with its outcome and the node that decided it."""
    found = [each for each in decisions(nodes, script) if isinstance(each, FailureDecidedEvent)]
    return [(each.node, each.time, each.fate, each.by) for each in found if each.node.endswith("Grasp")]


def told(found: Sequence[EpisodeEvent]) -> list[Told]:
    return [(e.cause, e.end, " > ".join(e.tried), e.tries, e.seconds) for e in found]


OUTER = "Main/Recover"
GRASP, LOOK = f"{OUTER}/Grasp", f"{OUTER}/LookAgain"
RECOVER = tree("Main", OUTER, GRASP, LOOK, f"{LOOK}/Observe")
SLIPPED: Script = {
    0.0: [*starts("Main", OUTER), begins(GRASP, "ball_1")],
    2.0: [*fails(GRASP, "grasp.slipped"), tries(OUTER, "grasp.slipped", "grasp.*")],
    2.1: starts(LOOK, f"{LOOK}/Observe"),
    3.0: succeed(f"{LOOK}/Observe", LOOK),
    3.1: [begins(GRASP, "ball_1")],
}
CURED: Script = {5.0: succeed(GRASP, OUTER, "Main")}
GIVEN_UP: Script = {5.0: fails(GRASP, "grasp.slipped", OUTER, "Main")}
TWICE: Script = SLIPPED | {
    5.0: [*fails(GRASP, "grasp.slipped"), tries(OUTER, "grasp.slipped", "grasp.*")],
    5.1: [begins(LOOK), ends(LOOK)],
    6.0: [begins(GRASP, "ball_1")],
    8.0: succeed(GRASP, OUTER, "Main"),
}
INNER = f"{OUTER}/Retry"
PLACE, RETREAT = f"{INNER}/Place", f"{OUTER}/SafeRetreat"
NESTED = tree("Main", OUTER, f"{INNER}:RetryUntilSuccessful", PLACE, RETREAT)
CHOICE = "Main/Fallback"
FREE, ASIDE = f"{CHOICE}/PushFree", f"{CHOICE}/SetAside"
FALLBACK = tree("Main", CHOICE, f"{CHOICE}/Grasp", FREE, ASIDE)
LOOP = tree("Main", "Main/ForEach", "Main/ForEach/Grasp")
RETRY = f"{CHOICE}/RetryUntilSuccessful"
AGAIN = f"{RETRY}/Again"
WEIGHING = f"{OUTER}/Do"
LIMIT = "Main/RecoveryNode/Timeout"
PARALLEL = f"{OUTER}/Parallel"

EPISODES: dict[str, tuple[Tree, Script, list[Told]]] = {
    # What the node had handled before is cured. To set the item aside changes nothing.
    "what is done instead is neither cured nor given up": (
        tree("Main", OUTER, WEIGHING, f"{WEIGHING}/Grasp", f"{WEIGHING}/Weigh", LOOK, f"{OUTER}/Reject",
             f"{OUTER}/Reject/SetAside"),
        {
            0.0: [*starts("Main", OUTER, WEIGHING), begins(f"{WEIGHING}/Grasp", "can_1")],
            1.0: [*fails(f"{WEIGHING}/Grasp", "grasp.missed", WEIGHING), tries(OUTER, "grasp.missed", "*")],
            1.1: starts(LOOK),
            2.0: succeed(LOOK),
            2.1: [begins(WEIGHING), begins(f"{WEIGHING}/Grasp", "can_1")],
            3.0: [ends(f"{WEIGHING}/Grasp"), begins(f"{WEIGHING}/Weigh")],
            4.0: [
                *fails(f"{WEIGHING}/Weigh", "weigh.heavy", WEIGHING),
                RecoveryEvent("", OUTER, cause="weigh.heavy", handler="weigh.*", ends=True),
            ],
            4.1: starts(f"{OUTER}/Reject", f"{OUTER}/Reject/SetAside"),
            5.0: succeed(f"{OUTER}/Reject/SetAside", f"{OUTER}/Reject", OUTER, "Main"),
        },
        [
            ("grasp.missed", "cured", "LookAgain", 1, 2.1),
            ("weigh.heavy", "done_instead", "Reject", 1, 0.0),
        ],
    ),
    "time up to the last done item is not lost": (
        tree("Main:Fallback", "Main/Repeat", "Main/Repeat/Pick", "Main/SafeRetreat"),
        {
            0.0: [*starts("Main", "Main/Repeat"), begins("Main/Repeat/Pick", "tote")],
            20.0: [
                ends("Main/Repeat/Pick"),
                ItemDoneEvent("", "Main/Repeat/Pick", object="thing_1"),
                begins("Main/Repeat/Pick", "tote"),
            ],
            23.0: [
                *fails("Main/Repeat/Pick", "grasp.no_candidate", "Main/Repeat"), begins("Main/SafeRetreat")
            ],
            25.0: succeed("Main/SafeRetreat", "Main"),
        },
        [("grasp.no_candidate", "given_up", "SafeRetreat", 1, 3.0)],
    ),
    # Lost is the time from the beginning of the first run to that of the last.
    "a cure helps at the second try": (
        RECOVER, TWICE, [("grasp.slipped", "cured", "LookAgain > LookAgain", 2, 6.0)]
    ),
    "each cause bears its own runs": (
        RECOVER,
        TWICE | {5.0: [*fails(GRASP, "planning.no_path"), tries(OUTER, "planning.no_path", "otherwise")]},
        [
            ("grasp.slipped", "cured", "LookAgain", 1, 3.1),
            ("planning.no_path", "cured", "LookAgain", 1, 2.9),
        ],
    ),
    # The branch that runs before the final failure adds to the cost, and is no try.
    "given up when the tries are used up": (
        RECOVER,
        SLIPPED | {
            4.0: [*fails(GRASP, "grasp.slipped"), begins(LOOK)],  # as its give_up
            5.0: [ends(LOOK), *pass_on(GRASP, "grasp.slipped", OUTER, "Main")],
        },
        [("grasp.slipped", "given_up", "LookAgain", 1, 5.0)],
    ),
    "a cure that fails is seen too and costs nothing of its own": (
        RECOVER,
        {time: SLIPPED[time] for time in (0.0, 2.0, 2.1)} | {
            3.0: [
                *fails(f"{LOOK}/Observe", "perception.no_image", LOOK),
                *pass_on(GRASP, "grasp.slipped", OUTER, "Main"),
            ],
        },
        [
            ("grasp.slipped", "given_up", "LookAgain", 1, 3.0),
            ("perception.no_image", "unhandled", "", 0, 0.0),
        ],
    ),
    "nobody handles it": (
        LOOP,
        {
            0.0: [*starts("Main", "Main/ForEach"), begins("Main/ForEach/Grasp", "a")],
            1.5: fails("Main/ForEach/Grasp", "grasp.missed"),
            1.6: [begins("Main/ForEach/Grasp", "b")],
            3.0: succeed("Main/ForEach/Grasp", "Main/ForEach", "Main"),
        },
        [("grasp.missed", "unhandled", "", 0, 1.5)],
    ),
    "a trouble that goes through several hands is seen once": (
        NESTED,
        {
            0.0: starts("Main", OUTER, INNER, PLACE),
            1.0: fails(PLACE, "place.full"),
            1.1: starts(PLACE),
            2.0: [*fails(PLACE, "place.full", INNER), tries(OUTER, "place.full", "place.*")],
            2.1: starts(RETREAT),
            4.0: succeed(RETREAT),
            4.1: starts(INNER, PLACE),
            6.0: succeed(PLACE, INNER, OUTER, "Main"),
        },
        [("place.full", "cured", "Place again > SafeRetreat", 2, 4.1)],
    ),
    # One that was cured within a run that failed later on bears its part of the time.
    "times of nested episodes add up": (
        NESTED,
        {
            0.0: starts("Main", OUTER, INNER, PLACE),
            1.0: fails(PLACE, "place.occupied"),
            1.5: starts(PLACE),
            3.0: [*fails(PLACE, "place.full", INNER), tries(OUTER, "place.full", "place.*")],
            3.1: starts(RETREAT),
            4.0: succeed(RETREAT),
            4.1: starts(INNER, PLACE),
            5.0: fails(PLACE, "place.occupied"),
            5.1: starts(PLACE),
            6.0: succeed(PLACE, INNER, OUTER, "Main"),
        },
        [
            ("place.occupied", "cured", "Place again", 1, 1.0),
            ("place.occupied", "cured", "Place again", 1, 1.5),
            ("place.full", "cured", "SafeRetreat", 1, 2.6),
        ],
    ),
    "the next branch of a fallback cures": (
        FALLBACK,
        {
            0.0: starts("Main", CHOICE, f"{CHOICE}/Grasp"),
            1.0: [*fails(f"{CHOICE}/Grasp", "grasp.no_candidate"), begins(FREE)],
            3.0: succeed(FREE, CHOICE, "Main"),
        },
        [("grasp.no_candidate", "cured", "PushFree", 1, 1.0)],
    ),
    "a branch that gives the item up cures nothing": (
        FALLBACK,
        {
            0.0: starts("Main", CHOICE, f"{CHOICE}/Grasp"),
            1.0: [*fails(f"{CHOICE}/Grasp", "grasp.no_candidate"), begins(FREE)],
            2.0: [ends(FREE, "FAILURE"), begins(ASIDE)],
            3.0: succeed(ASIDE, CHOICE, "Main"),
        },
        [("grasp.no_candidate", "given_up", "PushFree", 1, 2.0)],
    ),
    "a branch with nothing to do is no try": (
        FALLBACK,
        {
            0.0: starts("Main", CHOICE, f"{CHOICE}/Grasp"),
            1.0: [
                *fails(f"{CHOICE}/Grasp", "grasp.missed"),
                begins(FREE),
                ends(FREE, "SKIPPED"),
                *pass_on(f"{CHOICE}/Grasp", "grasp.missed", CHOICE, "Main"),
            ],
        },
        [("grasp.missed", "unhandled", "", 0, 2.0)],
    ),
    "a condition that is answered counts as attempts": (
        tree("Main", OUTER, f"{OUTER}/Condition", LOOK),
        {
            0.0: [*starts("Main", OUTER, f"{OUTER}/Condition"), ends(f"{OUTER}/Condition", "FAILURE")],
            0.01: [tries(OUTER, "tree.attempts", "otherwise", f"{OUTER}/Condition")],
            0.1: starts(LOOK),
            1.0: succeed(LOOK),
            1.1: [begins(f"{OUTER}/Condition"), *succeed(f"{OUTER}/Condition", OUTER, "Main")],
        },
        [("tree.attempts", "cured", "LookAgain", 1, 1.1)],
    ),
    "what is halted goes up to whoever stopped it": (
        tree("Main", "Main/RecoveryNode", LIMIT, f"{LIMIT}/Recover", f"{LIMIT}/Recover/Grasp",
             f"{LIMIT}/Recover/SafeRetreat", "Main/RecoveryNode/Observe"),
        {
            0.0: starts("Main", "Main/RecoveryNode", LIMIT, f"{LIMIT}/Recover", f"{LIMIT}/Recover/Grasp"),
            1.0: [
                *fails(f"{LIMIT}/Recover/Grasp", "grasp.missed"),
                tries(f"{LIMIT}/Recover", "grasp.missed", "grasp.*"),
            ],
            1.1: starts(f"{LIMIT}/Recover/SafeRetreat"),
            2.0: [
                ends(f"{LIMIT}/Recover/SafeRetreat", "IDLE"),
                ends(f"{LIMIT}/Recover", "IDLE"),
                *fails(LIMIT, "tree.timeout"),
                tries("Main/RecoveryNode", "tree.timeout", "recovery"),
            ],
            2.1: starts("Main/RecoveryNode/Observe"),
            3.0: succeed("Main/RecoveryNode/Observe"),
            3.1: starts(LIMIT, f"{LIMIT}/Recover", f"{LIMIT}/Recover/Grasp"),
            4.0: succeed(
                f"{LIMIT}/Recover/Grasp", f"{LIMIT}/Recover", LIMIT, "Main/RecoveryNode", "Main"
            ),
        },
        [("grasp.missed", "cured", "SafeRetreat", 1, 2.0), ("tree.timeout", "cured", "Observe", 1, 1.1)],
    ),
    "the same cause within the next branch is the same trouble": (
        tree("Main", CHOICE, f"{CHOICE}/Observe", RETRY, f"{AGAIN}:Observe"),
        {
            0.0: starts("Main", CHOICE, f"{CHOICE}/Observe"),
            1.0: [*fails(f"{CHOICE}/Observe", "perception.no_image"), *starts(RETRY, AGAIN)],
            2.0: fails(AGAIN, "perception.no_image"),
            2.1: starts(AGAIN),
            3.0: succeed(AGAIN, RETRY, CHOICE, "Main"),
        },
        [("perception.no_image", "cured", "Observe (Again) > Observe (Again) again", 2, 2.1)],
    ),
    "a node of a plugin that runs its child again cures": (
        tree("Main", "Main/TryTwice", "Main/TryTwice/Grasp"),
        {
            0.0: starts("Main", "Main/TryTwice", "Main/TryTwice/Grasp"),
            1.0: [*fails("Main/TryTwice/Grasp", "grasp.missed"), begins("Main/TryTwice/Grasp")],
            2.0: succeed("Main/TryTwice/Grasp", "Main/TryTwice", "Main"),
        },
        [("grasp.missed", "cured", "Grasp again", 1, 1.0)],
    ),
    "the next branch of a round robin cures too": (
        tree("Main", "Main/RoundRobin", "Main/RoundRobin/Grasp", "Main/RoundRobin/PushFree"),
        {
            0.0: starts("Main", "Main/RoundRobin", "Main/RoundRobin/Grasp"),
            1.0: [*fails("Main/RoundRobin/Grasp", "grasp.missed"), begins("Main/RoundRobin/PushFree")],
            2.0: succeed("Main/RoundRobin/PushFree", "Main/RoundRobin", "Main"),
        },
        [("grasp.missed", "cured", "PushFree", 1, 1.0)],
    ),
    # A child that begins after another one has failed does not mean that the failure is survived.
    "a parallel decides at its own end": (
        tree("Main", OUTER, PARALLEL, f"{PARALLEL}/Grasp", f"{PARALLEL}/Watch", LOOK),
        {
            0.0: starts("Main", OUTER, PARALLEL, f"{PARALLEL}/Grasp"),
            1.0: [*fails(f"{PARALLEL}/Grasp", "grasp.missed"), begins(f"{PARALLEL}/Watch")],
            2.0: [
                ends(f"{PARALLEL}/Watch", "IDLE"),
                *pass_on(f"{PARALLEL}/Grasp", "grasp.missed", PARALLEL),
                tries(OUTER, "grasp.missed", "grasp.*"),
            ],
            2.1: starts(LOOK),
            3.0: [ends(LOOK), *starts(PARALLEL, f"{PARALLEL}/Grasp")],
            4.0: succeed(f"{PARALLEL}/Grasp", PARALLEL, OUTER, "Main"),
        },
        [("grasp.missed", "cured", "LookAgain", 1, 3.0)],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", EPISODES)
def test_a_trouble_has_its_end_its_tries_and_its_cost(case: str) -> None:
    nodes, script, expected = EPISODES[case]
    assert sorted(told(episodes(nodes, script))) == sorted(expected)


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        ("what is done instead is neither cured nor given up", (f"{WEIGHING}/Grasp", 1.0, "cured", OUTER)),
        ("a node of a plugin that runs its child again cures",
         ("Main/TryTwice/Grasp", 1.0, "cured", "Main/TryTwice")),
        ("the next branch of a round robin cures too",
         ("Main/RoundRobin/Grasp", 1.0, "cured", "Main/RoundRobin")),
        ("a parallel decides at its own end", (f"{PARALLEL}/Grasp", 1.0, "cured", OUTER)),
    ],
)  # fmt: skip
def test_a_failure_is_decided_by_the_node_that_goes_on(
    case: str, expected: tuple[str, float, str, str]
) -> None:
    nodes, script, _ = EPISODES[case]
    assert fates(nodes, script) == [expected]


@pytest.mark.parametrize(
    ("case", "line"),
    [
        ("what is done instead is neither cured nor given up",
         "weigh.heavy   1 seen, 1 done instead (Reject)"),
        ("a cure helps at the second try",
         "grasp.slipped  1 seen, 1 cured by LookAgain after 2 tries, 6.0 s lost"),
        ("given up when the tries are used up",
         "grasp.slipped  1 seen, none cured (tried: LookAgain), 5.0 s lost"),
        ("nobody handles it", "grasp.missed  1 seen, nobody handled it, 1.5 s lost"),
    ],
)  # fmt: skip
def test_a_cause_is_told_in_a_line(case: str, line: str) -> None:
    nodes, script, _ = EPISODES[case]
    assert list(cause_lines(counted(episodes(nodes, script))))[-1] == line


@pytest.mark.parametrize(
    ("last", "line", "planted"),
    [
        ("SUCCESS", "1 cured by Regrasp after 2 tries (PushFree failed before), 2.0 s lost", "cured"),
        ("FAILURE", "none cured (tried: PushFree, Regrasp), 3.0 s lost", "given_up"),
    ],
)
def test_a_cure_that_failed_before_another_ran_is_named(last: str, line: str, planted: str) -> None:
    again = f"{CHOICE}/Regrasp"
    nodes = tree("Main", CHOICE, f"{CHOICE}/Grasp", FREE, again)
    script: Script = {
        0.0: starts("Main", CHOICE, f"{CHOICE}/Grasp"),
        1.0: [*fails(f"{CHOICE}/Grasp", "planning.no_path"), begins(FREE)],
        1.5: [FaultEvent("the planner finds nothing", fault="no_plan")],
        2.0: [*fails(FREE, "planning.no_path"), begins(again)],
        3.0: (
            fails(again, "planning.no_path", CHOICE, "Main")
            if last == "FAILURE"
            else succeed(again, CHOICE, "Main")
        ),
    }
    decided = decisions(nodes, script)
    (episode,) = (each for each in decided if isinstance(each, EpisodeEvent))
    assert list(cause_lines(counted([episode]))) == [f"planning.no_path  1 seen, {line}"]
    # A fault during the first cure is followed by that cure's failure, which the episode includes.
    (fault,) = (each for each in decided if isinstance(each, FaultOutcomeEvent))
    assert (fault.cause, fault.after, fault.end) == ("planning.no_path", 0.5, planted)


def test_an_episode_names_item_times_and_who_cured_it_how() -> None:
    (episode,) = episodes(RECOVER, TWICE)
    assert episode == EpisodeEvent(
        "grasp.slipped: cured by LookAgain, 6.0 s lost",
        GRASP,
        cause="grasp.slipped",
        item="ball_1",
        times=(2.0, 5.0),
        end="cured",
        ended=8.0,
        by=OUTER,
        handler="grasp.*",
        tried=("LookAgain", "LookAgain"),
        tries=2,
        seconds=6.0,
    )
    nodes, script, _ = EPISODES["nobody handles it"]
    (episode,) = episodes(nodes, script)
    assert (episode.item, episode.by, episode.ended) == ("a", "", 1.5)


def test_an_episode_is_open_when_the_log_ends_before() -> None:
    found = episodes(RECOVER, {time: SLIPPED[time] for time in (0.0, 2.0, 2.1)}, end=2.5)
    assert told(found) == [("grasp.slipped", "open", "LookAgain", 1, 2.5)]


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
    grasp, path = f"{CHOICE}/Grasp", f"{CHOICE}/Or"
    nodes = tree("Main", CHOICE, grasp, f"{path}:{skill}")
    script: Script = {
        0.0: [*starts("Main", CHOICE), begins(grasp, "ball_1")],
        1.0: [*fails(grasp, "grasp.missed"), begins(path, item)],
        2.0: [*succeed(path, CHOICE, "Main"), *([event] if event else [])],
    }
    (episode,) = episodes(nodes, script)
    assert told([episode]) == [("grasp.missed", end, episode.cure, 1, 1.0)]
    assert fates(nodes, script) == [(grasp, 1.0, "cured" if end == "cured" else "branched", CHOICE)]


def test_an_item_that_is_held_again_after_it_was_put_down_is_not_left_elsewhere() -> None:
    grasp, regrasp = f"{CHOICE}/Grasp", f"{CHOICE}/Regrasp"
    put, again = f"{regrasp}/Place", f"{regrasp}/Grasp"
    script: Script = {
        0.0: [*starts("Main", CHOICE), begins(grasp, "ball_1")],
        1.0: [*fails(grasp, "grasp.slipped"), begins(regrasp), begins(put, "ball_1")],
        2.0: [ends(put), ItemDoneEvent("", put, object="ball_1"), begins(again, "ball_1")],
        3.0: [PickEvent("", again, object="ball_1", held=True)],
        4.0: succeed(again, regrasp, CHOICE, "Main"),
    }
    (episode,) = episodes(tree("Main", CHOICE, grasp, regrasp, put, again), script)
    assert episode.end == "cured"


@pytest.mark.parametrize("end", ["cured", "given_up"])
def test_a_failure_within_a_cure_ends_as_what_the_cure_is_for(end: str) -> None:
    """The item could not be pushed free, and a look was enough; or it was not."""
    either = f"{OUTER}/Either"
    push, look = f"{either}/PushFree/Push", f"{either}/LookAgain"
    nodes = tree("Main", OUTER, GRASP, f"{either}:Fallback", f"{either}/PushFree", push, look)
    last = {
        "cured": succeed(GRASP, OUTER, "Main"),
        "given_up": fails(GRASP, "grasp.no_candidate", OUTER, "Main"),
    }
    script: Script = {
        0.0: [*starts("Main", OUTER), begins(GRASP, "ball_1")],
        1.0: [*fails(GRASP, "grasp.no_candidate"), tries(OUTER, "grasp.no_candidate", "grasp.*")],
        1.1: [begins(either), begins(f"{either}/PushFree", "ball_1"), begins(push, "ball_1")],
        2.0: [*fails(push, "push.blocked", f"{either}/PushFree"), begins(look)],
        3.0: succeed(look, either),
        3.1: [begins(GRASP, "ball_1")],
        4.0: last[end],
    }
    found = {(e.cause, e.end) for e in episodes(nodes, script)}
    assert found == {("grasp.no_candidate", end), ("push.blocked", end)}


@pytest.mark.parametrize("nothing", ["AlwaysSuccess", "Log", "Sequence"])
def test_a_branch_that_does_nothing_cures_nothing(nothing: str) -> None:
    below = (f"{CHOICE}/Or/Said:Log", f"{CHOICE}/Or/Done:AlwaysSuccess") if nothing == "Sequence" else ()
    nodes = tree("Main", CHOICE, f"{CHOICE}/Grasp", f"{CHOICE}/Or:{nothing}", *below)
    script: Script = {
        0.0: [*starts("Main", CHOICE), begins(f"{CHOICE}/Grasp", "ball_1")],
        2.0: [*fails(f"{CHOICE}/Grasp", "grasp.missed"), begins(f"{CHOICE}/Or")],
        2.05: succeed(f"{CHOICE}/Or", CHOICE, "Main"),
    }
    (episode,) = episodes(nodes, script)
    assert (episode.cause, episode.end, episode.cure, episode.tries) == ("grasp.missed", "given_up", "", 0)


def test_planted_faults_stand_beside_what_failed_first_after_them() -> None:
    slip = FaultEvent("it slips", fault="slip", item="item_00")
    jam = FaultEvent("the gripper jams", fault="gripper_jam")
    waits = FaultEvent("it waits", fault="obstacle", waits=True)
    done = {8.0: succeed(GRASP, OUTER, "Main")}
    decided = decisions(RECOVER, SLIPPED | {1.0: [slip, waits], 7.0: [jam]} | done)
    assert [each for each in decided if isinstance(each, FaultOutcomeEvent)] == [
        FaultOutcomeEvent(
            "it slips", fault="slip", time=1.0, item="item_00", cause="grasp.slipped", after=1.0, end="cured"
        ),
        FaultOutcomeEvent("the gripper jams", fault="gripper_jam", time=7.0, item="", cause=""),
    ]


def test_following_goes_on_from_any_moment() -> None:
    """Undecided episodes survive a checkpoint, as JSON; a state is a copy."""
    script = SLIPPED | {1.0: [FaultEvent("it slips", fault="slip")]} | CURED
    whole = decisions(RECOVER, script)
    states = TypeAdapter(EpisodeTrackerState)
    for cut in sorted(script):
        before = tracker(RECOVER)
        decided = take(before, {time: said for time, said in script.items() if time <= cut})
        rest = {time: said for time, said in script.items() if time > cut}
        state = before.state()
        take(before, rest)
        after = tracker(RECOVER, states.validate_python(json.loads(states.dump_json(state))))
        decided += take(after, rest)
        assert [*decided, *after.finish(100.0)] == whole


@pytest.mark.parametrize(
    ("last", "expected"),
    [
        (CURED, [(GRASP, 2.0, "cured", OUTER)]),
        (GIVEN_UP, [(GRASP, 2.0, "ended", "Main"), (GRASP, 5.0, "ended", "Main")]),
        ({}, [(GRASP, 2.0, "open", "")]),
    ],
)
def test_each_failure_has_the_outcome_of_its_episode(
    last: Script, expected: list[tuple[str, float, str, str]]
) -> None:
    assert fates(RECOVER, {**SLIPPED, **last}) == expected


@pytest.mark.parametrize(
    ("parent", "expected"), [("ForEach", "passed_over"), ("WhileDoElse", "branched"), ("Fallback", "cured")]
)
def test_a_failure_that_a_node_goes_on_without(parent: str, expected: str) -> None:
    path, grasp = f"Main/{parent}", f"Main/{parent}/Grasp"
    again = grasp if parent == "ForEach" else f"{path}/Hold"
    script: Script = {
        0.0: starts("Main", path, grasp),
        1.0: [*fails(grasp, "grasp.missed"), begins(again)],
        2.0: succeed(again, path, "Main"),
    }
    assert fates(tree("Main", path, grasp, f"{path}/Hold"), script) == [(grasp, 1.0, expected, path)]


@pytest.mark.parametrize(("count", "name"), [(1, "A"), (2, "A + B"), (3, "A + B + C"), (4, "A + B + 2 more")])
def test_a_cure_is_named_by_three_nodes_at_most(count: int, name: str) -> None:
    paths = [f"Sequence/{leaf}" for leaf in "ABCD"[:count]]
    assert CureNames(tree("Sequence", *paths).nodes).of("Sequence") == name
