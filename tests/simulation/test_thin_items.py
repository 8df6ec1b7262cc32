"""Thin items that fall into a bin come to rest on its floor."""

from __future__ import annotations

from dataclasses import replace

import pytest

from picktree.simulation.physics import PhysicsHardware
from picktree.world import Box
from picktree.world.scene import CatalogueEntry, Spawn

from .simulated_cell import cell, panda

CARDS = 6
CARD = CatalogueEntry("card", "plate", Box((0.06, 0.04, 0.004)), 0.012, 0.5)


@pytest.mark.parametrize("height", [0.13, 0.3])
def test_thin_items_do_not_fall_through_the_floor_of_a_bin(height: float) -> None:
    spawn = Spawn({CARD.kind: CARDS}, ("red",), ((0.35, -0.25), (0.65, 0.25)))
    hardware = PhysicsHardware(cell(catalogue=(CARD,), spawn=(spawn,)), panda(), 4)
    saved = hardware.checkpoint()
    x, y, _ = hardware.scene.bins[0].pose.position
    grid = [(x + 0.07 * (k % 3 - 1), y + 0.06 * (k // 3) - 0.03) for k in range(CARDS)]
    fallen = tuple(
        replace(state, position=(*at, height + 0.007 * k), asleep=False)
        for k, (state, at) in enumerate(zip(saved.items, grid, strict=True))
    )
    hardware.restore(replace(saved, items=fallen))
    for _ in range(480):
        hardware.step()
    lowest = min(body.pose.position[2] for body in hardware.truth())
    assert lowest == pytest.approx(hardware.scene.bins[0].wall + 0.002, abs=1e-4)
