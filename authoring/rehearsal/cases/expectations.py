"""What must come of a case, as a cases file says it."""

from __future__ import annotations

from ....files.models.validation import Checker, Unread
from ....files.yaml.document import Location
from .case import ANY_LEAVES, Expectation, TakenUp, Turn
from .cases_schema import CaseEntry, ExpectFile, HandledFile
from .partial_models import entries, or_else, those_read


class ExpectationReader:
    """Reads the mappings `expect` of one document."""

    def __init__(self, check: Checker) -> None:
        self._check, self._document = check, check.document

    def expectation(self, case: Location, entry: CaseEntry) -> Expectation:
        loc: Location = (*case, "expect")
        try:
            expect = entry.expect
        except Unread:
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
        """What contradicts itself."""

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

    def _order(self, loc: Location, count: int) -> tuple[Turn, ...]:
        return tuple(those_read(self._turn((*loc, n)) for n in range(count)))

    def _turn(self, loc: Location) -> Turn | None:
        match self._document.get(loc):
            case str(pattern) if pattern == ANY_LEAVES or pattern.strip("/"):
                return Turn(loc, pattern)
            case dict(entry) if len(entry) == 1:
                ((pattern, outcome),) = entry.items()
                if isinstance(outcome, str) and pattern.strip("/") and pattern != ANY_LEAVES:
                    return Turn(loc, pattern, outcome)
            case _:
                pass
        message = "an entry of 'order' is a leaf, or a leaf and how it ends"
        self._check.fault(loc, message, "as Grasp, or {Grasp: grasp.missed}, or '...'", code="P714")
        return None

    def _handled(self, loc: Location, expect: ExpectFile) -> tuple[TakenUp, ...]:
        count = len(or_else(lambda: expect.handled, []))
        return tuple(those_read(self._taken_up((*loc, n)) for n in range(count)))

    def _taken_up(self, loc: Location) -> TakenUp | None:
        value = self._document.get(loc)
        if isinstance(value, str):
            return TakenUp(loc, value)
        entry = self._check.read(HandledFile, loc)
        try:
            return TakenUp(loc, entry.cause, entry.by or "", entry.handler or "", entry.times)
        except Unread:
            return None
