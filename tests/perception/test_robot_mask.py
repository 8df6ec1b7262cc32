"""The robot in a picture, by the meshes of its links."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import trimesh

from picktree.perception.expectation.robot_mask import RobotMask
from picktree.robots.urdf_tree import UrdfMesh, UrdfPrimitive
from picktree.world.values import Array, Pose


@dataclass(frozen=True)
class Finger:
    """A robot of one link."""

    mesh: Path
    finger_links: tuple[str, ...] = ("finger",)

    def tcp(self, q: Array) -> Pose:
        return Pose()

    def link_poses(self, q: Array, width: float) -> dict[str, Pose]:
        return {"finger": Pose()}

    def collision_meshes(self) -> tuple[UrdfMesh, ...]:
        return (UrdfMesh("finger", str(self.mesh), Pose()),)

    def collision_shapes(self) -> tuple[UrdfPrimitive, ...]:
        return ()


def radius(robot: Finger) -> float:
    """Radius of the ball around the finger, m. The time of the file never changes."""
    os.utime(robot.mesh, (1, 1))
    (finger,) = RobotMask(robot).fingers([], 0.0)  # type: ignore[arg-type]
    return finger.radius


def test_a_mesh_that_has_changed_is_read_again(tmp_path: Path) -> None:
    robot = Finger(tmp_path / "finger.stl")
    trimesh.creation.box((0.02, 0.02, 0.02)).export(robot.mesh)
    small = radius(robot)
    trimesh.creation.box((0.06, 0.06, 0.06)).export(robot.mesh)
    assert abs(radius(robot) - 3 * small) < 1e-9
