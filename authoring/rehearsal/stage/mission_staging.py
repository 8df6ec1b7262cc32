"""Preparation of a mission for rehearsals: stubs for its leaves, spies on its other nodes and expressions."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TypeAlias

from ....files.expressions.expression import Attributes, Expression
from ....trees.mission import Assignment, Mission, NodeSpec, TreeSpec
from ....trees.node import Node
from ....trees.values.references import Binding, Constant
from ....world.scene.description import SceneDescription
from ....world.scene.loading.scene_loading import load_scene
from .node_roles import NodeRoles, is_stubbed, roles_of
from .stand_ins import leaf_stub, node_spy


@dataclass(frozen=True, slots=True)
class CoveredExpression(Expression):
    """Expression that records its results, as true or false, in `seen`."""

    seen: set[bool] = field(default_factory=set[bool], compare=False)

    @classmethod
    def of(cls, expression: Expression) -> CoveredExpression:
        return cls(**{part.name: getattr(expression, part.name) for part in fields(expression)})

    def evaluate(self, names: Mapping[str, object], attributes: Attributes | None = None) -> object:
        # super() fails here: a dataclass with slots is a new class, and super()'s cell holds the old one.
        value = Expression.evaluate(self, names, attributes)
        self.seen.add(bool(value))
        return value


_Watched: TypeAlias = defaultdict[str, dict[str, CoveredExpression]]


@dataclass(frozen=True, slots=True)
class StubbedMission:
    """Data shared by all cases of a mission. `expressions`: by the node's path in its tree, then by key."""

    mission: Mission
    """Mission that is built: the author's, with stub and spy classes."""
    roles: NodeRoles
    """Roles of the nodes of the author's mission."""
    scene: SceneDescription | None
    expressions: Mapping[str, Mapping[str, CoveredExpression]]
    texts: Mapping[str, str]
    """Path in the file's tree, by the path of the built node."""


def stub_mission(mission: Mission, scene: SceneDescription | None) -> StubbedMission:
    """Prepare a mission; `scene` supplies bins, kinds and destinations."""
    watched: _Watched = defaultdict(dict)
    trees = {name: _tree(tree, watched) for name, tree in mission.trees.items()}
    roles = roles_of(mission)
    texts = {role.path: role.text for role in roles.all}
    return StubbedMission(replace(mission, trees=trees), roles, scene, watched, texts)


def scene_of(mission: Mission) -> SceneDescription | None:
    """Return the mission's scene, None when it names none. Raises PicktreeError (FileError) for a faulty
    one."""
    if mission.scene is None:
        return None
    return load_scene(mission.scene, mission.document.path.parent)


def _tree(tree: TreeSpec, watched: _Watched) -> TreeSpec:
    return replace(tree, root=_node(tree.root, tree.name, watched))


def _node(spec: NodeSpec, above: str, watched: _Watched) -> NodeSpec:
    text = f"{above}/{spec.name}"

    def watch(key: str, expression: Expression) -> Expression:
        watched[text][key] = CoveredExpression.of(expression)
        return watched[text][key]

    played = spec.node is not None and is_stubbed(spec.node)

    def binding(key: str, bound: Binding) -> Binding:
        # The expressions of a stubbed leaf are never evaluated.
        if not played and isinstance(bound, Constant) and isinstance(bound.value, Expression):
            return Constant(watch(key, bound.value), bound.text)
        return bound

    slots = {
        key: tuple((label, _node(child, text, watched)) for label, child in filled)
        for key, filled in spec.slots.items()
    }
    return replace(
        spec,
        node=_class(spec.node),
        ports={key: binding(key, bound) for key, bound in spec.ports.items()},
        slots=slots,
        preconditions={key: watch(key, value) for key, value in spec.preconditions.items()},
        postconditions={
            key: tuple(
                Assignment(one.key, watch(f"{key} {n}", one.value)) for n, one in enumerate(assignments)
            )
            for key, assignments in spec.postconditions.items()
        },
        breakpoint=None,
    )


def _class(node: type[Node] | None) -> type[Node] | None:
    if node is None:
        return None
    return leaf_stub(node) if is_stubbed(node) else node_spy(node)
