"""Rules about nodes that are never reached, and decorators and defaults without effect."""

from __future__ import annotations

from collections.abc import Iterator

from picktree.files import Diagnostic
from picktree.trees import Decorator, Switch, data_flow, references

from .mission_survey import LintModel


def unreachable(survey: LintModel) -> Iterator[Diagnostic]:
    """P320: a node that is never ticked, or whose preconditions never let it start."""
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
        message = f"this node is never reached: {why}" if why else "this node is never reached"
        hint = f"nor what follows it: {', '.join(rest[:3])}{', …' if len(rest) > 3 else ''}" if rest else ""
        yield survey.fault(spec, message, hint, code="P320")


def _is_handler(place: data_flow.PlacedNode) -> bool:
    """Whether the place is a handler by cause with a possible further run: other rules check those."""
    parent = place.above[-1]
    for slot in parent.node.declaration.slots if parent.node is not None else ():
        if slot.of == "cause" and any(part is place.spec for _, part in parent.slots.get(slot.key, ())):
            attempts = parent.ports.get("attempts")
            return getattr(attempts, "value", None) != 1
    return False


def _following(place: data_flow.PlacedNode, survey: LintModel) -> list[str] | None:
    """Return the names of the further unreached nodes behind it in the same list; None: it follows such a
    node."""
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
    """P324: a decorator without an effect on its child."""
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
                message, at = "a time of 0 means no limit", "msec"
            case "Timeout" if not ends.running:
                message = f"{part.name} always ends in its first tick"
            case "Delay" if number(spec, "delay_msec") == 0:
                message, at = "a delay of 0 does not wait", "delay_msec"
            case "RetryUntilSuccessful" if number(spec, "num_attempts") == 1:
                message, at = "one attempt is no retry", "num_attempts"
            case "RetryUntilSuccessful":
                message = never_fails
            case _:
                pass
        if message:
            yield survey.fault(spec, f"{spec.id} has no effect: {message}", code="P324", at=at)


def needless_defaults(survey: LintModel) -> Iterator[Diagnostic]:
    """P326: a default although all possible values have a case."""
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
    """Return all possible values of a Switch's variable, in the form of its cases; empty: unknown."""
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
