"""The robot in a picture, by the meshes of its links."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import pytest
import trimesh

from picktree.robot.perception import RobotMask
from picktree.world import Array, Pose
from picktree.world.robot_model import LinkShape, link_shapes


@dataclass(frozen=True)
class Finger:
    """A robot of one link."""

    urdf: Path
    finger_links: tuple[str, ...] = ("finger",)

    def tcp(self, q: Array) -> Pose:
        return Pose()

    def link_poses(self, q: Array, width: float) -> dict[str, Pose]:
        return {"finger": Pose()}

    def collision_shapes(self) -> tuple[LinkShape, ...]:
        return link_shapes(str(self.urdf))


def radius(robot: Finger) -> float:
    """Radius of the ball around the finger, m. The time of the file never changes."""
    os.utime(robot.urdf.parent / "finger.stl", (1, 1))
    (finger,) = RobotMask(robot).fingers([], 0.0)  # type: ignore[arg-type]
    return finger.radius


def test_a_mesh_that_has_changed_is_read_again(tmp_path: Path) -> None:
    robot, mesh = Finger(tmp_path / "finger.urdf"), tmp_path / "finger.stl"
    shape = '<collision><geometry><mesh filename="finger.stl"/></geometry></collision>'
    robot.urdf.write_text(f'<robot name="x"><link name="finger">{shape}</link></robot>')
    trimesh.creation.box((0.02, 0.02, 0.02)).export(mesh)
    small = radius(robot)
    trimesh.creation.box((0.06, 0.06, 0.06)).export(mesh)
    assert radius(robot) == pytest.approx(3 * small)
