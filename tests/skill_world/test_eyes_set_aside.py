"""What a look recognises anew: changed and doubted items, and with `fresh` all that are not set aside."""

from __future__ import annotations

from dataclasses import replace

import pytest

from picktree.robot.perception import LABEL_NAMES
from picktree.robot.perception.item_fitting import ItemFitter
from picktree.robot.perception.segmentation import Blob

from .test_eyes_missing import cell, driven


def test_a_look_recognises_what_is_new_doubted_or_wanted_fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    world, recognised, explain = cell("x"), list[str](), ItemFitter.explain

    def noting(self: ItemFitter, blob: Blob, *arguments: object) -> object:
        recognised.append(LABEL_NAMES[blob.patch.label])
        return explain(self, blob, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(ItemFitter, "explain", noting)
    first = driven(world, world.vision.observe("overhead"))
    given_up, *others = (world.scene.get(name) for name in first.seen)
    assert sorted(recognised) == sorted(one.colour for one in (given_up, *others))
    world.scene.put(replace(given_up, place="aside"), "set aside")
    recognised.clear()
    world.control.step_tick(1.0)
    second = driven(world, world.vision.observe("overhead"))
    assert sorted(second.seen) == sorted(first.seen)
    assert world.scene.get(given_up.id).place == "aside"
    assert recognised == []
    for doubted in (given_up, others[0]):
        world.attempts.failed("Grasp", doubted.id, "from above")
    world.control.step_tick(1.0)
    driven(world, world.vision.observe("overhead"))
    assert recognised == [others[0].colour]
    recognised.clear()
    world.control.step_tick(1.0)
    driven(world, world.vision.observe("overhead", fresh=True))
    assert sorted(recognised) == sorted(one.colour for one in others)
