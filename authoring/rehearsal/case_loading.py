"""Loader of cases: converts a document of kind `cases`; names are checked against the mission elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...files.marks import Location
from ...files.value_wording import describe, suggest_name
from ...files.yaml.document_checker import DocumentChecker
from ...files.yaml.file_models import UnreadPart
from ...files.yaml.reader import Value
from .cases_schema import (
    ANY_LEAVES,
    STATUSES,
    AnswerFile,
    AnswerStatus,
    CaseEntry,
    CaseFile,
    CasesFile,
    Effects,
    EffectsFile,
    Expectation,
    ExpectedHandling,
    ExpectedStart,
    ExpectFile,
    HandledFile,
    LeafAnswer,
    LeafScript,
    Objects,
    RehearsalCase,
    TurnsFile,
    entries,
    or_else,
    those_read,
)


class ExpectationReader:
    """Reader of the mappings `expect` of one document."""

    def __init__(self, check: DocumentChecker) -> None:
        self._check, self._document = check, check.document

    def expectation(self, case: Location, entry: CaseEntry) -> Expectation:
        loc: Location = (*case, "expect")
        try:
            expect = entry.expect
        except UnreadPart:
            return Expectation(loc, "SUCCESS")
        order = or_else(lambda: expect.order, None)
        found = Expectation(
            loc,
            or_else(lambda: expect.status, None),
            or_else(lambda: expect.cause, None),
            or_else(lambda: expect.ticks, None),
            None if order is None else self._order((*loc, "order"), len(order)),
            self._handled((*loc, "handled"), expect),
            tuple(or_else(lambda: list(expect.never), [])),
            or_else(lambda: expect.facts, {}),
            entries(or_else(lambda: expect.objects, {})),
            or_else(lambda: expect.blackboard, {}),
        )
        given = self._document.get(loc)
        if isinstance(given, dict) and all(v in (None, [], {}) and k != "order" for k, v in given.items()):
            message = "nothing is expected: this case cannot fail"
            self._check.fault(loc, message, "as 'expect: {status: SUCCESS}'", code="P714", key=True)
        self._sense(found, or_else(lambda: entry.halt_after, None))
        return found

    def _sense(self, expect: Expectation, halt_after: int | None) -> None:
        """Report contradictions within an expectation."""

        def fault(key: str, message: str, hint: str = "") -> None:
            self._check.fault((*expect.loc, key), message, hint, code="P714")

        if expect.cause and expect.status not in (None, "FAILURE"):
            fault("cause", f"a mission that ends in {expect.status} has no cause")
        if expect.status == "RUNNING" and expect.ticks is None:
            fault("status", "RUNNING needs 'ticks': after how many it must still run")
        if expect.status == "IDLE" and halt_after is None:
            fault("status", "a mission is IDLE only when it was halted", "say so with 'halt_after'")
        if halt_after is not None and expect.ticks is not None and expect.ticks < halt_after:
            fault("ticks", f"the mission is halted after {halt_after} ticks, which is more")

    def _order(self, loc: Location, count: int) -> tuple[ExpectedStart, ...]:
        return tuple(those_read(self._turn((*loc, n)) for n in range(count)))

    def _turn(self, loc: Location) -> ExpectedStart | None:
        match self._document.get(loc):
            case str(pattern) if pattern == ANY_LEAVES or pattern.strip("/"):
                return ExpectedStart(loc, pattern)
            case dict(entry) if len(entry) == 1:
                ((pattern, outcome),) = entry.items()
                if isinstance(outcome, str) and pattern.strip("/") and pattern != ANY_LEAVES:
                    return ExpectedStart(loc, pattern, outcome)
            case _:
                pass
        message = "an entry of 'order' is a leaf, or a leaf and how it ends"
        self._check.fault(loc, message, "as Grasp, or {Grasp: grasp.missed}, or '...'", code="P714")
        return None

    def _handled(self, loc: Location, expect: ExpectFile) -> tuple[ExpectedHandling, ...]:
        count = len(or_else(lambda: expect.handled, []))
        return tuple(those_read(self._taken_up((*loc, n)) for n in range(count)))

    def _taken_up(self, loc: Location) -> ExpectedHandling | None:
        value = self._document.get(loc)
        if isinstance(value, str):
            return ExpectedHandling(loc, value)
        entry = self._check.read(HandledFile, loc)
        try:
            return ExpectedHandling(loc, entry.cause, entry.by or "", entry.handler or "", entry.times)
        except UnreadPart:
            return None


class AnswerReader:
    """Reader of the mappings `leaves` of one document."""

    def __init__(self, check: DocumentChecker) -> None:
        self._check, self._document = check, check.document

    def scripts(self, above: Location) -> tuple[LeafScript, ...]:
        """Return the scripts under `leaves` of the mapping at `above`, as far as they can be read."""
        loc: Location = (*above, "leaves")
        value = self._document.get(loc)
        if not isinstance(value, dict):
            return ()  # reported by the model
        return tuple(self._script(pattern, body, (*loc, pattern)) for pattern, body in value.items())

    def _script(self, pattern: str, body: Value, loc: Location) -> LeafScript:
        if not pattern.strip("/"):
            self._check.fault(loc, "the pattern is empty", "as SortOne/Grasp", code="P703", key=True)
        match body:
            case list():
                return LeafScript(loc, pattern, self._answers(body, loc))
            case {"answers": list(answers)}:
                self._keys(TurnsFile, loc)
                last = self._answer((*loc, "else")) if "else" in body else None
                return LeafScript(loc, pattern, self._answers(answers, (*loc, "answers")), last)
            case {"answers": _}:
                self._check.fault((*loc, "answers"), "'answers' is a list of answers", code="P710", key=True)
                return LeafScript(loc, pattern, ())
            case {"else": _}:
                self._check.read(TurnsFile, loc)
                return LeafScript(loc, pattern, ())
            case _:
                return LeafScript(loc, pattern, tuple(those_read([self._answer(loc)])))

    def _answers(self, body: list[Value], loc: Location) -> tuple[LeafAnswer, ...]:
        if not body:
            self._check.fault(loc, "the list of answers is empty", code="P710")
        return tuple(those_read(self._answer((*loc, n)) for n in range(len(body))))

    def _answer(self, loc: Location) -> LeafAnswer | None:
        value = self._document.get(loc)
        if isinstance(value, str):
            if value in STATUSES:
                return LeafAnswer(loc, value)
            if "." not in value:
                message = f"{describe(value)} is neither a status nor a cause"
                self._check.fault(loc, message, suggest_name(value, STATUSES), code="P710")
                return None
            return LeafAnswer(loc, "FAILURE", value)
        if not isinstance(value, dict):
            message = f"an answer is a status, a cause or a mapping, not {describe(value)}"
            self._check.fault(loc, message, "as SUCCESS, or {cause: grasp.missed, ticks: 3}", code="P710")
            return None
        entry = self._check.read(AnswerFile, loc)
        try:
            return self._full_answer(loc, entry)
        except UnreadPart:
            return None

    def _full_answer(self, loc: Location, entry: AnswerFile) -> LeafAnswer | None:
        status: AnswerStatus = entry.status or ("FAILURE" if entry.cause else "SUCCESS")
        if entry.cause and status != "FAILURE":
            message = f"an answer with a cause is a FAILURE, not {status}"
            self._check.fault((*loc, "status"), message, code="P710")
        if entry.message and not entry.cause:
            message = "only a failure with a cause has a message"
            self._check.fault((*loc, "message"), message, code="P710", key=True)
        if entry.then and status == "RUNNING":
            message = "what never ends has no 'then'"
            self._check.fault((*loc, "then"), message, code="P710", key=True)
        return LeafAnswer(
            loc, status, entry.cause or "", entry.ticks, entry.message, entry.outputs, _effects(entry.then)
        )

    def _keys(self, model: type[TurnsFile], loc: Location) -> None:
        """Report keys that the model does not have."""
        known = [field.alias or name for name, field in model.model_fields.items()]
        value = self._document.get(loc)
        for key in value if isinstance(value, dict) else ():
            if key not in known:
                message = f"unknown key {describe(key)}"
                self._check.fault((*loc, key), message, suggest_name(key, known), code="P104", key=True)


def _effects(then: EffectsFile | None) -> Effects:
    return Effects() if then is None else Effects(then.facts, entries(then.objects), then.hand)


MAX_CASES = 500
"""Maximum number of cases in a file: more are neither read by people, nor checked in a second."""


def read_cases(check: DocumentChecker) -> CaseFile:
    """Return the readable part of the checker's document; the checker collects the format errors."""
    return _Reader(check).read()


@dataclass(frozen=True, slots=True)
class _Common:
    """Settings for all cases of the file."""

    parameters: Mapping[str, object]
    objects: Objects
    facts: Mapping[str, object]
    scripts: tuple[LeafScript, ...]


class _Reader:
    def __init__(self, check: DocumentChecker) -> None:
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
        if isinstance(many, dict) and len(many) > MAX_CASES:
            message = f"at most {MAX_CASES} cases are wanted in a file, not {len(many)}"
            check.fault(("cases",), message, code="P110", key=True)
            return CaseFile(self._document, None, ())
        given = check.each(CaseEntry, "cases")
        cases = tuple(self._case(name, entry, common) for name, entry in given.items())
        mission = or_else(lambda: top.mission, None)
        return CaseFile(self._document, self._document.path.parent / mission if mission else None, cases)

    def _case(self, name: str, entry: CaseEntry, common: _Common) -> RehearsalCase:
        loc: Location = ("cases", name)
        return RehearsalCase(
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
    """Root of the file without its cases, which are read one by one."""

    cases: dict[str, CaseEntry] = {}  # noqa: RUF012 - pydantic copies it
