"""The simulation's own state in the log: what is told piece by piece is read as a whole."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from picktree.logs.log_records import TrueState
from picktree.logs.recording import fold_states, read_state
from picktree.logs.recording.true_state import STATE_PERIOD, StateWriter


def body(name: str, x: float) -> dict[str, Any]:
    return {"id": name, "x": x}


def state(step: int, bodies: list[Any], left: list[str] | None = None, **more: object) -> dict[str, Any]:
    inventory = None if left is None else {"brought": [], "departed": [{"id": name} for name in left]}
    return {"step": step, "items": bodies, "inventory": inventory, **more}


def since(full: dict[str, Any]) -> Callable[[int], dict[str, Any]]:
    """What a simulation answers: its state, without the first so many items that left."""

    def told(departed: int) -> dict[str, Any]:
        if full["inventory"] is None:
            return full
        left = full["inventory"]["departed"][departed:]
        return full | {"inventory": full["inventory"] | {"departed": left}}

    return told


def test_what_changed_is_told_and_read_as_a_whole() -> None:
    states = [
        state(1, [body("a", 0.0), body("b", 0.0)], ledger=[]),
        state(2, [body("a", 0.0), body("b", 0.1)], ledger=[]),
        state(3, [body("b", 0.1)], ["a"], ledger=["a"]),
        state(4, [body("b", 0.1), body("c", 0.2)], ["a"], ledger=["a"]),
        state(5, [], ["a", "c", "b"], ledger=["a"]),
    ]
    writer = StateWriter()
    told = [read_state(writer.encode(n * STATE_PERIOD, since(each))) for n, each in enumerate(states)]
    assert [message.whole for message in told] == [True, False, False, False, False]
    assert told[1].state == {"step": 2, "items": [body("a", 0.0), body("b", 0.1)][1:]}
    assert told[4].state["departed"] == [{"id": "c"}, {"id": "b"}]
    for n, each in enumerate(states, 1):
        assert fold_states(told[:n]) == each


def test_changes_of_older_logs_have_all_that_left() -> None:
    told = [TrueState(True, state(1, [], ["a"])), TrueState(False, state(2, [], ["a", "b"]))]
    assert fold_states(told) == state(2, [], ["a", "b"])


def test_everything_is_told_again_when_changes_took_as_much_room_and_in_a_further_file() -> None:
    writer = StateWriter()

    def encode(now: float, step: int, *, anew: bool = False) -> TrueState:
        return read_state(writer.encode(now, since(state(step, [], ["a" * 1000, "b"])), anew=anew))

    assert encode(0.0, 1).whole
    assert not writer.due(0.1) and writer.due(0.2)
    assert encode(0.2, 1).state == {}
    assert encode(0.4, 1, anew=True).state == state(1, [], ["a" * 1000, "b"])
    assert not encode(10.4, 2).whole
    several = [encode(10.4 + n * STATE_PERIOD, n) for n in range(1, 60)]
    assert several[-1].state["step"] == 59
    assert [message.whole for message in several].count(True) == 1


def test_a_state_takes_no_more_room_when_thousands_have_left() -> None:
    writer = StateWriter()
    writer.encode(0.0, since(state(1, [], [str(n) for n in range(5000)])))
    assert len(writer.encode(0.2, since(state(2, [], [str(n) for n in range(5001)])))) < 100
