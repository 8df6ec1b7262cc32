"""Whether the arm could reach a pose at all, whatever stands around."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ....errors import PicktreeError
from ....world.values import Pose

if TYPE_CHECKING:
    from ....logs.run_record import RunRecord
    from ....planning.kinematics.inverse_kinematics import InverseKinematics

POSES = 12
"""Of many poses so many are tried, spread over the list."""
SOLUTIONS = 1


def arm_of(run: RunRecord) -> InverseKinematics | None:
    """The arm's kinematics by the robot file in the log; None when that cannot be read here."""
    if "robot.yaml" not in run.log.attachments:
        return None
    # They are slow to import, and needed for few failures.
    from ....planning.kinematics.inverse_kinematics import InverseKinematics
    from ....robots.loading import parse_robot
    from ....robots.model import RobotModel

    text = run.log.attachment("robot.yaml").decode("utf-8", "replace")
    with tempfile.TemporaryDirectory() as folder:
        try:
            return InverseKinematics(RobotModel(parse_robot(text, Path(folder) / "robot.yaml")))
        except (PicktreeError, OSError, ValueError):
            return None


def reachable(arm: InverseKinematics, poses: Sequence[Pose]) -> bool:
    """Whether a configuration within the joint limits leads to one of the poses of the TCP in the world."""
    step = max(len(poses) // POSES, 1)
    home = arm.model.named("home")
    rng = np.random.default_rng(0)
    return any(arm.solutions(pose, rng, home, SOLUTIONS) for pose in poses[::step])
