"""The nodes that a command is to know."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...trees.loading.registry import NodeRegistry


def registry(*, shipped: bool = False) -> NodeRegistry:
    """All installed nodes, or (`shipped`) only those that come with picktree.

    What cannot be imported is told on stderr: its nodes are missing in the answer.
    """
    from ...trees.loading.registry import NodeRegistry

    if shipped:
        from ...recovery import NODES as RECOVERY
        from ...skills import NODES as SKILLS

        return NodeRegistry((*RECOVERY, *SKILLS), installed=False)
    found = NodeRegistry()
    for problem in found.problems:
        print(f"{problem.message}; its nodes are left out", file=sys.stderr)
    return found
