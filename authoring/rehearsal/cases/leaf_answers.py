"""How leaves answer, as a cases file says it."""

from __future__ import annotations

from ....files.models.validation import Checker, Unread, describe
from ....files.yaml.document import Location, Value, nearest
from .case import STATUSES, Answer, AnswerStatus, Effects, Script
from .cases_schema import AnswerFile, EffectsFile, TurnsFile
from .partial_models import entries, those_read


class AnswerReader:
    """Reads the mappings `leaves` of one document."""

    def __init__(self, check: Checker) -> None:
        self._check, self._document = check, check.document

    def scripts(self, above: Location) -> tuple[Script, ...]:
        """Those under `leaves` of the mapping at `above`, as far as they can be read."""
        loc: Location = (*above, "leaves")
        value = self._document.get(loc)
        if not isinstance(value, dict):
            return ()  # reported by the model
        return tuple(self._script(pattern, body, (*loc, pattern)) for pattern, body in value.items())

    def _script(self, pattern: str, body: Value, loc: Location) -> Script:
        if not pattern.strip("/"):
            self._check.fault(loc, "the pattern is empty", "as SortOne/Grasp", code="P703", key=True)
        match body:
            case list():
                return Script(loc, pattern, self._answers(body, loc))
            case {"answers": list(answers)}:
                self._keys(TurnsFile, loc)
                last = self._answer((*loc, "else")) if "else" in body else None
                return Script(loc, pattern, self._answers(answers, (*loc, "answers")), last)
            case {"answers": _}:
                self._check.fault((*loc, "answers"), "'answers' is a list of answers", code="P710", key=True)
                return Script(loc, pattern, ())
            case {"else": _}:
                self._check.read(TurnsFile, loc)
                return Script(loc, pattern, ())
            case _:
                return Script(loc, pattern, tuple(those_read([self._answer(loc)])))

    def _answers(self, body: list[Value], loc: Location) -> tuple[Answer, ...]:
        if not body:
            self._check.fault(loc, "the list of answers is empty", code="P710")
        return tuple(those_read(self._answer((*loc, n)) for n in range(len(body))))

    def _answer(self, loc: Location) -> Answer | None:
        value = self._document.get(loc)
        if isinstance(value, str):
            if value in STATUSES:
                return Answer(loc, value)
            if "." not in value:
                message = f"{describe(value)} is neither a status nor a cause"
                self._check.fault(loc, message, nearest(value, STATUSES), code="P710")
                return None
            return Answer(loc, "FAILURE", value)
        if not isinstance(value, dict):
            message = f"an answer is a status, a cause or a mapping, not {describe(value)}"
            self._check.fault(loc, message, "as SUCCESS, or {cause: grasp.missed, ticks: 3}", code="P710")
            return None
        entry = self._check.read(AnswerFile, loc)
        try:
            return self._full_answer(loc, entry)
        except Unread:
            return None

    def _full_answer(self, loc: Location, entry: AnswerFile) -> Answer | None:
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
        return Answer(
            loc, status, entry.cause or "", entry.ticks, entry.message, entry.outputs, _effects(entry.then)
        )

    def _keys(self, model: type[TurnsFile], loc: Location) -> None:
        """Refuse keys that the model does not have."""
        known = [field.alias or name for name, field in model.model_fields.items()]
        value = self._document.get(loc)
        for key in value if isinstance(value, dict) else ():
            if key not in known:
                message = f"unknown key {describe(key)}"
                self._check.fault((*loc, key), message, nearest(key, known), code="P104", key=True)


def _effects(then: EffectsFile | None) -> Effects:
    return Effects() if then is None else Effects(then.facts, entries(then.objects), then.hand)
