"""A snapshot of a simulation as somebody finds it who comes later: everything as it stood, at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from .backends import Backend

_STILL = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class RestSnapshot:
    """A simulation that stands still."""

    plain: dict[str, Any]
    """For `build_hardware`."""
    position: tuple[float, ...]
    """Of the arm's joints, rad."""


def snapshot_at_rest(backend: Backend, snapshot: Mapping[str, Any], joints: int) -> RestSnapshot:
    """The arm of so many joints is held where it was, its fingers go on with what they were told, nothing
    moves.

    Raises PicktreeError when this is no snapshot of such a backend.
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
