"""Recovery: nodes that cure failures by their cause, and bring the arm to safety."""

from ..trees.node import Node
from .recover import Recover
from .safe_retreat import SafeRetreat

NODES: tuple[type[Node], ...] = (Recover, SafeRetreat)
"""What the entry point `picktree.nodes` offers."""
