"""Cases files: their grammar, which is also the value of their parts, and their loader; names are checked
against the mission elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias, TypeVar, cast, get_args

from pydantic import BeforeValidator, Field, PlainValidator, Strict

from picktree.files import Location, describe, suggest_name
from picktree.files.yaml import Document, DocumentChecker, Value, file_models

T = TypeVar("T")


def or_else(read: Callable[[], T], default: T) -> T:
    """Return a part of a value, or the default where it could not be read; the error is reported already."""
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


def numbered(values: Sequence[T]) -> Iterator[tuple[int, T]]:
    """Yield the entries of a list that could be read, with their numbers from 0."""
    for number in range(len(values)):
        with suppress(file_models.UnreadPart):
            yield number, values[number]


AnswerStatus: TypeAlias = Literal["SUCCESS", "FAILURE", "SKIPPED", "RUNNING"]
EndStatus: TypeAlias = Literal["SUCCESS", "FAILURE", "SKIPPED", "RUNNING", "IDLE"]
STATUSES: tuple[AnswerStatus, ...] = get_args(AnswerStatus)
OUTCOMES = ("SUCCESS", "FAILURE", "SKIPPED", "HALTED", "RUNNING")
"""Possible ends of a leaf's run, besides the causes."""
ANY_LEAVES = "..."
"""Entry of `order` for any number of leaves, also none."""
EMPTY_HAND = "empty"
Ticks = Annotated[int, Strict(), Field(ge=0, le=100_000)]
Count = Annotated[int, Strict(), Field(ge=1, le=100_000)]
Text = Annotated[str, Strict()]
Sigma = Annotated[float, file_models.quantity("m", least=0)]
SigmaAngle = Annotated[float, file_models.quantity("rad", least=0)]


@dataclass(frozen=True, slots=True)
class Destination:
    """Destination that a case gives an object; None: nowhere."""

    name: str | None


@dataclass(frozen=True, slots=True)
class BelievedObject(file_models.FileValue):
    """One object in the robot's belief. Missing keys get values from the object's kind and the scene."""

    kind: Text | None = None
    """Kind of the scene's catalogue; default: unknown."""
    form: Text | None = None
    """box, cylinder, sphere, plate, mesh; default: its kind's."""
    colour: Text | None = None
    """Name of its colour; default: unknown."""
    role: Literal["item", "obstacle"] | None = None
    """item: to be handled; obstacle: only in the way. Default: item."""
    destination: Annotated[Destination | None, file_models.ReadAs(Text | None, Destination)] = None
    """Bin where the object belongs, null for nowhere. Default: by the scene's rules."""
    place: Text | None = None
    """Believed place: table, a bin, hand, or aside. Default: table."""
    mass: file_models.Mass | None = None
    """Mass as it was weighed, kg. Default: not weighed."""
    confidence: file_models.Share | None = None
    """Confidence of the belief, 0 to 1. Default: 1."""
    last_seen: file_models.Duration | None = None
    """Simulated time at which the object was last seen, s."""
    sigma_position: Sigma | None = None
    """Standard deviation of its position, m."""
    sigma_angle: SigmaAngle | None = None
    """Standard deviation of its rotation, rad."""


Objects: TypeAlias = dict[str, BelievedObject | None]
"""Objects by id; None: not in the belief."""


@dataclass(frozen=True, slots=True)
class Effects(file_models.FileValue):
    """Changes of the world after a leaf's answer."""

    facts: dict[str, object] = field(default_factory=dict[str, object])
    """Facts that the case sets from now on; null ends this, and the fact follows from the belief again."""
    objects: Objects = field(default_factory=dict[str, "BelievedObject | None"])
    """Objects that appear or change, by id; null takes one out of the belief."""
    hand: Text | None = None
    """Id of the object that the hand holds from now on, or 'empty'."""


