"""Hardware in another process: `world.protocols.Hardware` over the protocol of drivers.

In lockstep the robot's time passes only in `step`. Each set-point has the checked path ahead with it, which
the robot side follows by itself when a command is late.
"""

from __future__ import annotations

import math
import os
import struct
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import resource_tracker, shared_memory
from types import MappingProxyType
from typing import Final

import numpy as np

from picktree.files import PicktreeError
from picktree.world import (
    Array,
    Camera,
    Feed,
    GripperCommand,
    GripperState,
    Intrinsics,
    JointState,
    NoFeed,
    NoImage,
    RgbdImage,
    RobotStopped,
    SensorStamps,
    Wrench,
)
from picktree.world.robot_model import RobotDescription, RobotModel
from picktree.world.scene import CameraDescription, SceneDescription

from . import protocol
from .external_recogniser import ExternalRecogniser
from .measurement import RobotMeasurement

EVERYDAY_PERIOD: Final = 0.005
"""Control period outside of contacts, s: a tick has whole periods."""
CONNECT_TIME: Final = 5.0
"""Longest wait for a robot that does not listen yet, s of wall time."""
ANSWER_TIME: Final = 30.0
"""Longest wait for an answer, s of wall time."""
HISTORY_TIME: Final = 0.3
"""Time over which configurations are kept for pictures, s."""
STOPS: Final[Mapping[protocol.Stop, str]] = {
    protocol.Stop.SILENCE: "no command came in time",
    protocol.Stop.SPEED: "a joint was too fast",
    protocol.Stop.POSITION: "a joint was beyond its limit",
    protocol.Stop.WORKSPACE: "the tool left the workspace",
    protocol.Stop.FORCE: "the force at the wrist was too great",
    protocol.Stop.JUMP: "a commanded position was too far from the one before",
    protocol.Stop.REQUESTED: "a stop was requested",
    protocol.Stop.OPERATOR: "a person or a safety device stopped it",
    protocol.Stop.FAULT: "one of its devices is faulty",
    protocol.Stop.TRACKING: "the arm does not follow: something blocks it",
}
"""Reasons of a stop, in words."""
_COUNT_AND_STAMP = struct.Struct("<QQ")


class Link:
    """Connection to a robot's process: a question and its answer at a time."""

    def __init__(self, address: str, speed: float = 1.0, *, observes: bool = False) -> None:
        """Connect and greet; `speed`: share of the joints' speeds to which the robot is bound.

        `observes`: as a client that only reads.

        Raises PicktreeError when nobody listens or the robot refuses.
        """
        try:
            self.address = protocol.Address.parse(address)
            token = os.environ.get(protocol.TOKEN_VARIABLE, "")
            self.address.require_token(token)
        except protocol.ProtocolError as error:
            raise PicktreeError(f"--robot-at: {error}") from None
        self._channel = self._connect()
        self._lost = ""
        """Reason for which the connection is over; empty: it is not."""
        wishes = protocol.Wish.SHARED_MEMORY if self.address.loopback else protocol.Wish(0)
        answer = self.ask(protocol.Hello(protocol.Wish.OBSERVE if observes else wishes, token, speed))
        if not isinstance(answer, protocol.Welcome):
            raise self._unexpected(answer)
        self.robot = answer

    def _connect(self) -> protocol.Channel:
        until = time.monotonic() + CONNECT_TIME
        while True:
            try:
                connection = self.address.connect(ANSWER_TIME)
            except OSError as error:
                if time.monotonic() < until and isinstance(error, FileNotFoundError | ConnectionRefusedError):
                    time.sleep(0.05)
                    continue
                raise PicktreeError(
                    f"no robot at {self.address}: {error.strerror or error}; start its process first"
                ) from None
            connection.settimeout(ANSWER_TIME)
            return protocol.Channel(connection)

    def ask(self, message: protocol.Message) -> protocol.Message:
        """Send a message and return its answer. Raises RobotStopped when the robot refuses or is gone, and
        from then on at once."""
        if self._lost:
            raise RobotStopped(self._lost)
        try:
            self._channel.send(message)
            answer = self._channel.receive()
        except protocol.ProtocolError as error:
            self._lost = f"the robot at {self.address}: {error}"
            raise RobotStopped(self._lost) from None
        if isinstance(answer, protocol.Refusal):
            self._lost = f"the robot at {self.address} refuses: {answer.text}"
            raise RobotStopped(self._lost)
        return answer

    def state(self, message: protocol.Message) -> protocol.State:
        """Send a message whose answer is a state."""
        answer = self.ask(message)
        if not isinstance(answer, protocol.State):
            raise self._unexpected(answer)
        if len(answer.position) != len(self.robot.joints):
            raise PicktreeError(
                f"the robot at {self.address} sends the state of {len(answer.position)} joints"
            )
        return answer

    def close(self) -> None:
        with suppress(protocol.ProtocolError):
            self._channel.send(protocol.Bye())
        self._channel.close()

    def _unexpected(self, answer: protocol.Message) -> PicktreeError:
        return PicktreeError(f"the robot at {self.address} answers with {type(answer).__name__}")


