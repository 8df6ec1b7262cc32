"""The facts of the world: what is declared of them is what they are."""

from __future__ import annotations

import pytest

from picktree.world import PlanningScene, facts
from picktree.world.world_facts import FACTS


@pytest.mark.parametrize("looked", [True, False])
def test_names_and_types_are_as_declared(looked: bool) -> None:
    found = facts(PlanningScene((), ()), looked=looked, stopped=False, exhausted=True, done=3, now=1.5)
    assert {name: type(value) for name, value in found.items()} == FACTS
    assert found["items_left"] is not looked
