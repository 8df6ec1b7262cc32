"""How good a plan is, against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from picktree.robot.planning import NamedGoal, OffsetGoal, PoseGoal, Request
from picktree.world import Box, Plan, Pose

from .motion_cell import HOME, MODEL, Cell, down, item, run, table_scene


def test_the_nearest_is_what_the_scene_was_built_for() -> None:
    # The tips, 7.2 mm ahead of the TCP, stop 20 mm over the block.
    cell = Cell(table_scene(item("block", Box((0.1, 0.3, 0.1)), Pose((0.5, 0.0, 0.05)))))
    plan, _ = run(cell.plan.to(PoseGoal((down(0.5, 0.0, 0.1272),))))
    quality = cell.plan.quality(plan)
    assert quality.nearest is not None
    assert quality.nearest.contact.b == "block"
    assert quality.nearest.contact.a in ("panda_leftfinger", "panda_rightfinger")
    assert quality.nearest.contact.distance == pytest.approx(0.02, abs=2e-4)
    assert quality.nearest.at == pytest.approx(plan.trajectory.duration, abs=0.05)
    with cell.scene.allow(("gripper", "block"), ("arm", "block")):
        other = cell.plan.quality(plan).nearest
    assert other is not None and other.contact.b != "block"


def test_nothing_is_nearer_by_the_naive_test() -> None:
    cell = Cell(table_scene(item("block", Box((0.1, 0.1, 0.3)), Pose((0.45, 0.3, 0.15)))))
    plan, _ = run(cell.plan.to(NamedGoal("observe")))
    quality = cell.plan.quality(plan)
    cell.plan.solver.look(Request(NamedGoal("observe"), clearance=0.5))
    each = [cell.plan.solver.collision.contacts(q) for q in plan.trajectory.position[::4]]
    links = {frame.name for frame in MODEL.full.frames}
    around = min(c.distance for contacts in each for c in contacts if c.b not in links)
    itself = min(c.distance for contacts in each for c in contacts if c.b in links)
    assert quality.nearest is not None and quality.itself is not None
    assert quality.nearest.contact.distance == pytest.approx(around, abs=1e-3)
    assert quality.itself.contact.distance == pytest.approx(itself, abs=1e-3)


def test_lengths_singularity_and_the_joint_nearest_to_its_limit() -> None:
    cell = Cell(table_scene())
    plan, _ = run(cell.plan.line(OffsetGoal((0.0, 0.2, -0.1))))
    quality = cell.plan.quality(plan)
    assert quality.way == pytest.approx(np.hypot(0.2, 0.1), abs=1e-4)
    assert quality.duration == plan.trajectory.duration
    q = plan.trajectory.position
    assert quality.length == pytest.approx(np.linalg.norm(np.diff(q, axis=0), axis=1).sum())
    room = np.minimum(q - MODEL.lower, MODEL.upper - q).min(axis=0)
    assert quality.joint.joint == MODEL.description.joints[int(room.argmin())]
    assert quality.joint.room == pytest.approx(room.min())
    least = min(np.linalg.svd(MODEL.jacobian(one), compute_uv=False)[-1] for one in q)
    assert quality.singular == pytest.approx(least, abs=5e-3)


def test_a_chain_is_as_good_as_its_legs_together() -> None:
    cell = Cell(table_scene())
    legs = [Request(PoseGoal((down(0.5, -0.2, 0.3),))), Request(OffsetGoal((0.0, 0.0, -0.1)))]
    plan, _ = run(cell.plan.through(legs))
    quality = cell.plan.quality(plan)
    assert quality.duration == pytest.approx(plan.trajectory.duration, abs=0.05)
    q = plan.trajectory.position
    assert quality.length == pytest.approx(np.linalg.norm(np.diff(q, axis=0), axis=1).sum(), rel=0.02)
    assert quality.nearest is not None and quality.nearest.at > plan.passes[0]


def test_the_journal_has_it_and_the_plan_says_what_it_was_for() -> None:
    cell = Cell(table_scene())
    request = Request(NamedGoal("observe"), clearance=0.01)
    plan, _ = run(cell.plan.solve(request))
    (noted,) = [note for note in cell.journal.take() if isinstance(note, Plan)]
    quality = cell.plan.quality(plan)
    assert noted.request == "to observe, 10 mm clear"
    assert noted.length == pytest.approx(quality.length)
    assert noted.way == pytest.approx(quality.way, rel=0.01)
    assert noted.singular == pytest.approx(quality.singular, abs=5e-3)
    assert noted.start == tuple(HOME)
    assert plan.request is not None and plan.request.start is not None
    np.testing.assert_array_equal(plan.request.start, HOME)
    assert plan.version == noted.version == cell.scene.version
