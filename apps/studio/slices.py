"""List of the studio's slices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from .batch_slice import BatchSlice
from .folder_slice import FolderSlice
from .live_slice import LiveSlice
from .mission_slice import MissionSlice
from .run_slice import RunSlice
from .scene_slice import SceneSlice
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
