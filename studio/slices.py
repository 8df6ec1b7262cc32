"""List of the studio's slices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from .batches.batch_slice import BatchSlice
from .folder_slice import FolderSlice
from .live.live_slice import LiveSlice
from .missions.mission_slice import MissionSlice
from .missions.scene_slice import SceneSlice
from .runs.run_slice import RunSlice
from .slice import Slice, Studio

MAKERS: Final[tuple[Callable[[Studio], Slice], ...]] = (
    FolderSlice,
    MissionSlice,
    SceneSlice,
    RunSlice,
    LiveSlice,
    BatchSlice,
)


def slices(studio: Studio) -> tuple[Slice, ...]:
    """Return the slices of a server."""
    return tuple(make(studio) for make in MAKERS)
