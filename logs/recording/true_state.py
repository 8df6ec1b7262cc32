"""State of the simulation in the log, several times a second, from which a run can resume as it stood.

It is no part of the digest: its content is simulated, but it is not written for viewers of the run. Most of
it stays the same, so a message holds the changes since the one before. Every few seconds a message holds
everything, in case one is lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final, cast

import orjson

from ..schema.records import TrueState

STATE_PERIOD: Final = 0.2
"""Period of the messages, simulated s."""
WHOLE_STATE_PERIOD: Final = 10.0
"""Period after which everything is written again, simulated s."""
_ITEMS_FIELD: Final = "items"
"""Field with the list of bodies, each with its `id`; of these, too, only changed ones are written."""


class StateWriter:
    """Encoder of states."""

    def __init__(self) -> None:
        self._before: Mapping[str, Any] = {}
        self._at = self._whole_at = float("-inf")

    def due(self, now: float) -> bool:
        return now - self._at >= STATE_PERIOD - 1e-6

    def encode(self, now: float, state: Mapping[str, Any], *, anew: bool = False) -> bytes:
        """Encode a state. `anew`: the file holds no earlier message, so everything is written."""
        whole = anew or now - self._whole_at >= WHOLE_STATE_PERIOD - 1e-6
        self._at = now
        self._whole_at = now if whole else self._whole_at
        told = state if whole else _changed(self._before, state)
        self._before = state
        return orjson.dumps({"whole": whole, "state": told})


def read_state(data: bytes) -> TrueState:
    """Decode a message. Raises ValueError for something else."""
    said = cast("dict[str, Any]", orjson.loads(data))
    if not isinstance(said.get("whole"), bool) or not isinstance(said.get("state"), dict):
        raise ValueError("no state of a simulation")
    return TrueState(said["whole"], said["state"])


def fold_states(messages: Iterable[TrueState]) -> dict[str, Any] | None:
    """Return the state after all messages, of which the first is whole; None without any."""
    state: dict[str, Any] | None = None
    for message in messages:
        if message.whole or state is None:
            state = dict(message.state)
            continue
        told = dict(message.state)
        if _ITEMS_FIELD in told:
            news = {body["id"]: body for body in told.pop(_ITEMS_FIELD)}
            order = told.pop("item_ids", None) or [body["id"] for body in state[_ITEMS_FIELD]]
            known = {body["id"]: body for body in state[_ITEMS_FIELD]} | news
            told[_ITEMS_FIELD] = [known[name] for name in order]
        state.update(told)
    return state


def _changed(before: Mapping[str, Any], state: Mapping[str, Any]) -> dict[str, Any]:
    told = {key: value for key, value in state.items() if key not in before or before[key] != value}
    if _ITEMS_FIELD in told:
        known = {body["id"]: body for body in before[_ITEMS_FIELD]}
        told[_ITEMS_FIELD] = [body for body in state[_ITEMS_FIELD] if known.get(body["id"]) != body]
        ids = [body["id"] for body in state[_ITEMS_FIELD]]
        if ids != list(known):
            told["item_ids"] = ids
    return told
