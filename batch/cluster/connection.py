"""Being connected with a Ray cluster: one that runs, or one of this machine that goes when this goes."""

from __future__ import annotations

import logging
import os
import socket
from dataclasses import dataclass
from pathlib import Path

import ray

from ...errors import PicktreeError

_ANSWER = 5.0
"""Wall s within which a cluster's port answers."""
_STORE = 100 << 20
"""Bytes of memory for what is on its way between processes of a cluster of this machine."""


@dataclass(frozen=True, slots=True)
class ClusterNode:
    """A machine of the cluster."""

    id: str
    address: str
    cpus: int


def connect(address: str | None, workers: int | None, folder: Path) -> None:
    """To the cluster at `address`; None: start one with so many CPUs, its files in `folder`.

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
    """Those that are there now and have CPUs to give."""
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
        object_store_memory=_STORE,
        _temp_dir=str(folder),
    )


def _require_answer(address: str) -> None:
    """Ray itself ends the process when it finds nobody there."""
    host, _, port = address.rpartition(":")
    if not host or "/" in address or not port.isdigit():
        raise PicktreeError(f"--address {address}: the address of a Ray cluster is HOST:PORT, or auto")
    try:
        socket.create_connection((host, int(port)), _ANSWER).close()
    except (OSError, OverflowError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise PicktreeError(f"no Ray cluster answers at {address}: {why.lower()}") from None


def _first_line(error: Exception) -> str:
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
