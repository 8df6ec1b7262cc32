"""Use of the arm: an object in the hand at the end, and two users of one resource at the same time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import TypeAlias

from picktree.files import Diagnostic
from picktree.trees import (
    NodeSpec,
    ParallelNode,
    PipelineSequence,
    RateController,
    ReactiveFallback,
    ReactiveSequence,
    Resource,
    Sequence,
    TryCatch,
    control_flow,
)

from .mission_survey import LintModel
from .outcomes import HAND_EMPTY, FlowState, Outcomes


def left_in_hand(survey: LintModel) -> Iterator[Diagnostic]:
    """P330: an object that is still held at the end, without a node that releases it."""
    main = survey.main
    if main is None:
        return
    names: dict[int, list[str]] = {}
    for bit, filler in survey.walk.fillers.values():
        success = any(_held(state, bit) for state in main.success | main.skipped)
        failure = any(_held(state, bit) for state in main.failure)
        at = _in_own_file(survey, filler) if success or failure else None
        if at is not None:
            hidden = _passed_over(survey, filler, bit) if success else main
            when = "it succeeds" if hidden is None else _fails(survey, hidden, bit, names)
            when += " and the mission continues" if hidden not in (None, main) else ""
            message = (
                f"the hand may still hold the object of {filler.name} at the end of the mission, when {when}"
            )
            hint = _release(survey, at, bit) if hidden is not None else _AFTER_SUCCESS
            yield survey.fault(at, message, hint, code="P330")


_AFTER_SUCCESS = "put it down afterwards, by a Place or 'SafeRetreat: {hand: open}'"
_GIVE_UP = "give_up: {SafeRetreat: {hand: open}}"


def _release(survey: LintModel, filler: NodeSpec, bit: int) -> str:
    """Return the hint for an object that is held after a failure: what to write at which Recover."""
    for around in reversed(survey.around(filler)):
        ends = survey.ends(around)
        kept = any(_held(state, bit) for state in ends.success | ends.skipped)
        if around.id == "Recover" and not kept and any(_held(state, bit) for state in ends.failure):
            return f"write '{_GIVE_UP}' in the Recover, line {around.mark.line}"
    recover = f"Recover: {{do: […], otherwise: SafeRetreat, {_GIVE_UP}}}"
    return f"write '{recover}' around it and the nodes up to its Place"


def nothing_held(survey: LintModel) -> Iterator[Diagnostic]:
    """P333: a node puts down an object that no node has taken before."""
    for spec in survey.nodes():
        if spec.node is None or spec.node.hand_before != "full" or not survey.started(spec):
            continue
        entries = survey.entries(spec)
        if entries and all(state.hand == HAND_EMPTY for state in entries):
            message = (
                f"the hand holds nothing here: no node that runs before this {spec.name} takes an object"
            )
            yield survey.fault(spec, message, f"put a Grasp before {spec.name}", code="P333")


def _passed_over(survey: LintModel, filler: NodeSpec, bit: int) -> Outcomes | None:
    """Return the ends of the outermost node around that leaves the hand full only when it fails."""
    for around in survey.around(filler):
        ends = survey.ends(around)
        if not any(_held(state, bit) for state in ends.success | ends.skipped):
            return ends if any(_held(state, bit) for state in ends.failure) else None
    return None


def _fails(survey: LintModel, ends: Outcomes, bit: int, known: dict[int, list[str]]) -> str:
    """Return the nodes that fail with a full hand. `known`: their names by the `id` of the reasons."""
    reasons = [why for state, why in ends.failure.items() if _held(state, bit)]
    for why in reasons:
        if id(why) not in known:
            sources = why.sources(survey.file)
            known[id(why)] = [survey.short_name(each.at) for each in sources if each.causes]
    names = list(dict.fromkeys(name for why in reasons for name in known[id(why)]))
    if not names:
        return "it fails"
    return " or ".join(names[:3]) + (" or another node" if len(names) > 3 else "") + " fails"


def _held(state: FlowState, bit: int) -> bool:
    return bool(state.hand & bit) and not state.doubtful


def _in_own_file(survey: LintModel, filler: NodeSpec) -> NodeSpec | None:
    """Return the node, or the call in the mission's own file of the sub-tree that contains it."""
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


Users: TypeAlias = Mapping[Resource, NodeSpec]


