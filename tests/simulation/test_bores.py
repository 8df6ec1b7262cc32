"""Boards with holes: their pieces, what goes in and what does not, and how it is measured."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from trimesh import Trimesh

from picktree.simulation import HoledFixtures, HoleSeating, SpawnedItem, displace_fixtures
from picktree.simulation.checkpoints import Checkpoint
from picktree.simulation.physics import Client, PhysicsHardware, add_item, pb
from picktree.simulation.physics.bodies import add_fixed
from picktree.simulation.physics.contacts import Penetrations
from picktree.world import Array, Box, ObjectId, Pose
from picktree.world.hole_geometry import convex_pieces, outline, surface
from picktree.world.robot_model import load_robot
from picktree.world.scene import load_scene, parse_scene

SCENE = """\
picktree: 1
kind: scene
robot: panda
fixtures:
  table: {box: [1.2, 1.6, 0.04], at: [0.5, 0, -0.02]}
  board:
    box: [0.24, 0.16, 0.04]
    at: [0.5, 0.1, 0.02]
    yaw: 30 deg
    holes:
      disc: {round: 31 mm, at: [-70 mm, 20 mm], depth: 30 mm, chamfer: 1 mm}
      square: {square: 31 mm, at: [0, 10 mm], yaw: 20 deg, depth: 30 mm, chamfer: 1 mm}
      slot: {slot: [52 mm, 20 mm], at: [70 mm, -20 mm], yaw: 70 deg, depth: 40 mm}
    uncertainty: {position: 5 mm, angle: 2 deg}
catalogue:
  dowel: {cylinder: {radius: 15 mm, height: 60 mm}, mass: 80 g, friction: 0.5}
  post: {box: [30 mm, 30 mm, 60 mm], mass: 80 g, friction: 0.5}