@dataclass
class RobotClock:
    """Time of the robot's clock since the run began."""

    now: float = 0.0


class ExternalArm:
    """`protocols.Arm` of a robot in another process."""

    def __init__(self, hardware: ExternalHardware, model: RobotModel) -> None:
        self._hardware, self._model = hardware, model

    def read(self) -> JointState:
        return self._hardware.joints

    def follow(self, position: Array, velocity: Array, ahead: tuple[Array, ...] = ()) -> None:
        self._hardware.command = protocol.Mode.POSITION, position, velocity, ahead

    def apply_torque(self, torque: Array) -> None:
        own = self._model.gravity(self._hardware.joints.position)
        self._hardware.command = protocol.Mode.TORQUE, torque - own, np.zeros_like(torque), ()


class ExternalGripper:
    """`protocols.Gripper` of a robot in another process."""

    def __init__(self, hardware: ExternalHardware) -> None:
        self._hardware = hardware
        self._last: GripperCommand | None = None
        self._since = -math.inf
        measured = hardware.measured
        self._start = (measured.gripper_start or 0.0) if measured else 0.0

    def read(self) -> GripperState:
        """Return the state; fingers are busy for their measured start after a command, whatever they tell."""
        state = self._hardware.fingers
        waits = self._hardware.clock.now - self._since < self._start
        return replace(state, busy=True) if waits and not state.busy else state

    def command(self, command: GripperCommand) -> None:
        if command != self._last:
            self._last, self._since = command, self._hardware.clock.now
            self._hardware.grip = protocol.GripCommand(command.width, command.force, command.speed or 0.0)


class ExternalWrench:
    """`protocols.WrenchSensor` of a robot in another process; its readings are turned into world axes."""

    def __init__(self, hardware: ExternalHardware, model: RobotModel) -> None:
        self._hardware, self._model = hardware, model
        self._read: tuple[int, Wrench] = (-1, Wrench())

    def read(self) -> Wrench:
        state = self._hardware.state
        if self._read[0] != state.sequence:
            turn = self._model.flange(np.array(state.position)).rotation()
            numbers = np.array(state.wrench)
            force, torque = (turn @ numbers[:3]).tolist(), (turn @ numbers[3:]).tolist()
            self._read = state.sequence, Wrench(tuple(force), tuple(torque))
        return self._read[1]


class ExternalCamera:
    """`protocols.Camera` of a robot in another process."""

    def __init__(
        self, hardware: ExternalHardware, model: RobotModel, camera: CameraDescription, number: int
    ) -> None:
        self._hardware, self._model = hardware, model
        self._camera, self._number = camera, number
        info = hardware.link.robot.cameras[number]
        self._info = info
        self._intrinsics = Intrinsics(info.width, info.height, info.fx, info.fy, info.cx, info.cy)
        self._segment = _attach(info.segment) if info.segment else None

    def capture(self) -> RgbdImage:
        hardware, info = self._hardware, self._info
        try:
            answer = hardware.link.ask(protocol.Capture(self._number))
        except RobotStopped as error:
            raise NoImage(str(error)) from None  # The next step ends the run.
        if not isinstance(answer, protocol.Picture) or answer.camera != self._number:
            raise PicktreeError(f"the robot at {hardware.link.address} gives no picture of {info.name}")
        if not answer.given:
            raise NoImage(f"{info.name} gave no image")
        colour, depth = protocol.split_picture(self._data(answer), info.width, info.height)
        stamp = hardware.picture_time(answer.stamp)
        frame = self._camera.pose
        if self._camera.on == "hand":
            frame = self._model.tcp(hardware.configuration_at(stamp)) @ frame
        return RgbdImage(info.name, colour, depth, stamp, self._intrinsics, frame)

    def _data(self, picture: protocol.Picture) -> bytes:
        """Return the data of a picture, from its segment when it is not inline. Raises NoImage for half a
        picture."""
        info = self._info
        if self._segment is None:
            if len(picture.data) != info.picture_size:
                raise PicktreeError(f"a picture of {info.name} has {len(picture.data)} bytes")
            return picture.data
        buffer = self._segment.buf
        assert buffer is not None
        before = _COUNT_AND_STAMP.unpack_from(buffer)[0]
        data = bytes(buffer[protocol.SEGMENT_HEADER : protocol.SEGMENT_HEADER + info.picture_size])
        if before % 2 or before != _COUNT_AND_STAMP.unpack_from(buffer)[0]:
            raise NoImage(f"{info.name} was writing its image")
        return data


