"""Nodes of recovery, in the order of the reference."""

from __future__ import annotations

from typing import Final

from picktree.trees import Node

from .ask_for_help import AskForHelp, SetAside
from .free_spot import FreeSpot
from .guards import (
    CauseIs,
    WouldAGripperResetHelp,
    WouldAnotherGraspHelp,
    WouldARetreatHelp,
    WouldLookingHelp,
    WouldPushingHelp,
    WouldReplanningHelp,
    WouldWaitingHelp,
)
from .look_around import LookAround, ResetGripper
from .recover import Budget, ForAttempt, PlanWith, Recover, RecoveryNode
from .safe_retreat import SafeRetreat

NODES: Final[tuple[type[Node], ...]] = (
    AskForHelp, Recover, RecoveryNode, Budget, ForAttempt, PlanWith, CauseIs, WouldLookingHelp,
    WouldARetreatHelp, WouldAnotherGraspHelp, WouldAGripperResetHelp, WouldReplanningHelp, WouldPushingHelp,
    WouldWaitingHelp, FreeSpot, LookAround, ResetGripper, SafeRetreat, SetAside,
)  # fmt: skip
"""Node classes of the entry point `picktree.nodes`."""
