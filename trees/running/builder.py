"""Builder: Mission to tickable tree. Sub-trees are expanded, each instance with its own namespace."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from py_trees.behaviour import Behaviour

from ...world.journal import Plain
from ..blackboard import Namespace
from ..mission import Mission, NodeSpec, TreeSpec
from ..node import Node
from ..runtime import Runtime, TreeWorld, Wiring
from ..slots import child
from ..status import NodeStatus
from ..tree_definition import TreeDefinition
from ..values.references import Binding, Constant, Reference
from .run_settings import Overrides, read_settings
from .runner import BehaviourTree


class SubTree(Node):
    """Node that ticks its one child in a separate namespace.

    A port wired to a key of the caller is an alias of that key. Literals and defaults are written when the
    sub-tree starts. `inside` is the namespace of the sub-tree's nodes.
    """

    node_id = "SubTree"
    kind = "subtree"
    body = child("the root of the sub-tree")

    inside: Namespace

    def __init__(self, tree: TreeDefinition, **ports: Any) -> None:
        """Describe a call of a tree that was defined in Python."""
        Behaviour.__init__(self, name=tree.name)
        self.description = tree.describe_call(SubTree, ports)

    def on_start(self) -> None:
        self.on_rewired(frozenset(self.wiring.ports))

    def on_rewired(self, ports: frozenset[str]) -> None:
        for key, wired in self.wiring.ports.items():
            if key in ports and isinstance(wired, Constant):
                self.inside.write(key, wired.value, self.path)

    def on_tick(self) -> NodeStatus:
        state = self.body.step()
        if state is NodeStatus.FAILURE:
            return self.fail_with(self.body.failure)
        return state


def build(mission: Mission, world: TreeWorld, parameters: Mapping[str, Plain] | None = None) -> BehaviourTree:
    """Build the mission's tree. `parameters`: settings for this run, as `read_settings` takes them.

    Raises PicktreeError for a setting that is unknown, missing or of the wrong type.
    """
    runtime = Runtime(world)
    main = mission.main
    settings = read_settings(mission, parameters or {})
    caller = Namespace(runtime.blackboard, "")
    start = NodeSpec(main.name, main.name, main.mark, None, settings.parameters)
    root = _Builder(mission, runtime, settings.overrides).tree(main, start, main.name, caller)
    return BehaviourTree(root, runtime)


class _Builder:
    def __init__(self, mission: Mission, runtime: Runtime, overrides: Overrides) -> None:
        self._mission = mission
        self._runtime = runtime
        self._overrides = overrides

    def tree(self, tree: TreeSpec, call: NodeSpec, path: str, outer: Namespace) -> SubTree:
        """Build an instance of a tree. Its ports are wired to the caller's namespace or hold constants."""
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
        node = SubTree.bound(_wiring(call, path, outer, bindings), self._runtime)
        node.inside = inside
        node.fill({"do": (("", self.node(tree.root, path, inside)),)})
        return node

    def node(self, spec: NodeSpec, above: str, namespace: Namespace) -> Node:
        path = f"{above}/{spec.name}"
        if path in self._overrides:
            spec = replace(spec, ports={**spec.ports, **self._overrides[path]})
        if spec.node is None:
            return self.tree(self._mission.trees[spec.id], spec, path, namespace)
        node = spec.node.bound(_wiring(spec, path, namespace, spec.ports), self._runtime)
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
