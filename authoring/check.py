"""Check of a whole mission file: its language, its scene, the names that it uses, and the linter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

from picktree.authoring.lint import lint
from picktree.files import (
    Diagnostic,
    FileError,
    PicktreeError,
    ValueType,
    check_types,
    expression_syntax,
    suggest_name,
)
from picktree.files.yaml import Document
from picktree.trees import Mission, MissionFiles, data_flow, expression_fault, reachable, references
from picktree.trees.loading import (
    MissionReadResult,
    NodeRegistry,
    SceneNames,
    examine,
    load_surroundings,
    required_mission,
)
from picktree.world import planner_names, world_facts

_CODE = "P240"


def check_scene_names(reading: MissionReadResult, known: SceneNames) -> Iterator[Diagnostic]:
    """Yield an error for each literal, and each default in use, with an unknown name of scene or robot.

    Trees of other files count only where the mission uses them.
    """
    mission, circuit = reading.mission, reading.circuit
    if circuit is None:
        return
    used = reachable(mission.trees)
    own = str(mission.document.path)
    attributes = _attributes(known)
    for arrivals in circuit.arrivals:
        for arrival in arrivals:
            tree = arrival.at.trail.split("/")[0]
            if tree in used or arrival.at.mark.file == own:
                yield from _named(arrival, known)
    for name, keys in circuit.keys.items():
        if name in used or keys.tree.mark.file == own:
            for placed in keys.places.values():
                for use in data_flow.expressions_of(placed.spec):
                    yield from _check_expression(placed, use, keys, attributes, reading.pointer)
                yield from _check_cases(placed, attributes, known)


def _named(arrival: data_flow.ArrivingValue, known: SceneNames) -> Iterator[Diagnostic]:
    at, what, values = arrival.at, arrival.target.names, arrival.source.values or ()
    if what is None or arrival.problem is not None:
        return
    names = known.names.get(what, ())
    texts = [name for value in values for name in (value if isinstance(value, list) else [value])]
    wrong = [name for name in texts if name not in names]
    if what == "planner":
        wrong = [name for name in wrong if not planner_names.is_planner(str(name))]
    if wrong and (arrival.source.certain or len(wrong) == len(texts)):
        owner = f"robot {known.robot!r}" if what == "pose" else f"scene {known.scene!r}"
        lacks = f"the {owner} has no {what} {wrong[0]!r}"
        fault = planner_names.unknown_planner(str(wrong[0])) if what == "planner" else lacks
        message = f"port {at.port.key!r}: {fault}"
        if at.text == data_flow.DEFAULT:
            message += ", which is the default"
        suggest = planner_names.suggest_planner if what == "planner" else partial(suggest_name, known=names)
        hints = [suggest(str(wrong[0])), *arrival.hints()]
        yield Diagnostic(at.mark, at.trail, message, "; ".join(filter(None, hints)), _CODE)


def _attributes(known: SceneNames) -> Mapping[str, ValueType]:
    """Return the types of object attributes, with the texts that are possible in this scene."""
    bins = (*known.names.get("bin", ()), *known.names.get("hole", ()))
    choices = {
        "kind": (*known.names.get("kind", ()), "unknown"),
        "destination": bins,
        "place": (*bins, "table", "hand", world_facts.ASIDE),
    }
    return {
        name: replace(kind, choices=choices.get(name, kind.choices))
        for name, kind in references.ATTRIBUTE_TYPES.items()
    }


def _check_expression(
    placed: data_flow.PlacedNode,
    use: data_flow.NodeExpression,
    keys: data_flow.TreeKeys,
    attributes: Mapping[str, ValueType],
    pointer: references.ExpressionLocator,
) -> Iterator[Diagnostic]:
    """Check a valid expression against the names of this scene."""
    if not use.expression.paths:
        return
    try:
        check_types(use.expression, keys, references.ATTRIBUTE_TYPES)
    except expression_syntax.ExpressionError:
        return  # reported already
    try:
        check_types(use.expression, keys, attributes)
    except expression_syntax.ExpressionError as error:
        yield expression_fault(placed, use, error, pointer, _CODE)


def _check_cases(
    placed: data_flow.PlacedNode, attributes: Mapping[str, ValueType], known: SceneNames
) -> Iterator[Diagnostic]:
    """Check for cases that match no value of the attribute in this scene."""
    if placed.spec.node is None:
        return
    for slot in placed.spec.node.declaration.slots:
        bound = placed.spec.ports.get(slot.matches or "")
        if not isinstance(bound, references.Reference) or not bound.attributes:
            continue
        attribute = attributes[bound.attributes[-1]]
        if attribute.choices == references.ATTRIBUTE_TYPES[bound.attributes[-1]].choices:
            continue
        valid = (*attribute.choices, "null") if attribute.optional else attribute.choices
        for label, _ in placed.spec.slots.get(slot.key, ()):
            if label not in valid:
                message = f"in the scene {known.scene!r} {bound} is never {label!r}"
                mark = placed.spec.mark_at(f"{slot.key}/{label}")
                yield Diagnostic(mark, placed.path, message, suggest_name(label, valid), _CODE)


@dataclass(frozen=True, slots=True)
class MissionCheck:
    """Result of the check of a mission file. `mission` is None when the text has errors of its own."""

    mission: Mission | None
    faults: tuple[Diagnostic, ...]
    """Diagnostics in the order of the files, those of scene and robot (with their own places) included."""

    def required(self) -> Mission:
        """Return the mission, which can be run. Raises FileError with all errors, also for a library."""
        return required_mission(self.mission, self.faults)


def check_mission(
    document: Document,
    registry: NodeRegistry | None = None,
    known: SceneNames | None = None,
    robot: str | None = None,
    *,
    linted: bool = True,
    files: MissionFiles | None = None,
) -> MissionCheck:
    """Check a document of kind `mission` completely; never raises for its content.

    `known`: names of scene and robot of the run, by default those that the mission names. `robot`: shipped
    robot or robot file instead of the scene's. `linted`: whether the linter looks at it, too. `files`:
    source of the included files, by default the disk.
    """
    reading = examine(document, registry, files)
    known, faults = (known, []) if known is not None else _surroundings(reading.mission, robot)
    faults = [*reading.faults, *faults]
    if known is not None:
        faults += check_scene_names(reading, known)
    if linted and not any(fault.severity == "error" for fault in faults):
        faults += lint(reading.mission, known)
    ordered = sorted(dict.fromkeys(faults), key=lambda fault: fault.mark)
    wrong = any(fault.severity == "error" for fault in reading.faults)
    return MissionCheck(None if wrong else reading.mission, tuple(ordered))


def _surroundings(mission: Mission, robot: str | None) -> tuple[SceneNames | None, list[Diagnostic]]:
    """Return the names of the mission's scene and robot; None without a scene, or with a faulty one."""
    if mission.scene is None:
        return None, []
    try:
        return load_surroundings(mission.scene, mission.document.path.parent, robot), []
    except FileError as error:
        return None, list(error.faults)
    except PicktreeError as error:
        return None, [mission.document.fault(("scene",), str(error), code="P241")]
