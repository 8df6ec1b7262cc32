"""The statuses of a node, in BehaviorTree.CPP's words."""

from __future__ import annotations

from enum import StrEnum


class NodeStatus(StrEnum):
    """IDLE: not ticked in the present activation of its parent, or halted. SKIPPED: it had nothing to do."""

    IDLE = "IDLE"
    RUNNING = "RUNNING"
    SUCCESS = "SUCCESS"
    FAILURE = "FAILURE"
    SKIPPED = "SKIPPED"
