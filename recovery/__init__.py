"""Recovery: nodes that react to failures by their cause, and bring the arm to safety."""

from ..trees.node import Node
from .ask_for_help import AskForHelp
from .budget import Budget
from .free_spot import FreeSpot
from .guards import GUARDS
from .look_around import LookAround
from .plan_with import PlanWith
from .recover import ForAttempt, Recover, RecoveryNode
from .reset_gripper import ResetGripper
from .safe_retreat import SafeRetreat
from .set_aside import SetAside

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
