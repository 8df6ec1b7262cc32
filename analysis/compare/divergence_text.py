"""Divergence of two runs, as lines of text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ...logs.schema.records import Values
from ...logs.visits import HALTED, Visit
from .diff import value_changes
from .divergence import Divergence, How, MessageDifference
from .message_fields import first_difference_in_values, value_text

DIVERGENCE_TEXTS: Mapping[How, str] = {
    "type": "is of another type",
    "inputs": "begins with other inputs",
    "outcome": "ends otherwise",
    "cause": "fails with another cause",
    "length": "takes another time",
    "order": "another node begins",
    "end": "",
}


def parting_lines(parting: Divergence) -> Iterator[str]:
    a, b = parting.a, parting.b
    same = a is not None and b is not None and parting.how not in ("order", "end")
    if parting.how != "end":
        yield f"they part at {parting.time:.2f} s: {_divergence_phrase(parting, a if same else None)}"
    for side, visit in (("A", a), ("B", b)):
        if visit is None:
            yield f"  {side}  nothing more begins" if parting.how == "order" else f"  {side}  –"
            continue
        yield f"  {side}  {visit.path}{visit.about}"
        yield f"     {_visit_text(visit)}"
    if a is not None and b is not None and same:
        yield from _differing_values("read", a.inputs, b.inputs)
        yield from _differing_values("evidence", a.evidence, b.evidence)
    for side, visit in (("A", parting.next_a), ("B", parting.next_b)):
        if visit is not None:
            yield f"  then {side}  {visit.path}{visit.about} from {visit.start:.2f} s: {end_text(visit)}"
        else:
            yield f"  then {side}  nothing more begins"


def first_value_lines(first: MessageDifference) -> Iterator[str]:
    """Yield lines about the first simulated value that differs."""
    where = f"tick {first.tick}, {first.time:.2f} s, {first.topic}"
    if first.missing:
        side, value = ("B", first.b) if first.missing == "a" else ("A", first.a)
        yield f"first message that differs: {where}: only in {side}"
        yield f"  {side}  {value_text(value)}"
        return
    of = f" ({first.of})" if first.of else ""
    yield f"first value that differs: {where} {first.field}{of}"
    yield f"  A  {value_text(first.a)}"
    yield f"  B  {value_text(first.b)}"


def _differing_values(title: str, a: Values, b: Values) -> Iterator[str]:
    """Yield the values that differ; for lists the first differing element."""
    if not a or not b:
        for side, values in (("A", a), ("B", b)):
            if values:
                said = ", ".join(f"{name} {value_text(value)}" for name, value in values.items())
                yield f"     {title} of {side}: {said}"
        return
    for change in value_changes(a, b):
        found = first_difference_in_values(change.a, change.b, change.name)
        if found is not None:
            yield f"     {title} {found.path}: A {value_text(found.a)}, B {value_text(found.b)}"


def _divergence_phrase(parting: Divergence, same: Visit | None) -> str:
    if same is None:
        return DIVERGENCE_TEXTS[parting.how]
    also = "".join(f", {DIVERGENCE_TEXTS[aspect]}" for aspect in parting.also)
    return f"{same.name} {DIVERGENCE_TEXTS[parting.how]}{also}"


def _visit_text(visit: Visit) -> str:
    return f"{visit.start:.2f} to {visit.end:.2f} s: {end_text(visit)}"


def end_text(visit: Visit, *, short: bool = False) -> str:
    """Return how a visit ended; `short`: of a failure its cause alone."""
    if visit.outcome == "RUNNING":
        return "still runs when the log ends"
    if visit.outcome == HALTED:
        return "was halted"
    if short:
        return visit.cause or visit.outcome
    said = ": ".join(part for part in (visit.cause, visit.message) if part)
    return f"{visit.outcome}, {said}" if said else visit.outcome


def aligned(rows: list[tuple[str, ...]], *, right: bool = False) -> Iterator[str]:
    """Yield rows with columns of minimum width; `right`: numbers from the second column on."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))] if rows else []
    for row in rows:
        cells = (
            cell.rjust(width) if right and k else cell.ljust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        yield "  ".join(cells).rstrip()