def at_the_same_time(survey: LintModel) -> Iterator[Diagnostic]:
    """P331: two children of a Parallel or ParallelAll that use the same resource."""
    for spec in survey.nodes(ParallelNode):
        reported: set[int] = set()
        for first, second in combinations(spec.children, 2):
            mine, others = users(survey, first), users(survey, second)
            # Two may use it at once where one of them leaves it to others all the while.
            contested = (one for one in mine if one in others and not _shares(others[one], one))
            shared = next((one for one in contested if not _shares(mine[one], one)), None)
            if shared is None or id(second) in reported:
                continue
            reported.add(id(second))
            message = f"{others[shared].name} and {mine[shared].name} use the {shared} at the same time"
            yield survey.fault(
                second, message, "run one after the other, in a Sequence", code="P331", error=True
            )


def started_anew(survey: LintModel) -> Iterator[Diagnostic]:
    """P332: a reactive node restarts a child at each tick, which takes the resource of a later child."""
    for spec in survey.nodes(ReactiveSequence, ReactiveFallback, PipelineSequence):
        for index, part in enumerate(spec.children[:-1]):
            first = _first_user(survey, part)
            if first is None or first.node is None:
                continue
            later: dict[Resource, NodeSpec] = {}
            for other in reversed(spec.children[index + 1 :]):
                later |= users(survey, other)
            resource = next((one for one in first.node.uses if one in later), None)
            if resource is not None:
                user = later[resource].name
                message = f"{first.name} is started anew at each tick and takes the {resource} from {user}"
                plain = spec.id.removeprefix("Reactive").removeprefix("Pipeline")
                hint = f"put a condition before it, or use {plain} instead of {spec.id}"
                yield survey.fault(part, message, hint, code="P332")


def cleaning_arm(survey: LintModel) -> Iterator[Diagnostic]:
    """P334: the last child of a TryCatch uses the robot, though a halt has taken it away by then."""
    for spec in survey.nodes(TryCatch):
        if survey.walk.literal(spec, "catch_on_halt") is False or not spec.children:
            continue
        found = users(survey, spec.children[-1])
        if found:
            resource, user = next(iter(found.items()))
            message = (
                f"a halt ticks {user.name} once, while another node has the {resource} that {user.name} uses"
            )
            hint = "let a node after the TryCatch move, for example a handler of a Recover around it"
            yield survey.fault(spec.children[-1], message, hint, code="P334", error=True)


def _shares(spec: NodeSpec, resource: Resource) -> bool:
    return spec.node is not None and resource in spec.node.shares


def users(survey: LintModel, spec: NodeSpec) -> Users:
    """Return the resources of a branch with their first user; one that does not share comes first. Nodes that
    are never reached do not count."""
    found: dict[Resource, NodeSpec] = {}
    for part in spec.iterate():
        if not survey.started(part):
            continue
        if part.node is None:
            below = users(survey, survey.mission.trees[part.id].root)
            added = {one: part for one, user in below.items() if not _shares(user, one)}
            added |= {one: user for one, user in below.items() if one not in added}
        else:
            added = dict.fromkeys(part.node.uses, part)
        for resource, user in added.items():
            if resource not in found or (_shares(found[resource], resource) and not _shares(user, resource)):
                found[resource] = user
    return found


def _starts_first(spec: NodeSpec, flow: control_flow.Flow | None) -> bool:
    """Whether the node ticks its first child at once in any case."""
    match flow:
        case control_flow.Loop():
            return not flow.each_of and flow.guard not in spec.ports
        case control_flow.ChildFlow():
            return not (
                isinstance(
                    flow,
                    control_flow.AtOnce
                    | control_flow.Choice
                    | control_flow.Once
                    | control_flow.Resumed
                    | control_flow.Turns,
                )
                or control_flow.IDLE in flow.own
            )
        case _:
            return False


def _first_user(survey: LintModel, spec: NodeSpec) -> NodeSpec | None:
    """Return the leaf with a resource with which the branch begins in any case; None without one."""
    if spec.preconditions:
        return None
    if spec.node is None:
        return _first_user(survey, survey.mission.trees[spec.id].root)
    if not spec.children:
        return spec if spec.node.uses else None
    if issubclass(spec.node, RateController):
        return _first_user(survey, spec.children[0])
    if issubclass(spec.node, Sequence):
        first = next((part for part in spec.children if not _passes_by(survey, part)), None)
        return _first_user(survey, first) if first is not None else None
    return _first_user(survey, spec.children[0]) if _starts_first(spec, spec.node.declaration.flow) else None


def _passes_by(survey: LintModel, spec: NodeSpec) -> bool:
    """Whether it ends at once and always leads to the next child, as Log does."""
    ends = survey.ends(spec)
    return not ends.running and not ends.failure
