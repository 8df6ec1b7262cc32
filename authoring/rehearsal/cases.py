"""Cases files: their grammar, one pydantic model for each part, and their loader; names are checked against
the mission elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias, TypeVar

from pydantic import Field, PlainValidator, Strict

from picktree.files import Location, describe, suggest_name
from picktree.files.yaml import Document, DocumentChecker, Value, file_models

T = TypeVar("T")


def or_else(read: Callable[[], T], default: T) -> T:
    """Return a part of a model, or the default where it could not be read; the error is reported already."""
    try:
        return read()
    except file_models.UnreadPart:
        return default


def entries(mapping: Mapping[str, T]) -> dict[str, T]:
    """Return the entries of a mapping that could be read."""
    found: dict[str, T] = {}
    for key in mapping:
        with suppress(file_models.UnreadPart):
            found[key] = mapping[key]
    return found


def those_read(found: Iterable[T | None]) -> Iterator[T]:
    return (one for one in found if one is not None)


Ticks = Annotated[int, Strict(), Field(ge=0, le=100_000)]
Count = Annotated[int, Strict(), Field(ge=1, le=100_000)]
Text = Annotated[str, Strict()]
Mass = Annotated[float, file_models.quantity("kg", above=0)]
Sigma = Annotated[float, file_models.quantity("m", least=0)]
SigmaAngle = Annotated[float, file_models.quantity("rad", least=0)]


class ObjectFile(file_models.FileModel):
    """One object as the robot believes it to be. What is left out follows from its kind and the scene."""

    kind: Text | None = Field(None, description="Kind of the scene's catalogue; default: unknown.")
    form: Text | None = Field(None, description="box, cylinder, sphere, plate, mesh; default: its kind's.")
    colour: Text | None = Field(None, description="Name of its colour; default: unknown.")
    role: Literal["item", "obstacle"] | None = Field(
        None, description="item: to be handled; obstacle: only in the way. Default: item."
    )
    destination: Text | None = Field(
        None,
        description="The bin where it belongs, null for nowhere. Default: what the scene's rules say of it.",
    )
    place: Text | None = Field(
        None, description="Where it is believed to lie: table, a bin, hand, or aside. Default: table."
    )
    mass: Mass | None = Field(None, description="Mass as it was weighed, kg. Default: not weighed.")
    confidence: file_models.Share | None = Field(
        None, description="How sure the belief is, 0 to 1. Default: 1."
    )
    last_seen: file_models.Duration | None = Field(
        None, description="Simulated time when it was seen last, s."
    )
    sigma_position: Sigma | None = Field(None, description="Standard deviation of its position, m.")
    sigma_angle: SigmaAngle | None = Field(None, description="Standard deviation of its rotation, rad.")


class EffectsFile(file_models.FileModel):
    """Changes of the world after a leaf's answer."""

    facts: dict[str, object] = Field(
        default_factory=dict[str, object],
        description="Facts that have a value of the case's own from now on; null gives them back.",
    )
    objects: dict[str, ObjectFile | None] = Field(
        default_factory=dict[str, ObjectFile | None],
        description="Objects that appear or change, by id; null takes one out of the belief.",
    )
    hand: Text | None = Field(
        None, description="Id of the object that the hand holds from now on, or 'empty'."
    )


class AnswerFile(file_models.FileModel):
    """Answer of a leaf to one start."""

    status: Literal["SUCCESS", "FAILURE", "SKIPPED", "RUNNING"] | None = Field(
        None,
        description="How it ends; RUNNING: not by itself. Default: SUCCESS, with a cause FAILURE. A skill "
        "that fails has a cause; a condition that does not hold is a FAILURE without one.",
    )
    cause: Text | None = Field(None, description="Why it fails: one of the causes that the leaf declares.")
    ticks: Ticks = Field(0, description="For how many ticks (0.05 s each) it is RUNNING before it ends.")
    message: Text = Field("", description="The sentence of the failure. Default: the cause's own.")
    outputs: dict[str, object] = Field(
        default_factory=dict[str, object], description="Values that it writes to its outputs, by port."
    )
    then: EffectsFile | None = Field(None, description="What is otherwise in the world after it has ended.")


