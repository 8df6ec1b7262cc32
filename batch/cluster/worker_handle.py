"""Handle of a cluster's worker on the batch's machine: the only place with remote calls."""

from __future__ import annotations

import ray
from ray.exceptions import OutOfMemoryError, RayError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from .connection import ClusterNode
from .installation import Installation
from .messages import Task
from .node_worker import NodeWorker, TaskReport

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
