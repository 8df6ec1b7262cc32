"""How deep items were in a fixture with holes: which contacts count, how often, and for how long."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest

from picktree.simulation.physics.contacts import Penetrations
from picktree.world import ObjectId

ITEM, OTHER = ObjectId("item_00"), ObjectId("item_01")
BOARD, TABLE = 7, 3
"""Body numbers of the engine; the items have 10 and 11."""


@dataclass
class Engine:
    """As much of pybullet as is asked: contacts of bodies as (body, other, distance), m."""

    contacts: list[tuple[int, int, float]] = field(default_factory=list[tuple[int, int, float]])
    """Kept since the last step."""
    near: list[tuple[int, int, float]] = field(default_factory=list[tuple[int, int, float]])
    """By the shapes themselves."""

    def getContactPoints(self, number: int, **_: Any) -> list[tuple[Any, ...]]:  # noqa: N802
        return [(0, a, b, *[0] * 5, d) for a, b, d in self.contacts if a == number]

    def getAABB(self, number: int, *_: Any) -> tuple[int, int]:  # noqa: N802
        return number, number

    def getOverlappingObjects(self, low: int, _: int, **__: Any) -> list[tuple[int, int]]:  # noqa: N802
        return [(b, -1) for a, b, _ in self.near if a == low]

    def getClosestPoints(self, number: int, body: int, within: float, **_: Any) -> list[tuple[Any, ...]]:  # noqa: N802
        found = [(a, b, d) for a, b, d in self.near if (a, b) == (number, body) and d <= within]
        return [(0, a, b, *[0] * 5, d) for a, b, d in found]


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> Engine:
    made = Engine()
    monkeypatch.setattr("picktree.simulation.physics.contacts.pb", made)
    return made


def watching(every: int = 1) -> Penetrations:
    made = Penetrations(0)
    made.every = every
    made.watch({ITEM: 10, OTHER: 11}, [BOARD])
    return made


def test_the_deepest_contact_with_a_fixture_that_has_holes_counts(engine: Engine) -> None:
    watch = watching()
    engine.contacts = [(10, BOARD, -0.0002), (10, BOARD, -0.0005), (10, BOARD, 0.001), (10, TABLE, -0.009)]
    watch.stepped(0.1)
    assert watch.greatest == {ITEM: 0.0005}
    assert (watch.of(ITEM), watch.of(OTHER)) == (0.0005, 0.0)
    engine.contacts = [(10, BOARD, -0.0001), (11, BOARD, 0.001)]
    watch.stepped(0.2)
    assert watch.greatest == {ITEM: 0.0005, OTHER: 0.0}


def test_what_lasts_is_what_two_looks_in_a_row_have_seen(engine: Engine) -> None:
    watch = watching()
    for time, depth in enumerate((0.004, 0.0, 0.002, 0.003, 0.001, 0.0)):
        engine.contacts = [(10, BOARD, -depth)] if depth else []
        watch.stepped(0.01 * time)
    assert (watch.lasting[ITEM], watch.greatest[ITEM]) == (0.002, 0.004)
    assert watch.lasting[OTHER] == 0.0


def test_it_is_forgotten_a_second_after_it_was_last_touched(engine: Engine) -> None:
    watch = watching()
    engine.contacts = [(10, BOARD, -0.004)]
    watch.stepped(1.0)
    engine.contacts = [(10, BOARD, -0.001)]
    watch.stepped(1.999)
    assert watch.of(ITEM) == 0.004
    watch.stepped(2.001)
    assert watch.of(ITEM) == 0.001
    assert watch.greatest[ITEM] == 0.004


def test_it_is_looked_every_so_many_steps(engine: Engine) -> None:
    watch = Penetrations(0)
    watch.watch({ITEM: 10}, [BOARD])
    engine.contacts = [(10, BOARD, -0.004)]
    for step in range(1, 13):
        watch.stepped(0.001 * step)
        assert (watch.of(ITEM) > 0.0) is (step == 12), step


def test_the_shapes_themselves_are_asked_as_well(engine: Engine) -> None:
    watch = watching()
    engine.near = [(10, BOARD, -0.003), (10, TABLE, -0.009), (11, BOARD, 0.001)]
    assert (watch.of(ITEM), watch.of(OTHER)) == (0.003, 0.0)


def test_another_watch_begins_anew_and_without_fixtures_nothing_is_looked_at(engine: Engine) -> None:
    watch = watching()
    engine.contacts = [(10, BOARD, -0.004)]
    watch.stepped(0.1)
    watch.stepped(0.2)
    watch.watch({ITEM: 10}, [BOARD])
    assert (watch.of(ITEM), watch.greatest, watch.lasting) == (0.0, {}, {})
    watch.stepped(0.3)
    assert watch.lasting == {ITEM: 0.0}
    watch.watch({ITEM: 10}, [])
    watch.stepped(0.4)
    assert (watch.greatest, watch.lasting) == ({}, {})
