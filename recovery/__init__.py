"""Recovery: nodes that cure failures by their cause, and bring the arm to safety."""

from ..trees.node import Node
from .ask_for_help import AskForHelp
from .budget import Budget
from .for_attempt import ForAttempt
from .guards import GUARDS
from .plan_with import PlanWith
from .recover import Recover
from .recovery_node import RecoveryNode
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
    ResetGripper,
    SafeRetreat,
    SetAside,
)
"""What the entry point `picktree.nodes` offers."""
