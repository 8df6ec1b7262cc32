"""Each skill ends: one that yields for ever by its limit, one that raises as a fault of the program."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from picktree.skills import AwaitItems
from picktree.trees import In, NodeStatus, Skill, Steps, port
from picktree.trees.loading import NodeRegistry, parse_mission

from .scripted import FILE, NODES, FakeWorld, Run, run_of

if TYPE_CHECKING:
    from picktree.robot import World


class Endless(Skill):
    """Yields for ever."""

    speed: In[float] = port("share of what is possible", default=1.0)
    limit = 2.0

    def run(self, world: World) -> Steps:
        try:
            while True:
                yield
        finally:
            cast("FakeWorld", world).trace.append("closed")


class Waiting(Skill):
    """Waits by design."""

    longest: In[float] = port("how long it may wait", unit="s", default=3.0)
    limit = 1.0
    waits_for = "longest"

    def run(self, world: World) -> Steps:
        while True:
            yield


def run(body: str) -> Run:
    text = f"picktree: 1\nkind: mission\ntrees:\n  Main:\n    {body}\n"
    return run_of(parse_mission(text, FILE, NodeRegistry((*NODES, Endless, Waiting), installed=False)))


def ended(one: Run) -> tuple[str, str, float]:
    """Cause, sentence and simulated time of the end."""
    assert one.to_end(400)[-1] is NodeStatus.FAILURE
    report = one.failure
    return str(report.cause), report.message, round(one.world.clock.now, 2)


def test_a_skill_that_yields_for_ever_is_ended_by_its_limit_and_closed() -> None:
    one = run("Endless")
    assert ended(one) == (
        "tree.timeout",
        "Endless still ran after 2 s, its longest time, and was stopped",
        2.1,
    )
    assert one.failure.evidence == {"seconds": 2.05, "limit": 2.0}
    assert one.trace == ["closed"]
    assert one.notes("undeclared_cause") == []


def test_a_slow_one_and_one_that_waits_by_design_have_more() -> None:
    assert ended(run("Endless: {speed: 0.05}"))[2] == 10.1
    assert ended(run("Endless: {speed: 0.5}"))[2] == 2.1
    assert ended(run("Waiting: {longest: 5 s}"))[2] == 6.1


def test_it_begins_anew_with_each_activation_and_recovery_may_handle_it() -> None:
    one = run("RetryUntilSuccessful: {num_attempts: 3, do: Endless}")
    cause, _, at = ended(one)
    assert (cause, at) == ("tree.timeout", 6.3)
    assert one.trace == ["closed"] * 3


def test_the_reference_says_it() -> None:
    assert AwaitItems.limit_words() == "It is stopped with tree.timeout after 10 s beyond `longest`."
    assert (
        Endless.limit_words() == "It is stopped with tree.timeout after 2 s, longer at a `speed` below 0.25."
    )
