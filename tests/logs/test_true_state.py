"""The simulation's own state in the log: what is told piece by piece is read as a whole."""

from __future__ import annotations

from typing import Any

from picktree.logs.recording.true_state import STATE_PERIOD, StateWriter, fold_states, read_state


def body(name: str, x: float) -> dict[str, Any]:
    return {"id": name, "x": x}


def test_what_changed_is_told_and_read_as_a_whole() -> None:
    states: list[dict[str, Any]] = [
        {"step": 1, "ledger": [], "items": [body("a", 0.0), body("b", 0.0)]},
        {"step": 2, "ledger": [], "items": [body("a", 0.0), body("b", 0.1)]},
        {"step": 3, "ledger": ["a"], "items": [body("b", 0.1)]},
        {"step": 4, "ledger": ["a"], "items": [body("b", 0.1), body("c", 0.2)]},
    ]
    writer = StateWriter()
    told = [read_state(writer.encode(n * STATE_PERIOD, state)) for n, state in enumerate(states)]
    assert [message.whole for message in told] == [True, False, False, False]
    assert told[1].state == {"step": 2, "items": [body("b", 0.1)]}
    for n, state in enumerate(states, 1):
        assert fold_states(told[:n]) == state


def test_everything_is_told_again_after_a_while_and_in_a_further_file() -> None:
    writer = StateWriter()
    state = {"step": 1, "items": [body("a", 0.0)]}
    assert read_state(writer.encode(0.0, state)).whole
    assert not writer.due(0.1) and writer.due(0.2)
    assert read_state(writer.encode(0.2, state)).state == {}
    assert read_state(writer.encode(0.4, state, anew=True)).state == state
    assert read_state(writer.encode(10.4, state)).whole
