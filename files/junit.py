"""JUnit XML: results of cases, as CI systems show them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

Outcome: TypeAlias = Literal["passed", "failure", "error", "skipped"]

# Characters that XML 1.0 allows; no escape makes the other characters valid.
_INVALID = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True, slots=True)
class JunitCase:
    """One test case. `error`: it gave no result; `failure`: its result is not the one that is wanted."""

    group: str
    """Class name of the case, by which CI systems fold cases."""
    name: str
    seconds: float = 0.0
    outcome: Outcome = "passed"
    kind: str = ""
    """Type of the failure or error: `grasp.slipped`."""
    message: str = ""
    """Failure, error or reason of the skip, as one sentence."""
    detail: str = ""
    output: str = ""
    file: str = ""
    line: int = 0
    """Line of the case in `file`; 0: none."""


def junit_text(suite: str, cases: Iterable[JunitCase], properties: Mapping[str, str] | None = None) -> str:
    """Return a whole file with one suite."""
    listed = tuple(cases)
    root = ElementTree.Element("testsuites", {"name": _valid(suite), **_counts(listed)})
    below = ElementTree.SubElement(root, "testsuite", {"name": _valid(suite), **_counts(listed)})
    if properties:
        group = ElementTree.SubElement(below, "properties")
        for name, value in properties.items():
            ElementTree.SubElement(group, "property", {"name": _valid(name), "value": _valid(value)})
    for case in listed:
        _add(below, case)
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def _counts(cases: tuple[JunitCase, ...]) -> dict[str, str]:
    outcomes = [case.outcome for case in cases]
    return {
        "tests": str(len(cases)),
        "failures": str(outcomes.count("failure")),
        "errors": str(outcomes.count("error")),
        "skipped": str(outcomes.count("skipped")),
        "time": _seconds(sum(case.seconds for case in cases)),
    }


def _add(suite: ElementTree.Element, case: JunitCase) -> None:
    place = {"file": _valid(case.file), "line": str(case.line)} if case.file else {}
    about = {"classname": _valid(case.group), "name": _valid(case.name), "time": _seconds(case.seconds)}
    made = ElementTree.SubElement(suite, "testcase", {**about, **place})
    if case.outcome == "skipped":
        ElementTree.SubElement(made, "skipped", {"message": _valid(case.message)})
    elif case.outcome != "passed":
        attributes = {"message": _valid(case.message), "type": _valid(case.kind)}
        ElementTree.SubElement(made, case.outcome, attributes).text = _valid(case.detail)
    if case.output:
        ElementTree.SubElement(made, "system-out").text = _valid(case.output)


def _seconds(value: float) -> str:
    return f"{value:.3f}"


def _valid(text: str) -> str:
    """Return the text with a sign in place of the characters that no XML file can hold."""
    return _INVALID.sub("\ufffd", text)