def _attach(name: str) -> shared_memory.SharedMemory:
    """Attach a segment of the robot's process. Raises PicktreeError when it is missing."""
    try:
        segment = shared_memory.SharedMemory(name)
    except OSError as error:
        raise PicktreeError(f"the robot's shared memory {name!r} cannot be read: {error.strerror}") from None
    # Its owner removes it; the tracker of this process would, too.
    resource_tracker.unregister(f"/{name}", "shared_memory")
    return segment


class ExternalHardware:
    """`protocols.Hardware` of a robot in another process, in lockstep.

    Raises PicktreeError for a robot that is not the scene's: other joints, cameras that are missing; and for
    one that does not keep to the speed.
    """

    observes = False
    """Whether the robot is only read."""

    def __init__(
        self,
        scene: SceneDescription,
        robot: RobotDescription,
        address: str,
        speed: float = 1.0,
        measured: RobotMeasurement | None = None,
        perception_at: str = "",
    ) -> None:
        """Connect; `speed`: share of the joints' speeds beyond which the robot stops.

        `measured`: measurement of the robot. That of another engine is not used. `perception_at`: address of
        the process that recognises items; empty: no such process.
        """
        self.link = Link(address, speed, observes=self.observes)
        told = self.link.robot
        try:
            self._check(told, scene, robot)
            if told.speed > speed:
                raise PicktreeError(
                    f"the robot at {self.link.address} moves at {100 * told.speed:g} % of its speeds, not at "
                    f"{100 * speed:g} %"
                )
            fits = measured is not None and (measured.robot, measured.engine) == (told.robot, told.engine)
            self.measured = measured if fits else None
            """Measurement of this robot; None: it was not tested."""
            if self.measured is not None and self.measured.refused:
                raise PicktreeError(
                    f"the robot at {self.link.address} failed its test: {'; '.join(self.measured.refused)}; "
                    "mend it and repeat `picktree robot test --robot-at`"
                )
            self.recogniser = ExternalRecogniser(perception_at, scene.catalogue) if perception_at else None
            """Process that recognises items; None: no such process."""
        except PicktreeError:
            self.link.close()
            raise
        model = RobotModel(replace(robot, tool=scene.tool))
        n = len(robot.joints)
        self.clock = RobotClock()
        self.period = EVERYDAY_PERIOD
        self.grip: protocol.GripCommand | None = None
        """Command of the gripper that goes with the next step; None: no new one."""
        self.command: tuple[protocol.Mode, Array, Array, tuple[Array, ...]] = (
            protocol.Mode.HOLD,
            np.zeros(n),
            np.zeros(n),
            (),
        )
        """Mode of the next command, its positions or torques (n,), velocities (n,), and the path ahead."""
        self._sequence = 0
        self.began = 0.0
        self._history: deque[tuple[float, Array]] = deque()
        self._take(self._exchange(0.0))
        self.began = self.state.time
        self._take(self.state)
        self.arm = ExternalArm(self, model)
        self.gripper = ExternalGripper(self)
        self.wrench = ExternalWrench(self, model)
        numbers = {camera.name: n for n, camera in enumerate(told.cameras)}
        self.cameras: Mapping[str, Camera] = MappingProxyType(
            {c.name: ExternalCamera(self, model, c, numbers[c.name]) for c in scene.cameras}
        )
        self.feed: Feed = NoFeed()

    @property
    def feels_effort(self) -> bool:
        """Whether joint efforts can be checked against the robot's dynamics: False until these are
        identified."""
        return False

    @property
    def takes_torque(self) -> bool:
        return protocol.Capability.TORQUE in self.link.robot.capabilities

    @property
    def latency(self) -> float:
        """Age of the joint reading, and of the command that was in force, s; the measured one where these
        are not told truly."""
        age = self.state.time - self.state.stamps[0]
        told = age + max(0, self._sequence - self.state.command) * self.period
        measured = self.measured
        return told if measured is None or measured.honest else max(told, measured.latency)

    @property
    def preview(self) -> tuple[float, ...]:
        return protocol.PREVIEW_TIMES

    @property
    def stamps(self) -> SensorStamps:
        joints, gripper, wrench = (stamp - self.began for stamp in self.state.stamps)
        return SensorStamps(joints, gripper, wrench)

    def pace(self, rate: int | None = None) -> None:
        """Set the control rate, Hz. Raises PicktreeError for a period that the robot's servo does not
        have."""
        wanted = EVERYDAY_PERIOD if rate is None else 1.0 / rate
        servo = self.link.robot.period
        steps = round(wanted / servo)
        if steps < 1 or abs(steps * servo - wanted) > 1e-6:
            raise PicktreeError(
                f"a control rate of {rate} Hz: the robot's servo has periods of {1000 * servo:g} ms"
            )
        self.period = wanted

    def settings(self) -> Mapping[str, str]:
        """Return what the robot's side is, for the record."""
        told = self.link.robot
        return {
            "engine": told.engine,
            "robot": told.robot,
            "protocol": str(protocol.VERSION),
            "capabilities": ", ".join(str(each.name).lower() for each in told.capabilities),
            "period": f"{EVERYDAY_PERIOD} s",
            **({} if self.measured is None else {"measured": repr(self.measured)}),
            **({} if self.recogniser is None else {"perception": self.recogniser.name}),
            **({} if told.speed == 1.0 else {"speed": f"{100 * told.speed:g} %"}),
        }

    def step(self) -> None:
        """Send the command, let a period pass, and take the state at its end.

        Raises RobotStopped when the robot has stopped by itself or is gone.
        """
        self._take(self._exchange(self.period))
        self.grip = None
        stop = self.state.stop
        if stop is not protocol.Stop.NONE:
            raise RobotStopped(
                f"the robot at {self.link.address} has stopped by itself at {self.clock.now:.2f} s: "
                f"{STOPS[stop]}"
            )

    def picture_time(self, stamp: float) -> float:
        """Return the time since the run began of a picture with that stamp, s."""
        return stamp - self.began

    def configuration_at(self, time: float) -> Array:
        """Return the configuration (n,) that is nearest to a time within the last `HISTORY_TIME` s."""
        return min(self._history, key=lambda each: abs(each[0] - time))[1]

    def close(self) -> None:
        """Let the robot brake and end the connections."""
        self.link.close()
        if self.recogniser is not None:
            self.recogniser.close()

    def _exchange(self, advance: float) -> protocol.State:
        """Send the command, let `advance` s pass, and return the state."""
        return self.link.state(self._message(advance))

    def _message(self, advance: float) -> protocol.Command:
        mode, numbers, velocity, ahead = self.command
        self._sequence += 1
        zero = (0.0,) * len(numbers)
        values = tuple(numbers.tolist())
        torque = mode is protocol.Mode.TORQUE
        return protocol.Command(
            self._sequence,
            mode,
            zero if torque else values,
            tuple(velocity.tolist()),
            values if torque else zero,
            advance,
            tuple(tuple(each.tolist()) for each in ahead),
            self.grip,
        )

    def _take(self, state: protocol.State) -> None:
        """Take a state as the readings of this period."""
        self.state = state
        self.clock.now = state.time - self.began
        self.joints = JointState(np.array(state.position), np.array(state.velocity), np.array(state.torque))
        width, rate, force = state.gripper
        self.fingers = GripperState(width, rate, force, state.busy)
        stamp = state.stamps[0] - self.began
        self._history.append((stamp, self.joints.position))
        while stamp - self._history[0][0] > HISTORY_TIME:
            self._history.popleft()

    def _check(self, told: protocol.Welcome, scene: SceneDescription, robot: RobotDescription) -> None:
        where = f"the robot at {self.link.address}"
        names = tuple(joint.name for joint in told.joints)
        if names != robot.joints:
            raise PicktreeError(
                f"{where} has the joints {', '.join(names)}, but {robot.name} has {', '.join(robot.joints)}"
            )
        known = {camera.name for camera in told.cameras}
        if missing := [camera.name for camera in scene.cameras if camera.name not in known]:
            raise PicktreeError(f"{where} has no camera {missing[0]!r}, which the scene {scene.name} has")
        if protocol.Capability.LOCKSTEP not in told.capabilities:
            raise PicktreeError(f"{where} runs in real time; this version drives a robot in lockstep only")
        if not told.capabilities & (protocol.Capability.POSITION | protocol.Capability.TORQUE):
            raise PicktreeError(f"{where} takes neither positions nor torques")
        if protocol.Capability.WRENCH not in told.capabilities:
            raise PicktreeError(f"{where} has no force/torque sensor at the wrist")
