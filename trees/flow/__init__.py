"""How a mission may go: each kind of node says in which ways it can end, without running anything.

A node class answers `flow(spec, entry, walk)`: from one State to the States in which it may succeed, fail, be
skipped or still run, with the causes of its failures. `analysis` puts these together for a whole mission; the
linter's rules read what it finds. Faults of the program (internal.error) are left out: any node may have one.
"""

from .failure_reasons import NO_REPORT, UNREPORTED, FailureReasons, joined
from .flow_state import NONE, NOTHING, ConcurrentEffect, FlowState, States, tidy
from .outcomes import NEVER, Failures, NodeOutcomes, OutcomeCollector

__all__ = [
    "NEVER",
    "NONE",
    "NOTHING",
    "NO_REPORT",
    "UNREPORTED",
    "ConcurrentEffect",
    "FailureReasons",
    "Failures",
    "FlowState",
    "NodeOutcomes",
    "OutcomeCollector",
    "States",
    "joined",
    "tidy",
]  # fmt: skip
