"""Recovery: nodes that react to failures by their cause, and bring the arm to safety."""

from ..trees.node import Node
from .ask_for_help import AskForHelp, SetAside
from .budget import Budget, PlanWith
from .free_spot import FreeSpot
from .guards import GUARDS
from .look_around import LookAround, ResetGripper
from .recover import ForAttempt, Recover, RecoveryNode
from .safe_retreat import SafeRetreat

NODES: tuple[type[Node], ...] = (
    AskForHelp,
    Recover,
    RecoveryNode,
    Budget,
    ForAttempt,
    PlanWith,
    *GUARDS,
    FreeSpot,
    LookAround,
    ResetGripper,
    SafeRetreat,
    SetAside,
)
"""Node classes of the entry point `picktree.nodes`."""
