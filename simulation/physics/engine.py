"""pybullet: import without its build message, clients, step rates and solver settings."""

from __future__ import annotations

import os
import tempfile
import weakref
from collections.abc import Generator
from contextlib import contextmanager

from picktree.files import PicktreeError
from picktree.world import GRAVITY

__all__ = ["pb"]
STANDARD_ERROR = 2
BUILD_MESSAGE = b"pybullet build time"


@contextmanager
def _without_build_time() -> Generator[None]:
    """Drop pybullet's build message, which C code writes past `sys.stderr`. All other output is passed on,
    also when the import fails."""
    try:
        kept = os.dup(STANDARD_ERROR)
    except OSError:
        # Standard error is closed.
        yield
        return
    with tempfile.TemporaryFile() as output:
        os.dup2(output.fileno(), STANDARD_ERROR)
        try:
            yield
        finally:
            os.dup2(kept, STANDARD_ERROR)
            os.close(kept)
            output.seek(0)
            for line in output:
                if not line.startswith(BUILD_MESSAGE):
                    os.write(STANDARD_ERROR, line)


with _without_build_time():
    import pybullet as pb


class Client:
    """pybullet client, disconnected when its last user is gone or by `close`. pybullet has 1024 clients at
    most."""

    def __init__(self) -> None:
        self.id = pb.connect(pb.DIRECT)
        self.close = weakref.finalize(self, _disconnect, self.id)


def _disconnect(client: int) -> None:
    if pb.isConnected(client):
        pb.disconnect(client)


RESOLUTION = 12_000
"""Units of simulated time per second. Time is an integer count of them, so that no rounding depends on the
step rate."""
EVERYDAY_STEP_RATE = 240
"""Everyday step rate, Hz; at 120 Hz plates are dropped in transport."""
MAX_STEP_RATE = 2000
STEP_RATE_DIVISOR = 20
"""Divisor of all step rates, Hz: a tick of 50 ms is then a whole number of steps."""
SOLVER_ITERATIONS, FINE_ITERATIONS = 50, 100
RESIDUAL_THRESHOLD = 3e-7
"""Residual at which the solver stops. At 1e-5 boxes creep 0.15 mm/s over the table unless they get rolling
friction, at three times the cost."""
CONTACT_DISTANCE = 0.005
"""Distance, m, from which the engine keeps contact points and enlarges bounding boxes. Its own value of 20 mm
costs a dense scene twice the time and wakes neighbours that nothing touches."""
HEAP_CONTACT_DISTANCE = 0.002
"""Contact distance of scenes with heaps, m. A heap of 20 items takes two thirds of the time with it."""
ERROR_REDUCTION, CONTACT_REDUCTION, FINE_REDUCTION = 0.2, 0.08, 0.8
"""Share of a joint error, and of a penetration, that one step corrects: everyday values are the engine's own.

At a fine rate both are the last value. With the everyday values a peg goes up to 1.5 mm into a wall rather
than into its hole. With larger ones the everyday step would throw bodies about.
"""


def check_step_rate(rate: int) -> int:
    """Return the step rate, Hz. Raises PicktreeError for a rate that is not possible."""
    known = [
        r for r in range(EVERYDAY_STEP_RATE, MAX_STEP_RATE + 1, STEP_RATE_DIVISOR) if RESOLUTION % r == 0
    ]
    if rate not in known:
        raise PicktreeError(f"a step of 1/{rate} s is not possible; rates: {', '.join(map(str, known))} Hz")
    return rate


def set_step_rate(rate: int, client: int) -> None:
    """Set the engine's step to 1/`rate` s, with suitable solver settings."""
    fine = rate > EVERYDAY_STEP_RATE
    pb.setTimeStep(1 / rate, client)
    pb.setPhysicsEngineParameter(
        numSolverIterations=FINE_ITERATIONS if fine else SOLVER_ITERATIONS,
        erp=FINE_REDUCTION if fine else ERROR_REDUCTION,
        contactERP=FINE_REDUCTION if fine else CONTACT_REDUCTION,
        physicsClientId=client,
    )


def reset(client: int, contact_distance: float = CONTACT_DISTANCE) -> None:
    """Remove all bodies from a client and set gravity, the everyday step and the solver."""
    pb.resetSimulation(physicsClientId=client)
    pb.setGravity(0, 0, -GRAVITY, physicsClientId=client)
    set_step_rate(EVERYDAY_STEP_RATE, client)
    pb.setPhysicsEngineParameter(
        solverResidualThreshold=RESIDUAL_THRESHOLD,
        deterministicOverlappingPairs=1,
        contactBreakingThreshold=contact_distance,
        jointFeedbackMode=pb.JOINT_FEEDBACK_IN_WORLD_SPACE,
        physicsClientId=client,
    )
