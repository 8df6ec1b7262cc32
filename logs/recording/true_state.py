"""State of the simulation in the log, several times a second. A run can resume from its last state.

It is no part of the digest: its content is simulated, but it is not written for viewers of the run. Most of
it stays the same, so a message holds the changes since the one before. Now and then a message holds
everything, in case one is lost: after some seconds at the earliest, and not before changes have taken as much
room. A run of hours has thousands of items that left with bins; each is written once in between.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, cast

import orjson

from picktree.logs import log_records

STATE_PERIOD: Final = 0.2
"""Period of the messages, simulated s."""
WHOLE_STATE_PERIOD: Final = 10.0
"""Least period after which everything is written again, simulated s."""
_ITEMS_FIELD: Final = "items"
"""Field with the list of bodies, each with its `id`; of these, too, only changed ones are written."""
_INVENTORY_FIELD: Final = "inventory"
_DEPARTED_FIELD: Final = "departed"
"""Field of the inventory with the items that left; a change has the further ones in a field of this name."""


class StateWriter:
    """Encoder of states."""

    def __init__(self) -> None:
        self._before: Mapping[str, Any] = {}
        """State of the message before, without the items that left."""
        self._departed = 0
        """Number of the items that left and are written already."""
        self._at = self._whole_at = float("-inf")
        self._whole_size = self._size = 0
        """Bytes of the last whole message, and of those after it."""

    def due(self, now: float) -> bool:
        return now - self._at >= STATE_PERIOD - 1e-6

    def encode(self, now: float, state: Callable[[int], Mapping[str, Any]], *, anew: bool = False) -> bytes:
        """Encode a state, which `state` returns without the first so many items that left. `anew`: the file
        holds no earlier message, so everything is written."""
        late = now - self._whole_at >= WHOLE_STATE_PERIOD - 1e-6
        whole = anew or (late and self._size >= self._whole_size)
        self._at = now
        full = state(0 if whole else self._departed)
        rest, left = _parted(full)
        content = dict(full) if whole else _changed(self._before, rest)
        if left and not whole:
            content[_DEPARTED_FIELD] = left
        self._before = rest
        self._departed = len(left) + (0 if whole else self._departed)
        data = orjson.dumps({"whole": whole, "state": content})
        if whole:
            self._whole_at, self._whole_size, self._size = now, len(data), 0
        else:
            self._size += len(data)
        return data


def read_state(data: bytes) -> log_records.TrueState:
    """Decode a message. Raises ValueError for something else."""
    message = cast("dict[str, Any]", orjson.loads(data))
    if not isinstance(message.get("whole"), bool) or not isinstance(message.get("state"), dict):
        raise ValueError("no state of a simulation")
    return log_records.TrueState(message["whole"], message["state"])


def fold_states(messages: Iterable[log_records.TrueState]) -> dict[str, Any] | None:
    """Return the state after all messages, of which the first is whole; None without any."""
    state: dict[str, Any] | None = None
    for message in messages:
        if message.whole or state is None:
            state = dict(message.state)
            continue
        changes = dict(message.state)
        if _ITEMS_FIELD in changes:
            news = {body["id"]: body for body in changes.pop(_ITEMS_FIELD)}
            order = changes.pop("item_ids", [body["id"] for body in state[_ITEMS_FIELD]])
            known = {body["id"]: body for body in state[_ITEMS_FIELD]} | news
            changes[_ITEMS_FIELD] = [known[name] for name in order]
        left = [*_parted(state)[1], *changes.pop(_DEPARTED_FIELD, ())]
        inventory = changes.get(_INVENTORY_FIELD, state.get(_INVENTORY_FIELD))
        if inventory:  # a change of an older log has all that left
            left = _parted(changes)[1] or left
            changes[_INVENTORY_FIELD] = {**inventory, _DEPARTED_FIELD: left}
        state.update(changes)
    return state


def _parted(state: Mapping[str, Any]) -> tuple[Mapping[str, Any], list[Any]]:
    """Return a state without the items that left, and these."""
    inventory = state.get(_INVENTORY_FIELD)
    if not inventory:
        return state, []
    rest: dict[str, Any] = {**state, _INVENTORY_FIELD: {**inventory, _DEPARTED_FIELD: []}}
    return rest, inventory[_DEPARTED_FIELD]


def _changed(before: Mapping[str, Any], state: Mapping[str, Any]) -> dict[str, Any]:
    changes = {key: value for key, value in state.items() if key not in before or before[key] != value}
    if _ITEMS_FIELD in changes:
        known = {body["id"]: body for body in before[_ITEMS_FIELD]}
        changes[_ITEMS_FIELD] = [body for body in state[_ITEMS_FIELD] if known.get(body["id"]) != body]
        ids = [body["id"] for body in state[_ITEMS_FIELD]]
        if ids != list(known):
            changes["item_ids"] = ids
    return changes
