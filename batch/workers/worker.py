"""The worker's side: one process that has everything loaded and sees to one order after the other."""

from __future__ import annotations

import gc
import os
import signal
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection
from types import FrameType
from typing import NoReturn

from .executor import Event, Order
from .job_output import silence
from .processes import die_with_parent, take_in_orphans

READY = "ready"
"""What a worker says once it has loaded all that it needs."""

_MODULES = (
    "pybullet",
    "picktree.recovery",
    "picktree.skills",
    "picktree.simulation.kinematic.backend",
    "picktree.simulation.physics.backend",
    "picktree.batch.workers.job_process",
)


class _Told(BaseException):
    """The batch tells the worker to break off, or is gone."""


def serve(orders: Connection) -> None:
    """Carry out what comes, each order in a process of its own, until the other side is closed.

    On SIGTERM, and when the batch's process is gone, it ends with all that is under way.
    """
    os.setsid()  # Ctrl-C is for the batch to deal with
    die_with_parent(signal.SIGTERM)
    take_in_orphans()
    with silence():  # libraries greet when they are loaded
        load()
    with suppress(EOFError, OSError, _Told):
        orders.send(READY)
        while True:
            orders.send(_seen_to(orders.recv()))
    os._exit(0)  # without the farewells of libraries, which would stand in the batch's output


def _seen_to(order: Order) -> Event:
    from .job_process import Contained

    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    before = signal.signal(signal.SIGTERM, _told)
    try:
        under_way = Contained(order)
        try:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
            return under_way.event()
        finally:
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
            under_way.end()
    finally:
        signal.signal(signal.SIGTERM, before)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})


def _told(number: int, frame: FrameType | None) -> NoReturn:
    raise _Told


def load() -> None:
    """Everything that a job would load in its own time, and what is the same for all of them."""
    for module in _MODULES:
        import_module(module)
    from ...logs.meshes.link_meshes import link_meshes
    from ...perception.expectation.robot_mask import RobotMask
    from ...planning.collision.collision_checker import robot_geometry
    from ...robots.loading import load_robot
    from ...robots.model import RobotModel
    from ...session.arithmetic_probe import arithmetic
    from ...session.environment import revision, sources
    from ...session.recipe_files import installed_meshes

    # The robot of the shipped scenes; with another one, each job loads its own.
    robot = load_robot("panda")
    link_meshes(robot.urdf)
    installed_meshes(robot)
    model = RobotModel(robot)
    robot_geometry(model)
    RobotMask(model)
    arithmetic()
    revision()
    sources()
    arithmetic()
    gc.collect()
    gc.freeze()  # what is shared with the jobs' processes stays shared
