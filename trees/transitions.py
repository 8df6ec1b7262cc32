"""What happened to the nodes of a tree within one tick, in order: which began, and how they ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..world.causes import Evidence
from .status import NodeStatus


def _no_inputs() -> Mapping[str, object]:
    return {}


def _no_evidence() -> Evidence:
    return {}


@dataclass(frozen=True, slots=True)
class NodeTransition:
    """A node begins (RUNNING) or has ended (SUCCESS, FAILURE, SKIPPED; IDLE: it was halted)."""

    path: str
    status: NodeStatus
    inputs: Mapping[str, object] = field(default_factory=_no_inputs)
    """Of a node that begins: what it read through references, by port."""
    subject: str = ""
    """Of a node that begins: the object that its first port of type `object` names, if any."""
    cause: str = ""
    """Of a failure: its name; empty for a false condition."""
    origin: str = ""
    """Of a failure: path of the node that it came from."""
    message: str = ""
    evidence: Evidence = field(default_factory=_no_evidence)


class TransitionCollector:
    """Collects them while a tree is ticked."""

    def __init__(self) -> None:
        self._noted: list[NodeTransition] = []

    def note(self, transition: NodeTransition) -> None:
        self._noted.append(transition)

    def take(self) -> tuple[NodeTransition, ...]:
        """Those since it was last asked."""
        noted = tuple(self._noted)
        self._noted.clear()
        return noted
