"""Nodes that no run comes to."""

from __future__ import annotations

from collections.abc import Iterator

from ...files.yaml.document import Fault
from .mission_survey import Place, Survey


def unreachable(survey: Survey) -> Iterator[Fault]:
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


def _is_handler(place: Place) -> bool:
    """Of a table of causes: those have rules of their own, unless there is no run after any handler."""
    parent = place.above[-1]
    for slot in parent.node.declaration.slots if parent.node is not None else ():
        if slot.of == "cause" and any(part is place.spec for _, part in parent.slots.get(slot.key, ())):
            attempts = parent.ports.get("attempts")
            return getattr(attempts, "value", None) != 1
    return False


def _following(place: Place, survey: Survey) -> list[str] | None:
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
