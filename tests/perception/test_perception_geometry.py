"""The mathematics under perception, against definitions."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from picktree.robot.perception import PosedCamera, segmentation
from picktree.robot.perception.backdrop import BackgroundModel
from picktree.robot.perception.camera_registration import level_camera
from picktree.robot.perception.resting_poses import stable_poses
from picktree.robot.perception.silhouette_fitting import (
    BlobOutline,
    StandingPose,
    distances_outside,
    fit_outline,
    silhouette,
    support,
)
from picktree.world import ITEM_COLOURS, Box, ConvexMesh, Cylinder, Intrinsics, Pose, Shape, Sphere, ray_hits
from picktree.world.scene import CatalogueEntry

from .perception_pictures import CAMERA, CATALOGUE, DOWN, SCENE, TABLE, photograph

LENS = Intrinsics(320, 240, 208.0, 208.0, 160.0, 119.0)
WEDGE = ConvexMesh(
    tuple((x, y, z) for x, z in ((-0.03, -0.01), (0.03, -0.01), (-0.03, 0.02)) for y in (-0.02, 0.02)),
    "wedge",
)
SHAPES: tuple[Shape, ...] = (Box((0.1, 0.2, 0.3)), Cylinder(0.1, 0.3), Sphere(0.15), WEDGE)


def inside(shape: Shape, point: np.ndarray, slack: float) -> bool:
    match shape:
        case Box(size):
            return bool((np.abs(point) <= np.array(size) / 2 + slack).all())
        case Cylinder(radius, height):
            return math.hypot(point[0], point[1]) <= radius + slack and abs(point[2]) <= height / 2 + slack
        case Sphere(radius):
            return float(np.linalg.norm(point)) <= radius + slack
        case ConvexMesh():
            x, y, z = point
            wide = abs(y) <= 0.02 + slack and x >= -0.03 - slack and z >= -0.01 - slack
            return wide and 0.03 * (x + 0.03) + 0.06 * (z + 0.01) <= 0.03 * 0.06 + slack * 0.07


@given(
    st.sampled_from(SHAPES),
    st.tuples(*[st.floats(-0.12, 0.12)] * 3),
    st.tuples(*[st.floats(-3, 3)] * 3),
)
@settings(max_examples=100)
def test_a_ray_meets_a_shape_first_on_its_surface(
    shape: Shape, target: tuple[float, float, float], turn: tuple[float, float, float]
) -> None:
    pose = Pose.from_rpy((0.3, -0.2, 1.0), turn)
    origin = np.zeros(3)
    ray = pose.apply(np.array(target)) - origin
    depth = float(ray_hits(shape, pose.rotation(), np.array(pose.position), origin, ray[None])[0])
    to_body = pose.inverse()
    if math.isinf(depth):
        assert not any(inside(shape, to_body.apply(ray * s), -1e-6) for s in np.linspace(0.2, 2.0, 400))
        return
    assert inside(shape, to_body.apply(ray * depth), 1e-9)
    assert not any(
        inside(shape, to_body.apply(ray * s), -1e-6) for s in np.linspace(0.0, max(0.0, depth - 1e-6), 100)
    )


def test_pixels_and_directions_undo_each_other() -> None:
    sight = PosedCamera.at(LENS, Pose.from_rpy((0.4, 0.1, 0.9), (math.pi - 0.2, 0.1, 0.4)))
    pixels = np.array([[0.0, 0.0], [100.5, 20.25], [319.0, 239.0]])
    points = sight.origin + sight.directions(pixels) * np.array([[0.5], [1.0], [0.8]])
    assert sight.pixels(points) == pytest.approx(pixels)
    there = sight.at_height(pixels[1], 0.05)
    assert sight.pixels(np.array([[*there, 0.05]]))[0] == pytest.approx(pixels[1])


def test_every_named_colour_is_told_in_light_and_shade() -> None:
    for name, rgb in ITEM_COLOURS.items():
        for light in (1.0, 0.7, 0.45):
            pixel = np.round(np.array([[rgb]]) * 255 * light).astype(np.uint8)
            assert segmentation.LABEL_NAMES[int(segmentation.labels(pixel)[0, 0])] == name


def test_greys_have_no_colour() -> None:
    greys = np.array([[[v, v, v] for v in (0, 20, 90, 200, 255)]], dtype=np.uint8)
    assert (segmentation.labels(greys) == 0).all()
    assert segmentation.label_of("grey") == segmentation.label_of("unknown") == 0


@pytest.mark.parametrize(
    ("shape", "heights"),
    [
        (Box((0.04, 0.04, 0.04)), [0.04]),
        (Box((0.06, 0.03, 0.04)), [0.03, 0.04, 0.06]),
        (Box((0.06, 0.045, 0.006)), [0.006, 0.045, 0.06]),
        (Cylinder(0.02, 0.07), [0.04, 0.07]),
        (Sphere(0.02), [0.04]),
    ],
)
def test_an_item_rests_on_each_of_its_faces(shape: Shape, heights: list[float]) -> None:
    found = stable_poses(CatalogueEntry("it", "box", shape, 0.1, 0.5))
    assert sorted(r.height for r in found) == pytest.approx(heights)
    for rest in found:
        assert np.linalg.det(rest.rotation) == pytest.approx(1.0)
        assert 0 < rest.below < rest.height


def test_a_mesh_rests_only_where_its_centroid_is_held() -> None:
    points = np.array(WEDGE.vertices) - np.array([-0.01, 0.0, 0.0])
    wedge = ConvexMesh(tuple((float(x), float(y), float(z)) for x, y, z in points), "wedge")
    found = stable_poses(CatalogueEntry("it", "mesh", wedge, 0.1, 0.5))
    downs = {tuple(np.round(r.rotation.T @ [0, 0, -1], 3) + 0.0) for r in found}
    assert (0.0, 0.0, -1.0) in downs, "on its base"
    leaning = ConvexMesh(tuple((x + 0.2 * z / 0.02, y, z) for x, y, z in wedge.vertices), "leaning")
    assert len(stable_poses(CatalogueEntry("it", "mesh", leaning, 0.1, 0.5))) < len(found)


def test_a_nut_has_two_looks() -> None:
    ring = [(0.018 * math.cos(k * math.pi / 3), 0.018 * math.sin(k * math.pi / 3)) for k in range(6)]
    nut = ConvexMesh(tuple((x, y, z) for x, y in ring for z in (-0.015, 0.015)), "nut")
    found = {round(r.height, 4): r for r in stable_poses(CatalogueEntry("nut", "mesh", nut, 0.1, 0.5))}
    assert sorted(found) == [0.03, round(0.018 * math.sqrt(3), 4)]
    assert found[0.03].turn == pytest.approx(math.pi / 3)
    assert found[round(0.018 * math.sqrt(3), 4)].turn == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("radius", "sides"), [(0.005, 12), (0.008, 61), (0.015, 32), (0.025, 16), (0.025, 90)]
)
def test_a_roll_lies_and_stands_however_fine_its_facets_are(radius: float, sides: int) -> None:
    ring = [
        (radius * math.cos(k * 2 * math.pi / sides), radius * math.sin(k * 2 * math.pi / sides))
        for k in range(sides)
    ]
    roll = ConvexMesh(tuple((x, y, z) for x, y in ring for z in (-0.03, 0.03)), "roll")
    found = sorted(stable_poses(CatalogueEntry("roll", "mesh", roll, 0.1, 0.5)), key=lambda r: r.height)
    assert [r.height for r in found] == pytest.approx([2 * radius, 0.06], rel=0.04)
    assert found[0].turn == pytest.approx(math.pi)


def test_a_ball_of_many_facets_looks_the_same_on_each() -> None:
    n = np.arange(250) + 0.5
    slopes, turns = np.arccos(1 - 2 * n / 250), math.pi * (1 + math.sqrt(5)) * n
    points = 0.02 * np.stack(
        [np.cos(turns) * np.sin(slopes), np.sin(turns) * np.sin(slopes), np.cos(slopes)], axis=1
    )
    ball = ConvexMesh(tuple((float(x), float(y), float(z)) for x, y, z in points), "ball")
    (rest,) = stable_poses(CatalogueEntry("ball", "mesh", ball, 0.1, 0.5))
    assert rest.height == pytest.approx(0.04, rel=0.02)
    assert rest.turn == 0.0


@pytest.mark.parametrize("kind", [entry.kind for entry in CATALOGUE])
def test_the_fit_finds_back_the_place_from_beside_it(kind: str) -> None:
    sight = PosedCamera.at(LENS, DOWN)
    entry = next(e for e in CATALOGUE if e.kind == kind)
    for rest in stable_poses(entry):
        true = StandingPose(rest, np.array([0.55, -0.2, rest.below]), 0.4)
        (corners,) = silhouette(sight, true)
        share = np.linspace(0, 1, 8, endpoint=False)[:, None, None]
        points = (corners * (1 - share) + np.roll(corners, -1, axis=0) * share).reshape(-1, 2)
        outline = BlobOutline(points, np.ones(len(points), dtype=bool))
        start = StandingPose(
            rest, true.centre + np.array([0.004, -0.003, 0.0]), true.yaw + (0.1 if rest.turn else 0.0)
        )
        fitted = fit_outline(sight, outline, start, rounds=12)
        assert fitted.misfit < 0.01
        assert fitted.stand.centre == pytest.approx(true.centre, abs=2e-5)
        assert fitted.stand.yaw == pytest.approx(true.yaw, abs=2e-3)


def test_the_support_function_turns_and_moves_with_its_points() -> None:
    points = np.random.default_rng(1).uniform(-10, 10, (30, 2))
    reach, middle = support(points)
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    turned, at = support(points @ quarter.T + np.array([7.0, -3.0]))
    assert turned == pytest.approx(np.roll(reach, 9))
    assert at == pytest.approx(quarter @ middle + np.array([7.0, -3.0]))


def test_levelling_finds_height_and_tilt_but_not_what_a_plane_cannot_show() -> None:
    sight = PosedCamera.at(LENS, CAMERA.pose)
    image = photograph([])
    backdrop = BackgroundModel.of(SCENE, PosedCamera.at(image.intrinsics, DOWN), TABLE, 0.0)
    off = DOWN @ Pose.from_rpy((0.004, 0.003, 0.006), (0.01, -0.006, 0.0))
    corrected = level_camera(PosedCamera.at(image.intrinsics, off), image.depth.astype(float), backdrop, 0.0)
    assert corrected.origin[2] == pytest.approx(DOWN.position[2], abs=5e-4)
    assert corrected.rotation[:, 2] == pytest.approx(sight.rotation[:, 2], abs=1e-3)
    assert corrected.origin[:2] == pytest.approx(np.array(off.position[:2]))


def test_a_picture_without_a_table_is_not_levelled() -> None:
    image = photograph([])
    sight = PosedCamera.at(image.intrinsics, DOWN)
    backdrop = BackgroundModel.of(SCENE, sight, TABLE, 0.0)
    assert level_camera(sight, np.zeros(image.depth.shape), backdrop, 0.0) is sight


@pytest.mark.parametrize("seed", range(2))
def test_distances_from_a_silhouette_are_those_of_opencv(seed: int) -> None:
    rng = np.random.default_rng(seed)
    hull = cv2.convexHull(rng.uniform(20.0, 60.0, (12, 2)).astype(np.float32))
    pixels = np.argwhere(np.ones((80, 80))).astype(np.float64)
    expected = [max(0.0, -cv2.pointPolygonTest(hull, (u, v), True)) for u, v in pixels.tolist()]
    for corners in (hull[:, 0], hull[::-1, 0]):
        found = distances_outside([corners.astype(np.float64)], pixels)
        assert found == pytest.approx(np.array(expected), abs=1e-4)
