"""Result of a rehearsal as JUnit XML."""

from __future__ import annotations

from collections.abc import Iterable

from ...files.junit import JunitCase, junit_text
from .rehearsal_result import CaseResult, Rehearsal
from .rehearsal_text import trace_lines


def to_junit(rehearsal: Rehearsal, gaps: Iterable[str] = ()) -> str:
    """Return a file with a test case for each case, and one that fails for each of the `gaps` in coverage.

    Times are simulated seconds.
    """
    group = rehearsal.file.stem
    cases = [_case(rehearsal, case, group) for case in rehearsal.cases]
    file = str(rehearsal.file)
    cases += [
        JunitCase(group, "coverage", outcome="failure", kind="coverage", message=gap, detail=gap, file=file)
        for gap in gaps
    ]
    coverage = rehearsal.coverage
    properties = {
        "coverage": f"{coverage.percent} %",
        "recovery coverage": f"{coverage.recovery.percent} %",
    }
    return junit_text(rehearsal.mission, cases, properties if rehearsal.complete else None)


def _case(rehearsal: Rehearsal, case: CaseResult, group: str) -> JunitCase:
    place = case.mark
    if case.passed:
        return JunitCase(group, case.name, case.seconds, output=case.doc, file=place.file, line=place.line)
    differences = [str(difference) for difference in case.differences]
    trace = "\n".join(trace_lines(case.events, rehearsal.names))
    end = case.status + (f" {case.cause}" if case.cause else "")
    return JunitCase(
        group,
        case.name,
        case.seconds,
        "failure",
        case.cause or case.status,
        case.differences[0].message,
        "\n".join([f"{end} after {case.ticks} ticks", *differences]),
        trace,
        place.file,
        place.line,
    )
