"""Recovery: nodes that cure failures by their cause, and bring the arm to safety."""

from ..trees.node import Node
from .recover import Recover
from .recovery_node import RecoveryNode
from .safe_retreat import SafeRetreat

NODES: tuple[type[Node], ...] = (Recover, RecoveryNode, SafeRetreat)
"""What the entry point `picktree.nodes` offers."""