class TurnsFile(file_models.FileModel):
    """Answers in turn, and the one that is given when they are used up."""

    answers: Annotated[
        list[object], PlainValidator(lambda v: v, json_schema_input_type=list[AnswerFile | Text])
    ] = Field(description="For the first start, the second, …")
    else_: Annotated[object, PlainValidator(lambda v: v, json_schema_input_type=AnswerFile | Text)] = Field(
        None, alias="else", description="For every start after these. Default: the last answer again."
    )


Leaf = Annotated[
    object,
    PlainValidator(
        lambda v: v, json_schema_input_type=AnswerFile | Text | list[AnswerFile | Text] | TurnsFile
    ),
]
"""One answer for every start; a list of answers in turn, the last repeated; or answers with `else`."""
Leaves = dict[str, Leaf]
_LEAVES = (
    "How leaves answer, by pattern: Grasp is any node of that name, SortOne/Grasp one below SortOne, "
    "/Main/Sequence/Grasp that one alone. The first that fits is used; a leaf that none fits succeeds."
)
_PARAMETERS = "Values of the mission's parameters, the ports of Main."
_OBJECTS = "What is in the belief when the mission begins, by id."
_FACTS = (
    "Facts (items_left, items_to_do, holding, held_object, stopped, feed_exhausted, items_done) that have a "
    "value of the case's own; the others follow from the belief."
)


class HandledFile(file_models.FileModel):
    """A failure that some node must take up."""

    cause: Text = Field(description="The cause, or a family of causes as grasp.*.")
    by: Text | None = Field(None, description="Pattern of the node that takes it up: SortOne/Recover.")
    handler: Text | None = Field(
        None, description="Which of its handlers: the pattern under `when:`, or otherwise."
    )
    times: Count | None = Field(None, description="How often exactly. Default: at least once.")


class ExpectFile(file_models.FileModel):
    """Expected result of a case."""

    status: Literal["SUCCESS", "FAILURE", "SKIPPED", "RUNNING", "IDLE"] | None = Field(
        None,
        description="The mission's last status. RUNNING: it still runs after `ticks`; IDLE: it was halted.",
    )
    cause: Text | None = Field(None, description="Why the mission fails: a cause, or a family as grasp.*.")
    ticks: Count | None = Field(None, description="How many ticks it may take at most.")
    order: (
        list[Annotated[object, PlainValidator(lambda v: v, json_schema_input_type=Text | dict[str, Text])]]
        | None
    ) = Field(
        None,
        description="The leaves that start, in this order: patterns, or {pattern: outcome} with SUCCESS, "
        "FAILURE, SKIPPED, HALTED, RUNNING or a cause. '...' stands for any leaves, also none.",
    )
    handled: list[
        Annotated[object, PlainValidator(lambda v: v, json_schema_input_type=HandledFile | Text)]
    ] = Field(default_factory=list[object], description="Failures that are taken up; a bare text is a cause.")
    never: list[Text] = Field(
        default_factory=list[str], description="Patterns of nodes of any kind that must not start."
    )
    facts: dict[str, object] = Field(
        default_factory=dict[str, object], description="Values that facts have at the end."
    )
    objects: dict[str, ObjectFile | None] = Field(
        default_factory=dict[str, ObjectFile | None],
        description="What is believed of objects at the end; null: there is no such object.",
    )
    blackboard: dict[str, object] = Field(
        default_factory=dict[str, object],
        description="Values on the blackboard at the end: items is Main's key, SortOne/count one of SortOne.",
    )


class CaseEntry(file_models.FileModel):
    """One case: how the world is, how the leaves answer, what must come of it."""

    doc: Text = Field("", description="What the case is about, in a sentence.")
    parameters: dict[str, object] = Field(default_factory=dict[str, object], description=_PARAMETERS)
    objects: dict[str, ObjectFile | None] = Field(
        default_factory=dict[str, ObjectFile | None], description=_OBJECTS
    )
    facts: dict[str, object] = Field(default_factory=dict[str, object], description=_FACTS)
    leaves: Leaves = Field(default_factory=dict[str, object], description=_LEAVES)
    halt_after: Count | None = Field(None, description="The tick after which the mission is halted.")
    expect: ExpectFile = Field(description="What must come of it.")


