"""An edited mission goes on in the middle of a recovery."""

from __future__ import annotations

import pytest

from ..trees.scripted import Run
from .test_recover import start

BEFORE = """\
attempts: 4
do: {Scripted: {name: Do, script: grasp.missed}}
when:
  grasp.missed: [{Repeat: {num_cycles: 2, do: {Scripted: {name: Look}}}}]
otherwise: [{Scripted: {name: Else}}]
"""


def edited(after: str, ticks: int) -> Run:
    old = start(BEFORE)
    for _ in range(ticks):
        old.tick()
    new = start(after, old.world)
    new.tree.adopt(old.tree.save())
    new.world.trace.clear()
    new.to_end()
    return new


def starts(run: Run) -> str:
    return " ".join(line.removeprefix("start ") for line in run.trace if line.startswith("start "))


WHOLE = "Look Look Do Look Look Do Look Look Do"
"""After the first failure, with four attempts."""


@pytest.mark.parametrize(
    ("after", "expected"),
    [
        (BEFORE, WHOLE),
        (BEFORE.replace("attempts: 4", "attempts: 2"), "Look Look Do"),
        (BEFORE.replace("when:", "when:\n  grasp.slipped: [{Scripted: {name: New}}]"), WHOLE),
        (BEFORE.replace("Look", "Gaze"), WHOLE.replace("Look", "Gaze")),
        # The cure that ran is gone: the recovery begins anew, with all its attempts.
        (BEFORE.replace("grasp.missed: [", "grasp.slipped: ["), "Do Else Do Else Do Else Do"),
    ],
)
def test_it_goes_on_with_the_cure_that_ran(after: str, expected: str) -> None:
    assert starts(edited(after, ticks=1)) == expected


def test_the_causes_so_far_stay_attached() -> None:
    run = edited(BEFORE, ticks=4)
    assert len(run.tree.failure.attached) == 3
