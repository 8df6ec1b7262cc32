"""Staging of a mission: stubs that replace its leaves, spies that record its other nodes."""

from __future__ import annotations

import types
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Any, TypeAlias, cast

from picktree.files import Attributes, Expression
from picktree.trees import (
    BehaviourTree,
    Mission,
    Node,
    NodeSpec,
    NodeStatus,
    PortDeclaration,
    TreeSpec,
    build,
    control_flow,
    convert_literal,
    references,
)
from picktree.world import Failure, Plain, cause_named
from picktree.world.scene import SceneDescription, load_scene

from .cases import LeafAnswer, PlacedAnswer, RehearsalCase
from .leaf_roles import NodeRole, follows_from_belief, is_stubbed, roles_of
from .rehearsal_world import Contradiction, MissingOutput, RehearsalWorld
from .trace import ScriptedAnswers, Trace

DEFAULT_MAX_TICKS = 10_000
"""Default limit of a case, ticks."""


class LeafStub(Node, abstract=True):
    """Stub that answers as the case defines, with the ports and causes of the replaced leaf.

    The leaf's own code does not run, so that neither a robot nor a real scene is needed.
    """

    _given: PlacedAnswer | None = None
    _ticks_left: int = 0

    def on_start(self) -> None:
        self._given = self._stage.prompter.answer(self.path)
        self._ticks_left = self._answer.ticks if self._answer else 0

    @property
    def _answer(self) -> LeafAnswer | None:
        return self._given and self._given.answer

    def on_tick(self) -> NodeStatus:
        answer = self._answer
        if answer is not None and answer.end == "RUNNING":
            return NodeStatus.RUNNING
        if self._ticks_left > 0:
            self._ticks_left -= 1
            return NodeStatus.RUNNING
        try:
            return self._succeed(None) if answer is None else self._end(answer)
        except Contradiction as contradiction:
            contradiction.path = self.path
            self._stage.contradictions.append(contradiction)
            return NodeStatus.SUCCESS

    def step(self, *, kept: bool = False) -> NodeStatus:
        before = self.state
        state = super().step(kept=kept)
        trace = self._stage.trace
        trace.stepped(self.path, before, state)
        if state is not NodeStatus.RUNNING:
            trace.ended(self.path, state, self.failure)
        return state

    def halt(self) -> None:
        if self.state is NodeStatus.RUNNING:
            self._stage.trace.halted(self.path)
        super().halt()

    @property
    def _stage(self) -> RehearsalWorld:
        return cast("RehearsalWorld", self.world)

    def _end(self, answer: LeafAnswer) -> NodeStatus:
        belief = self._stage.belief
        if answer.end == "SUCCESS":
            state = self._succeed(answer)
            belief.apply(answer.effects)
            return state
        self._write(answer)
        cause = cause_named(answer.cause) if answer.cause else None
        if cause is not None:
            belief.failed(cause)
        belief.apply(answer.effects)
        if cause is not None:
            raise Failure(cause, answer.message or cause.sentence.rstrip("."))
        return NodeStatus(answer.end)

    def _succeed(self, answer: LeafAnswer | None) -> NodeStatus:
        # A case that defines the hand's content overrides the leaf's declaration.
        if answer is None or answer.effects.hand is None:
            inputs = {port.key: self.input(port.key) for port in self.declaration.inputs}
            given = {key: references.Constant(value, None) for key, value in inputs.items()}
            hand, _ = self.declaration.hand_with({**self.wiring.ports, **given})
            given = inputs | (dict(answer.outputs) if answer else {})
            self._stage.belief.succeeded(self.declaration, hand, given, of_itself=answer is None)
            flow = self.declaration.flow
            emptied, unless = flow.empties if isinstance(flow, control_flow.LeafFlow) else ("", "")
            if emptied and not inputs.get(unless):
                self._stage.belief.take_away(str(inputs[emptied]))
        self._write(answer)
        for port in self.declaration.outputs:
            if port.key in self.wiring.ports and (answer is None or port.key not in answer.outputs):
                self.output(port.key, self._believed(port))
        return NodeStatus.SUCCESS

    def _write(self, answer: LeafAnswer | None) -> None:
        for key, value in answer.outputs.items() if answer else ():
            port = self.declaration.port(key)
            if port is not None and key in self.wiring.ports:
                self.output(key, convert_literal(value, port.type, port.unit, port.choices, port.within))

    def _believed(self, port: PortDeclaration) -> object:
        if not follows_from_belief(port, self.declaration.uses):
            raise MissingOutput(self.declaration.id, port.key, self._given)
        return self._stage.belief.to_do()


