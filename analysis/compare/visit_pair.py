"""Pair of visits: the same visit in two runs, and the aspects in which it differs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias, cast

from ...logs.visits import Visit

TIME_TOLERANCE: Final = 1e-6
"""Difference below which two times are equal, s."""

Aspect: TypeAlias = Literal["type", "inputs", "outcome", "cause", "length"]


@dataclass(frozen=True, slots=True)
class VisitPair:
    """Same visit in both runs, each with the item, path and times of its own run."""

    a: Visit
    b: Visit
    differs: tuple[Aspect, ...]
    """Aspects that differ, apart from the start time."""


def differences(a: Visit, b: Visit, items: Mapping[str, str], *, resumed: bool) -> tuple[Aspect, ...]:
    """Return the aspects in which two visits differ.

    `items`: ids in A of the objects of B. `resumed`: one of the visits had begun before the comparison, so
    its inputs are unknown. A visit that is cut off by the end of its log differs only when the other one had
    ended by that time.
    """
    found: list[Aspect] = []
    if a.id != b.id:
        found.append("type")
    if not resumed and a.inputs != {port: renamed(value, items) for port, value in b.inputs.items()}:
        found.append("inputs")
    if "RUNNING" in (a.outcome, b.outcome):
        open_, other = (a, b) if a.outcome == "RUNNING" else (b, a)
        if other.outcome != "RUNNING" and other.end - other.start < open_.end - open_.start - TIME_TOLERANCE:
            found.append("length")
        return tuple(found)
    if a.outcome != b.outcome:
        found.append("outcome")
    if (a.cause, a.origin == a.path) != (b.cause, b.origin == b.path):
        found.append("cause")
    if abs(a.duration - b.duration) > TIME_TOLERANCE:
        found.append("length")
    return tuple(found)


def renamed(value: object, names: Mapping[str, str]) -> object:
    """Return the value with each text that is a name in `names` replaced, also in lists and mappings.

    >>> renamed(["red_ball_1", {"object": "red_ball_2"}], {"red_ball_1": "red_ball_2", "red_ball_2": "x"})
    ['red_ball_2', {'object': 'x'}]
    """
    if isinstance(value, str):
        return names.get(value, value)
    if isinstance(value, list):
        return [renamed(one, names) for one in cast("list[object]", value)]
    if isinstance(value, dict):
        return {key: renamed(one, names) for key, one in cast("dict[str, object]", value).items()}
    return value