@dataclass(frozen=True, slots=True)
class LeafAnswer(file_models.FileValue):
    """Answer of a leaf to one start."""

    status: AnswerStatus | None = None
    """Status at the end; RUNNING: the leaf does not end by itself. Default: SUCCESS, or FAILURE with a cause.
    A skill that fails has a cause; a condition that does not hold is a FAILURE without a cause."""
    cause: Text | None = None
    """Cause of the failure: one of the causes that the leaf declares."""
    ticks: Ticks = 0
    """Number of ticks (0.05 s each) for which the leaf is RUNNING before its end."""
    message: Text = ""
    """The sentence of the failure. Default: the cause's own."""
    outputs: dict[str, object] = field(default_factory=dict[str, object])
    """Values that the leaf writes to its outputs, by port."""
    then: Effects | None = None
    """Changes of the world after the leaf has ended."""

    @property
    def end(self) -> AnswerStatus:
        """Status with which the leaf ends."""
        return self.status or ("FAILURE" if self.cause else "SUCCESS")

    @property
    def effects(self) -> Effects:
        """Changes of the world after the answer, none where `then` is left out."""
        return self.then or Effects()


def _as_written(value: object) -> object:
    return value


Answer = Annotated[object, PlainValidator(_as_written, json_schema_input_type=LeafAnswer | Text)]


@dataclass(frozen=True, slots=True)
class AnswerTurns(file_models.FileValue):
    """Answers in turn, and the one that is given when they are used up."""

    answers: list[Answer]
    """Answers for the first start, the second, …"""
    else_: Annotated[Answer, Field(alias="else")] = None
    """Answer for every start after these. Default: the last answer again."""


Leaf = Annotated[
    object,
    PlainValidator(
        _as_written,
        json_schema_input_type=LeafAnswer | Text | list[LeafAnswer | Text] | AnswerTurns,
    ),
]
"""One answer for every start; a list of answers in turn, the last repeated; or answers with `else`."""


@dataclass(frozen=True, slots=True)
class ExpectedStart:
    """One entry of `order`: pattern of a leaf, and end of its run; ANY_LEAVES matches any leaves."""

    pattern: str
    outcome: str = ""


def _expected_start(value: object) -> ExpectedStart:
    match value:
        case str(pattern) if pattern == ANY_LEAVES or pattern.strip("/"):
            return ExpectedStart(pattern)
        case dict() if len(cast("dict[str, object]", value)) == 1:
            ((pattern, outcome),) = cast("dict[str, object]", value).items()
            if isinstance(outcome, str) and pattern.strip("/") and pattern != ANY_LEAVES:
                return ExpectedStart(pattern, outcome)
        case _:
            pass
    message = "an entry of 'order' is a leaf, or a leaf and how it ends"
    raise file_models.InvalidValue(message, "as Grasp, or {Grasp: grasp.missed}, or '...'", code="P714")


@dataclass(frozen=True, slots=True)
class ExpectedHandling(file_models.FileValue):
    """A failure that some node must take up."""

    cause: Text
    """The cause, or a family of causes as grasp.*."""
    by: Text | None = None
    """Pattern of the node that takes up the failure: SortOne/Recover."""
    handler: Text | None = None
    """Handler of that node: a pattern under its `when:`, or `otherwise`."""
    times: Count | None = None
    """Exact number of times. Default: at least once."""


def _expected_handling(value: object) -> object:
    return {"cause": value} if isinstance(value, str) else value


