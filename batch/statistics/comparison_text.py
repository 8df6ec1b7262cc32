"""Text and JSON output of a comparison of two recipes."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterator
from typing import Any

from .comparison import ChangedSeed, RecipeComparison
from .differences import MeanDifference
from .rates import SIGNIFICANCE_LEVEL

_TITLES = {
    "goal": "goal reached, %",
    "items": "items sorted",
    "in_vain": "grasps in vain",
    "failures": "failures",
    "seconds_a_pick": "seconds a pick",
}
_MOST_CAUSES = 8


def text_of(found: RecipeComparison, program: str = "picktree") -> str:
    """Return a text for a terminal, without a trailing newline. `program`: name of picktree in commands to
    copy."""
    return "\n".join(_lines(found, program))


def json_text_of(found: RecipeComparison) -> str:
    return json.dumps(_json(found), ensure_ascii=False, indent=2, allow_nan=False) + "\n"


def _lines(found: RecipeComparison, program: str) -> Iterator[str]:
    yield f"A  {found.label_a}: goal reached {found.success_a}"
    yield f"B  {found.label_b}: goal reached {found.success_b}"
    table = found.paired
    if table is not None:
        left = f"; {found.alone} in one alone are left out" if found.alone else ""
        yield f"paired by seed: {table.total} seeds in both{left}"
    else:
        of = f"{found.success_a.total} and {found.success_b.total} jobs, {found.shared} seeds in both"
        yield f"not paired: {of}; they are compared as independent runs"
    if found.arithmetic:
        yield found.arithmetic
    yield ""
    yield _row("of a job", "A", "B", "B − A, 95 % interval", "p", "Holm")
    for criterion in found.criteria:
        scale = 100.0 if criterion.name == "goal" else 1.0
        yield _difference_row(_TITLES[criterion.name], criterion.difference, criterion.adjusted, scale)
    if table is not None:
        counts = f"both {table.both}, only A {table.only_a}, only B {table.only_b}, neither {table.neither}"
        yield f"goal by seed: {counts}"
    yield ""
    better = [f"{c.better} {c.words}" for c in found.criteria if c.better]
    yield "so: " + ("; ".join(better) or "no difference that these runs could show")
    if found.causes:
        yield ""
        yield _row("failures by cause", "A", "B", "B − A, 95 % interval", "p", "Holm")
        for change in found.causes[:_MOST_CAUSES]:
            yield _difference_row(change.cause, change.difference, change.adjusted)
        if len(found.causes) > _MOST_CAUSES:
            yield f"and {len(found.causes) - _MOST_CAUSES} causes more"
    if found.changed:
        yield ""
        yield f"{len(found.changed)} seeds changed sides"
        for changed in found.changed:
            yield from _changed_lines(changed, program)
        lacking = [changed for changed in found.changed if changed.missing]
        if lacking and not any(changed.parting for changed in lacking):
            yield f"of {len(lacking)} a log was not kept: --remake runs them again and says where they part"


def _row(title: str, a: str, b: str, difference: str, p_value: str, adjusted: str) -> str:
    return f"{title:<22} {a:>8} {b:>8}  {difference:<28} {p_value:>7} {adjusted:>7}"


def _difference_row(title: str, found: MeanDifference, adjusted: float, scale: float = 1.0) -> str:
    digits = 1 if scale != 1.0 else 2

    def said(value: float | None) -> str:
        return "–" if value is None else f"{scale * value:.{digits}f}"

    apart = "–"
    if found.count:
        low, high = scale * found.interval.low, scale * found.interval.high
        within = f"{low:+.{digits}f} … {high:+.{digits}f}" if math.isfinite(low) else "too few for one"
        apart = f"{scale * found.mean:+.{digits}f} ({within})"
    clear = " *" if adjusted < SIGNIFICANCE_LEVEL else ""
    return _row(title, said(found.a), said(found.b), apart, _p(found.p_value), _p(adjusted)) + clear


def _p(value: float) -> str:
    return f"{value:.3f}" if value >= 0.001 else "< 0.001"


def _changed_lines(changed: ChangedSeed, program: str) -> Iterator[str]:
    said = f"  seed {changed.seed}: {changed.winner} alone reached its goal"
    yield f"{said}; {changed.parting}" if changed.parting else said
    if changed.logs is not None:
        yield f"    {program} diff {shlex.join(changed.logs)}"


def _json(found: RecipeComparison) -> dict[str, Any]:
    table = found.paired
    return {
        "a": found.label_a,
        "b": found.label_b,
        "paired": table is not None,
        "arithmetic": found.arithmetic,
        "jobs": {"a": found.success_a.total, "b": found.success_b.total},
        "shared": found.shared,
        "alone": found.alone,
        "goal": None
        if table is None
        else {
            "both": table.both,
            "only_a": table.only_a,
            "only_b": table.only_b,
            "neither": table.neither,
        },
        "differ": found.differ,
        "criteria": {
            c.name: {**_difference_json(c.difference), "holm": c.adjusted, "better": c.better}
            for c in found.criteria
        },
        "causes": {c.cause: {**_difference_json(c.difference), "holm": c.adjusted} for c in found.causes},
        "changed": [
            {"seed": c.seed, "winner": c.winner, "logs": c.logs, "missing": c.missing, "parting": c.parting}
            for c in found.changed
        ],
    }


def _difference_json(found: MeanDifference) -> dict[str, Any]:
    finite = math.isfinite(found.interval.low)
    return {
        "a": found.a,
        "b": found.b,
        "difference": found.mean,
        "low": found.interval.low if finite else None,
        "high": found.interval.high if finite else None,
        "p": found.p_value,
        "jobs": found.count,
    }
