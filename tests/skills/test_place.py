"""Place: what it does when the object does not come off the hand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from picktree.world.simulation.kinematic import KinematicHardware

from .cell import Cell, items, mission

LOOK = 'Observe: {camera: overhead, objects: "{items}"}'


def holding() -> tuple[Cell, KinematicHardware, str]:
    """A cell whose hand holds its block above the table."""
    cell = Cell(mission(LOOK), items(block=1))
    cell.finish()
    (block,) = (str(o.id) for o in cell.world.scene.objects)
    cell.start(mission(f"Grasp: {{object: {block}, onward: false}}"))
    cell.finish()
    assert cell.tree.failure is None
    assert isinstance(cell.hardware, KinematicHardware)
    return cell, cell.hardware, block


@pytest.mark.parametrize("where", ["into: red_bin", "at: [0.5, 0.2, 0]"])
def test_what_sticks_to_the_opened_fingers_was_not_placed(
    where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell, hardware, block = holding()
    monkeypatch.setattr(hardware.bodies, "let_go", lambda: None)
    cell.start(mission(f"Place: {{object: {block}, {where}}}"))
    cell.finish()
    failure = cell.tree.failure
    assert failure is not None
    assert (str(failure.cause), failure.message) == (
        "place.missed",
        f"{block} still hangs on the open fingers (load 0.98 N, then 0.98 N)",
    )
    assert cell.world.grip.width > 0.06
    cell.wait()
    held = cell.world.scene.held
    assert held is not None
    assert (held.id, held.place) == (block, "hand")
    assert cell.happened("item_done") == []
    (body,) = hardware.truth()
    assert held.pose.distance(body.pose) < 0.003


@pytest.mark.parametrize(("left", "placed"), [(0.45, True), (0.55, False)])
def test_half_of_the_load_must_be_gone(left: float, placed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what breaks when the fingers open, a part stays at them: the lighter one counts as rubbish."""
    cell, hardware, block = holding()
    (body,) = hardware.bodies.items

    def break_() -> None:
        now = hardware.bodies[body.id]
        hardware.bodies.put(replace(now, entry=replace(body.entry, mass=left * body.entry.mass)))

    monkeypatch.setattr(hardware.bodies, "let_go", break_)
    cell.start(mission(f"Place: {{object: {block}, into: red_bin}}"))
    cell.finish()
    said = "" if cell.tree.failure is None else cell.tree.failure.message
    assert said == ("" if placed else f"{block} still hangs on the open fingers (load 0.98 N, then 0.54 N)")
    assert (cell.world.scene.held is None) is placed
