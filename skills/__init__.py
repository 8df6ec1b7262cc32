"""Skills that come with picktree: leaves that move the robot or look through its cameras.

The classes are imported on first use: one skill does not load the others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..trees.loading.plugin_import import lazy_node

if TYPE_CHECKING:
    from ..trees.node import Node
    from .feed import AwaitItems as AwaitItems
    from .feed import ExchangeBin as ExchangeBin
    from .go_to import GoTo as GoTo
    from .grasp import Grasp as Grasp
    from .gripper import CloseGripper as CloseGripper
    from .gripper import OpenGripper as OpenGripper
    from .insert import Insert as Insert
    from .jog import Jog as Jog
    from .observe import Observe as Observe
    from .observe import Present as Present
    from .pick_any import PickAny as PickAny
    from .place import Place as Place
    from .push import Push as Push
    from .stir import Stir as Stir
    from .survey import Survey as Survey
    from .touch_target import TouchTarget as TouchTarget
    from .watch_scene import WatchScene as WatchScene

    NODES: tuple[type[Node], ...]
    """Node classes of the entry point `picktree.nodes`."""

MODULES = {
    "Observe": "observe",
    "Grasp": "grasp",
    "PickAny": "pick_any",
    "Present": "observe",
    "Place": "place",
    "Insert": "insert",
    "Push": "push",
    "Stir": "stir",
    "GoTo": "go_to",
    "OpenGripper": "gripper",
    "CloseGripper": "gripper",
    "AwaitItems": "feed",
    "ExchangeBin": "feed",
    "Jog": "jog",
    "Survey": "survey",
    "TouchTarget": "touch_target",
    "WatchScene": "watch_scene",
}
"""Modules by class, in the order of the reference."""


def __getattr__(name: str) -> object:
    """Return a skill's class, or `NODES`: all of them."""
    return lazy_node(__name__, MODULES, name)
