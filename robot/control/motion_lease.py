"""Lease: the exclusive right to move the arm, held by its last acquirer."""

from __future__ import annotations

from types import TracebackType
from typing import Protocol

from picktree.files import PicktreeError

from .commands import Controller
from .force_guard import ForceGuard


class LeaseIssuer(Protocol):
    """Issuer of leases: the control loop."""

    def holds(self, lease: Lease) -> bool: ...
    def run(self, controller: Controller, guard: ForceGuard | None) -> None: ...
    def brake(self) -> None: ...
    def leave(self) -> None: ...


class Lease:
    """Lease on the arm from `ControlLoop.acquire`; as a context manager it is released on every exit.

    Release brakes the arm while the lease is valid. Release of a stale lease does nothing. When a new branch
    takes the arm before the old skill is halted, the old skill must not stop the new motion.
    """

    def __init__(self, lessor: LeaseIssuer, owner: str) -> None:
        self._lessor = lessor
        self.owner = owner

    @property
    def valid(self) -> bool:
        return self._lessor.holds(self)

    def run(self, controller: Controller, guard: ForceGuard | None = None) -> None:
        """Let `controller` move the arm from the next control period on."""
        if not self.valid:
            raise PicktreeError(f"{self.owner or 'a motion'} commands the arm, but another has taken it over")
        self._lessor.run(controller, guard)

    def release(self) -> None:
        if self.valid:
            self._lessor.brake()

    def hand_over(self) -> None:
        """Return the lease without braking: the controller continues until another skill takes it over.

        The controller must brake by itself when no skill does (`TrajectoryController.hand_over`).
        """
        if not self.valid:
            raise PicktreeError(
                f"{self.owner or 'a motion'} hands its motion over, but another has taken it over"
            )
        self._lessor.leave()

    def __enter__(self) -> Lease:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()
