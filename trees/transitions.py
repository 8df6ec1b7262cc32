"""Node transitions within one tick, in order: starts and ends of nodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..world.causes import Evidence, FailureReport
from .ports import PortDeclaration
from .status import NodeStatus
from .values.port_types import plain_copy
from .values.references import Binding, Reference


def _no_inputs() -> Mapping[str, object]:
    return {}


def _no_evidence() -> Evidence:
    return {}


@dataclass(frozen=True, slots=True)
class NodeTransition:
    """Start (RUNNING) or end of a node (SUCCESS, FAILURE, SKIPPED; IDLE: halted)."""

    path: str
    status: NodeStatus
    inputs: Mapping[str, object] = field(default_factory=_no_inputs)
    """Values that a starting node read through references, by port."""
    subject: str = ""
    """Object named by the first port of type `object` of a starting node; empty: none."""
    cause: str = ""
    """Name of a failure's cause; empty for a false condition."""
    origin: str = ""
    """Path of the node in which the failure arose."""
    message: str = ""
    evidence: Evidence = field(default_factory=_no_evidence)


def start_transition(
    path: str,
    wired: Mapping[str, Binding],
    ports: tuple[PortDeclaration, ...],
    inputs: Mapping[str, object],
) -> NodeTransition:
    """Describe the start of a node with these input ports and values."""
    read = {key: plain_copy(value) for key, value in inputs.items() if isinstance(wired.get(key), Reference)}
    of_objects = (port.key for port in ports if port.type.name == "object")
    subject = next((str(inputs[key]) for key in of_objects if inputs.get(key)), "")
    return NodeTransition(path, NodeStatus.RUNNING, read, subject)


def end_transition(
    path: str, status: NodeStatus, failure: FailureReport | None, message: str
) -> NodeTransition:
    """Describe the end of a node; `message` is its feedback where it has not failed with a report."""
    if failure is None:
        return NodeTransition(path, status, message=message)
    return NodeTransition(
        path,
        status,
        cause=failure.cause.name,
        origin=failure.node,
        message=failure.message,
        evidence=failure.evidence,
    )


class TransitionCollector:
    """Collector of node transitions while a tree is ticked."""

    def __init__(self) -> None:
        self._noted: list[NodeTransition] = []

    def note(self, transition: NodeTransition) -> None:
        self._noted.append(transition)

    def take(self) -> tuple[NodeTransition, ...]:
        """Return and clear the transitions since the last call."""
        noted = tuple(self._noted)
        self._noted.clear()
        return noted
