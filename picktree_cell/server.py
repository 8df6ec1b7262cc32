"""Server of a cell over picktree's protocol: one client at a time, in lockstep."""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import shared_memory
from threading import Lock
from typing import Final

import mujoco
import numpy as np

from picktree.drivers import protocol

from .cell_description import CellError
from .plant import SILENCE, Plant
from .ray_camera import RayCamera

CLIENT_TIMEOUT: Final = 600.0
"""Time without a message after which a client is given up, s of wall time: planning may take long."""
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

    def serve(self, channel: protocol.Channel) -> None:
        """Serve one client until it leaves. Raises ProtocolError when it breaks the protocol."""
        try:
            hello = channel.receive()
            if not isinstance(hello, protocol.Hello):
                raise protocol.ProtocolError(f"a client begins with HELLO, not {type(hello).__name__}")
            if self._token and not protocol.same_token(self._token, hello.token):
                channel.send(protocol.Refusal(protocol.Refused.TOKEN, "the token is not the robot's"))
                return
            self.plant.speed = hello.speed
            channel.send(self._welcome(hello.wishes))
            while True:
                message = channel.receive()
                if isinstance(message, protocol.Bye):
                    return
                with self.lock:
                    answer = self._answer(message)
                channel.send(answer)
        except protocol.ProtocolError as error:
            with suppress(protocol.ProtocolError):
                channel.send(protocol.Refusal(protocol.Refused.MESSAGE, str(error)[:200]))
            raise
        finally:
            self.plant.halt(protocol.Stop.REQUESTED)
            self.plant.clear()
            self.plant.speed = 1.0
            self._release()

    def _answer(self, message: protocol.Message) -> protocol.Message:
        plant = self.plant
        match message:
            case protocol.Command():
                self._check(message)
                plant.take(message)
                plant.advance(message.advance)
                self._advanced()
            case protocol.StopRequest(reason):
                plant.halt(reason if reason is not protocol.Stop.NONE else protocol.Stop.REQUESTED)
            case protocol.Clear():
                plant.clear()
            case protocol.Capture(camera):
                return self._picture(camera)
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

    def _welcome(self, wishes: protocol.Wish) -> protocol.Welcome:
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
            self.plant.speed,
        )

    def _state(self) -> protocol.State:
        plant = self.plant
        reading = plant.reading()
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

    def _picture(self, number: int) -> protocol.Picture:
        if number >= len(self._cameras):
            raise protocol.ProtocolError(f"there is no camera {number}; the cell has {len(self._cameras)}")
        plant = self.plant
        seen = self._cameras[number].capture(plant.data, plant.tcp())
        if seen is None:
            return protocol.Picture(number, False, plant.time)
        data = protocol.join_picture(*seen)
        if not self._segments:
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


def serve(server: CellServer, address: protocol.Address, *, clients: int = 0) -> None:
    """Listen at an address and serve clients one after another; `clients`: their number, 0: without an end.

    Raises CellError when nothing can listen there.
    """
    try:
        listener = address.listen()
    except OSError as error:
        raise CellError(f"nothing can listen at {address}: {error.strerror or error}") from None
    served = 0
    with listener:
        print(f"ready at {address}", flush=True)
        while not clients or served < clients:
            connection, _ = listener.accept()
            served += 1
            with connection:
                connection.settimeout(CLIENT_TIMEOUT)
                try:
                    server.serve(protocol.Channel(connection))
                except protocol.ProtocolError as error:
                    print(f"client given up: {error}", flush=True)
