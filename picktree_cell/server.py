"""Server of a cell over picktree's protocol, in lockstep: one client moves the robot, others may observe."""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import shared_memory
from threading import Condition, Lock
from typing import Final

import mujoco
import numpy as np

from picktree.drivers import protocol

from .plant import SILENCE, Plant
from .ray_camera import RayCamera

CLIENT_TIMEOUT: Final = 600.0
"""Time without a message after which a client is given up, s of wall time: planning may take long."""
OBSERVER_STREAM: Final = 1000
"""Number of the random stream of what observers read; those of cameras are added."""
_STAMP = struct.Struct("<QQ")


class CellServer:
    """Robot of a cell, as clients meet it."""

    def __init__(
        self,
        plant: Plant,
        seed: int,
        token: str = "",
        mode: protocol.Capability | None = None,
        advanced: Callable[[], object] = lambda: None,
        camera: type[RayCamera] = RayCamera,
    ) -> None:
        """`token`: what a client must know; empty: nothing. `mode`: the only mode of commands; None: all.
        `advanced`: called after time has passed. `camera`: the kind of all cameras."""
        self.plant = plant
        self._advanced = advanced
        self._token = token
        modes = protocol.Capability.POSITION | protocol.Capability.TORQUE if mode is None else mode
        self.capabilities = modes | protocol.Capability.LOCKSTEP | protocol.Capability.WRENCH
        self._cameras = [
            camera(entry, plant.parts, plant.faults, seed, n) for n, entry in enumerate(plant.cell.cameras)
        ]
        self._segments: list[shared_memory.SharedMemory] = []
        self._sequence = 0
        self.lock = Lock()
        """Lock that is held while the plant moves or is read."""
        self._passed = Condition(self.lock)
        self._moved = False
        """Whether a client moves the robot."""
        # Observers have noise of their own: the pictures and readings of the other client stay the same.
        self._eyes = [
            RayCamera(entry, plant.parts, plant.faults, seed, n + OBSERVER_STREAM)
            for n, entry in enumerate(plant.cell.cameras)
        ]
        self._rng = np.random.default_rng([seed, OBSERVER_STREAM])

    def serve(self, channel: protocol.Channel, *, moves: bool = True) -> None:
        """Serve one client until it leaves; `moves`: whether it may move the robot.

        Raises ProtocolError when it breaks the protocol.
        """
        try:
            hello = channel.receive()
            if not isinstance(hello, protocol.Hello):
                raise protocol.ProtocolError(f"a client begins with HELLO, not {type(hello).__name__}")
            if self._token and not protocol.same_token(self._token, hello.token):
                channel.send(protocol.Refusal(protocol.Refused.TOKEN, "the token is not the robot's"))
            elif protocol.Wish.OBSERVE in hello.wishes:
                channel.send(self._welcome(protocol.Wish.OBSERVE, hello.speed))
                self._converse(channel, self._observation)
            elif moves:
                self._serve_mover(channel, hello)
            else:
                raise protocol.ProtocolError("clients at this address only observe: HELLO lacks that wish")
        except protocol.ProtocolError as error:
            with suppress(protocol.ProtocolError):
                channel.send(protocol.Refusal(protocol.Refused.MESSAGE, str(error)[:200]))
            raise

    def _serve_mover(self, channel: protocol.Channel, hello: protocol.Hello) -> None:
        self.plant.speed, self._moved = hello.speed, True
        try:
            channel.send(self._welcome(hello.wishes, hello.speed))
            self._converse(channel, self._answer)
        finally:
            with self._passed:
                self.plant.halt(protocol.Stop.REQUESTED)
                self.plant.clear()
                self.plant.speed, self._moved = 1.0, False
                self._passed.notify_all()
            self._release()

    def _converse(
        self, channel: protocol.Channel, answer: Callable[[protocol.Message], protocol.Message]
    ) -> None:
        while not isinstance(message := channel.receive(), protocol.Bye):
            with self.lock:
                told = answer(message)
            channel.send(told)

    def _observation(self, message: protocol.Message) -> protocol.Message:
        """Return the answer to a client that only reads."""
        match message:
            case protocol.Observe(until):
                self._passed.wait_for(lambda: not self._moved or self.plant.time > until - 1e-6)
                return self._state(self._rng)
            case protocol.Capture(camera):
                return self._picture(camera, self._eyes)
            case _:
                raise protocol.ProtocolError(f"a client that only observes sent {type(message).__name__}")

    def _answer(self, message: protocol.Message) -> protocol.Message:
        plant = self.plant
        match message:
            case protocol.Command():
                self._check(message)
                plant.take(message)
                plant.advance(message.advance)
                self._advanced()
                self._passed.notify_all()
            case protocol.StopRequest(reason):
                plant.halt(reason if reason is not protocol.Stop.NONE else protocol.Stop.REQUESTED)
            case protocol.Clear():
                plant.clear()
            case protocol.Capture(camera):
                return self._picture(camera, self._cameras)
            case protocol.Observe():
                pass
            case _:
                raise protocol.ProtocolError(f"a client does not send {type(message).__name__}")
        return self._state()

    def _check(self, command: protocol.Command) -> None:
        n, mode = len(self.plant.cell.robot.joints), command.mode
        if len(command.position) != n:
            raise protocol.ProtocolError(f"a command has {len(command.position)} joints, the robot {n}")
        wanted = {
            protocol.Mode.POSITION: protocol.Capability.POSITION,
            protocol.Mode.TORQUE: protocol.Capability.TORQUE,
        }.get(mode)
        if wanted is not None and not wanted & self.capabilities:
            raise protocol.ProtocolError(f"the robot takes no commands in mode {mode.name}")
        if command.advance > 1.0:
            raise protocol.ProtocolError(
                f"a command advances {command.advance:g} s; the greatest step is 1 s"
            )

    def _welcome(self, wishes: protocol.Wish, speed: float) -> protocol.Welcome:
        cell = self.plant.cell
        gripper = cell.robot.gripper
        shared = bool(wishes & protocol.Wish.SHARED_MEMORY)
        cameras: list[protocol.CameraInfo] = []
        for camera in self._cameras:
            width, height = camera.entry.size
            segment = ""
            if shared:
                size = protocol.SEGMENT_HEADER + width * height * 7
                memory = shared_memory.SharedMemory(create=True, size=size)
                self._segments.append(memory)
                segment = memory.name
            lens = camera.focal, camera.focal, *camera.centre
            cameras.append(protocol.CameraInfo(camera.entry.name, segment, width, height, *lens))
        return protocol.Welcome(
            cell.robot.name,
            f"MuJoCo {mujoco.__version__}",
            self.capabilities,
            0.001,
            SILENCE,
            cell.workspace,
            cell.force,
            (gripper.max_width, gripper.max_force, gripper.speed),
            tuple(protocol.Joint(j.name, j.lower, j.upper, j.velocity, j.torque) for j in cell.robot.joints),
            tuple(cameras),
            speed,
        )

    def _state(self, rng: np.random.Generator | None = None) -> protocol.State:
        plant = self.plant
        reading = plant.reading(rng)
        self._sequence += 1
        return protocol.State(
            self._sequence,
            plant.command,
            plant.time,
            tuple(reading.position.tolist()),
            tuple(reading.velocity.tolist()),
            tuple(reading.torque.tolist()),
            reading.gripper,
            tuple(reading.wrench.tolist()),
            (reading.time,) * 3,
            reading.busy,
            plant.stop,
        )

    def _picture(self, number: int, cameras: Sequence[RayCamera]) -> protocol.Picture:
        if number >= len(cameras):
            raise protocol.ProtocolError(f"there is no camera {number}; the cell has {len(cameras)}")
        plant = self.plant
        seen = cameras[number].capture(plant.data, plant.tcp())
        if seen is None:
            return protocol.Picture(number, False, plant.time)
        data = protocol.join_picture(*seen)
        if not self._segments or cameras is self._eyes:
            return protocol.Picture(number, True, plant.time, data)
        memory = self._segments[number].buf
        assert memory is not None
        count = int(np.frombuffer(memory, "<u8", 1)[0])
        memory[: _STAMP.size] = _STAMP.pack(count + 1, 0)
        memory[protocol.SEGMENT_HEADER : protocol.SEGMENT_HEADER + len(data)] = data
        memory[: _STAMP.size] = _STAMP.pack(count + 2, round(plant.time * 1e6))
        return protocol.Picture(number, True, plant.time)

    def _release(self) -> None:
        for memory in self._segments:
            memory.close()
            with suppress(FileNotFoundError):
                memory.unlink()
        self._segments = []


def serve(server: CellServer, listener: socket.socket, *, clients: int = 0, moves: bool = True) -> None:
    """Serve clients one after another; `clients`: their number, 0: without an end. `moves`: whether they may
    move the robot."""
    served = 0
    with listener:
        while not clients or served < clients:
            connection, _ = listener.accept()
            served += 1
            with connection:
                connection.settimeout(CLIENT_TIMEOUT)
                try:
                    server.serve(protocol.Channel(connection), moves=moves)
                except protocol.ProtocolError as error:
                    print(f"client given up: {error}", flush=True)
