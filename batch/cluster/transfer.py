"""Bringing the files of an order from the node where they were made: all of them, or none."""

from __future__ import annotations

import shutil
from pathlib import Path

from .node_worker import File
from .worker_handle import Hired

_PIECE = 4 << 20
"""Bytes that are on their way at once."""


async def bring(hired: Hired, files: tuple[File, ...], folder: Path) -> None:
    """Into `folder`, which takes its name when everything has arrived.

    Raises OSError when they cannot be written, RayError when the node is gone.
    """
    arriving = folder.with_name(f"{folder.name}.arriving")
    shutil.rmtree(arriving, ignore_errors=True)
    try:
        for file in files:
            path = arriving / file.name
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("wb") as written:
                for offset in range(0, file.size, _PIECE):
                    size = min(_PIECE, file.size - offset)
                    written.write(await hired.piece(folder.name, file.name, offset, size))
        shutil.rmtree(folder, ignore_errors=True)
        if files:
            arriving.rename(folder)
    finally:
        shutil.rmtree(arriving, ignore_errors=True)
    await hired.forget(folder.name)
