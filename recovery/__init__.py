"""Recovery: nodes that react to failures by their cause, and bring the arm to safety.

The classes are imported on first use: one node does not load the others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..trees.loading.plugin_import import lazy_node

if TYPE_CHECKING:
    from ..trees.node import Node
    from .recover import Recover as Recover
    from .recover import RecoveryNode as RecoveryNode

    NODES: tuple[type[Node], ...]
    """Node classes of the entry point `picktree.nodes`."""

MODULES = {
    "AskForHelp": "ask_for_help",
    "Recover": "recover",
    "RecoveryNode": "recover",
    "Budget": "recover",
    "ForAttempt": "recover",
    "PlanWith": "recover",
    "CauseIs": "guards",
    "WouldLookingHelp": "guards",
    "WouldARetreatHelp": "guards",
    "WouldAnotherGraspHelp": "guards",
    "WouldAGripperResetHelp": "guards",
    "WouldReplanningHelp": "guards",
    "WouldPushingHelp": "guards",
    "WouldWaitingHelp": "guards",
    "FreeSpot": "free_spot",
    "LookAround": "look_around",
    "ResetGripper": "look_around",
    "SafeRetreat": "safe_retreat",
    "SetAside": "ask_for_help",
}
"""Modules by class, in the order of the reference."""


def __getattr__(name: str) -> object:
    """Return a node's class, or `NODES`: all of them."""
    return lazy_node(__name__, MODULES, name)
