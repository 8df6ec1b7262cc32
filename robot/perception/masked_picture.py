"""Masked picture: one RGB-D image with what perception knows of its background."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .backdrop import BackgroundModel
from .item_fitting import MODEL_DEPTH_SIGMA
from .known_object_fitting import NEAR_DEPTH_SIGMA
from .segmentation import SegmentationInput


@dataclass(frozen=True, eq=False)
class MaskedPicture:
    """Picture with the robot and the walls masked, and the scene that is expected without items."""

    picture: SegmentationInput
    backdrop: BackgroundModel
    robot: NDArray[np.bool_]
    noise: float
    """Standard deviation of the depth at 0.7 m, m."""
    moving: bool
    """Whether the camera is on the hand. Then hand and border may cut through items in the picture."""

    @property
    def rough(self) -> float:
        """Part of the depth's standard deviation that does not depend on the distance, m."""
        return NEAR_DEPTH_SIGMA if self.moving else MODEL_DEPTH_SIGMA
