"""Cluster of Ray: the connection to a running one or one of this machine, its nodes, workers on them."""

from __future__ import annotations

import logging
import os
import socket
from dataclasses import dataclass
from pathlib import Path

import ray
from ray.exceptions import OutOfMemoryError, RayError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from ...files.errors import PicktreeError
from .messages import Installation, Task
from .node_worker import NodeWorker, TaskReport

_REPLY_TIME_LIMIT = 5.0
"""Time limit for a reply of the cluster's port, wall s."""
_OBJECT_STORE_BYTES = 100 << 20
"""Size of the object store of a cluster of this machine, bytes."""


@dataclass(frozen=True, slots=True)
class ClusterNode:
    """Machine of the cluster."""

    id: str
    address: str
    cpus: int


def connect(address: str | None, workers: int | None, folder: Path) -> None:
    """Connect to the cluster at `address`; None: start one with this number of CPUs, its files in `folder`.

    Raises PicktreeError when there is none.
    """
    if address is None:
        _start(workers or len(os.sched_getaffinity(0)), folder)
        return
    if address != "auto":
        _require_answer(address)
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError) as error:
        if address == "auto":
            raise PicktreeError("no Ray cluster runs here that --address auto could find") from None
        raise PicktreeError(f"the Ray cluster at {address} cannot be used: {_first_line(error)}") from None


def nodes() -> tuple[ClusterNode, ...]:
    """Return the present nodes that have CPUs."""
    made = (
        ClusterNode(str(n["NodeID"]), str(n["NodeManagerAddress"]), int(n["Resources"].get("CPU", 0)))
        for n in ray.nodes()
        if n["Alive"]
    )
    return tuple(sorted((node for node in made if node.cpus), key=lambda node: node.id))


def _start(cpus: int, folder: Path) -> None:
    ray.init(
        address="local",
        num_cpus=cpus,
        include_dashboard=False,
        log_to_driver=False,
        logging_level=logging.ERROR,
        object_store_memory=_OBJECT_STORE_BYTES,
        _temp_dir=str(folder),
    )


def _require_answer(address: str) -> None:
    """Check that the port replies: Ray itself ends the process when it does not."""
    host, _, port = address.rpartition(":")
    if not host or "/" in address or not port.isdigit():
        raise PicktreeError(f"--address {address}: the address of a Ray cluster is HOST:PORT, or auto")
    try:
        socket.create_connection((host, int(port)), _REPLY_TIME_LIMIT).close()
    except (OSError, OverflowError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise PicktreeError(f"no Ray cluster answers at {address}: {why.lower()}") from None


def _first_line(error: Exception) -> str:
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)


__all__ = ["RayError", "WorkerHandle", "reason"]


class WorkerHandle:
    """Worker that takes one CPU of a node. All methods raise RayError when the worker is gone."""

    def __init__(self, node: ClusterNode) -> None:
        self.node = node
        self._actor = (
            ray.remote(NodeWorker)
            .options(
                num_cpus=1,
                max_restarts=0,  # who tries again is the batch
                max_task_retries=0,
                scheduling_strategy=NodeAffinitySchedulingStrategy(node.id, soft=False),
            )
            .remote()
        )

    async def installed(self) -> Installation:
        return await self._actor.installed.remote()

    async def is_there(self) -> None:
        """Return when the worker replies; raise RayError when it is gone."""
        await self._actor.is_there.remote()

    async def carry_out(self, task: Task, recipe: ray.ObjectRef[bytes]) -> TaskReport:
        return await self._actor.carry_out.remote(task, recipe)

    def stop(self, task: Task) -> None:
        self._actor.stop.remote(task.order.folder)

    async def piece(self, folder: str, name: str, offset: int, size: int) -> bytes:
        return await self._actor.piece.remote(folder, name, offset, size)

    async def forget(self, folder: str) -> None:
        await self._actor.forget.remote(folder)

    async def close(self) -> None:
        await self._actor.close.remote()

    def kill(self) -> None:
        """Kill the worker with its process, whatever that does."""
        ray.kill(self._actor)


def shared(content: bytes) -> ray.ObjectRef[bytes]:
    """Store content that many tasks need and each node fetches once."""
    return ray.put(content)


def reason(error: RayError, node: ClusterNode) -> str:
    """Return the reason why a worker does not reply, in a few words."""
    if isinstance(error, OutOfMemoryError):
        return f"Ray ended its worker: the node {node.address} ran out of memory"
    if "its node has died" in str(error):
        return f"the node {node.address} is gone"
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    told = next((line for line in lines if line.startswith(("ModuleNotFoundError", "ImportError"))), "")
    return told or f"its worker on the node {node.address} is gone"
