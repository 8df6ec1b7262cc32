"""Socket of a run in progress: its place in the run's folder, and a connection to it."""

from __future__ import annotations

import os
import socket
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from picktree.files import PicktreeError
from picktree.logs.mcap import is_written

SOCKET_NAME: Final = "attach.sock"
"""Name of the socket in the run's folder."""


@contextmanager
def socket_address(folder: Path, name: str = SOCKET_NAME) -> Generator[str]:
    """Return a short address of a socket in a folder, independent of the length of the folder's path.

    The address of a Unix socket has at most 108 bytes.
    """
    descriptor = os.open(folder, os.O_PATH | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{descriptor}/{name}"
    finally:
        os.close(descriptor)


def listen_in(folder: Path) -> socket.socket:
    """Return a listening socket that does not block, in the run's folder, for this user alone.

    It appears under its name when clients can connect. Raises OSError where the file system has no sockets.
    """
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    hidden = f".{SOCKET_NAME}"
    try:
        os.fchmod(listener.fileno(), 0o600)  # Linux: the mode of the file that `bind` makes.
        with socket_address(folder, hidden) as address:
            listener.bind(address)
        listener.listen()
        (folder / hidden).rename(folder / SOCKET_NAME)
    except OSError:
        listener.close()
        raise
    return listener


def connect_to_run(folder: Path) -> socket.socket:
    """Connect to the run of a folder. Raises PicktreeError when it is not in progress, or not attachable."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        with socket_address(folder) as address:
            connection.connect(address)
    except PermissionError:
        connection.close()
        raise PicktreeError(f"{folder}: the run belongs to another user") from None
    except OSError:
        connection.close()
        if any(is_written(log) for log in folder.glob("*.mcap")):
            raise PicktreeError(
                f"{folder}: the run cannot be attached: it is no run of `picktree run`, or the disk of its "
                f"folder has no sockets ({SOCKET_NAME})"
            ) from None
        raise PicktreeError(f"{folder}: the run is not in progress") from None
    return connection
