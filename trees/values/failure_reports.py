"""Failure reports on their way up and into a saved state."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import cast

from ...world.causes import Evidence, FailureReport, cause_named, matches
from ...world.journal import Plain
from .plain_values import plain_copy


def cannot_be_hidden(report: FailureReport | None) -> bool:
    """Whether no node may turn this failure into a success: a safety stop, or a fault of the program."""
    return report is not None and (matches("safety.*", report.cause) or matches("internal.*", report.cause))


def with_attached(report: FailureReport, others: Iterable[FailureReport]) -> FailureReport:
    """The report with the others attached to it."""
    added = tuple(others)
    return replace(report, attached=(*report.attached, *added)) if added else report


def decisive(reports: Iterable[FailureReport | None]) -> FailureReport | None:
    """The last that is a report at all (a false condition has none), with the earlier ones attached."""
    known = [report for report in reports if report is not None]
    return with_attached(known[-1], known[:-1]) if known else None


def report_to_plain(report: FailureReport | None) -> Plain:
    if report is None:
        return None
    return {
        "cause": report.cause.name,
        "message": report.message,
        "evidence": plain_copy(dict(report.evidence)),
        "node": report.node,
        "attached": [report_to_plain(other) for other in report.attached],
    }


def report_from_plain(value: Plain) -> FailureReport | None:
    """The inverse of `report_to_plain`."""
    if not isinstance(value, dict):
        return None
    attached = cast("list[Plain]", value["attached"])
    return FailureReport(
        cause_named(str(value["cause"])),
        str(value["message"]),
        cast("Evidence", value["evidence"]),
        str(value["node"]),
        tuple(other for item in attached if (other := report_from_plain(item)) is not None),
    )


def plain_evidence(evidence: Mapping[str, object]) -> Evidence:
    """Evidence as it may be logged: numbers of other libraries become Python's, anything else its text."""
    return cast("Evidence", {key: _evidence(value) for key, value in evidence.items()})


def _evidence(value: object) -> Plain:
    listed = getattr(value, "tolist", None)
    value = listed() if callable(listed) else value
    if isinstance(value, list | tuple):
        return [_evidence(item) for item in cast("list[object]", value)]
    try:
        return plain_copy(value)
    except (TypeError, ValueError):
        return str(value)


def pack(value: object) -> Plain:
    """A remembered value as a plain one; reports and tuples stay recognisable."""
    if isinstance(value, FailureReport):
        return {"report": report_to_plain(value)}
    if isinstance(value, tuple):
        return {"tuple": [pack(item) for item in cast("tuple[object, ...]", value)]}
    if isinstance(value, dict | list):
        return {"value": plain_copy(cast("object", value))}
    return plain_copy(value)


def unpack(value: Plain) -> object:
    """The inverse of `pack`."""
    match value:
        case {"report": report}:
            return report_from_plain(report)
        case {"tuple": list(items)}:
            return tuple(unpack(item) for item in items)
        case {"value": inner}:
            return inner
        case _:
            return value
