"""From a document of kind `cases` to its cases; names are held against the mission elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ....files.models.validation import Checker
from ....files.yaml.document import Location
from .case import Case, CaseFile, Objects, Script
from .cases_schema import CaseEntry, CasesFile
from .expectations import ExpectationReader
from .leaf_answers import AnswerReader
from .partial_models import entries, or_else

MOST_CASES = 500
"""In one file: what is beyond is no longer read by people, nor checked in a second."""


def read_cases(check: Checker) -> CaseFile:
    """What could be read of the checker's document; what is wrong with its form is with the checker."""
    return _Reader(check).read()


@dataclass(frozen=True, slots=True)
class _Common:
    """What the file says for all cases."""

    parameters: Mapping[str, object]
    objects: Objects
    facts: Mapping[str, object]
    scripts: tuple[Script, ...]


class _Reader:
    def __init__(self, check: Checker) -> None:
        self._check, self._document = check, check.document
        self._answers, self._expectations = AnswerReader(check), ExpectationReader(check)

    def read(self) -> CaseFile:
        check = self._check
        check.keys([field.alias or name for name, field in CasesFile.model_fields.items()])
        if not self._document.data.get("cases"):
            check.fault((), "the file has no cases", "'cases:' holds them by name", code="P701", key=True)
        ignored = {name for name in self._document.data if name not in CasesFile.model_fields}
        top = check.read(_Top, ignore={*ignored, "cases"})
        common = _Common(
            or_else(lambda: top.parameters, {}),
            entries(or_else(lambda: top.objects, {})),
            or_else(lambda: top.facts, {}),
            self._answers.scripts(()),
        )
        many = self._document.data.get("cases")
        if isinstance(many, dict) and len(many) > MOST_CASES:
            message = f"at most {MOST_CASES} cases are wanted in a file, not {len(many)}"
            check.fault(("cases",), message, code="P110", key=True)
            return CaseFile(self._document, None, ())
        given = check.each(CaseEntry, "cases")
        cases = tuple(self._case(name, entry, common) for name, entry in given.items())
        mission = or_else(lambda: top.mission, None)
        return CaseFile(self._document, self._document.path.parent / mission if mission else None, cases)

    def _case(self, name: str, entry: CaseEntry, common: _Common) -> Case:
        loc: Location = ("cases", name)
        return Case(
            name,
            loc,
            or_else(lambda: entry.doc, ""),
            {**common.parameters, **or_else(lambda: entry.parameters, {})},
            {**common.objects, **entries(or_else(lambda: entry.objects, {}))},
            {**common.facts, **or_else(lambda: entry.facts, {})},
            (*self._answers.scripts(loc), *common.scripts),
            or_else(lambda: entry.halt_after, None),
            self._expectations.expectation(loc, entry),
        )


class _Top(CasesFile):
    """The file without its cases, which are read one by one."""

    cases: dict[str, CaseEntry] = {}  # noqa: RUF012 - pydantic copies it
