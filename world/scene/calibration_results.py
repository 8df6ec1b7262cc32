"""What a calibration has found: where cameras and tool are believed to be from then on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ..values import Pose

if TYPE_CHECKING:
    from .description import CameraDescription


@dataclass(frozen=True, slots=True)
class Calibration:
    """Corrections of a scene's belief. They move what is believed, never what is true."""

    cameras: tuple[tuple[str, Pose], ...] = ()
    """Name, and the optical frame in the world, or in the corrected TCP's frame for a camera on the hand."""
    tcp: Pose = field(default_factory=Pose)
    """The corrected TCP in the frame of the one that the robot file states: the whole hand sits off by it."""
    date: str = ""
    by: str = ""
    """What has calibrated, in a few words."""


def corrected(camera: CameraDescription, calibration: Calibration | None) -> CameraDescription:
    """The camera with its calibrated pose, where there is one. The true pose, `pose @ error`, stays."""
    found = dict(calibration.cameras).get(camera.name) if calibration is not None else None
    if found is None:
        return camera
    return replace(camera, pose=found, error=found.inverse() @ camera.pose @ camera.error)
