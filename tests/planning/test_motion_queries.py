"""The scene's own queries against distances known by construction."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from picktree.robot.planning import SceneQueries
from picktree.robot.planning.scene_queries import place, solid
from picktree.world import Box, ConvexMesh, Cylinder, Pose, Sphere

from .motion_cell import MODEL, down, item, table_scene

TIP = MODEL.description.gripper.tip


def test_the_distance_between_spheres_is_centre_distance_less_radii() -> None:
    queries = SceneQueries(MODEL, scene := table_scene())
    rng = np.random.default_rng(0)
    for k in range(30):
        centre = rng.uniform([0.2, -0.2, 0.5], [0.8, 0.2, 0.7])
        scene.put(item("ball", Sphere(0.04), Pose(tuple(centre))), f"{k}")
        asking = rng.uniform([0.2, -0.2, 0.4], [0.8, 0.2, 0.7])
        (near,) = queries.free(Sphere(0.03), Pose(tuple(asking)), ("table", "bin_1", "bin_2"), margin=1.0)
        expected = float(np.linalg.norm(centre - asking)) - 0.07
        assert near.b == "ball" and near.distance == pytest.approx(expected, abs=1e-5)
        if expected > 0:
            to_body = float(np.linalg.norm(np.array(near.point) - asking))
            assert to_body == pytest.approx(expected + 0.03, abs=1e-4)


def test_an_object_of_python_fcl_that_is_free_again_is_moved_for_the_next() -> None:
    shape = solid(Box((0.041, 0.042, 0.043)))
    one, other = place(shape, Pose((0.0, 0.0, 0.1))), place(shape, Pose((0.0, 0.0, 0.2)))
    assert one.object is not other.object
    moved = one.object
    del one
    again = place(solid(Box((0.041, 0.042, 0.043))), Pose((0.0, 0.3, 0.0)))
    assert again.object is moved and again.object.getTranslation().tolist() == [0.0, 0.3, 0.0]
    assert other.object.getTranslation().tolist() == [0.0, 0.0, 0.2]


def test_a_spot_is_free_until_something_stands_there() -> None:
    queries = SceneQueries(MODEL, scene := table_scene())
    spot = Pose((0.5, 0.0, 0.031))
    assert queries.free(Box((0.06, 0.06, 0.06)), spot) == []
    (touched,) = queries.free(Box((0.06, 0.06, 0.06)), spot, margin=0.005)
    assert (touched.a, touched.b) == ("shape", "table")
    assert touched.distance == pytest.approx(0.001, abs=1e-6)
    scene.put(item("can", Cylinder(0.03, 0.1), Pose((0.55, 0.0, 0.05))), "test")
    (touched,) = queries.free(Box((0.06, 0.06, 0.06)), spot)
    assert touched.b == "can"
    assert touched.distance == pytest.approx(-0.01, abs=1e-4)
    assert queries.free(Box((0.06, 0.06, 0.06)), spot, ignore=("can",)) == []
    scene.put(replace(scene.get("can"), pose=Pose((0.7, 0.0, 0.05))), "moved")
    assert queries.free(Box((0.06, 0.06, 0.06)), spot) == []
    scene.attach("can", Pose())
    assert queries.free(Cylinder(0.03, 0.1), Pose((0.7, 0.0, 0.06))) == []


def test_a_convex_mesh_is_where_its_points_are() -> None:
    points = ((0.03, 0.0, 0.0), (-0.03, 0.0, 0.0), (0.0, 0.03, 0.0), (0.0, -0.03, 0.0), (0.0, 0.0, 0.06))
    queries = SceneQueries(
        MODEL, table_scene(item("roof", ConvexMesh(points, "test"), Pose((0.5, 0.0, 0.2))))
    )
    nearest = queries.free(Sphere(0.01), Pose((0.5, 0.0, 0.3)), margin=1.0)[0]
    assert nearest.b == "roof"
    assert nearest.distance == pytest.approx(0.03, abs=1e-5)


def test_what_the_hand_would_touch() -> None:
    queries = SceneQueries(MODEL, scene := table_scene())
    assert queries.hand_contacts(down(0.5, 0.0, TIP + 0.001), 0.04) == []
    low = queries.hand_contacts(down(0.5, 0.0, TIP + 0.0002), 0.04)
    assert [(c.a, c.b) for c in low] == [("finger", "table"), ("finger", "table")]
    wide = queries.hand_contacts(down(0.5, 0.0, TIP + 0.01), 0.04, margin=0.02)
    assert {c.b for c in wide} == {"table"}
    # Right beside the +y finger, which begins at half the opening and is 26.4 mm thick.
    beside = 0.02 + 0.0264 + 0.015 + 0.002
    scene.put(item("block", Box((0.03, 0.03, 0.03)), Pose((0.5, beside, 0.015))), "test")
    (touched,) = queries.hand_contacts(down(0.5, 0.0, 0.02), 0.04)
    assert (touched.a, touched.b) == ("finger", "block")
    assert touched.distance == pytest.approx(0.002, abs=1e-5)
    assert queries.hand_contacts(down(0.5, 0.0, 0.02), 0.04, margin=0.001) == []
    assert queries.hand_contacts(down(0.5, 0.0, 0.02), 0.04, ignore=("block",)) == []
    deeper = queries.hand_contacts(down(0.5, 0.0, 0.02), 0.06)
    assert deeper[0].distance < -0.005
    tall = item("tall", Box((0.03, 0.03, 0.2)), Pose((0.5, 0.09, 0.1)))
    scene.put(tall, "test")
    assert ("hand", "tall") in {(c.a, c.b) for c in queries.hand_contacts(down(0.5, 0.0, 0.02), 0.0)}


def test_the_clearance_of_the_hand_is_that_of_its_nearest_contact() -> None:
    queries = SceneQueries(MODEL, scene := table_scene())
    rng = np.random.default_rng(2)
    for k in range(4):
        x, y = rng.uniform([0.42, -0.08], [0.58, 0.08])
        scene.put(item(f"block_{k}", Box((0.04, 0.04, 0.05)), Pose((x, y, 0.025))), "test")
    met = 0
    for _ in range(40):
        tcp = down(*rng.uniform([0.4, -0.1, 0.012], [0.6, 0.1, 0.09]))
        width, margin = float(rng.uniform(0.0, 0.08)), float(rng.choice([0.003, 0.008]))
        contacts = queries.hand_contacts(tcp, width, ("block_0",), margin)
        nearest = contacts[0].distance if contacts else math.inf
        assert queries.hand_clearance(tcp, width, ("block_0",), margin, -math.inf) == nearest
        early = queries.hand_clearance(tcp, width, ("block_0",), margin, 0.002)
        assert (early < 0.002) is (nearest < 0.002)
        met += nearest < 0.002
    assert 0 < met < 40


def test_bodies_that_just_touch_in_a_symmetric_way_are_measured() -> None:
    """python-fcl's own signed distance ends the process for these: a plate, and a ball at its edge."""
    rng = np.random.default_rng(1)
    shapes = (Cylinder(0.05, 0.006), Sphere(0.02), Cylinder(0.02, 0.08))
    depths = list[float]()
    for _ in range(300):
        one, other = (shapes[int(rng.integers(3))] for _ in range(2))
        across, lying = rng.choice([0.0, 0.01, 0.02, -0.02, -0.02 + 1e-9], 2), rng.choice([0.0, np.pi / 2], 2)
        standing = item("one", one, Pose.from_rpy((0.5, 0.0, 0.02), (0.0, float(lying[0]), np.pi / 2)))
        place = (0.5 + float(across[0]), float(across[1]), 0.02)
        there = Pose.from_rpy(place, (0.0, float(lying[1]), np.pi / 4))
        found = SceneQueries(MODEL, table_scene(standing)).free(other, there, ignore=("table",))
        depths += [-touched.distance for touched in found]
    assert len(depths) > 200
    assert min(depths) >= 0.0
    assert max(depths) <= 0.07 + 1e-6  # a ball in the middle of a plate on edge
