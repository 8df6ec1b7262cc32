"""Statuses of a node, in BehaviorTree.CPP's words."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from py_trees.common import Status


class NodeStatus(StrEnum):
    """IDLE: not ticked in the present activation of its parent, or halted. SKIPPED: it had nothing to do."""

    IDLE = "IDLE"
    RUNNING = "RUNNING"
    SUCCESS = "SUCCESS"
    FAILURE = "FAILURE"
    SKIPPED = "SKIPPED"


PY_TREES_STATUS: Mapping[NodeStatus, Status] = {
    NodeStatus.IDLE: Status.INVALID,
    NodeStatus.RUNNING: Status.RUNNING,
    NodeStatus.SUCCESS: Status.SUCCESS,
    NodeStatus.FAILURE: Status.FAILURE,
    NodeStatus.SKIPPED: Status.INVALID,
}
"""Status that py_trees' tools see."""
