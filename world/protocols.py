"""The hardware as skills and controllers meet it: two simulations implement it, a driver would be a third."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from picktree.files import PicktreeError

from .values import Array, GripperState, JointState, ObjectId, Pose, Wrench


class Clock(Protocol):
    """Simulated (on hardware: the controller's) time."""

    @property
    def now(self) -> float:
        """Seconds since the run began."""
        ...


class Arm(Protocol):
    """The joints of the arm, at the control rate."""

    def read(self) -> JointState:
        """Read the encoders of this control period; the result is the same until the next step."""
        ...

    def follow(self, position: Array, velocity: Array, ahead: tuple[Array, ...] = ()) -> None:
        """Command the stiff joint servo for the next period: (n,) rad, (n,) rad/s.

        `ahead`: configurations (n,) of the checked path at the times of `Hardware.preview`; empty: it ends.
        """
        ...

    def apply_torque(self, torque: Array) -> None:
        """Command joint torques (n,) Nm for the next period; gravity is not compensated for you."""
        ...


@dataclass(frozen=True, slots=True)
class GripperCommand:
    """Command to the gripper. Raises PicktreeError for values that are not finite or no speed."""

    width: float
    """Opening, m."""
    force: float
    """Greatest force of each finger, N."""
    speed: float | None = None
    """Greatest speed of each finger, m/s; None: as fast as it can."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.width) and math.isfinite(self.force)):
            raise PicktreeError(f"gripper: width {self.width}, force {self.force}; both must be finite")
        if self.speed is not None and not (math.isfinite(self.speed) and self.speed > 0.0):
            raise PicktreeError(f"gripper: speed {self.speed}; it must be finite and above 0")

    def within(self, max_width: float, max_force: float, max_speed: float) -> GripperCommand:
        """Return the command within the limits of a gripper."""
        return GripperCommand(
            min(max(self.width, 0.0), max_width),
            min(max(self.force, 0.0), max_force),
            None if self.speed is None or self.speed >= max_speed else self.speed,
        )


class Gripper(Protocol):
    """Two parallel fingers. A command stays in force until the next."""

    def read(self) -> GripperState: ...

    def command(self, command: GripperCommand) -> None:
        """Drive towards an opening. The command is within the gripper's limits."""
        ...


class WrenchSensor(Protocol):
    """The force/torque sensor in the wrist."""

    def read(self) -> Wrench:
        """Read the wrench that hand and load exert on the wrist: their weight plus contact forces. It is in
        the *world's* axes about the sensor's origin, with noise, and not tared.

        A load of m kg hanging still adds (0, 0, -9.81·m); a table that pushes the hand up adds +z.
        """
        ...


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Pinhole camera: pixels. The ray of pixel (column u, row v) is ((u - cx)/fx, (v - cy)/fy, 1)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float


@dataclass(frozen=True, slots=True, eq=False)
class RgbdImage:
    """One shot: colour (h, w, 3) uint8, depth (h, w) float32 in m along the optical axis, 0 where unknown."""

    camera: str
    colour: NDArray[np.uint8]
    depth: NDArray[np.float32]
    stamp: float
    intrinsics: Intrinsics
    camera_in_world: Pose
    """Believed pose of the camera (from the scene file): x right, y down, z forward."""


class RobotStopped(PicktreeError):
    """Stop that the robot's own side has made, or the loss of the connection to it: the run ends."""


class NoImage(Exception):
    """The camera gave no image in time. Perception reports it as perception.no_image."""


class Camera(Protocol):
    """A camera that returns colour, depth and stamp, and no segmentation."""

    def capture(self) -> RgbdImage:
        """Return the next image. Raises NoImage without one."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class RecognisedItem:
    """Item that another process has recognised in a picture."""

    kind: str
    """Kind of the catalogue."""
    colour: str
    """Name of its colour; empty: unknown."""
    confidence: float
    """Confidence, 0 … 1."""
    rows: NDArray[np.intp]
    """Rows of its pixels (n,)."""
    columns: NDArray[np.intp]
    """Columns of its pixels (n,)."""
    masked: bool
    """Whether the pixels show the item alone. Else they are a box around it."""
    pose: Pose | None = None
    """Its pose in the camera's optical frame; None: unknown."""
    sigma_position: float = 0.0
    """Standard deviation of the position along each axis, m; 0: unknown."""
    sigma_angle: float = 0.0
    """Standard deviation of the turn, rad; 0: unknown."""


class NotRecognised(Exception):
    """No usable answer of a recogniser, with its reason. Perception reports it as perception.no_image."""


class Recogniser(Protocol):
    """Process that recognises items in pictures, in place of perception's own recognition by colour."""

    def recognise(self, image: RgbdImage) -> tuple[RecognisedItem, ...]:
        """Return the items in a picture. Raises NotRecognised without a usable answer."""
        ...


@dataclass(frozen=True, slots=True)
class SensorStamps:
    """Times of the last new reading of each sensor of the robot, s. The stamp of a silent sensor does not
    change, and its reading repeats."""

    joints: float
    gripper: float
    wrench: float


@dataclass(frozen=True, slots=True)
class FeedSignals:
    """Signals of the feed to the robot."""

    exhausted: bool = True
    """Whether nothing more will come."""
    busy: bool = False
    """Whether items are set down, a belt runs or a bin is exchanged, or would be with the arm out of the
    way."""
    obstructed: bool = False
    """Whether the feed waits for the arm to leave the place."""
    deliveries: int = 0
    """Number of deliveries since the run began: items set down, or a belt that stopped with something new."""
    exchanges: Mapping[ObjectId, int] = field(default_factory=dict[ObjectId, int])
    """Number of exchanges of each bin: for an empty one, or a tote for a full one."""


class Feed(Protocol):
    """Feed that brings items and takes full bins away: people, a feeder, belts. It communicates by binary
    signals only; cameras find items and their places."""

    def ready(self) -> None:
        """Report that the robot is done with the present items: waiting loads may come, belts may run."""
        ...

    def exchange(self, bin_id: ObjectId) -> None:
        """Request an empty bin in place of this one. Repeated requests before the exchange count once."""
        ...

    def read(self) -> FeedSignals:
        """Return the signals in this control period."""
        ...


class Hardware(Protocol):
    """Hardware below a `World`. `step` lets one control period pass."""

    @property
    def clock(self) -> Clock: ...
    @property
    def arm(self) -> Arm: ...
    @property
    def gripper(self) -> Gripper: ...
    @property
    def wrench(self) -> WrenchSensor: ...
    @property
    def cameras(self) -> Mapping[str, Camera]: ...
    @property
    def feed(self) -> Feed: ...
    @property
    def stamps(self) -> SensorStamps: ...
    @property
    def feels_effort(self) -> bool:
        """Whether `JointState.effort` is the effort of the joints also during motions, so that it can be
        checked against the robot's dynamics."""
        ...

    @property
    def takes_torque(self) -> bool:
        """Whether the arm takes torques; else contact is made by positions (see `robot.control`)."""
        ...

    @property
    def latency(self) -> float:
        """Time from a command to the reading that shows its effect, beyond a control period, s."""
        ...

    @property
    def preview(self) -> tuple[float, ...]:
        """Times for which `Arm.follow` wants the path ahead, s after the command; empty: it does not."""
        ...

    @property
    def period(self) -> float:
        """Length of a control period, s."""
        ...

    def pace(self, rate: int | None = None) -> None:
        """Let control go `rate` times a second from now on, where contacts want that; without a rate as
        everyday. Raises PicktreeError for a rate that it does not have."""
        ...

    def step(self) -> None:
        """Apply the commands, let `period` pass, refresh the sensors.

        Raises RobotStopped when the robot's own side has stopped it, or is gone.
        """
        ...

    def settings(self) -> Mapping[str, str]:
        """Return what the hardware is, for the record."""
        ...

    def close(self) -> None:
        """Release the hardware. A robot brakes."""
        ...


NO_SIGNALS = FeedSignals()


class NoFeed:
    """`protocols.Feed` of a scene without a feed."""

    def ready(self) -> None: ...

    def exchange(self, bin_id: ObjectId) -> None: ...

    def read(self) -> FeedSignals:
        return NO_SIGNALS
