"""Skills that come with picktree, in the order of the reference."""

from __future__ import annotations

from typing import Final

from picktree.trees import Node

from .feed import AwaitItems, ExchangeBin
from .go_to import GoTo
from .grasp import Grasp
from .gripper import CloseGripper, OpenGripper
from .insert import Insert
from .jog import Jog
from .observe import Observe, Present
from .pick_any import PickAny
from .place import Place
from .push import Push
from .stir import Stir
from .survey import Survey
from .touch_target import TouchTarget
from .watch_scene import WatchScene

NODES: Final[tuple[type[Node], ...]] = (
    Observe, Grasp, PickAny, Present, Place, Insert, Push, Stir, GoTo, OpenGripper, CloseGripper, AwaitItems,
    ExchangeBin, Jog, Survey, TouchTarget, WatchScene,
)  # fmt: skip
"""Node classes of the entry point `picktree.nodes`."""
