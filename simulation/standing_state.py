"""Snapshots of a simulation brought to rest: all bodies at their poses, with zero velocity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from .backends import Backend

_STILL = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class RestSnapshot:
    """Snapshot of a simulation in which nothing moves, and the arm's configuration in it."""

    plain: dict[str, Any]
    """Plain values of the checkpoint, as `build_hardware` takes them."""
    position: tuple[float, ...]
    """Configuration of the arm, rad."""


def snapshot_at_rest(backend: Backend, snapshot: Mapping[str, Any], joints: int) -> RestSnapshot:
    """Return a snapshot with all velocities set to zero. The arm has `joints` joints and holds its
    configuration; the fingers keep their last command.

    Raises PicktreeError when `snapshot` is no checkpoint of the backend.
    """
    if backend == "kinematic":
        from .checkpoints.kinematic_state import KinematicState

        stood = KinematicState.from_plain(snapshot)
        return RestSnapshot(
            replace(stood, velocity=tuple(0.0 for _ in stood.velocity)).to_plain(), stood.position
        )
    from .checkpoints.physics_state import ArmCommand, Checkpoint

    saved = Checkpoint.from_plain(snapshot)
    position = saved.robot.position[:joints]
    still = replace(
        saved,
        arm=ArmCommand("follow", position, (0.0,) * joints, ()),
        robot=replace(saved.robot, velocity=tuple(0.0 for _ in saved.robot.velocity)),
        items=tuple(replace(item, velocity=_STILL, spin=_STILL) for item in saved.items),
    )
    return RestSnapshot(still.to_plain(), position)