@dataclass(frozen=True, slots=True)
class Expectation(file_models.FileValue):
    """Expected result of a case."""

    status: EndStatus | None = None
    """The mission's last status. RUNNING: the mission still runs after `ticks`; IDLE: it was halted."""
    cause: Text | None = None
    """Cause of the mission's failure, or a family as grasp.*."""
    ticks: Count | None = None
    """Maximum number of ticks of the mission."""
    order: (
        tuple[
            Annotated[
                ExpectedStart, PlainValidator(_expected_start, json_schema_input_type=Text | dict[str, Text])
            ],
            ...,
        ]
        | None
    ) = None
    """The leaves that start, in this order: patterns, or {pattern: outcome} with SUCCESS, FAILURE, SKIPPED,
    HALTED, RUNNING or a cause. '...' stands for any leaves, also none."""
    handled: tuple[
        Annotated[ExpectedHandling, BeforeValidator(_expected_handling, ExpectedHandling | Text)], ...
    ] = field(default_factory=tuple[ExpectedHandling, ...])
    """Failures that are taken up; a bare text is a cause."""
    never: tuple[Text, ...] = field(default_factory=tuple[str, ...])
    """Patterns of nodes of any kind that must not start."""
    facts: dict[str, object] = field(default_factory=dict[str, object])
    """Values that facts have at the end."""
    objects: Objects = field(default_factory=dict[str, "BelievedObject | None"])
    """Beliefs about objects at the end; null: there is no such object."""
    blackboard: dict[str, object] = field(default_factory=dict[str, object])
    """Values on the blackboard at the end: items is Main's key, SortOne/count one of SortOne."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CaseEntry(file_models.FileValue):
    """One case: state of the world, answers of the leaves, expected result."""

    doc: Text = ""
    """Subject of the case, in a sentence."""
    parameters: dict[str, object] = field(default_factory=dict[str, object])
    """Values of the mission's parameters, the ports of Main."""
    objects: Objects = field(default_factory=dict[str, "BelievedObject | None"])
    """Objects in the belief when the mission begins, by id."""
    facts: dict[str, object] = field(default_factory=dict[str, object])
    """Facts (items_left, items_to_do, holding, held_object, stopped, feed_exhausted, items_done) that the
    case sets; the others follow from the belief."""
    leaves: dict[str, Leaf] = field(default_factory=dict[str, object])
    """Answers of leaves, by pattern: Grasp fits any node of that name, SortOne/Grasp a node below
    SortOne, /Main/Sequence/Grasp only this node. The first pattern that fits is used; a leaf without one
    succeeds."""
    halt_after: Count | None = None
    """The tick after which the mission is halted."""
    expect: Expectation
    """Expected result."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CasesSettings(file_models.FileValue):
    """Keys of a cases file besides its cases."""

    mission: Text | None = None
    """The mission file; its path counts from this file."""
    parameters: dict[str, object] = field(default_factory=dict[str, object])
    """Values of the mission's parameters, the ports of Main. For all cases."""
    objects: Objects = field(default_factory=dict[str, "BelievedObject | None"])
    """Objects in the belief when the mission begins, by id. In all cases."""
    facts: dict[str, object] = field(default_factory=dict[str, object])
    """Facts (items_left, items_to_do, holding, held_object, stopped, feed_exhausted, items_done) that the
    case sets; the others follow from the belief."""
    leaves: dict[str, Leaf] = field(default_factory=dict[str, object])
    """Answers of leaves, by pattern: Grasp fits any node of that name, SortOne/Grasp a node below
    SortOne, /Main/Sequence/Grasp only this node. The first pattern that fits is used; a leaf without one
    succeeds. A case's own patterns come before these."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CasesFile(CasesSettings):
    """A cases file: what its mission does when the leaves answer as each case says."""

    cases: dict[file_models.Name, CaseEntry]
    """The cases by name."""


@dataclass(frozen=True, slots=True)
class PlacedAnswer:
    """Answer of a leaf, and its place in the file."""

    loc: Location
    answer: LeafAnswer


@dataclass(frozen=True, slots=True)
class LeafScript:
    """Answers of all leaves that match the pattern, one start after the other."""

    loc: Location
    answers: tuple[PlacedAnswer, ...]
    otherwise: PlacedAnswer | None = None
    """Answer when the others are used up; None: the last one repeats."""

    @property
    def pattern(self) -> str:
        return str(self.loc[-1])

    def answer(self, start: int) -> PlacedAnswer | None:
        """Return the answer to the start of that number, from 1; None when there are no answers."""
        if start <= len(self.answers):
            return self.answers[start - 1]
        return (self.otherwise or self.answers[-1]) if self.answers else None

    @property
    def everything(self) -> tuple[PlacedAnswer, ...]:
        return self.answers if self.otherwise is None else (*self.answers, self.otherwise)


@dataclass(frozen=True, slots=True)
class RehearsalCase:
    """One case with its name. `entry` is merged with the settings for all cases of the file."""

    name: str
    entry: CaseEntry
    scripts: tuple[LeafScript, ...]
    """Scripts of the case, then those for all cases."""

    @property
    def loc(self) -> Location:
        return ("cases", self.name)


@dataclass(frozen=True, slots=True)
class CaseFile:
    """Content of a cases file. `mission` is the file that it names."""

    document: Document
    mission: Path | None
    cases: tuple[RehearsalCase, ...]


MAX_CASES = 500
"""Maximum number of cases in a file: more are neither read by people, nor checked in a second."""


def read_cases(check: DocumentChecker) -> CaseFile:
    """Return the readable part of the checker's document; the checker collects the format errors."""
    return _Reader(check).read()


