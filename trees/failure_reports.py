"""Failure reports: portable tracebacks, attachment of reports, and conversion to plain values."""

from __future__ import annotations

import re
import sys
import traceback
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import GeneratorType
from typing import Final, cast

from picktree.files import file_system
from picktree.world import (
    PLUGIN_LINE,
    Evidence,
    EvidenceValue,
    FailureReport,
    Plain,
    cause_named,
    internal,
    matches,
)

from .port_types import plain_copy

_ADDRESS: Final = re.compile(r"\b0x[0-9a-fA-F]{6,}\b")


def portable_trace(error: BaseException) -> str:
    """Return the traceback as Python prints it, with file names in place of paths and without object
    addresses."""
    summary = traceback.TracebackException.from_exception(error)
    todo: list[traceback.TracebackException | None] = [summary]
    while todo:
        one = todo.pop()
        if one is None:
            continue
        for frame in one.stack:
            frame.filename = _portable(frame.filename)
        todo += [one.__cause__, one.__context__]
    return without_addresses("".join(summary.format()))


def without_addresses(text: str) -> str:
    """`<Wave object at 0x7f3a10b2c4d0>` is another in each process.

    >>> without_addresses("<Wave object at 0x7f3a10b2c4d0>")
    '<Wave object at 0x…>'
    """
    return _ADDRESS.sub("0x…", text)


def internal_error_report(error: BaseException, doing: str, path: str) -> FailureReport:
    """Report an exception of a node's own code as internal.error, with its portable trace.

    Where code of a plug-in raised it, message and evidence name the line of its file.
    """
    name = type(error).__name__
    message = f"{name} while {doing}: {without_addresses(str(error))}"
    evidence: dict[str, EvidenceValue] = {"exception": name}
    if isinstance(error, AttributeError) and isinstance(error.obj, GeneratorType):
        message += ": a motion gives its result to 'yield from' only"
    place = _line_of_plugin(error)
    if place is not None:
        evidence[PLUGIN_LINE] = place
        message += "" if place in message else f" ({place})"
    evidence["traceback"] = portable_trace(error)
    return FailureReport(internal.ERROR, message, evidence, path)


def _line_of_plugin(error: BaseException) -> str | None:
    """Return the last line of a traceback that is neither ours nor a library's, as `wave.py, line 13`."""
    found = None
    for frame, line in traceback.walk_tb(error.__traceback__):
        package = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        file = frame.f_code.co_filename
        if package not in sys.stdlib_module_names and "/" not in _portable(file):
            found = f"{Path(file).name}, line {line}"
    return found


def _portable(file: str) -> str:
    path = Path(file)
    if (
        path.is_relative_to(file_system.ROOT)
        and path.relative_to(file_system.ROOT).parts[0] in file_system.rooms()
    ):
        return f"picktree/{path.relative_to(file_system.ROOT).as_posix()}"
    for place in ("site-packages", "dist-packages"):
        if place in path.parts:
            return "/".join(path.parts[path.parts.index(place) + 1 :])
    return path.name


def cannot_be_hidden(report: FailureReport | None) -> bool:
    """Whether no node may turn this failure into a success: a safety stop, or a program fault."""
    return report is not None and (matches("safety.*", report.cause) or matches("internal.*", report.cause))


def with_attached(report: FailureReport, others: Iterable[FailureReport]) -> FailureReport:
    """Return the report with the others attached."""
    added = tuple(others)
    return replace(report, attached=(*report.attached, *added)) if added else report


def decisive_report(reports: Iterable[FailureReport | None]) -> FailureReport | None:
    """Return the last report with the earlier ones attached; None entries (false conditions) are ignored."""
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
    """Convert back from the result of `report_to_plain`."""
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
    """Return evidence that can be logged: foreign numbers as Python's, other values as text."""
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
    """Return a remembered value as a plain one; reports and tuples stay recognisable."""
    if isinstance(value, FailureReport):
        return {"report": report_to_plain(value)}
    if isinstance(value, tuple):
        return {"tuple": [pack(item) for item in cast("tuple[object, ...]", value)]}
    if isinstance(value, dict | list):
        return {"value": plain_copy(cast("object", value))}
    return plain_copy(value)


def unpack(value: Plain) -> object:
    """Convert back from the result of `pack`."""
    match value:
        case {"report": report}:
            return report_from_plain(report)
        case {"tuple": list(items)}:
            return tuple(unpack(item) for item in items)
        case {"value": inner}:
            return inner
        case _:
            return value
