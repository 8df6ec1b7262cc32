"""Causes that nothing handles; handlers, nodes, decorators and defaults without effect."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from picktree.files import Diagnostic
from picktree.trees import Decorator, NodeSpec, Switch, Timeout, data_flow, references
from picktree.world import internal, tree

from .mission_survey import LintModel
from .outcomes import UNREPORTED, joined


@dataclass(slots=True)
class _Unmet:
    """Failures that may come out of a node and end the mission without a handler."""

    node: NodeSpec
    causes: int


def unhandled(survey: LintModel) -> Iterator[Diagnostic]:
    """P310: a cause that ends the mission although nothing was tried against it."""
    if survey.main is None:
        return
    # A key that is not written has a finding of its own.
    said_elsewhere = UNREPORTED | survey.walk.causes.of((tree.MISSING_INPUT,))
    found: dict[int, _Unmet] = {}
    by_node: dict[int, int] = {}
    for state, reasons in survey.main.failure.items():
        if state.doubtful:
            continue
        for source in reasons.sources(survey.file):
            causes = source.causes & ~said_elsewhere
            if causes and not source.met:
                unmet = found.setdefault(id(source.at), _Unmet(source.at, 0))
                unmet.causes |= causes
                by_node[id(source.node)] = by_node.get(id(source.node), 0) | causes
    raised = {node: causes & ~said_elsewhere for node, causes in survey.walk.raised.items()}
    handled = any(causes & ~by_node.get(node, 0) for node, causes in raised.items())
    places = sorted(found.values(), key=lambda unmet: unmet.node.mark)
    if not handled:
        # One node alone is a command; there is nothing that a recovery could go on with.
        if len(places) > 1:
            yield _nothing_handled(survey, places)
        return
    for unmet in places:
        causes = survey.walk.causes.words(unmet.causes)
        inside = " from inside" if unmet.node.node is None else ""
        message = f"nothing handles {causes}{inside}: it ends the mission"
        hint = "a Recover around it, with a handler for it or 'otherwise'"
        yield survey.fault(unmet.node, message, hint, code="P310")


def _nothing_handled(survey: LintModel, places: list[_Unmet]) -> Diagnostic:
    """One finding in place of many, for a mission without any recovery."""
    names = list(dict.fromkeys(unmet.node.name for unmet in places))
    shown = ", ".join(names[:3]) + (", …" if len(names) > 3 else "")
    main = survey.mission.main
    message = f"whatever fails ends the mission: nothing in it handles a cause (of {shown})"
    hint = "a Recover around the work, with 'otherwise: [SafeRetreat]' to begin with"
    return Diagnostic(main.mark, main.name, message, hint, "P310", "warning")


def needless_handlers(survey: LintModel) -> Iterator[Diagnostic]:
    """P311, P312: a handler whose causes the child does not fail with, or an earlier pattern takes."""
    for spec in survey.nodes():
        # In a single run no handler is ever needed; that has a finding of its own.
        if spec.node is None or not survey.started(spec) or survey.walk.number(spec, "attempts") == 1:
            continue
        for slot in spec.node.declaration.slots:
            if slot.of == "cause":
                yield from _table(survey, spec, slot.key)


def _table(survey: LintModel, spec: NodeSpec, slot: str) -> Iterator[Diagnostic]:
    tried = spec.slots["do"][0][1]
    causes = joined(survey.ends(tried).failure.values()).any & ~UNREPORTED
    earlier: list[str] = []
    for pattern, _ in spec.slots.get(slot, ()):
        used = (id(spec), pattern) in survey.walk.handled
        over = next((other for other in earlier if _covers(other, pattern)), None)
        at = f"{slot}/{pattern}"
        earlier.append(pattern)
        if used or (over is None and pattern in (str(internal.ANY), internal.ERROR.name)):
            continue  # any node may have a fault, which is not walked through
        if over is not None:
            message = f"{pattern!r} is never used: {over!r} above it takes its causes"
            yield survey.fault(spec, message, "the first that fits is used", code="P312", at=at)
        elif causes & survey.walk.causes.matching(pattern):
            message = f"{pattern!r} is never used: the patterns above take all its causes that are possible"
            yield survey.fault(spec, message, code="P312", at=at)
        else:
            message = f"{pattern!r} is never used: {tried.name} does not fail with it"
            possible = survey.walk.causes.words(causes & ~survey.walk.undeclared)
            yield survey.fault(
                spec, message, f"it may with {possible}" if possible else "", code="P311", at=at
            )


def _covers(pattern: str, other: str) -> bool:
    """Whether the first takes all that the second would."""
    if pattern == "*":
        return not other.startswith(f"{internal.ANY}".removesuffix("*"))
    if pattern.endswith(".*"):
        return other.startswith(pattern[:-1])
    return pattern == other


def unreachable(survey: LintModel) -> Iterator[Diagnostic]:
    """P320: a node that is never ticked, or that its preconditions never let start."""
    for place in survey.places():
        spec = place.spec
        if place.tree.name not in survey.walk.entered or survey.started(spec):
            continue
        if place.above and not survey.started(place.above[-1]):
            continue  # said of what stands above it
        why = survey.walk.blocked.get(id(spec), "")
        if survey.reached(spec):
            yield survey.fault(spec, f"it never starts: {why}", code="P320")
            continue
        if not place.above or _is_handler(place):
            continue
        rest = _following(place, survey)
        if rest is None:
            continue
        message = f"it is never reached: {why}" if why else "it is never reached"
        hint = f"nor what follows it: {', '.join(rest[:3])}{', …' if len(rest) > 3 else ''}" if rest else ""
        yield survey.fault(spec, message, hint, code="P320")


def _is_handler(place: data_flow.PlacedNode) -> bool:
    """Whether the place is a handler by cause after which its node may run again: other rules judge those."""
    parent = place.above[-1]
    for slot in parent.node.declaration.slots if parent.node is not None else ():
        if slot.of == "cause" and any(part is place.spec for _, part in parent.slots.get(slot.key, ())):
            attempts = parent.ports.get("attempts")
            return getattr(attempts, "value", None) != 1
    return False


def _following(place: data_flow.PlacedNode, survey: LintModel) -> list[str] | None:
    """The names of what is not reached either, behind it in the same list; None: it is itself such a one."""
    parent = place.above[-1]
    slots = parent.node.declaration.slots if parent.node is not None else ()
    for slot in slots:
        parts = [part for _, part in parent.slots.get(slot.key, ())]
        index = next((i for i, part in enumerate(parts) if part is place.spec), None)
        if index is None or slot.arity != "many":
            continue
        if index and not survey.reached(parts[index - 1]):
            return None
        return [part.name for part in parts[index + 1 :] if not survey.reached(part)]
    return []


def without_effect(survey: LintModel) -> Iterator[Diagnostic]:
    """P324: a decorator that changes nothing about its child."""
    for spec in survey.nodes(Decorator):
        if not survey.started(spec):
            continue
        part = spec.children[0]
        ends, number = survey.ends(part), survey.walk.number
        never_fails = f"{part.name} never fails" if survey.reached(part) and not ends.failure else ""
        message, at = "", ""
        match spec.id:
            case "ForceSuccess":
                message = never_fails
            case "ForceFailure" if not ends.success:
                message = f"{part.name} never succeeds"
            case "Timeout" if number(spec, "msec") == 0:
                message, at = "a time of 0 is without limit", "msec"
            case "Timeout" if not ends.running:
                message = f"{part.name} always ends at once"
            case "Delay" if number(spec, "delay_msec") == 0:
                message, at = "it waits no time", "delay_msec"
            case "RetryUntilSuccessful" if number(spec, "num_attempts") == 1:
                message, at = "one attempt is no retry", "num_attempts"
            case "RetryUntilSuccessful":
                message = never_fails
            case _:
                pass
        if message:
            yield survey.fault(spec, f"{spec.id} has no effect: {message}", code="P324", at=at)


def needless_defaults(survey: LintModel) -> Iterator[Diagnostic]:
    """P326: a default although all values that can come have a case."""
    for place in survey.places():
        spec = place.spec
        if spec.node is None or not issubclass(spec.node, Switch) or "default" not in spec.slots:
            continue
        possible = _values(place)
        cases = {name for name, _ in spec.slots["cases"]}
        if possible and cases.issuperset(possible):
            message = f"the default is never used: {spec.ports['variable']} is one of {', '.join(possible)}"
            yield survey.fault(spec, message, "each of them has a case", code="P326", at="default")


def _values(place: data_flow.PlacedNode) -> tuple[str, ...]:
    """All values that the variable of a Switch may have, as its cases would write them; empty: not known."""
    bound = place.spec.ports.get("variable")
    if not isinstance(bound, references.Reference):
        return ()
    if bound.attributes:
        return _BOOL if references.ATTRIBUTE_TYPES[bound.attributes[-1]].kind == "bool" else ()
    port = next((port for port in place.tree.ports if port.key == bound.key), None)
    if port is None or port.direction != "in" or port.type.many or port.type.optional:
        return ()
    return _BOOL if port.type.name == "bool" else tuple(map(str, port.choices or ()))


_BOOL = ("true", "false")
MIN_BARE_TIMEOUT = 500.0
"""Number of a Timeout below which one without a unit is taken for seconds, ms."""


def short_timeouts(survey: LintModel) -> Iterator[Diagnostic]:
    """P345: a Timeout of a bare number that is no longer than some ticks."""
    for spec in survey.nodes(Timeout):
        bound = spec.ports.get("msec")
        if (
            isinstance(bound, references.Constant)
            and isinstance(bound.text, int | float)
            and bound.text < MIN_BARE_TIMEOUT
        ):
            message = (
                f"{bound.text:g} counts milliseconds, and a tick takes 50: hardly anything ends within it"
            )
            hint = f"write {bound.text:g} s, or {bound.text:g} ms where that is meant"
            yield survey.fault(spec, message, hint, code="P345", at="msec")


def unknown_objects(survey: LintModel) -> Iterator[Diagnostic]:
    """P346: the name of an object that nothing in the scene will have."""
    known = survey.known
    if known is None:
        return
    kinds = known.names.get("kind", ())
    # Names that perception and `PickAny` give, whatever the catalogue says.
    patterns = (r"(obstacle|thing)_\d+", *(rf"\w+_{re.escape(kind)}_\d+" for kind in kinds))
    for spec in survey.nodes():
        for port in spec.node.declaration.ports if spec.node is not None else ():
            bound = spec.ports.get(port.key)
            if (
                port.type.name != "object"
                or port.names
                or not isinstance(bound, references.Constant)
                or not bound.value
            ):
                continue
            name = str(bound.value)
            if not any(re.fullmatch(pattern, name) for pattern in patterns):
                message = f"port {port.key!r}: no object of the scene {known.scene!r} gets the name {name!r}"
                like = f"colour, kind and number, as 'red_{kinds[0]}_1'" if kinds else "'thing' and a number"
                hint = f"a name is {like}; or a key, as '{{item}}'"
                yield survey.fault(spec, message, hint, code="P346", at=port.key)
