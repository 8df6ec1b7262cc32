"""Names of cameras, poses, bins: those that a mission uses against those that scene and robot have."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

from ..world.files.document import Fault, nearest
from .mission import Mission, NodeSpec
from .ports import PortDeclaration
from .references import Constant
from .surroundings import Surroundings


def misnamed(mission: Mission, known: Surroundings) -> list[Fault]:
    """A fault for each literal, and each default that counts, that names nothing of scene or robot."""
    return [
        fault
        for tree in mission.trees.values()
        for path, spec in _with_paths(tree.root, tree.name)
        if spec.node is not None
        for port in spec.node.declaration.inputs
        for fault in _port(spec, path, port, known)
    ]


def _port(spec: NodeSpec, path: str, port: PortDeclaration, known: Surroundings) -> Iterator[Fault]:
    bound = spec.ports.get(port.key)
    given = isinstance(bound, Constant)
    if port.names is None or (bound is not None and not given):
        return
    value = bound.value if isinstance(bound, Constant) else port.default
    names = known.names.get(port.names, ())
    named: list[object] = cast("list[object]", value) if isinstance(value, list) else [value]
    for name in named:
        if not isinstance(name, str) or name == "" or name in names:
            continue
        owner = f"robot {known.robot!r}" if port.names == "pose" else f"scene {known.scene!r}"
        message = f"port {port.key!r}: the {owner} has no {port.names} {name!r}"
        if not given:
            message += ", which is the default"
        yield Fault(spec.places.get(port.key, spec.mark), path, message, nearest(name, names), "P240")


def _with_paths(spec: NodeSpec, above: str) -> Iterator[tuple[str, NodeSpec]]:
    path = f"{above}/{spec.name}"
    yield path, spec
    for child in spec.children:
        yield from _with_paths(child, path)
