"""The report of a run: one HTML file to look into it, without a network and without picktree."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ...errors import PicktreeError
from ..run import Run
from .page import page
from .page_data.packing import Section
from .panels.board import pack_board
from .panels.events import pack_events
from .panels.failures import pack_failures
from .panels.header import pack_run, summary
from .panels.images import pack_images
from .panels.lanes import pack_lanes
from .panels.plots import pack_plots
from .panels.stage import pack_stage
from .panels.tree import pack_tree

PACKERS: tuple[Callable[[Run], Section], ...] = (
    pack_run,
    pack_stage,
    pack_failures,
    pack_lanes,
    pack_tree,
    pack_board,
    pack_images,
    pack_events,
    pack_plots,
)
"""What is packed for each panel; `src/panels.js` has the panels by the names of these sections."""


@dataclass(frozen=True, slots=True)
class Written:
    """A report that was written: the file, its size, and what it took."""

    file: Path
    bytes: int
    seconds: float
    """Of the wall clock."""
    simulated: float
    """Simulated s that the run lasted."""

    def to_text(self) -> str:
        return (
            f"{self.file}: {self.bytes / 1e6:.1f} MB for {self.simulated:.0f} simulated s, "
            f"made in {self.seconds:.1f} s"
        )

    def to_json(self) -> dict[str, str | int | float]:
        return {
            "file": str(self.file.absolute()),
            "bytes": self.bytes,
            "seconds": round(self.seconds, 3),
            "sim_seconds": round(self.simulated, 3),
        }


def write_report(run: Run, file: Path) -> Written:
    """Write the report of `run`. Raises PicktreeError when the file cannot be written."""
    began = time.perf_counter()
    text = report(run)
    data = text.encode("utf-8")
    _write_whole(file, data)
    return Written(file, len(data), time.perf_counter() - began, run.end)


def report(run: Run) -> str:
    """The page as text. Raises PicktreeError for a log without a tick, and where it is damaged."""
    if not run.ticks.times:
        raise PicktreeError(f"{run.path}: the log holds no tick, so there is nothing to report")
    info = run.info
    title = f"{info.mission}, {info.scene}, seed {info.seed}"
    return page(title, summary(run), [packer(run) for packer in PACKERS])


def _write_whole(file: Path, data: bytes) -> None:
    """Beside it first, so that a full disk leaves what was there before."""
    beside: str | None = None
    try:
        handle, beside = tempfile.mkstemp(prefix=f".{file.name}-", dir=file.parent)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        os.chmod(beside, 0o666 & ~_umask())
        os.replace(beside, file)
    except OSError as error:
        if beside is not None:
            Path(beside).unlink(missing_ok=True)
        raise PicktreeError(f"{file} cannot be written: {(error.strerror or str(error)).lower()}") from None


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
