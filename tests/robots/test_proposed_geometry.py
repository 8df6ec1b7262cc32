"""Proposals from meshes: pads within the fingers, the direction out of a hand, hulls, and home."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from picktree.apps.commissioning import ProposalRequest, propose
from picktree.apps.commissioning.base_pose import YAWS, places
from picktree.apps.commissioning.link_geometry import MAX_STICK_OUT
from picktree.apps.commissioning.proposal import Proposal
from picktree.robot.planning import InverseKinematics
from picktree.world import Array, Box, Pose, corners
from picktree.world.robot_model import RobotModel

from .arms import mini

TIP, ROOT = (-0.004, 0.010), (-0.03, 0.03)
"""Ends of a finger along x at its tip and at its root, m: the tip is beside the middle."""


OFFSET_WRIST = (
    ('<origin xyz="0 0 0.4"/>', '<origin xyz="0 0 0.25"/>'),
    ('<origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>', '<origin xyz="0 0 0.22"/><axis xyz="0 1 0"/>'),
    ('<origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>', '<origin xyz="0 0.08 0"/><axis xyz="0 0 1"/>'),
    ('<origin xyz="0 0 0.065"/><axis xyz="0 0 1"/>', '<origin xyz="0 0 0.12"/><axis xyz="0 1 0"/>'),
    (
        '<child link="hand"/><origin xyz="0 0 0.03"',
        '<child link="hand"/><origin xyz="0 0.03 0" rpy="-1.5708 0 0"',
    ),
    (
        '"0 0.09 0.2"/><geometry><box size="0.08 0.06 0.46"',
        '"0 0.12 0.125"/><geometry><box size="0.08 0.06 0.31"',
    ),
    ('"0 0 0.15"/><geometry><box size="0.08 0.06 0.36"', '"0 0 0.11"/><geometry><box size="0.06 0.06 0.22"'),
    ('"0 0 0.05"/><geometry><box size="0.07 0.07 0.12"', '"0 0.04 0"/><geometry><box size="0.06 0.06 0.06"'),
    ('"0 0 0.015"/><geometry><box size="0.06 0.06 0.03"', '"0 0.01 0"/><geometry><box size="0.05 0.02 0.05"'),
    ('lower="-2.9" upper="2.9"', 'lower="-6.2" upper="6.2"'),
    ('lower="-2.2" upper="2.2"', 'lower="-6.2" upper="6.2"'),
)
"""Three parallel axes and a wrist of three offsets, as many collaborative arms have: turned over, the wrist
reaches less far."""


def proposed(folder: Path, *edits: tuple[str, str], samples: int = 100) -> Proposal:
    (folder / "mini.urdf").write_text(mini(*edits), encoding="utf-8")
    return propose(ProposalRequest(str(folder / "mini.urdf"), folder / "mini.yaml", samples=samples))


def wedge(side: float) -> trimesh.Trimesh:
    """A finger that becomes narrower and thinner towards its tip; its face is at y = 0."""
    root = [(x, y * side, 0.0) for x, y in product(ROOT, (0.0, 0.025))]
    tip = [(x, y * side, 0.06) for x, y in product(TIP, (0.0, 0.005))]
    return trimesh.convex.convex_hull(np.array(root + tip))


def outside(points: Array, boxes: tuple[tuple[Box, Pose], ...]) -> float:
    """How far the corners of boxes are outside of the hull of points at most, m."""
    planes = ConvexHull(points).equations
    found = np.concatenate([pose.apply(corners(box)) for box, pose in boxes])
    return float((found @ planes[:, :3].T + planes[:, 3]).max())


def test_pads_and_bodies_of_tapered_fingers_are_within_the_fingers(tmp_path: Path) -> None:
    meshes = {"left": wedge(1.0), "right": wedge(-1.0)}
    edits: list[tuple[str, str]] = []
    for name, mesh in meshes.items():
        mesh.export(tmp_path / f"{name}.stl")
        at = f"0 {0.006 if name == 'left' else -0.006} 0.025"
        edits.append(
            (
                f'<origin xyz="{at}"/><geometry><box size="0.02 0.012 0.05"/></geometry>',
                f'<geometry><mesh filename="{name}.stl"/></geometry>',
            )
        )
    gripper = proposed(tmp_path, *edits).draft.gripper
    for n, mesh in enumerate(meshes.values()):
        boxes = (gripper.pads[n], *gripper.finger_bodies[n::2])
        # The planner takes the hull; a pad beyond it would hit what the planner passes.
        assert outside(np.asarray(mesh.vertices), boxes) <= MAX_STICK_OUT + 1e-6
        width, depth, length = gripper.pads[n][0].size
        assert (width > 0.01, depth >= 0.004, length >= 0.03) == (True, True, True)
    # The pads grip where the tips are, beside the middle of the roots.
    assert gripper.tcp_in_palm.position[0] == pytest.approx(sum(TIP) / 2, abs=2e-3)


@pytest.mark.parametrize("beside", [0.0, 0.02, 0.045])
def test_a_one_sided_hand_grips_along_the_last_axis(beside: float, tmp_path: Path) -> None:
    hand = (
        '"0 0 0.03"/><geometry><box size="0.05 0.2 0.06"',
        f'"{beside} 0 0.03"/><geometry><box size="0.05 0.2 0.06"',
    )
    gripper = proposed(tmp_path, hand).draft.gripper
    assert gripper.tcp_in_palm.rotation()[:, 2] == pytest.approx([0, 0, 1], abs=1e-9)


@pytest.mark.parametrize(("beside", "reason"), [(0.10, "hulls"), (0.08, None)])
def test_links_of_which_only_the_hulls_collide_need_no_check(
    beside: float, reason: str | None, tmp_path: Path
) -> None:
    # A plate on the forearm is beside the wrist. Between both is a gap, which the hull fills.
    plate = trimesh.creation.box(
        (0.01, 0.06, 0.2), trimesh.transformations.translation_matrix((beside, 0, 0.29))
    )
    arm = trimesh.creation.box((0.08, 0.06, 0.36), trimesh.transformations.translation_matrix((0, 0, 0.15)))
    trimesh.util.concatenate([arm, plate]).export(tmp_path / "l3.stl")
    mesh = (
        '<origin xyz="0 0 0.15"/><geometry><box size="0.08 0.06 0.36"/>',
        '<geometry><mesh filename="l3.stl"/>',
    )
    made = proposed(tmp_path, mesh, samples=400)
    assert made.draft.collision is not None
    reasons = {(p.first, p.second): p.reason for p in made.draft.collision.disabled}
    assert reasons.get(("l3", "l5")) == reason
    assert (("l3", "l5") in made.robot.disabled_pairs) == (reason is not None)


def test_from_home_no_elbow_or_wrist_turns_over_on_the_way_to_items_and_bins(tmp_path: Path) -> None:
    made = proposed(tmp_path, *OFFSET_WRIST)
    model, generator = RobotModel(made.robot), np.random.default_rng(0)
    home = np.array(made.draft.poses[0].joints)
    assert made.draft.poses[0].comment == "Tool pointing down, in front of the first joint."
    kinematics = InverseKinematics(model)
    for place in places():
        x, y, z = place.position.tolist()
        ends = [
            end
            for yaw in YAWS
            for end in kinematics.solutions(Pose.from_rpy((x, y, z), (np.pi, 0.0, yaw)), generator, home, 8)
        ]
        assert min(float(np.abs(end - home)[1:-1].max()) for end in ends) < 2.0, place.name
