"""Names of cameras, poses, bins: those that a mission uses against those that scene and robot have."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from ...files.expressions.expression import ExpressionError
from ...files.expressions.type_inference import ValueType, check_types
from ...files.yaml.document import Fault, nearest
from ...trees.loading.loader import Reading
from ...trees.loading.scene_names import Surroundings
from ...trees.subtree_calls import reachable
from ...trees.values.expression_pointer import Pointer
from ...trees.values.references import ATTRIBUTE_TYPES, Reference
from ...trees.wiring.circuit import Arrival
from ...trees.wiring.expression_checks import Asked, expressions_of
from ...trees.wiring.key_writers import Keys, Placed
from ...trees.wiring.type_fit import DEFAULT
from ...world.belief.facts import ASIDE

_CODE = "P240"


def misnamed(reading: Reading, known: Surroundings) -> Iterator[Fault]:
    """A fault for each literal, and each default that counts, that names nothing of scene or robot.

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
            tree = arrival.trail.split("/")[0]
            if tree in used or arrival.mark.file == own:
                yield from _named(arrival, known)
    for name, keys in circuit.keys.items():
        if name in used or keys.tree.mark.file == own:
            for placed in keys.nodes:
                for asked in expressions_of(placed):
                    yield from _asked(asked, keys, attributes, reading.pointer)
                yield from _cases(placed, attributes, known)


def _named(arrival: Arrival, known: Surroundings) -> Iterator[Fault]:
    what, values = arrival.target.names, arrival.source.values or ()
    if what is None or arrival.problem is not None:
        return
    names = known.names.get(what, ())
    given = [name for value in values for name in (value if isinstance(value, list) else [value])]
    wrong = [name for name in given if name not in names]
    if wrong and (arrival.source.certain or len(wrong) == len(given)):
        owner = f"robot {known.robot!r}" if what == "pose" else f"scene {known.scene!r}"
        message = f"port {arrival.key!r}: the {owner} has no {what} {wrong[0]!r}"
        if arrival.text == DEFAULT:
            message += ", which is the default"
        hints = [nearest(str(wrong[0]), names)]
        if arrival.via:
            hints.append(f"it goes to the port {arrival.target.key!r} of {arrival.via}")
        if arrival.text.startswith("{"):
            hints.append(arrival.source.told(arrival.mark.file))
        yield Fault(arrival.mark, arrival.trail, message, "; ".join(filter(None, hints)), _CODE)


def _attributes(known: Surroundings) -> Mapping[str, ValueType]:
    """The attributes of an object, with the texts that they can be in this scene."""
    bins = (*known.names.get("bin", ()), *known.names.get("hole", ()))
    choices = {
        "kind": (*known.names.get("kind", ()), "unknown"),
        "destination": bins,
        "place": (*bins, "table", "hand", ASIDE),
    }
    return {
        name: replace(kind, choices=choices.get(name, kind.choices)) for name, kind in ATTRIBUTE_TYPES.items()
    }


def _asked(
    asked: Asked, keys: Keys, attributes: Mapping[str, ValueType], pointer: Pointer
) -> Iterator[Fault]:
    """An expression that has a value in general, and not with the names of this scene."""
    if not asked.expression.paths:
        return
    try:
        check_types(asked.expression, keys, ATTRIBUTE_TYPES)
    except ExpressionError:
        return  # reported already
    try:
        check_types(asked.expression, keys, attributes)
    except ExpressionError as error:
        yield asked.fault(error, pointer, _CODE)


def _cases(placed: Placed, attributes: Mapping[str, ValueType], known: Surroundings) -> Iterator[Fault]:
    """Cases for what an attribute never is in this scene."""
    if placed.spec.node is None:
        return
    for slot in placed.spec.node.declaration.slots:
        bound = placed.spec.ports.get(slot.matches or "")
        if not isinstance(bound, Reference) or not bound.attributes:
            continue
        attribute = attributes[bound.attributes[-1]]
        if attribute.choices == ATTRIBUTE_TYPES[bound.attributes[-1]].choices:
            continue
        valid = (*attribute.choices, "null") if attribute.optional else attribute.choices
        for label, _ in placed.spec.slots.get(slot.key, ()):
            if label not in valid:
                message = f"in the scene {known.scene!r} {bound} is never {label!r}"
                mark = placed.mark(f"{slot.key}/{label}")
                yield Fault(mark, placed.path, message, nearest(label, valid), _CODE)
