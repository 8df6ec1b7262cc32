"""What a backend lets faults do."""

from __future__ import annotations

from typing import Protocol

from ...world.protocols import Clock, Gripper
from ...world.scene.description import Fixture
from ...world.values import ObjectId, Pose, Vector3
from ..fault_files.device_entries import Ailing
from ..scoring.truth import TrueBody, TrueObstacle
from .device_faults import DeviceFaults


class InjectableRobot(Protocol):
    """A simulated robot and its surroundings."""

    @property
    def clock(self) -> Clock: ...
    @property
    def gripper(self) -> Gripper: ...
    @property
    def ailments(self) -> DeviceFaults:
        """What is wrong with its devices now."""
        ...

    def truth(self) -> tuple[TrueBody, ...]: ...
    def true_tcp(self) -> Pose: ...
    def in_hand(self) -> ObjectId | None:
        """The item that the fingers really hold."""
        ...

    def remove(self, item: str) -> None: ...
    def change_dynamics(
        self, item: str, friction: float | None = None, mass: float | None = None
    ) -> None: ...
    def bump(self, item: str, velocity: Vector3, spin: Vector3 = (0.0, 0.0, 0.0)) -> None: ...
    def lubricate(self, item: str, friction: float | None, *, again: bool = False) -> None:
        """The item has that friction until it is given its own back, None. `again`: it had it when the
        checkpoint was taken."""
        ...

    def enlarge(self, item: str, factor: float) -> bool:
        """The item becomes so many times as large; False: there is no room for that now."""
        ...

    def appear(self, kind: str, colour: str, place: tuple[float, float], yaw: float) -> ObjectId | None:
        """A further item comes to lie there; None: something is there now. Raises PicktreeError where nothing
        is below."""
        ...

    def obstacles(self) -> tuple[TrueObstacle, ...]: ...
    def room_for(self, body: Fixture) -> bool: ...
    def put_obstacle(self, body: Fixture) -> ObjectId: ...
    def take_obstacle(self, name: ObjectId) -> None: ...
    def afflict(self, number: int, fault: Ailing, held: tuple[float, ...] | None = None) -> None:
        """A device begins to fail. `held`: it did when the checkpoint was taken, and that was what the device
        was doing when it began."""
        ...

    def relieve(self, number: int) -> None:
        """It works again."""
        ...
