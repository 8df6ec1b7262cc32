"""Measurement of a robot in another process, in a file beside its robot file: what a run relies on.

`picktree robot test --robot-at` writes it, `picktree run --robot-at` reads it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from picktree.files import PicktreeError
from picktree.world.robot_model import RobotDescription, robot_file

SUFFIX: Final = ".measured.json"


@dataclass(frozen=True)
class RobotMeasurement:
    """Measured properties of a robot and its devices."""

    robot: str
    """Name that the robot tells."""
    engine: str
    """Engine, or controller, that the robot tells. Another one has other properties."""
    wrench_noise: float
    """Standard deviation of the force at rest, of the worst axis, N."""
    encoder_noise: float
    """Standard deviation of a joint at rest, of the worst one, rad."""
    latency: float
    """Time from a set-point to the encoders, s, the servo's own lag included."""
    told_latency: float
    """The same by stamps and sequence numbers, without that lag, s."""
    honest: bool
    """Whether the told latency can be relied on."""
    gripper_start: float | None
    """Time from a command to the fingers' first motion, s. None: they did not move."""
    gripper_time: float | None
    """Time in which the free fingers close halfway, s. None: they did not."""
    hand_mass: float
    """Mass of the hand, kg."""
    refused: tuple[str, ...] = ()
    """Reasons for which no mission is run: wrong signs or frames."""


_ADAPTER: Final = TypeAdapter(RobotMeasurement)


def measurement_path(robot: RobotDescription) -> Path:
    """Return the file of a measurement: beside its file; of a shipped robot in the present folder."""
    source = Path(robot.source)
    folder = Path.cwd() if source.parent == robot_file.SHIPPED else source.parent
    return folder / f"{source.stem}{SUFFIX}"


def write_measurement(measurement: RobotMeasurement, path: Path) -> None:
    """Write a measurement as JSON. Raises PicktreeError when the disk refuses."""
    try:
        path.write_bytes(_ADAPTER.dump_json(measurement, indent=1) + b"\n")
    except OSError as error:
        raise PicktreeError(f"{path}: the measurement cannot be written: {error.strerror}") from None


def read_measurement(path: Path) -> RobotMeasurement | None:
    """Return the measurement in a file; None when there is no such file.

    Raises PicktreeError for a file that is none.
    """
    try:
        return _ADAPTER.validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        raise PicktreeError(f"{path}: the measurement cannot be read: {error.strerror}") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "the file"
        raise PicktreeError(
            f"{path}: {where}: {first['msg']}; `picktree robot test --robot-at` writes it anew"
        ) from None
