"""From a Mission to a Tree that can be ticked: sub-trees are written out, each with its own namespace."""

from __future__ import annotations

from collections.abc import Mapping

from ..world.errors import PicktreeError
from ..world.files.nearest import nearest
from ..world.files.reader import resolve
from ..world.journal import Plain
from .blackboard import Namespace
from .mission import Mission, NodeSpec, TreeSpec
from .node import Node
from .ports import PortDeclaration
from .references import Binding, Constant, Reference
from .runner import Tree
from .runtime import Runtime, TreeWorld, Wiring
from .subtree import SubTree
from .types import convert


def build(mission: Mission, world: TreeWorld, parameters: Mapping[str, Plain] | None = None) -> Tree:
    """The mission as a tree. `parameters` are values for the ports of `Main`; texts are read as in a file.

    Raises PicktreeError for an unknown, missing or unfitting parameter.
    """
    runtime = Runtime(world)
    main = mission.main
    bindings = _parameters(main.ports, parameters or {})
    caller = Namespace(runtime.blackboard, "")
    start = NodeSpec(main.name, main.name, main.mark, None, bindings)
    root = _Builder(mission, runtime).tree(main, start, main.name, caller)
    return Tree(root, runtime)


def _parameters(ports: tuple[PortDeclaration, ...], given: Mapping[str, Plain]) -> dict[str, Binding]:
    names = [port.key for port in ports]
    for name in given:
        if name not in names:
            known = nearest(name, names) or "it has none"
            raise PicktreeError(f"the mission has no parameter {name!r} ({known})")
    bindings: dict[str, Binding] = {}
    for port in ports:
        if port.key not in given:
            if port.required:
                raise PicktreeError(
                    f"the mission's parameter {port.key!r} needs a value: {port.doc}".rstrip(": ")
                )
            continue
        value = given[port.key]
        try:
            bindings[port.key] = Constant(parameter_value(value, port), value)
        except ValueError as error:
            raise PicktreeError(f"the mission's parameter {port.key!r}: {error}") from None
    return bindings


def parameter_value(value: Plain, port: PortDeclaration) -> object:
    """The value that a parameter of the mission gets; a text is read as in a file. Raises ValueError."""
    if isinstance(value, str) and port.type.many:
        value = [_scalar(part.strip(), port) for part in value.split(",") if part.strip()]
    elif isinstance(value, str):
        value = _scalar(value, port)
    return convert(value, port.type, port.unit, port.choices, port.within)


def _scalar(text: str, port: PortDeclaration) -> Plain:
    # A text from the command line means what it would mean in a file.
    return text if port.type.name in ("string", "object") else resolve(text)


class _Builder:
    def __init__(self, mission: Mission, runtime: Runtime) -> None:
        self._mission = mission
        self._runtime = runtime

    def tree(self, tree: TreeSpec, call: NodeSpec, path: str, outer: Namespace) -> SubTree:
        """An instance of a tree: its ports are wired to the caller's namespace or hold constants."""
        inside = Namespace(self._runtime.blackboard, path)
        bindings: dict[str, Binding] = {}
        for port in tree.ports:
            bound = call.ports.get(port.key)
            if isinstance(bound, Reference):
                inside.wire(port.key, outer, bound)
                bindings[port.key] = bound
            elif bound is not None:
                bindings[port.key] = bound
            elif port.direction == "in":
                bindings[port.key] = Constant(port.default, _plain(port.default))
        node = SubTree(_wiring(call, path, outer, bindings), self._runtime, inside)
        node.fill({"do": (("", self.node(tree.root, path, inside)),)})
        return node

    def node(self, spec: NodeSpec, above: str, namespace: Namespace) -> Node:
        path = f"{above}/{spec.name}"
        if spec.node is None:
            return self.tree(self._mission.trees[spec.id], spec, path, namespace)
        node = spec.node(_wiring(spec, path, namespace, spec.ports), self._runtime)
        node.fill(
            {
                key: tuple((label, self.node(child, path, namespace)) for label, child in filled)
                for key, filled in spec.slots.items()
            }
        )
        return node


def _wiring(spec: NodeSpec, path: str, namespace: Namespace, ports: Mapping[str, Binding]) -> Wiring:
    return Wiring(
        spec.id,
        spec.name,
        path,
        namespace,
        ports,
        spec.preconditions,
        spec.postconditions,
        spec.breakpoint,
    )


def _plain(value: object) -> Plain:
    return value if isinstance(value, str | int | float | bool) else str(value)