class CasesFile(file_models.FileModel):
    """A cases file: what its mission does when the leaves answer as each case says."""

    mission: Text | None = Field(None, description="The mission file; its path counts from this file.")
    parameters: dict[str, object] = Field(
        default_factory=dict[str, object], description=_PARAMETERS + " For all cases."
    )
    objects: dict[str, ObjectFile | None] = Field(
        default_factory=dict[str, ObjectFile | None], description=_OBJECTS + " In all cases."
    )
    facts: dict[str, object] = Field(default_factory=dict[str, object], description=_FACTS)
    leaves: Leaves = Field(
        default_factory=dict[str, object], description=_LEAVES + " A case's own patterns come before these."
    )
    cases: dict[file_models.Name, CaseEntry] = Field(description="The cases by name.")


AnswerStatus: TypeAlias = Literal["SUCCESS", "FAILURE", "SKIPPED", "RUNNING"]
EndStatus: TypeAlias = Literal["SUCCESS", "FAILURE", "SKIPPED", "RUNNING", "IDLE"]
STATUSES: tuple[AnswerStatus, ...] = ("SUCCESS", "FAILURE", "SKIPPED", "RUNNING")
OUTCOMES = ("SUCCESS", "FAILURE", "SKIPPED", "HALTED", "RUNNING")
"""Possible ends of a leaf's run, besides the causes."""
ANY_LEAVES = "..."
"""Entry of `order` for any number of leaves, also none."""
EMPTY_HAND = "empty"
Objects: TypeAlias = Mapping[str, ObjectFile | None]
"""Objects by id; None: not in the belief."""


@dataclass(frozen=True, slots=True)
class Effects:
    """Changes of the world after a leaf's answer."""

    facts: Mapping[str, object] = field(default_factory=dict[str, object])
    objects: Objects = field(default_factory=dict[str, "ObjectFile | None"])
    hand: str | None = None
    """Id of an object, or EMPTY_HAND; None: as the leaf's declaration implies."""


@dataclass(frozen=True, slots=True)
class LeafAnswer:
    """Answer of a leaf to one start; `loc` is its place in the file."""

    loc: Location
    status: AnswerStatus = "SUCCESS"
    cause: str = ""
    ticks: int = 0
    """Number of ticks RUNNING before the end."""
    message: str = ""
    outputs: Mapping[str, object] = field(default_factory=dict[str, object])
    then: Effects = field(default_factory=Effects)


@dataclass(frozen=True, slots=True)
class LeafScript:
    """Answers of all leaves that match the pattern, one start after the other."""

    loc: Location
    pattern: str
    answers: tuple[LeafAnswer, ...]
    otherwise: LeafAnswer | None = None
    """Answer when the others are used up; None: the last one repeats."""

    @property
    def everything(self) -> tuple[LeafAnswer, ...]:
        return self.answers if self.otherwise is None else (*self.answers, self.otherwise)


@dataclass(frozen=True, slots=True)
class ExpectedStart:
    """One entry of `order`: pattern of a leaf, and end of its run; ANY_LEAVES matches any leaves."""

    loc: Location
    pattern: str
    outcome: str = ""


@dataclass(frozen=True, slots=True)
class ExpectedHandling:
    """Failure that a node must handle."""

    loc: Location
    cause: str
    by: str = ""
    handler: str = ""
    times: int | None = None


@dataclass(frozen=True, slots=True)
class Expectation:
    """Expected result of a case; None or empty: any."""

    loc: Location
    status: EndStatus | None = None
    cause: str | None = None
    ticks: int | None = None
    order: tuple[ExpectedStart, ...] | None = None
    handled: tuple[ExpectedHandling, ...] = ()
    never: tuple[str, ...] = ()
    facts: Mapping[str, object] = field(default_factory=dict[str, object])
    objects: Objects = field(default_factory=dict[str, "ObjectFile | None"])
    blackboard: Mapping[str, object] = field(default_factory=dict[str, object])


