"""Keys and expressions on a walk: which bits stand for a key, and what reading one may come to."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ...files.expressions.expression import Expression, ExpressionError
from ...files.expressions.syntax_tree import (
    Attribute,
    ComparisonChain,
    Conditional,
    ListOf,
    LiteralValue,
    Logic,
    Name,
    Not,
    Part,
    walk,
)
from ...files.expressions.syntax_tree import children as parts_of
from ...world.belief.facts import FACTS
from ...world.causes import perception
from ...world.causes import tree as tree_causes
from ...world.causes import world as world_causes
from ..mission import NodeSpec
from ..ports import Required
from ..values.references import Constant, Reference
from .failure_reasons import CauseBits, FailureReasons
from .flow_state import EMPTY, SHARED, FlowState, States, tidy
from .key_bits import KeyBits
from .outcomes import Failures, NodeOutcomes, OutcomeCollector


@dataclass(frozen=True, slots=True)
class ExpressionShape:
    """`certain`: names that are read whatever the values are. `total`: it has a value as soon as its names
    have one, of whatever type. `constant`: whether it holds, where no name decides; None: cannot be said."""

    names: tuple[str, ...]
    certain: frozenset[str]
    attributes: bool
    total: bool
    constant: bool | None
    fails: bool
    """It has no value at all: `1 / 0`."""
    if_yes: bool | None
    """What it says of the fact `holding` where it holds; None: nothing."""
    if_no: bool | None
    """The same where it does not hold."""


def shape(expression: Expression) -> ExpressionShape:
    constant, fails = _constant(expression)
    names = dict.fromkeys(part.name for part in walk(expression.root) if isinstance(part, Name))
    return ExpressionShape(
        tuple(names),
        certain_names(expression.root),
        bool(expression.paths),
        is_total(expression.root),
        constant,
        fails,
        says_of_hand(expression.root, answer=True),
        says_of_hand(expression.root, answer=False),
    )


def certain_names(part: Part) -> frozenset[str]:
    """Names that are read whatever the values are: those behind a first `and` or `or` are not."""
    match part:
        case Name(name=name):
            return frozenset((name,))
        case Logic(parts=(first, *_)):
            return certain_names(first)
        case Conditional(test=test, yes=yes, no=no):
            return certain_names(test) | (certain_names(yes) & certain_names(no))
        case ComparisonChain(first=first, rest=(second, *_)):
            return certain_names(first) | certain_names(second.operand)
        case _:
            return frozenset[str]().union(*map(certain_names, parts_of(part)))


def is_total(part: Part) -> bool:
    """Whether nothing in it works on some types only."""
    match part:
        case LiteralValue() | Name():
            return True
        case ComparisonChain(rest=rest):
            return all(r.relation in ("==", "!=") for r in rest) and all(map(is_total, parts_of(part)))
        case Logic() | Not() | Conditional() | ListOf():
            return all(map(is_total, parts_of(part)))
        case _:
            return False


def says_of_hand(part: Part, *, answer: bool) -> bool | None:
    """Whether something is held when that is the answer; None: it does not tell."""
    match part:
        case Name(name="holding"):
            return answer
        case Not(operand=operand):
            return says_of_hand(operand, answer=not answer)
        case Logic(symbol=symbol, parts=parts) if (symbol == "and") is answer:
            # All parts of an `and` that holds do, and no part of an `or` that does not.
            known = (says_of_hand(one, answer=answer) for one in parts)
            return next((said for said in known if said is not None), None)
        case _:
            return None


def _constant(expression: Expression) -> tuple[bool | None, bool]:
    if expression.names or any(isinstance(part, Attribute) for part in walk(expression.root)):
        return None, False
    try:
        return bool(expression.evaluate({})), False
    except ExpressionError:
        return None, True


@dataclass(frozen=True, slots=True)
class ExpressionAnswers:
    """What an expression may answer: where it holds, where not, and where it has no value."""

    yes: States
    no: States
    failed: Failures


@dataclass(slots=True)
class KeyRead:
    """A key that is read at one place. It may be unwritten there (`missing`), or written (`ever`)."""

    spec: NodeSpec
    place: str
    key: str
    tree: str
    missing: bool = False
    ever: bool = False


@dataclass(slots=True)
class WiredTree:
    """A tree in one way of being wired; `same`: bits that stand for one key; `owned`: inputs that are
    attributes of an object."""

    layout: KeyBits
    same: Mapping[int, int]
    owned: int
    memo: dict[tuple[int, FlowState], NodeOutcomes] = field(
        default_factory=dict[tuple[int, FlowState], NodeOutcomes]
    )


class KeyReader:
    """What a walk knows of keys, in the tree through which it goes at the moment."""

    def __init__(self) -> None:
        self.causes = CauseBits()
        self.reads: dict[tuple[int, str, str], KeyRead] = {}
        """By `id` of the spec, its key under which the name stands, and the name."""
        self.raised: dict[int, int] = {}
        """What each node has raised itself, by `id` of its spec."""
        self._missing_input = self.causes.of((tree_causes.MISSING_INPUT,))
        self._unknown_object = self.causes.of((world_causes.UNKNOWN_OBJECT,))
        self.undeclared = self._missing_input | self._unknown_object | self.causes.of((tree_causes.TIMEOUT,))
        """What a node may fail with although it does not declare it."""
        self.no_image = self.causes.of((perception.NO_IMAGE,))
        """What whoever looks may fail with. Where it declares nothing else of a look, nobody is told to
        handle it: any device may fail."""
        self._here: WiredTree | None = None
        self._missing = 0
        self._shapes: dict[int, ExpressionShape] = {}
        self._made: dict[tuple[int, int, int], FailureReasons] = {}

    @property
    def _frame(self) -> WiredTree:
        assert self._here is not None, "no tree was entered"
        return self._here

    def fails(self, spec: NodeSpec, loud: int, quiet: int = 0) -> FailureReasons:
        """Failures of the node's own making."""
        key = (id(spec), loud, quiet & ~loud)
        if key not in self._made:
            self._made[key] = FailureReasons(loud, quiet & ~loud, origin=spec)
            self.raised[id(spec)] = self.raised.get(id(spec), 0) | loud
        return self._made[key]

    def literal(self, spec: NodeSpec, key: str) -> object:
        """The value of an input where the text says it, or its default; None where a reference does."""
        bound = spec.ports.get(key)
        if isinstance(bound, Constant):
            return bound.value
        port = spec.node.declaration.port(key) if spec.node is not None and bound is None else None
        return None if port is None or isinstance(port.default, Required) else port.default

    def number(self, spec: NodeSpec, key: str) -> float | None:
        """As `literal`, of a number."""
        value = self.literal(spec, key)
        return value if isinstance(value, int | float) else None

    def key_of(self, spec: NodeSpec, port: str) -> int:
        """The bits of the key that a port is wired to; 0 when it is wired to none."""
        bound = spec.ports.get(port)
        return self.bits(bound.key) if isinstance(bound, Reference) else 0

    def keys_of(self, spec: NodeSpec, ports: Iterable[str]) -> int:
        """As `key_of`, of several."""
        bits = 0
        for port in ports:
            bits |= self.key_of(spec, port)
        return bits

    def flags(self, spec: NodeSpec) -> tuple[int, ...]:
        """The bits of a node that is `lasting`."""
        return self._frame.layout.flags[id(spec)]

    def shape(self, expression: Expression) -> ExpressionShape:
        found = self._shapes.get(id(expression))
        if found is None:
            found = self._shapes[id(expression)] = shape(expression)
        return found

    def ask(
        self, spec: NodeSpec, place: str, expression: Expression, states: Iterable[FlowState]
    ) -> ExpressionAnswers:
        """What the expression that stands under the key `place` of a node answers."""
        found = self.shape(expression)
        yes: list[FlowState] = []
        no: list[FlowState] = []
        failed = OutcomeCollector()
        for state in states:
            after, reasons = self._names(spec, place, found, state)
            if reasons is not None:
                failed.fail_at(state, reasons)
            if found.fails:
                continue
            if found.constant is not False:
                yes.append(self._told(after, holding=found.if_yes))
            if found.constant is not True:
                no.append(self._told(after, holding=found.if_no))
        return ExpressionAnswers(tidy(yes), tidy(no), failed.flow().failure)

    # For the walk.

    def _told(self, state: FlowState, *, holding: bool | None) -> FlowState:
        """After the fact `holding` was heard, unless a key hides it."""
        hidden = state.maybe & self._frame.layout.keys.get("holding", 0)
        if holding is None or hidden or state.hand & SHARED:
            return state
        # What a node holds that does not say so of itself is not known here.
        held = state.hand & ~EMPTY
        return state.holding((held or state.hand) if holding else EMPTY)

    def bits(self, key: str) -> int:
        """The bits that stand for a key: several where ports of the tree are wired to one."""
        bit = self._frame.layout.keys[key]
        return self._frame.same.get(bit, bit)

    def inputs(self, spec: NodeSpec, state: FlowState) -> tuple[FlowState, FailureReasons | None]:
        """After the inputs were read as the node starts; and why that may fail."""
        assert spec.node is not None
        loud = quiet = 0
        for key, bound in spec.ports.items():
            if not isinstance(bound, Reference):
                continue
            port = spec.node.declaration.port(key)
            if port is None or port.direction != "in":
                continue
            bits = self.bits(bound.key)
            state, missing = self.read(spec, key, bound.key, bits, state)
            loud |= missing
            if bound.attributes or bits & self._frame.owned:
                loud, quiet = loud | self._unknown_object, quiet | self._missing_input
            if port.type.name != "any" or port.type.many:
                quiet |= self._missing_input
        return state, self.fails(spec, loud, quiet) if loud or quiet else None

    def _names(
        self, spec: NodeSpec, place: str, found: ExpressionShape, state: FlowState
    ) -> tuple[FlowState, FailureReasons | None]:
        """After the names of an expression were read; and why it may have no value."""
        loud = quiet = 0
        for name in found.names:
            bits = self.bits(name)
            if name in FACTS and not state.sure & bits:
                continue
            after, missing = self.read(spec, place, name, bits, state)
            loud |= missing
            state = after if name in found.certain else state
            if bits & self._frame.owned:
                loud, quiet = loud | self._unknown_object, quiet | self._missing_input
        if found.attributes:
            loud, quiet = loud | self._unknown_object, quiet | self._missing_input
        if found.fails:
            loud |= self._missing_input
        elif not found.total:
            quiet |= self._missing_input
        return state, self.fails(spec, loud, quiet) if loud or quiet else None

    def read(
        self, spec: NodeSpec, place: str, key: str, bits: int, state: FlowState
    ) -> tuple[FlowState, int]:
        """After a key was read: then it was written. Also the cause if it may not have been."""
        unwritten = not state.sure & bits
        self.note_read(spec, place, key, state, missing=unwritten)
        if not unwritten:
            return state, 0
        after = state.written(bits)
        # Of what comes behind a read that cannot succeed nothing is told; a loop does not make it succeed.
        told = state.maybe & bits or self._frame.layout.inputs & bits
        return after if told else after.in_doubt(), self._missing_input

    def note_read(self, spec: NodeSpec, place: str, key: str, state: FlowState, *, missing: bool) -> None:
        """That the key is read at that place, in that state."""
        layout, bits = self._frame.layout, self.bits(key)
        if bits & layout.inputs:
            # Whether an input is written is for the user of the sub-tree to see to.
            self._missing |= bits & layout.inputs if missing and not state.doubtful else 0
            return
        where = (id(spec), place, key)
        read = self.reads.get(where)
        if read is None:
            read = self.reads[where] = KeyRead(spec, place, key, layout.tree.name)
        read.missing = read.missing or (missing and not state.doubtful)
        read.ever = read.ever or (bool(state.maybe & bits) and not state.doubtful)
