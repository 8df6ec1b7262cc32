"""Nodes of a Ray cluster on this machine, each as `ray start` makes it."""

from __future__ import annotations

import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..commands import until
from .processes import below, name

SECRET = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
NODES = {
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "1",
    "RAY_enable_worker_prestart": "0",  # a process for each CPU that no test would use
    "RAY_prestart_worker_first_driver": "0",
    "RAY_worker_niceness": "0",  # else they wait until all other tests leave a CPU to them
    **SECRET,
}
"""Environment of every process of a cluster whose nodes have the address of this machine."""


@contextmanager
def head(cpus: int) -> Generator[str]:
    """The address of a cluster whose first node has so many CPUs."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory(prefix="ray-", ignore_cleanup_errors=True) as folder:
        options = ["--head", f"--port={port}", f"--temp-dir={folder}", "--include-dashboard=false"]
        with _node(options, cpus):
            yield f"127.0.0.1:{port}"


@contextmanager
def node(address: str, cpus: int) -> Generator[int]:
    """Another one; the process that is the node for the others."""
    with _node([f"--address={address}"], cpus) as process:
        yield process


@contextmanager
def _node(options: list[str], cpus: int) -> Generator[int]:
    ray = Path(sys.executable).with_name("ray")
    common = ["--block", f"--num-cpus={cpus}", "--object-store-memory=100000000", "--disable-usage-stats"]
    common += ["--no-monitor", "--include-log-monitor=false"]  # of autoscaling and of output for a driver
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(
            [ray, "start", *common, *options],
            env={**os.environ, **NODES},
            stdout=output,
            stderr=output,
            start_new_session=True,
        )
        try:
            until(lambda: _said(output.fileno(), b"Ray runtime started") or process.poll() is not None)
            assert process.poll() is None, os.pread(output.fileno(), 10_000, 0).decode()
            yield next(pid for pid in below(process.pid) if name(pid) == "raylet")
        finally:
            everything = below(process.pid)
            for pid in everything:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            process.wait(120)


def _said(file: int, words: bytes) -> bool:
    return words in os.pread(file, 100_000, 0)
