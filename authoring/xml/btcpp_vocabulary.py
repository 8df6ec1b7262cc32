"""Node names of BehaviorTree.CPP 4, and picktree's names for nodes that it does not have."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final, NamedTuple

from picktree.trees.loading import FOREIGN_WORDS

_ENTRY = re.compile(r"\s*((?:[^\\;=]|\\.)*?)\s*=\s*(\d{1,6})\s*(?:;|$)")
_SPECIAL = re.compile(r"[\\;=]")


class SlotRow(NamedTuple):
    """Label of a table and the index, from 0, of the child at that label."""

    label: str
    child: int


def table_text(rows: Iterable[SlotRow]) -> str:
    escaped = ((_SPECIAL.sub(r"\\\g<0>", row.label), row.child) for row in rows)
    return "; ".join(f"{label}={child}" for label, child in escaped)


def read_table(text: str) -> tuple[SlotRow, ...]:
    """Parse a table. Raises ValueError."""
    rows: list[SlotRow] = []
    at = 0
    while at < len(text):
        match = _ENTRY.match(text, at)
        if match is None or not match[1]:
            raise ValueError(f"{text[at : at + 30]!r} is not 'label=child'")
        rows.append(SlotRow(re.sub(r"\\(.)", r"\1", match[1]), int(match[2])))
        at = match.end()
    return tuple(rows)


def indexes_text(indexes: Iterable[int]) -> str:
    return ";".join(map(str, indexes))


def read_indexes(text: str) -> tuple[int, ...]:
    """Parse a list of indexes. Raises ValueError."""
    if not re.fullmatch(r"\s*\d{1,6}\s*(;\s*\d{1,6}\s*)*", text, re.ASCII):
        raise ValueError(f"{text[:30]!r} is not a list of indexes; write e.g. '1;2'")
    return tuple(int(part) for part in text.split(";"))


XML_FORMAT: Final = "4"

ELEMENTS: Final = ("Action", "Condition", "Control", "Decorator", "SubTree")
"""Elements that name their node in the attribute ID."""
STRUCTURE: Final = ("root", "Root", "BehaviorTree", "TreeNodesModel", "include", *ELEMENTS)
"""Names that the format reserves."""

SHARED_NODES: Final = frozenset(
    (
        "Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "Parallel", "IfThenElse",
        "WhileDoElse", "Inverter", "ForceSuccess", "ForceFailure", "Repeat", "KeepRunningUntilFailure",
        "RetryUntilSuccessful", "Timeout", "Delay", "RunOnce", "AlwaysSuccess", "AlwaysFailure",
        "SequenceWithMemory", "ParallelAll", "Sleep", "SkipUnlessUpdated", "WaitValueUpdate",
        "WasEntryUpdated", "AsyncSequence", "AsyncFallback", "TryCatch",
    )
)  # fmt: skip
"""Nodes that both have, with the same ports."""
PORT_TYPES: Final[dict[str, str]] = {
    "success_count": "int", "failure_count": "int", "num_cycles": "int", "num_attempts": "int",
    "max_failures": "int",
    "msec": "unsigned", "delay_msec": "unsigned", "then_skip": "bool", "catch_on_halt": "bool",
    "variable": "std::string",
}  # fmt: skip
"""C++ types of the ports of those nodes, and of Switch."""
TRANSLATED: Final = frozenset(
    (
        "ScriptCondition", "Script", "SetBlackboard", "Precondition", "LoopInt", "LoopBool",
        "LoopDouble", "LoopString", "Switch2", "Switch3", "Switch4", "Switch5", "Switch6",
    )
)  # fmt: skip
"""Nodes of BehaviorTree.CPP that the import translates to other nodes."""
FOREIGN: Final[dict[str, str]] = {
    name: FOREIGN_WORDS[name]
    for name in (
        "UnsetBlackboard", "ManualSelector", "SubTreePlus", "SequenceStar",
    )
}  # fmt: skip
"""Nodes of BehaviorTree.CPP without a counterpart, and the nearest alternative."""
BUILT_IN: Final = SHARED_NODES | TRANSLATED | (frozenset(FOREIGN) - {"SubTreePlus", "SequenceStar"})

CHECK: Final = "CheckExpression"
"""Condition leaf for an expression that scripts cannot express."""
GUARDED: Final = "Guarded"
"""Decorator for conditions of its child that scripts cannot express."""
REPEAT_WHILE: Final = "RepeatWhile"
ASSIGN: Final = "AssignExpressions"
"""Action leaf for a Script with expressions that scripts cannot express."""
OURS: Final = (CHECK, GUARDED, REPEAT_WHILE, ASSIGN)
SWITCH: Final = re.compile(r"Switch[1-9]\d*")

GUARDS: Final[dict[str, str]] = {
    "_failureIf": "failure_if", "_successIf": "success_if", "_skipIf": "skip_if", "_while": "while",
    "_onHalted": "on_halted", "_onFailure": "on_failure", "_onSuccess": "on_success", "_post": "post",
}  # fmt: skip
"""Ports of a Guarded by condition key."""

BREAKPOINT: Final = "_breakpoint"
LEFT_OUT: Final = "_left_out"
"""Attribute: ports without a value in the mission that BehaviorTree.CPP requires, separated by spaces."""
OWN_NAME: Final = "_name"
"""Attribute: the name in the mission, where BehaviorTree.CPP needs another."""
SETS: Final = "_sets"
"""Attribute that marks a Script that is a SetBlackboard of the mission."""
NO_CASE: Final = "_no_case"
"""Attribute that marks the default of a Switch that has none."""
DESCRIPTION: Final = "_description"
"""Attribute in which Groot2 keeps the description of a tree or a node."""
IGNORED: Final = (
    "_uid", "_fullpath", DESCRIPTION, "_favorite", "_hardcoded", "_collapsed", "_hidden", "_subtreeOnly",
)  # fmt: skip
"""Attributes of the editors Groot2 and MoveIt Pro."""


def taken(identity: str) -> bool:
    """Whether BehaviorTree.CPP reserves the name, so that no tree or plug-in node may have it."""
    return (
        identity in BUILT_IN or identity in STRUCTURE or identity in OURS or bool(SWITCH.fullmatch(identity))
    )