class NodeSpy(Node, abstract=True):
    """Mixin for a node of the language, which runs itself: it records the node's results in the trace."""

    def step(self, *, kept: bool = False) -> NodeStatus:
        before = self.state
        state = super().step(kept=kept)
        trace = cast("RehearsalWorld", self.world).trace
        trace.stepped(self.path, before, state)
        if self.kind == "condition":
            trace.says(self.path, state)
        report = self.failure
        if state is NodeStatus.FAILURE:
            if report is not None and report.node == self.path:
                trace.failed(report)
            return state
        by_handlers = any(slot.of == "cause" for slot in self.declaration.slots)
        for node in self.below:
            if node.ticked and node.state is NodeStatus.FAILURE and node.failure is not None:
                trace.took_up(self.path, node.failure, by_handlers=by_handlers)
        return state


@cache
def leaf_stub(node: type[Node]) -> type[Node]:
    kept = {name: getattr(node, name) for name in ("declaration", "kind", "causes", "uses", "hand_after")}
    return _node_class(node.__name__, (LeafStub,), kept)


@cache
def node_spy(node: type[Node]) -> type[Node]:
    """Return a spy class derived from the node's own class."""
    return _node_class(node.__name__, (NodeSpy, node), {})


def _node_class(name: str, bases: tuple[type[Node], ...], members: dict[str, Any]) -> type[Node]:
    return cast(
        "type[Node]", types.new_class(name, bases, {"abstract": True}, lambda body: body.update(members))
    )


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
    roles: tuple[NodeRole, ...]
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
    texts = {role.path: role.text for role in roles}
    return StubbedMission(replace(mission, trees=trees), roles, scene, watched, texts)


def play_case(staging: StubbedMission, case: RehearsalCase) -> tuple[BehaviourTree, RehearsalWorld]:
    """Tick the staged mission with the answers of a case, to its end; return its tree and its world.

    Raises PicktreeError for a parameter that is unknown, missing or of the wrong type.
    """
    played = (role.path for role in staging.roles if role.played)
    world = RehearsalWorld(staging.scene, ScriptedAnswers(case.scripts), Trace(played))
    world.belief.change(case.entry.objects)
    world.belief.pin(case.entry.facts)
    tree = build(staging.mission, world, cast("Mapping[str, Plain]", case.entry.parameters))
    trace = world.trace
    tree.on_start.append(trace.begun)
    trace.writes = tree.blackboard.take_writes
    most = min(case.entry.expect.ticks or DEFAULT_MAX_TICKS, case.entry.halt_after or DEFAULT_MAX_TICKS)
    while True:
        trace.tick = world.clock.ticks + 1
        tree.step()
        trace.flush()
        if tree.status is not NodeStatus.RUNNING or world.contradictions or trace.tick >= most:
            return tree, world
        world.clock.ticks += 1


def scene_of(mission: Mission) -> SceneDescription | None:
    """Return the mission's scene; None when it names none. Raises PicktreeError for a faulty one."""
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

    def binding(key: str, bound: references.Binding) -> references.Binding:
        # The expressions of a stubbed leaf are never evaluated.
        if not played and isinstance(bound, references.Constant) and isinstance(bound.value, Expression):
            return references.Constant(watch(key, bound.value), bound.text)
        return bound

    slots = {
        key: tuple((label, _node(child, text, watched)) for label, child in filled)
        for key, filled in spec.slots.items()
    }
    return replace(
        spec,
        node=spec.node and (leaf_stub(spec.node) if played else node_spy(spec.node)),
        ports={key: binding(key, bound) for key, bound in spec.ports.items()},
        slots=slots,
        preconditions={key: watch(key, value) for key, value in spec.preconditions.items()},
        postconditions={
            key: tuple(
                replace(one, value=watch(f"{key} {n}", one.value)) for n, one in enumerate(assignments)
            )
            for key, assignments in spec.postconditions.items()
        },
        breakpoint=None,
    )