class _Reader:
    def __init__(self, check: DocumentChecker) -> None:
        self._check, self._document = check, check.document

    def read(self) -> CaseFile:
        check, data = self._check, self._document.data
        known = file_models.keys_of(CasesFile)
        check.keys(known)
        if not data.get("cases"):
            check.fault(
                (), "the file has no cases", "add 'cases:' with a name for each case", code="P701", key=True
            )
        top = check.read(CasesSettings, ignore={"cases", *(name for name in data if name not in known)})
        scripts = self._scripts(())
        many = data.get("cases")
        if isinstance(many, dict) and len(many) > MAX_CASES:
            message = f"a file may have at most {MAX_CASES} cases, not {len(many)}"
            check.fault(("cases",), message, code="P110", key=True)
            return CaseFile(self._document, None, ())
        given = check.each(CaseEntry, "cases")
        cases = tuple(self._case(name, entry, top, scripts) for name, entry in given.items())
        mission = or_else(lambda: top.mission, None)
        return CaseFile(self._document, self._document.path.parent / mission if mission else None, cases)

    def _case(
        self, name: str, entry: CaseEntry, top: CasesSettings, scripts: tuple[LeafScript, ...]
    ) -> RehearsalCase:
        loc: Location = ("cases", name)
        merged = CaseEntry(
            doc=or_else(lambda: entry.doc, ""),
            parameters={**or_else(lambda: top.parameters, {}), **or_else(lambda: entry.parameters, {})},
            objects=entries(or_else(lambda: top.objects, {})) | entries(or_else(lambda: entry.objects, {})),
            facts={**or_else(lambda: top.facts, {}), **or_else(lambda: entry.facts, {})},
            halt_after=or_else(lambda: entry.halt_after, None),
            expect=or_else(lambda: entry.expect, Expectation("SUCCESS")),
        )
        case = RehearsalCase(name, merged, (*self._scripts(loc), *scripts))
        self._sense((*loc, "expect"), merged.expect, merged.halt_after)
        return case

    def _sense(self, loc: Location, expect: Expectation, halt_after: int | None) -> None:
        """Report an expectation without content, and contradictions within one."""

        def fault(key: str, message: str, hint: str = "") -> None:
            self._check.fault((*loc, key), message, hint, code="P714")

        given = self._document.get(loc)
        if isinstance(given, dict) and all(v in (None, [], {}) and k != "order" for k, v in given.items()):
            message = "nothing is expected: this case cannot fail"
            self._check.fault(loc, message, "as 'expect: {status: SUCCESS}'", code="P714", key=True)
        status, ticks = or_else(lambda: expect.status, None), or_else(lambda: expect.ticks, None)
        if or_else(lambda: expect.cause, None) and status not in (None, "FAILURE"):
            fault("cause", f"a mission that ends in {status} has no cause")
        if status == "RUNNING" and ticks is None:
            fault("status", "RUNNING needs 'ticks', the number of ticks after which the mission still runs")
        if status == "IDLE" and halt_after is None:
            fault("status", "a mission is IDLE only when it was halted", "say so with 'halt_after'")
        if halt_after is not None and ticks is not None and ticks < halt_after:
            fault("ticks", f"the mission is halted only after {halt_after} ticks, later than that")

    # Answers.

    def _scripts(self, above: Location) -> tuple[LeafScript, ...]:
        """Return the scripts under `leaves` of the mapping at `above`, as far as they can be read."""
        loc: Location = (*above, "leaves")
        value = self._document.get(loc)
        if not isinstance(value, dict):
            return ()  # reported by the model
        return tuple(self._script(body, (*loc, pattern)) for pattern, body in value.items())

    def _script(self, body: Value, loc: Location) -> LeafScript:
        if not str(loc[-1]).strip("/"):
            self._check.fault(loc, "the pattern is empty", "as SortOne/Grasp", code="P703", key=True)
        match body:
            case list():
                return LeafScript(loc, self._answers(body, loc))
            case {"answers": list(answers)}:
                self._check.read(AnswerTurns, loc)
                last = self._answer((*loc, "else")) if "else" in body else None
                return LeafScript(loc, self._answers(answers, (*loc, "answers")), last)
            case {"answers": _}:
                self._check.fault((*loc, "answers"), "'answers' is a list of answers", code="P710", key=True)
                return LeafScript(loc, ())
            case {"else": _}:
                self._check.read(AnswerTurns, loc)
                return LeafScript(loc, ())
            case _:
                return LeafScript(loc, tuple(_those_read([self._answer(loc)])))

    def _answers(self, body: list[Value], loc: Location) -> tuple[PlacedAnswer, ...]:
        if not body:
            self._check.fault(loc, "the list of answers is empty", code="P710")
        return tuple(_those_read(self._answer((*loc, n)) for n in range(len(body))))

    def _answer(self, loc: Location) -> PlacedAnswer | None:
        value = self._document.get(loc)
        match value:
            case "SUCCESS" | "FAILURE" | "SKIPPED" | "RUNNING":
                return PlacedAnswer(loc, LeafAnswer(value))
            case str() if "." in value:
                return PlacedAnswer(loc, LeafAnswer(cause=value))
            case str():
                message = f"{describe(value)} is neither a status nor a cause"
                self._check.fault(loc, message, suggest_name(value, STATUSES), code="P710")
            case dict():
                answer = self._check.read(LeafAnswer, loc)
                with self._check.readable():
                    self._agree(loc, answer)
                    return PlacedAnswer(loc, answer)
            case _:
                message = f"an answer is a status, a cause or a mapping, not {describe(value)}"
                self._check.fault(loc, message, "as SUCCESS, or {cause: grasp.missed, ticks: 3}", code="P710")
        return None

    def _agree(self, loc: Location, answer: LeafAnswer) -> None:
        """Report contradictions within an answer."""

        def fault(key: str, message: str, *, at_key: bool = True) -> None:
            self._check.fault((*loc, key), message, code="P710", key=at_key)

        if answer.cause and answer.end != "FAILURE":
            fault("status", f"an answer with a cause is a FAILURE, not {answer.end}", at_key=False)
        if answer.message and not answer.cause:
            fault("message", "only a failure with a cause has a message")
        if answer.then is not None and answer.end == "RUNNING":
            fault("then", "an answer that never ends has no 'then'")


def _those_read(found: Iterable[T | None]) -> Iterator[T]:
    return (one for one in found if one is not None)
