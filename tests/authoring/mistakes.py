"""Mistakes in what a file says, as hypothesis draws them: a value, a key, a level too much or too little."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, cast

from hypothesis import strategies as st

Value: TypeAlias = Any
"""What JSON can hold."""
VALUES: tuple[Value, ...] = (
    None, True, 0, 1, -1, 2.5, 1e9, "", "x", "{item}", "{item.colour}", "{item.foo}", "{a b}", "30 mm",
    "5 deg", "20 N", "-3 s", "2", "home", "before", "any", "holding", "a := 1", [], {},
    [1, 2, 3], ["x"], {"x": 1}, "Grasp", "GoTo", {"GoTo": {}}, {"GoTo": None}, ["GoTo"],
    [{"Grasp": {"object": "{x}"}}], {"GoTo": []},
)  # fmt: skip


@dataclass(frozen=True)
class Change:
    """One mistake: `at` picks the place, `pick` the word or value."""

    what: Literal["replace", "drop", "rename", "add", "wrap"]
    at: int
    pick: int
    raw: bool


CHANGES = st.builds(
    Change,
    st.sampled_from(["replace", "drop", "rename", "add", "wrap"]),
    st.integers(0, 10_000),
    st.integers(0, 10_000),
    st.booleans(),
)


def changed(data: Value, change: Change, words: tuple[str, ...]) -> None:
    """Make the mistake in the data."""
    places = [path for path in paths(data) if path and path[0] not in ("picktree", "kind")]
    if not places:
        return
    path = places[change.at % len(places)]
    parent = _get(data, path[:-1])
    key = path[-1]
    words = (*words, f"{key}x", f"_{key}", str(key).lower())
    word = words[change.pick % len(words)]
    value = copy.deepcopy(VALUES[change.pick % len(VALUES)]) if change.raw else word
    match change.what:
        case "replace":
            parent[key] = value
        case "drop":
            parent.pop(key)
        case "rename" if isinstance(parent, dict):
            mapping = cast("dict[str, Value]", parent)
            renamed = {word if name == key else name: below for name, below in mapping.items()}
            mapping.clear()
            mapping.update(renamed)
        case "add" if isinstance(parent, dict):
            parent[word] = value
        case "add":
            parent.insert(0, value)
        case _:
            parent[key] = [parent[key]] if change.raw else {word: parent[key]}


def paths(data: Value, above: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    yield above
    if isinstance(data, dict):
        for key, below in cast("dict[str, Value]", data).items():
            yield from paths(below, (*above, key))
    elif isinstance(data, list):
        for number, below in enumerate(cast("list[Value]", data)):
            yield from paths(below, (*above, number))


def _get(data: Value, path: tuple[str | int, ...]) -> Value:
    for part in path:
        data = data[part]
    return data