@dataclass(frozen=True, slots=True)
class RehearsalCase:
    """One case, merged with the settings for all cases of the file."""

    name: str
    loc: Location
    doc: str
    parameters: Mapping[str, object]
    objects: Objects
    facts: Mapping[str, object]
    scripts: tuple[LeafScript, ...]
    halt_after: int | None
    expect: Expectation


@dataclass(frozen=True, slots=True)
class CaseFile:
    """Content of a cases file. `mission` is the file that it names."""

    document: Document
    mission: Path | None
    cases: tuple[RehearsalCase, ...]


class _Reader:
    def __init__(self, check: DocumentChecker) -> None:
        self._check, self._document = check, check.document

    def read(self) -> CaseFile:
        check = self._check
        check.keys([field.alias or name for name, field in CasesFile.model_fields.items()])
        if not self._document.data.get("cases"):
            check.fault((), "the file has no cases", "'cases:' holds them by name", code="P701", key=True)
        ignored = {name for name in self._document.data if name not in CasesFile.model_fields}
        top = check.read(_Top, ignore={*ignored, "cases"})
        scripts = self._scripts(())
        many = self._document.data.get("cases")
        if isinstance(many, dict) and len(many) > MAX_CASES:
            message = f"at most {MAX_CASES} cases are wanted in a file, not {len(many)}"
            check.fault(("cases",), message, code="P110", key=True)
            return CaseFile(self._document, None, ())
        given = check.each(CaseEntry, "cases")
        cases = tuple(self._case(name, entry, top, scripts) for name, entry in given.items())
        mission = or_else(lambda: top.mission, None)
        return CaseFile(self._document, self._document.path.parent / mission if mission else None, cases)

    def _case(
        self, name: str, entry: CaseEntry, top: CasesFile, scripts: tuple[LeafScript, ...]
    ) -> RehearsalCase:
        loc: Location = ("cases", name)
        return RehearsalCase(
            name,
            loc,
            or_else(lambda: entry.doc, ""),
            {**or_else(lambda: top.parameters, {}), **or_else(lambda: entry.parameters, {})},
            entries(or_else(lambda: top.objects, {})) | entries(or_else(lambda: entry.objects, {})),
            {**or_else(lambda: top.facts, {}), **or_else(lambda: entry.facts, {})},
            (*self._scripts(loc), *scripts),
            or_else(lambda: entry.halt_after, None),
            self._expectation(loc, entry),
        )

    # Expectations.

    def _expectation(self, case: Location, entry: CaseEntry) -> Expectation:
        loc: Location = (*case, "expect")
        try:
            expect = entry.expect
        except file_models.UnreadPart:
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
        except file_models.UnreadPart:
            return None

    # Answers.

    def _scripts(self, above: Location) -> tuple[LeafScript, ...]:
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
                known = [field.alias or name for name, field in TurnsFile.model_fields.items()]
                for key in (key for key in body if key not in known):
                    message, hint = f"unknown key {describe(key)}", suggest_name(key, known)
                    self._check.fault((*loc, key), message, hint, code="P104", key=True)
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
        except file_models.UnreadPart:
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
        then = entry.then
        effects = Effects() if then is None else Effects(then.facts, entries(then.objects), then.hand)
        return LeafAnswer(loc, status, entry.cause or "", entry.ticks, entry.message, entry.outputs, effects)


MAX_CASES = 500
"""Maximum number of cases in a file: more are neither read by people, nor checked in a second."""


def read_cases(check: DocumentChecker) -> CaseFile:
    """Return the readable part of the checker's document; the checker collects the format errors."""
    return _Reader(check).read()


class _Top(CasesFile):
    """Root of the file without its cases, which are read one by one."""

    cases: dict[str, CaseEntry] = {}  # noqa: RUF012 - pydantic copies it
