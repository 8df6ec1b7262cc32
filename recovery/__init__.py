"""Recovery: nodes that cure failures by their cause, and bring the arm to safety."""

from ..trees.node import Node
from .recover import Recover
from .recovery_node import RecoveryNode
from .safe_retreat import SafeRetreat
from .set_aside import SetAside

NODES: tuple[type[Node], ...] = (Recover, RecoveryNode, SafeRetreat, SetAside)
"""What the entry point `picktree.nodes` offers."""
