"""Preconditions and postconditions of a node, as `trees.conditions` carries them out."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from ..declaration import PRECONDITIONS
from ..mission import NodeSpec
from .failure_reasons import NO_REPORT, UNREPORTED, joined
from .flow_state import State, States, tidy
from .outcomes import Ends, Flow

if TYPE_CHECKING:
    from .flow_walk import Walk


def conditioned(spec: NodeSpec, state: State, walk: Walk, run: Callable[[State], Flow]) -> Flow:
    """The ends of a node whose preconditions are asked, which then runs, and whose postconditions follow."""
    ends = Ends()
    states: States = frozenset((state,))
    for name in PRECONDITIONS:
        condition = spec.preconditions.get(name)
        if condition is None:
            continue
        asked = walk.ask(spec, name, condition, states)
        ends.fail(asked.failed)
        settled, states = (asked.no, asked.yes) if name == "_while" else (asked.yes, asked.no)
        match name:
            case "_failureIf":
                ends.fail(dict.fromkeys(settled, NO_REPORT))
            case "_successIf":
                ends.succeed(settled)
            case _:
                ends.skip(settled)
        if not states:
            walk.unreached(spec, f"its {name} {'never' if name == '_while' else 'always'} holds")
            break
    for start in states:
        flow = run(start)
        ends.take(flow)
        if "_while" in spec.preconditions:
            # Where it no longer holds, the node is halted first.
            halted = _assigned_keys(spec, ("_onHalted",), walk)
            running = frozenset(state.perhaps(halted) for state in flow.running)
            asked = walk.ask(spec, "_while", spec.preconditions["_while"], running)
            ends.fail(asked.failed)
            ends.skip(asked.no)
    return _concluded(spec, ends.flow(), walk) if spec.postconditions else ends.flow()


def _concluded(spec: NodeSpec, flow: Flow, walk: Walk) -> Flow:
    """After the assignments of the postconditions; one that has no value makes a success a failure."""
    ends = Ends()
    ends.succeed(_assigned(spec, ("_onSuccess", "_post"), flow.success, walk, ends))
    ends.skip(flow.skipped)
    for state, reasons in flow.failure.items():
        problems = Ends()
        for after in _assigned(spec, ("_onFailure", "_post"), frozenset((state,)), walk, problems):
            ends.fail_at(after, reasons)
        for after, missing in problems.flow().failure.items():
            ends.fail_at(after, joined((reasons.only(~UNREPORTED), missing)))
    halted = _assigned_keys(spec, ("_onHalted",), walk)
    ends.run(state.perhaps(halted) for state in flow.running)
    for state in flow.running:  # no end comes of them, but the names are read
        _assigned(spec, ("_onHalted",), frozenset((state,)), walk, Ends())
    return ends.flow()


def _assigned(spec: NodeSpec, places: tuple[str, ...], states: States, walk: Walk, ends: Ends) -> States:
    """The states after all could be carried out; the others are failures of `ends`."""
    written = _assigned_keys(spec, places, walk)
    for place in places:
        for assignment in spec.postconditions.get(place, ()):
            bits = walk.bits(assignment.key)
            asked = walk.ask(spec, place, assignment.value, states)
            for state, reasons in asked.failed.items():
                ends.fail_at(state.perhaps(written), reasons)
            after: list[State] = []
            for state in (*asked.yes, *asked.no):
                if not assignment.new:
                    _, missing = walk.read(spec, place, assignment.key, bits, state)
                    if missing:
                        ends.fail_at(state.perhaps(written), walk.fails(spec, missing))
                after.append(state.written(bits))
            states = tidy(after)
    return states


def _assigned_keys(spec: NodeSpec, places: tuple[str, ...], walk: Walk) -> int:
    bits = 0
    for place in places:
        for assignment in spec.postconditions.get(place, ()):
            bits |= walk.bits(assignment.key)
    return bits
