"""Items that were believed elsewhere all the time: by what the belief came to that place."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from picktree.analysis.explain import FailureStory
from picktree.analysis.explain.case import Investigation
from picktree.analysis.explain.device_causes import cameras_off
from picktree.analysis.explain.explanation import DeviceFinding, Finding
from picktree.analysis.explain.held_items import HeldPeriod, held_periods
from picktree.analysis.explain.item_causes import explain_misjudged_place
from picktree.world import Pose

ITEM = "red_ball_1"
OFF = DeviceFinding(
    Finding("camera.off", "the camera overhead", "it hangs elsewhere", (), "", 1.0), ((1.0, 2.0),), ()
)


def case(*, held: tuple[HeldPeriod, ...], off: tuple[DeviceFinding, ...]) -> Investigation:
    """A ball that was seen 4 cm off at 1 s, and given up at 6 s."""
    believed = SimpleNamespace(pose=Pose((0.5, 0.04, 0.02)), last_seen=1.0, attached=False)
    lies = SimpleNamespace(pose=Pose((0.5, 0.0, 0.02)))
    answers = {held_periods: held, cameras_off: off}
    told = {
        "pairs": {ITEM: "item_00"},
        "belief": SimpleNamespace(tracks={ITEM: SimpleNamespace(before=lambda _: believed)}),
        "truth": SimpleNamespace(at=lambda *_: lies),
        "changes": lambda *_, **__: [SimpleNamespace(time=6.0)],
        "visit": lambda _: SimpleNamespace(start=9.0),
        "identities": SimpleNamespace(by_item={ITEM: [SimpleNamespace(time=1.0, off=(0.0, -0.04))]}),
        "once": lambda question: answers[question],
        "sampled": 0.05,
    }
    return cast("Investigation", SimpleNamespace(**told))


@pytest.mark.parametrize(
    ("held", "off", "cause"),
    [
        ((HeldPeriod(ITEM, "item_00", 3.0, 5.0, None),), (), "item.fell_elsewhere"),
        # What was never in the hand was not let go, though the belief has changed since it was seen.
        ((), (), "perception.misjudged"),
        ((HeldPeriod("blue_can_1", "item_01", 3.0, 5.0, None),), (), "perception.misjudged"),
        ((), (OFF,), "camera.off"),
    ],
)
def test_an_item_that_lay_elsewhere_was_let_go_or_seen_wrongly(
    held: tuple[HeldPeriod, ...], off: tuple[DeviceFinding, ...], cause: str
) -> None:
    failure = SimpleNamespace(cause="world.unknown_object", item=ITEM, time=10.0)
    found = explain_misjudged_place(case(held=held, off=off), cast("FailureStory", failure))
    assert found is not None
    assert found.cause == cause
