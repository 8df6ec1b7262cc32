"""Faults and imperfections of the cell's own, from a JSON file. picktree never sees them."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, cast

from .cell_description import CellError


@dataclass(frozen=True, slots=True)
class CellFaults:
    """Imperfections of robot, sensors and items; the defaults are those of a good laboratory."""

    gripper_latency: float = 0.0
    """Time from a command to the fingers' first motion, s."""
    command_latency: float = 0.0
    """Age of a command when the servo follows it, s."""
    state_latency: float = 0.0
    """Age of a state when it is sent, s."""
    wrench_noise: float = 0.05
    """Standard deviation of the force at the wrist, each axis, N; of the torque a twentieth of it in Nm."""
    encoder_noise: float = 0.0
    """Standard deviation of a joint's angle, rad; of its speed ten times that a second."""
    joint_friction: float = 0.0
    """Coulomb friction of each joint beyond its own, Nm."""
    inertia_error: float = 0.2
    """Greatest share by which mass and inertia of each link of the arm differ from the URDF."""
    hand_mass_error: float = 0.02
    """Greatest share by which mass and inertia of the hand differ from the URDF: it has been weighed."""
    item_mass_error: float = 0.0
    """Greatest share by which the mass of each item differs from the file."""
    dropped_pictures: float = 0.0
    """Probability that a camera gives no picture."""
    depth_holes: float = 0.0
    """Share of the depth picture that is unknown, in blobs."""
    depth_edges: float = 0.0
    """Probability that a pixel within 2 pixels of an edge has no depth."""
    depth_ripple: float = 0.0
    """Amplitude of a slow ripple over the depth picture, m."""
    flying_pixels: float = 0.0
    """Probability that a pixel at an edge lies up to 30 mm before or behind it."""

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not (isinstance(value, int | float) and math.isfinite(value) and value >= 0.0):
                raise CellError(f"{each.name} is {value!r}; it is a number of at least 0")


def read_faults(path: Path) -> CellFaults:
    """Read a file of faults. Raises CellError with file, key and problem."""
    try:
        data: Any = json.loads(path.read_bytes())
    except OSError as error:
        raise CellError(f"{path}: the file cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise CellError(f"{path}: this is no JSON: {error}") from None
    names = [each.name for each in fields(CellFaults)]
    if not isinstance(data, dict):
        raise CellError(f"{path}: an object is expected")
    given = cast("dict[str, Any]", data)
    unknown = [key for key in given if key not in names]
    if unknown:
        raise CellError(f"{path}: {unknown[0]!r} is no fault of the cell; the faults are {', '.join(names)}")
    try:
        return CellFaults(**given)
    except CellError as error:
        raise CellError(f"{path}: {error}") from None
