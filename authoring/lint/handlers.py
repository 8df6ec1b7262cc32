"""Rules about handlers: causes that nothing handles, and handlers that are never used."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from picktree.files import Diagnostic
from picktree.trees import NodeSpec
from picktree.world import internal, tree

from .mission_survey import LintModel
from .outcomes import UNREPORTED, joined


@dataclass(slots=True)
class _Unmet:
    """Failures that may come out of a node and end the mission without a handler."""

    node: NodeSpec
    causes: int


def unhandled(survey: LintModel) -> Iterator[Diagnostic]:
    """P310: a cause that ends the mission without an attempted cure."""
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
        message = f"nothing handles {causes}{inside}: such a failure ends the mission"
        recover = f"Recover: {{do: {{{unmet.node.id}: …}}, otherwise: SafeRetreat}}"
        hint = f"write '{recover}' in its place, or handlers by cause in 'when'"
        if unmet.node.id == "SafeRetreat":
            hint = "write 'Fallback: [SafeRetreat, {AskForHelp: {reason: …}}]' in its place"
        yield survey.fault(unmet.node, message, hint, code="P310")


def _nothing_handled(survey: LintModel, places: list[_Unmet]) -> Diagnostic:
    """Return one finding in place of many, for a mission without any recovery."""
    names = list(dict.fromkeys(unmet.node.name for unmet in places))
    shown = ", ".join(names[:3]) + (", …" if len(names) > 3 else "")
    main = survey.mission.main
    message = f"whatever fails ends the mission: nothing in it handles a cause (of {shown})"
    hint = "put a Recover around the work, with 'otherwise: [SafeRetreat]' to begin with"
    return Diagnostic(main.mark, main.name, message, hint, "P310", "warning")


def needless_handlers(survey: LintModel) -> Iterator[Diagnostic]:
    """P311, P312: a handler for causes that the child does not raise, or that an earlier pattern covers."""
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
            message = f"{pattern!r} is never used: the earlier pattern {over!r} takes its causes"
            yield survey.fault(spec, message, "the first pattern that fits is used", code="P312", at=at)
        elif causes & survey.walk.causes.matching(pattern):
            message = f"{pattern!r} is never used: earlier patterns take all its possible causes"
            yield survey.fault(spec, message, code="P312", at=at)
        else:
            message = f"{pattern!r} is never used: {tried.name} never fails with this cause"
            possible = survey.walk.causes.words(causes & ~survey.walk.undeclared)
            yield survey.fault(
                spec, message, f"it may with {possible}" if possible else "", code="P311", at=at
            )


def _covers(pattern: str, other: str) -> bool:
    """Whether the first pattern covers all causes of the second."""
    if pattern == "*":
        return not other.startswith(f"{internal.ANY}".removesuffix("*"))
    if pattern.endswith(".*"):
        return other.startswith(pattern[:-1])
    return pattern == other
