"""What is in the hand when the mission ends."""

from __future__ import annotations

from collections.abc import Iterator

from ...files.yaml.document import Diagnostic
from ...trees.flow import FlowState
from ...trees.flow.flow_state import FIRST_FILLER
from ...trees.mission import NodeSpec
from .mission_survey import LintModel


def left_in_hand(survey: LintModel) -> Iterator[Diagnostic]:
    """P330: an object that is still held at the end, with nobody having seen to it."""
    main = survey.main
    if main is None:
        return
    failed: list[tuple[FlowState, tuple[str, ...]]] = []
    for state, why in main.failure.items():
        if not state.doubtful and state.hand >= FIRST_FILLER:
            names = (source.at.name for source in why.sources(survey.file) if source.causes)
            failed.append((state, tuple(dict.fromkeys(names))))
    for index, filler in enumerate(survey.walk.fillers):
        bit = FIRST_FILLER << index
        success = any(_held(state, bit) for state in main.success | main.skipped)
        failures = [names for state, names in failed if _held(state, bit)]
        at = _in_own_file(survey, filler) if success or failures else None
        if at is not None:
            when = "it succeeds" if success else _fails(failures)
            message = f"the mission may end with what {filler.name} took still in the hand, when {when}"
            hint = "on the way out, place it, or let 'SafeRetreat: {hand: open}' see to it"
            yield survey.fault(at, message, hint, code="P330")


def _fails(failures: list[tuple[str, ...]]) -> str:
    names = list(dict.fromkeys(name for names in failures for name in names))
    if not names:
        return "it fails"
    return " or ".join(names[:3]) + (" or another node" if len(names) > 3 else "") + " fails"


def _held(state: FlowState, bit: int) -> bool:
    return bool(state.hand & bit) and not state.doubtful


def _in_own_file(survey: LintModel, filler: NodeSpec) -> NodeSpec | None:
    """The node, or where the mission's own file uses the sub-tree in which it stands."""
    if survey.own(filler.mark):
        return filler
    for place in survey.places():
        if place.spec.node is None and _contains(survey, place.spec.id, filler):
            return place.spec
    return None


def _contains(survey: LintModel, tree: str, wanted: NodeSpec) -> bool:
    return any(
        spec is wanted or (spec.node is None and _contains(survey, spec.id, wanted))
        for spec in survey.mission.trees[tree].root.iterate()
    )
