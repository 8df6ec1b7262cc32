"""A comparison of two runs as JSON values."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from ....logs.visits import Visit
from ..diff import RunDiff
from ..divergence import Parting
from ..run_outcome import RunOutcome
from ..run_settings import value_changes
from ..time_spent import Spent, TimeChange


def to_json_text(diff: RunDiff) -> str:
    """One object, with a line's end."""
    return json.dumps(to_json(diff), ensure_ascii=False, indent=2, allow_nan=False, default=str) + "\n"


def to_json(diff: RunDiff) -> dict[str, Any]:
    nodes, items = diff.alignment.nodes, diff.alignment.items
    return {
        "verdict": diff.verdict,
        "a": _outcome(diff.a),
        "b": _outcome(diff.b),
        "settings": [asdict(change) for change in diff.set_up.settings],
        "files": [asdict(change) for change in diff.set_up.files],
        "arithmetic": diff.set_up.arithmetic,
        "nodes": {
            "only_a": [node.path for node in nodes.only_a],
            "only_b": [node.path for node in nodes.only_b],
            "moved": [{"a": pair.a.path, "b": pair.b.path} for pair in nodes.moved],
            "retyped": [{"path": p.a.path, "a": p.a.id, "b": p.b.id} for p in nodes.retyped],
            "ports": [asdict(change) for change in nodes.rewired],
        },
        "first_value": None if diff.first is None else asdict(diff.first),
        "derived": diff.alignment.derived,
        "parting": None if diff.alignment.parting is None else _parting(diff.alignment.parting),
        "time": {
            "by_type": [_time(change) for change in diff.time.by_type],
            "by_node": [_time(change) for change in diff.time.by_node],
        },
        "causes": [asdict(change) for change in diff.causes],
        "ways": [asdict(change) for change in diff.ways],
        "items": [{**asdict(change), "differs": change.differs} for change in diff.items],
        "item_pairs": [asdict(pair) for pair in items.pairs],
    }


def _outcome(outcome: RunOutcome) -> dict[str, Any]:
    return {**asdict(outcome), "log": str(outcome.log.absolute())}


def _parting(parting: Parting) -> dict[str, Any]:
    evidence = value_changes(parting.a.evidence if parting.a else {}, parting.b.evidence if parting.b else {})
    return {
        "time": parting.time,
        "how": parting.how,
        "also": list(parting.also),
        "a": _visit(parting.a),
        "b": _visit(parting.b),
        "evidence": [asdict(change) for change in evidence],
        "next_a": _visit(parting.next_a),
        "next_b": _visit(parting.next_b),
    }


def _visit(visit: Visit | None) -> dict[str, Any] | None:
    return None if visit is None else asdict(visit)


def _time(change: TimeChange) -> dict[str, Any]:
    return {"name": change.name, "a": _spent(change.a), "b": _spent(change.b), "change": change.change}


def _spent(spent: Spent) -> dict[str, Any]:
    return asdict(spent)
