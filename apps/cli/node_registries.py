"""Registry of the nodes that a command may use."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...trees.loading.registry import NodeRegistry


def registry(*, shipped: bool = False) -> NodeRegistry:
    """Return all installed nodes, or with `shipped` only those that come with picktree.

    Plug-ins that cannot be imported are reported on stderr; their nodes are missing.
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
