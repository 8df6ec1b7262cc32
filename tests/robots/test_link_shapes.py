"""Shapes of links: what a URDF may say of geometry, and that planner, physics and pictures take the same."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pybullet
import pytest
import trimesh

from picktree.files import PicktreeError
from picktree.logs.binary_gltf import link_meshes, read_glb
from picktree.robot.planning import robot_geometry
from picktree.simulation.physics import Client, RobotBody
from picktree.world import ConvexMesh, Cylinder, Pose, Sphere, corners, greatest_length
from picktree.world.robot_model import RobotModel, link_shapes, load_robot
from picktree.world.robot_model.link_solids import geometry_faults
from picktree.world.robot_model.robot_file import robot_names
from picktree.world.robot_model.urdf_parser import links_seen_only

CASE = "<{kind}>{origin}<geometry>{shape}</geometry></{kind}>"


def urdf(folder: Path, shape: str, kind: str = "collision", origin: str = "") -> str:
    """Write an arm of 1 m with this shape on its last link, and return the path."""
    joint = '<joint name="j{n}" type="revolute"><parent link="l{n}"/><child link="l{m}"/>{origin}'
    joint += '<limit lower="-1" upper="1" effort="9" velocity="1"/></joint>'
    links = [f'<link name="l{n}"/>' for n in range(2)]
    elements = CASE.format(kind=kind, origin=origin, shape=shape)
    links.append(f'<link name="l2">{elements}</link>')
    joints = [joint.format(n=n, m=n + 1, origin='<origin xyz="0 0 0.5"/>') for n in range(2)]
    (folder / "arm.urdf").write_text(f'<robot name="arm">{"".join(links + joints)}</robot>')
    return str(folder / "arm.urdf")


def block(folder: Path, name: str, size: float = 0.1, scale: float = 1.0) -> Path:
    mesh = trimesh.creation.box((size * scale, 2 * size * scale, 3 * size * scale))
    mesh.export(folder / name)
    return folder / name


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ('<box size="0 0.1 0.1"/>', '<box size="0 0.1 0.1"> must be greater than 0'),
        (
            '<box size="0.1 0.1"/>',
            '<box size="0.1 0.1"> has 2 numbers, not three; write it as size="0.1 0.1 0.1"',
        ),
        ('<box size="0,1 0,2 0,3"/>', '<box size="0,1 0,2 0,3"> has a decimal comma; write 0.1'),
        ('<box/>', "<box> has no size; write it, in m"),
        ('<cylinder radius="-0.03" length="0.1"/>', '<cylinder radius="-0.03"> must be greater than 0'),
        ('<cylinder length="0.1"/>', "<cylinder> has no radius; write it, in m"),
        ('<cylinder radius="3cm" length="1"/>', '<cylinder radius="3cm"> has a unit; write 0.03, in m'),
        ('<sphere radius="nan"/>', '<sphere radius="nan"> is no finite number; write one, in m'),
        ('<capsule radius="0" length="0.1"/>', '<capsule radius="0"> must be greater than 0'),
        (
            '<mesh filename="ok.stl" scale="0.5"/>',
            '<mesh scale="0.5"> has 1 number, not three; write it as scale="0.5 0.5 0.5"',
        ),
        ('<mesh filename="ok.stl" scale="1 0 1"/>', '<mesh scale="1 0 1"> must not be 0'),
        (
            '<cone radius="1"/>',
            "<cone> is no shape that is read here (one of <mesh>, <box>, <cylinder>, <sphere>, <capsule>)",
        ),
        (
            '<box size="1 1 1"/><box size="1 1 1"/>',
            "the <geometry> of its <collision> must be one shape "
            "(one of <mesh>, <box>, <cylinder>, <sphere>, <capsule>)",
        ),
        (
            '<mesh filename="flat.stl"/>',
            "{here}/flat.stl: the mesh is flat: it encloses no volume "
            "(give it a thickness, or take a <box>)",
        ),
        (
            '<mesh filename="lfs.stl"/>',
            "{here}/lfs.stl: the file is a pointer of git-lfs, not the mesh (get the mesh: git lfs pull)",
        ),
        (
            '<mesh filename="mm.stl"/>',
            "mm.stl is 100 × 200 × 300 m large, and the whole robot 1 m long "
            '(is it in millimetres? then scale="0.001 0.001 0.001" in its <mesh>)',
        ),
        (
            '<mesh filename="cm.stl"/>',
            "cm.stl is 10 × 20 × 30 m large, and the whole robot 1 m long "
            '(is it in centimetres? then scale="0.01 0.01 0.01" in its <mesh>)',
        ),
        (
            '<cylinder radius="30" length="200"/>',
            "a shape of it is 60 × 60 × 200 m large, and the whole robot 1 m long (is it in millimetres?)",
        ),
        (
            '<mesh filename="ok.stl" scale="0.001 0.001 0.001"/>',
            "ok.stl is 0.3 mm large with its scale 0.001 0.001 0.001 (is it in metres? then it has no scale)",
        ),
    ],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["collision", "visual"])
def test_geometry_that_cannot_be_used_is_told_with_its_link(
    shape: str, message: str, kind: str, tmp_path: Path
) -> None:
    block(tmp_path, "ok.stl")
    block(tmp_path, "mm.stl", scale=1000.0)
    block(tmp_path, "cm.stl", scale=100.0)
    (tmp_path / "lfs.stl").write_text("version https://git-lfs.github.com/spec/v1\n")
    trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).export(tmp_path / "flat.stl")
    file = urdf(tmp_path, shape, kind)
    message = message.replace("{here}", str(tmp_path))
    if "of its <collision>" in message:
        message = message.replace("<collision>", f"<{kind}>")
    if kind == "visual" and "flat.stl" in message:
        assert link_shapes(file) == ()  # what is only seen may be flat
        return
    assert geometry_faults(file)[0] == f"link 'l2': {message}"
    with pytest.raises(PicktreeError) as raised:
        link_shapes(file)
    assert str(raised.value) == f"{file}: link 'l2': {message}"


def test_all_faults_of_a_file_are_told_at_once(tmp_path: Path) -> None:
    block(tmp_path, "mm.stl", scale=1000.0)
    two = '</geometry></collision><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    file = urdf(tmp_path, f'<mesh filename="mm.stl"/>{two}<collision><geometry><mesh filename="mm.stl"/>')
    assert len(geometry_faults(file)) == 1  # the same sentence once
    file = urdf(tmp_path, f'<sphere radius="-1"/>{two}<collision><geometry><sphere radius="-2"/>')
    assert [fault[:31] for fault in geometry_faults(file)] == [
        "link 'l2': <sphere radius=\"-1\">",
        "link 'l2': <sphere radius=\"-2\">",
    ]


def test_a_capsule_is_a_cylinder_between_two_spheres(tmp_path: Path) -> None:
    origin = '<origin xyz="0 0 0.2" rpy="0 1.5707963267948966 0"/>'
    parts = link_shapes(urdf(tmp_path, '<capsule radius="0.03" length="0.2"/>', origin=origin))
    assert [part.shape for part in parts] == [Cylinder(0.03, 0.2), Sphere(0.03), Sphere(0.03)]
    places = [part.pose_in_link.position for part in parts]
    np.testing.assert_allclose(places, [[0, 0, 0.2], [0.1, 0, 0.2], [-0.1, 0, 0.2]], atol=1e-12)
    np.testing.assert_allclose(parts[0].pose_in_link.rotation()[:, 2], [1, 0, 0], atol=1e-12)


def test_a_link_that_is_only_seen_collides_as_it_is_seen(tmp_path: Path) -> None:
    block(tmp_path, "part.ply")
    file = urdf(tmp_path, '<mesh filename="part.ply"/>', "visual", '<origin xyz="0 0 0.3"/>')
    (part,) = link_shapes(file)
    assert isinstance(part.shape, ConvexMesh)
    np.testing.assert_allclose(np.ptp(corners(part.shape), axis=0), [0.1, 0.2, 0.3], atol=1e-6)
    assert part.pose_in_link == Pose((0.0, 0.0, 0.3))
    assert links_seen_only(file) == ("l2",)
    (drawn,) = link_meshes(urdf(tmp_path, '<box size="0.1 0.2 0.3"/>'))
    assert np.ptp(read_glb(drawn.glb).vertices, axis=0) == pytest.approx([0.1, 0.2, 0.3])


def test_a_mesh_and_its_hull_are_read_again_when_the_file_has_changed(tmp_path: Path) -> None:
    file = urdf(tmp_path, '<mesh filename="part.stl"/>')
    sizes: list[float] = []
    for size in (0.1, 0.2):
        os.utime(block(tmp_path, "part.stl", size), (1, 1))
        sizes.append(float(np.ptp(corners(link_shapes(file)[0].shape), axis=0)[0]))
    assert sizes == pytest.approx([0.1, 0.2])


def test_a_mesh_too_fine_for_a_picture_is_drawn_as_its_hull(tmp_path: Path) -> None:
    # Many small bodies of their own: there is no edge that a decimation could collapse.
    rng = np.random.default_rng(1)
    places = rng.uniform(-0.1, 0.1, (30_000, 1, 3))
    soup = places + rng.normal(scale=1e-3, size=(30_000, 3, 3))
    np.testing.assert_equal(soup.shape, (30_000, 3, 3))
    trimesh.Trimesh(soup.reshape(-1, 3), np.arange(90_000).reshape(-1, 3), process=False).export(
        tmp_path / "soup.stl"
    )
    (drawn,) = link_meshes(urdf(tmp_path, '<mesh filename="soup.stl"/>', "visual"))
    mesh = read_glb(drawn.glb)
    assert len(mesh.faces) < 22_000
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), np.ptp(soup.reshape(-1, 3), axis=0), rtol=0.05)


@pytest.mark.parametrize("name", robot_names())
def test_each_link_with_a_shape_collides_in_planner_and_physics_and_is_drawn(name: str) -> None:
    robot = load_robot(name)
    model = RobotModel(robot)
    parts = link_shapes(robot.urdf)
    counts = {link: sum(part.link == link for part in parts) for link in {part.link for part in parts}}
    planned = [o.name.rpartition("_")[0] for o in robot_geometry(model)]
    assert {link: planned.count(link) for link in set(planned)} == counts
    assert {drawn.link for drawn in link_meshes(robot.urdf)} >= set(counts)
    client = Client()
    body = RobotBody(robot, client, 1 / 240)
    body.load()
    taken = {
        name: len(pybullet.getCollisionShapeData(body.body, link, physicsClientId=client.id))
        for link, name in body.links.items()
    }
    fingers = robot.gripper.fingers
    assert {k: n for k, n in taken.items() if n and k not in fingers} == {
        k: n for k, n in counts.items() if k not in fingers
    }
    assert all(taken[finger] for finger in fingers)
    for link, link_name in body.links.items():
        shapes = [part.shape for part in parts if part.link == link_name and link_name not in fingers]
        if len(shapes) == 1 and isinstance(shapes[0], ConvexMesh):
            # The engine keeps a hull in a frame of its own: lengths within it are compared.
            _, kept = pybullet.getMeshData(body.body, link, collisionShapeIndex=0, physicsClientId=client.id)
            points = np.array(kept)
            longest = np.linalg.norm(points[:, None] - points[None], axis=2).max()
            assert longest == pytest.approx(greatest_length(shapes[0]), abs=1e-4)


def test_a_shape_that_the_engine_has_lost_is_told() -> None:
    robot = load_robot("panda")
    body = RobotBody(robot, Client(), 1 / 240)
    body.shape_counts["panda_link0"] = 2
    with pytest.raises(PicktreeError) as raised:
        body.load()
    assert str(raised.value) == (
        f"{robot.urdf}: link 'panda_link0' has 2 shapes, of which 1 collide in the simulation"
    )


BALL = '<visual><geometry><sphere radius="0.005"/></geometry></visual>'
WEIGHT = '<inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial>'


@pytest.mark.parametrize(
    ("mark", "joint", "bodies"),
    [
        (BALL, "fixed", []),
        (BALL.replace("0.005", "0.02"), "fixed", ["mark"]),
        (BALL + WEIGHT, "fixed", ["mark"]),
        (BALL + BALL.replace("visual", "collision"), "fixed", ["mark"]),
        (BALL, "floating", ["mark"]),
        (BALL.replace('<sphere radius="0.005"/>', '<mesh filename="block.stl"/>'), "fixed", ["mark"]),
    ],
)
def test_a_marker_of_a_frame_is_no_body(mark: str, joint: str, bodies: list[str], tmp_path: Path) -> None:
    block(tmp_path, "block.stl", 0.005)
    (tmp_path / "arm.urdf").write_text(
        f'<robot name="arm"><link name="l0"/><link name="mark">{mark}</link>'
        f'<joint name="j" type="{joint}"><parent link="l0"/><child link="mark"/></joint></robot>'
    )
    file = str(tmp_path / "arm.urdf")
    assert [part.link for part in link_shapes(file)] == bodies
    assert links_seen_only(file) == (() if "collision" in mark else tuple(bodies))