"""
STEP = 1 / 500
DESCRIPTION = parse_scene(SCENE, Path("scene.yaml"))
BOARD = DESCRIPTION.fixture("board")
ITEM = ObjectId("item_00")


class Bench:
    """A board, and one item that is let go over a hole."""

    def __init__(self, kind: str, off: float = 0.0) -> None:
        self.owner = Client()
        client = self.client = self.owner.id
        pb.setGravity(0, 0, -9.81, physicsClientId=client)
        pb.setTimeStep(STEP, client)
        pb.setPhysicsEngineParameter(numSolverIterations=100, contactERP=0.8, erp=0.8, physicsClientId=client)
        fixed = add_fixed(DESCRIPTION, Pose(), client)
        self.hole = BOARD.holes[0 if kind == "dowel" else 1]
        self.mouth = BOARD.pose @ self.hole.pose
        self.pose = self.mouth @ Pose((off, 0.0, 0.0305))
        entry = DESCRIPTION.entry(kind)
        self.shape = entry.shape
        item = SpawnedItem(ITEM, entry, "red", self.pose, dropped=False)
        self.number = add_item(item, self.pose, client, {})
        self.deep = Penetrations(client)
        self.deep.every = 1
        self.deep.watch({ITEM: self.number}, [n for n, name in fixed.items() if name == "board"])
        self.now = 0.0

    def run(self, seconds: float, force: Array | None = None) -> None:
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            if force is not None:
                at, _ = pb.getBasePositionAndOrientation(self.number, self.client)
                pb.applyExternalForce(
                    self.number, -1, force.tolist(), at, pb.WORLD_FRAME, physicsClientId=self.client
                )
            pb.stepSimulation(self.client)
            self.deep.stepped(self.now)

    def seat(self) -> HoleSeating | None:
        position, orientation = pb.getBasePositionAndOrientation(self.number, self.client)
        return HoledFixtures([BOARD]).seat(self.shape, Pose(position, orientation))


def test_the_pieces_are_the_box_without_its_holes_and_lie_side_by_side() -> None:
    assert isinstance(BOARD.shape, Box)
    pieces = [Trimesh(pose.apply(np.array(mesh.vertices))).convex_hull for mesh, pose in convex_pieces(BOARD)]
    disc, square, slot = BOARD.holes
    rounded = 32 * math.tan(math.pi / 32) * 0.0155**2 * disc.depth
    straight = square.size[0] ** 2 * square.depth + slot.size[0] * slot.size[1] * slot.depth
    # A bevel of 1 mm takes half a square mm along the sides of the mouth, and the pyramids at the corners.
    sides = 64 * math.tan(math.pi / 32) * 0.0155 + 4 * square.size[0]
    corners = (32 * math.tan(math.pi / 32) + 4) * 0.001**3 / 3
    left = float(np.prod(BOARD.shape.size)) - rounded - straight - sides * 0.5e-6 - corners
    assert sum(piece.volume for piece in pieces) == pytest.approx(left, rel=1e-9)
    # With the right volume in all, none can overlap another and leave no gap elsewhere unseen.
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (4000, 3)) * BOARD.shape.size
    inside = np.array([_within(piece, points) for piece in pieces]).sum(axis=0)
    assert inside.max() == 1
    free = [_in_hole(points, n) for n in range(3)]
    assert (inside == 0).tolist() == np.logical_or.reduce(free).tolist()


def _within(piece: Trimesh, points: Array) -> NDArray[np.bool_]:
    """Which points are in a convex piece."""
    normals: Array = np.asarray(piece.face_normals)
    faces: Array = np.asarray(piece.triangles_center)
    return (points @ normals.T < np.einsum("ij,ij->i", normals, faces)).all(axis=1)


def _in_hole(points: Array, n: int) -> NDArray[np.bool_]:
    """Which points in the board are in its n-th hole, chamfer included."""
    hole = BOARD.holes[n]
    below = 0.02 - points[:, 2]
    grown = np.maximum(0.0, hole.chamfer - below)
    walls, found = outline(hole), np.ones(len(points), dtype=np.bool_)
    for k in range(len(walls)):
        x, y = walls[k] - walls[k - 1]
        outward = np.array([y, -x]) / math.hypot(x, y)
        found &= (points[:, :2] - walls[k]) @ outward < grown
    return found & (below < hole.depth)


def test_the_surface_is_closed_around_the_same_volume() -> None:
    assert isinstance(BOARD.shape, Box)
    seen = surface(BOARD.shape, BOARD.holes)
    mesh = Trimesh(seen.corners, np.arange(len(seen.corners)).reshape(-1, 3))
    solid = sum(Trimesh(np.array(piece.vertices)).convex_hull.volume for piece, _ in convex_pieces(BOARD))
    assert mesh.volume == pytest.approx(solid, rel=1e-6)
    assert np.allclose(mesh.bounds, [[-0.12, -0.08, -0.02], [0.12, 0.08, 0.02]])


def test_the_circle_that_counts_is_free() -> None:
    corners = outline(BOARD.holes[0]) - np.array(BOARD.holes[0].pose.position[:2])
    middles = (corners + np.roll(corners, 1, axis=0)) / 2
    assert np.hypot(*middles.T).min() == pytest.approx(0.0155)


@pytest.mark.parametrize("kind", ["dowel", "post"])
def test_an_item_over_its_hole_falls_in_with_a_mm_of_room(kind: str) -> None:
    bench = Bench(kind)
    bench.run(1.5)
    seat = bench.seat()
    assert seat is not None
    assert (seat.hole, seat.over, seat.fits) == (bench.hole.id, True, True)
    assert seat.depth == pytest.approx(0.03, abs=1e-4)
    assert seat.tilt < math.radians(0.5)
    assert bench.deep.of(ITEM) < 0.05e-3


@pytest.mark.parametrize("kind", ["dowel", "post"])
def test_an_item_that_is_3_mm_off_does_not_get_in(kind: str) -> None:
    """It stands with a strip of 1.5 mm on the face, and leans over; pressed down or not."""
    bench = Bench(kind, off=0.003)
    bench.run(1.0)
    bench.run(0.5, force=np.array([0.0, 0.0, -10.0]))
    seat = bench.seat()
    assert seat is None or seat.depth < 0.5 * seat.bottom
    assert bench.deep.of(ITEM) < 0.15e-3


@pytest.mark.parametrize("kind", ["dowel", "post"])
def test_a_wall_holds_30_n_and_what_is_in_it_is_measured(kind: str) -> None:
    bench = Bench(kind)
    bench.run(0.5)
    aside = bench.mouth.rotation()[:, 0]
    bench.run(1.5, force=30.0 * aside)
    seat = bench.seat()
    assert seat is not None
    assert seat.over
    assert seat.off < 0.0008
    assert bench.deep.of(ITEM) < 0.05e-3
    pose = bench.mouth @ Pose((0.002, 0.0, 0.005))
    pb.resetBasePositionAndOrientation(bench.number, pose.position, pose.orientation, bench.client)
    assert bench.deep.of(ITEM) == pytest.approx(1.5e-3, abs=0.05e-3)


def test_a_fixture_stands_elsewhere_within_its_bounds_and_by_the_seed_alone() -> None:
    really = [displace_fixtures(DESCRIPTION, seed).fixture("board").pose for seed in range(40)]
    assert displace_fixtures(DESCRIPTION, 7).fixture("board").pose == really[7]
    away = [BOARD.pose.inverse() @ pose for pose in really]
    assert all(abs(p.position[0]) <= 0.005 and abs(p.position[1]) <= 0.005 for p in away)
    assert all(p.position[2] == pytest.approx(0.0) for p in away)
    tilts = [math.acos(min(1.0, float(p.rotation()[2, 2]))) for p in away]
    assert 0.01 < max(tilts) <= math.radians(2.0) + 1e-9
    assert max(abs(p.position[0]) for p in away) > 0.004
    level = displace_fixtures(DESCRIPTION, 7, level=True).fixture("board").pose
    assert level.position == really[7].position
    assert level.rotation()[2, 2] == pytest.approx(1.0)
    assert displace_fixtures(DESCRIPTION, 7).fixture("table") == DESCRIPTION.fixture("table")


def test_a_resumed_cell_has_its_board_where_it_was() -> None:
    scene = load_scene("pegs")
    robot = load_robot(scene.robot)
    hardware = PhysicsHardware(scene, robot, 5)
    board = next(f for f in hardware.true_fixtures() if f.id == "board")
    assert 0.0 < board.pose.distance(scene.fixture("board").pose) <= math.hypot(0.005, 0.005)
    for _ in range(24):
        hardware.step()
    saved = Checkpoint.from_plain(hardware.checkpoint().to_plain())
    resumed = PhysicsHardware.resume(scene, robot, 5, saved)
    assert resumed.true_fixtures() == hardware.true_fixtures()
    for _ in range(24):
        hardware.step()
        resumed.step()
    assert resumed.truth() == hardware.truth()
