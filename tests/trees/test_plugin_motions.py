"""Motions that a plug-in calls without `yield from`: found in its text, and when they happen."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from textwrap import indent

import pytest

from picktree.files import FileError
from picktree.trees import NodeStatus
from picktree.world import remedy_of

from .scripted import run_of
from .waving import WAVE, forgotten, mission

LINE = 13
"""Line of `run`'s body in the plug-in."""
MORE = """
    def lift(self, world):
        yield

def helper(world):
    yield

def plain(world):
    return 1
"""


@pytest.fixture(autouse=True)
def alone() -> Iterator[None]:
    with forgotten():
        yield


def write(folder: Path, body: str) -> None:
    source = WAVE.replace("        yield\n", indent(body, "        ") + "\n" + MORE)
    (folder / "wave.py").write_text(source)


@pytest.mark.parametrize(
    ("body", "calls"),
    [
        ("world.gripper.open()\nyield", "world.gripper.open"),
        ("world.move.along(None, guard=3.0)\nyield", "world.move.along"),
        ("self.lift(world)\nyield", "self.lift"),
        ("helper(world)\nyield", "helper"),
        ("yield world.gripper.close(force=3.0)", "world.gripper.close"),
        ("felt = world.move.guarded((0, 0, -1), 0.1, force=3.0)\nyield", "world.move.guarded"),
        ("if not world.gripper.close(force=3.0):\n    yield", "world.gripper.close"),
        ("if world.move.guarded((0, 0, -1), 0.1, force=3.0).contact:\n    yield", "world.move.guarded"),
        ("done = world.move.jog(None)\nif done.failure() is not None:\n    yield", "world.move.jog"),
        ("done = world.move.jog(None)\nkept = [done]\nif done.failure():\n    yield", "world.move.jog"),
        ("done = world.gripper.close(force=3.0)\nwhile not done:\n    yield", "world.gripper.close"),
        ("if (met := world.move.guarded((0, 0, -1), 0.1)).contact:\n    yield", "world.move.guarded"),
        ("one, two = helper(world)\nyield", "helper"),
        ("return world.gripper.open()\nyield", "world.gripper.open"),
        ("self.note('said', helper(world))\nyield", "helper"),
        ("self.note(kind='said', message=helper(world))\nyield", "helper"),
        ("if bool(helper(world)):\n    yield", "helper"),
        ("self.times = 1 if world.gripper.open() else 2\nyield", "world.gripper.open"),
        ("text = f'{helper(world)}'\nyield", "helper"),
        ("self.lift(world) or helper(world)\nyield", "self.lift"),
    ],
)
def test_a_motion_that_goes_nowhere_is_a_fault_with_its_line(tmp_path: Path, body: str, calls: str) -> None:
    write(tmp_path, body)
    with pytest.raises(FileError) as caught:
        mission(tmp_path, "{Main: AlwaysSuccess}")
    (fault,) = caught.value.faults
    assert (fault.code, str(fault).removeprefix(f"{tmp_path}/m.yaml:3:11: ")) == (
        "P261",
        f"plugins[0]: the plug-in 'wave.py', line {LINE}: Wave.run calls {calls} without 'yield from', so "
        f"that it does nothing (write 'yield from {calls}(…)')",
    )


def test_further_lines_are_named(tmp_path: Path) -> None:
    write(tmp_path, "self.lift(world)\nyield\nhelper(world)\nworld.gripper.open()")
    with pytest.raises(FileError) as caught:
        mission(tmp_path, "{Main: AlwaysSuccess}")
    assert str(caught.value).endswith(
        f"line {LINE}: Wave.run calls self.lift without 'yield from', so that it does nothing; lines "
        f"{LINE + 2}, {LINE + 3}, too (write 'yield from self.lift(…)')"
    )


@pytest.mark.parametrize(
    "body",
    [
        "yield from world.gripper.open()",
        "felt = yield from world.move.guarded((0, 0, -1), 0.1, force=3.0)\nif felt.contact:\n    yield",
        "part = self.lift(world)\nyield from part",
        "for _ in helper(world):\n    yield",
        "plain(world)\nworld.journal.note(None)\nyield",
        "parts = [self.lift(world), helper(world)]\nfor part in parts:\n    yield from part",
        "part = helper(world)\nnext(part)\npart.close()\nyield",
        "yield from self.lift(world) if self.times else helper(world)",
        "part = helper(world)\nif part is not None:\n    yield from part",
        "part = helper(world)\nself.kept = part\nyield",
        "part = None\nfor _ in (0, 1):\n    part = helper(world)\n    yield from part",
        "done = self.lift(world)\ndone = yield from done\nyield done.failure() if done else None",
        "def inner():\n    return helper(world)\nyield from inner()",
        "print(helper(world), list(self.lift(world)))\nyield",
        "both = lambda one, two: one\nyield from both(helper(world), self.lift(world))",
        "self.part = helper(world)\nyield from self.part",
        "return helper(world)",
    ],
)
def test_motions_that_are_carried_out_are_no_fault(tmp_path: Path, body: str) -> None:
    write(tmp_path, body)
    assert mission(tmp_path).main.name == "Main"


@pytest.mark.parametrize(
    ("body", "motion", "ahead"),
    [
        ("for part in (self.lift, helper):\n    part(world)\nyield", "part", 1),
        ("open_hand = self.lift\nopen_hand(world)\nyield", "open_hand", 1),
        ("yield\nyield {'a': self.lift}['a'](world)", "{'a': self.lift}['a']", 1),
    ],
)
def test_what_the_text_does_not_show_fails_the_node_when_it_happens(
    tmp_path: Path, body: str, motion: str, ahead: int
) -> None:
    write(tmp_path, body)
    run = run_of(mission(tmp_path))
    assert run.to_end()[-1] is NodeStatus.FAILURE
    report = run.failure
    assert report.cause.name == "internal.error"
    assert report.message == (
        f"UnstartedMotion while Wave was ticked: {motion} is called without 'yield from', so that it does "
        f"nothing (wave.py, line {LINE + ahead})"
    )


def test_an_unstarted_motion_of_another_name_is_named_with_the_line_that_uses_it(tmp_path: Path) -> None:
    write(tmp_path, "jog = self.lift\ndone = jog(world)\nif done.failure():\n    yield")
    run = run_of(mission(tmp_path))
    assert run.to_end()[-1] is NodeStatus.FAILURE
    report = run.failure
    assert report.evidence["plugin_line"] == f"wave.py, line {LINE + 2}"
    assert report.message == (
        "AttributeError while Wave was ticked: 'generator' object has no attribute 'failure': a motion gives "
        f"its result to 'yield from' only (wave.py, line {LINE + 2})"
    )
    assert remedy_of(report.cause, report.evidence).startswith(f"mend wave.py, line {LINE + 2};")


def test_what_is_called_for_its_effect_goes_on(tmp_path: Path) -> None:
    write(tmp_path, "seen = []\nfor call in (seen.append, seen.append):\n    call(plain(world))\nyield")
    assert run_of(mission(tmp_path)).to_end()[-1] is NodeStatus.SUCCESS
