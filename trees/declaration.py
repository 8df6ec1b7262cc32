"""Declaration of a node: the single source of loader, schema, linter and reference."""

from __future__ import annotations

import inspect
import re
import sys
import typing
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache
from typing import Literal, Protocol, TypeAlias

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from picktree.files import PicktreeError
from picktree.world import Cause, Family

from .control_flow import ChildFlow, Flow, Hand, LeafFlow
from .port_types import PortType, convert_literal
from .ports import In, Out, PortDeclaration, Required, Slot, SlotDeclaration
from .references import Binding, Constant

Kind: TypeAlias = Literal["action", "condition", "control", "decorator", "subtree"]

IDENTIFIER = re.compile(r"[A-Za-z_]\w{0,59}", re.ASCII)
PRECONDITIONS = ("_failureIf", "_successIf", "_skipIf", "_while")
"""Precondition keys, in the order in which BT.CPP evaluates them."""
POSTCONDITIONS = ("_onHalted", "_onFailure", "_onSuccess", "_post")
"""Postcondition keys: assignments that BT.CPP runs after a halt, a failure, a success, or any end."""
BREAKPOINT = "breakpoint"
"""Key that stops `run --debug` before or after the node."""
AUTOREMAP = "_autoremap"
"""Key of a sub-tree's call: keys and ports of the sub-tree that it does not name are the caller's keys."""
COMMON_KEYS = ("name", *PRECONDITIONS, *POSTCONDITIONS, BREAKPOINT)
"""Keys that every node may have, sub-trees included."""


class Resource(StrEnum):
    """Hardware that two skills cannot use at the same time."""

    ARM = "arm"
    GRIPPER = "gripper"
    CAMERA = "camera"


@dataclass(frozen=True, slots=True)
class NodeDeclaration:
    """Static description of a node: all that is known of it without running it."""

    id: str
    doc: str
    kind: Kind
    ports: tuple[PortDeclaration, ...] = ()
    causes: tuple[Cause | Family, ...] = ()
    uses: tuple[Resource, ...] = ()
    slots: tuple[SlotDeclaration, ...] = ()
    hand_after: Hand = "unchanged"
    example: str = ""
    """A node of this kind as a mission writes it, for the reference; a test checks it."""
    shares: tuple[Resource, ...] = ()
    flow: Flow | None = None
    """None: nothing is known."""

    def port(self, key: str) -> PortDeclaration | None:
        return next((p for p in self.ports if p.key == key), None)

    def slot(self, key: str) -> SlotDeclaration | None:
        return next((s for s in self.slots if s.key == key), None)

    @property
    def inputs(self) -> tuple[PortDeclaration, ...]:
        return tuple(p for p in self.ports if p.direction == "in")

    @property
    def outputs(self) -> tuple[PortDeclaration, ...]:
        return tuple(p for p in self.ports if p.direction == "out")

    @property
    def scripts(self) -> tuple[str, ...]:
        """Keys of the ports that take assignments."""
        return tuple(p.key for p in self.ports if p.takes == "assignments")

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys that the node may have in a file."""
        return (*(p.key for p in self.ports), *(s.key for s in self.slots), *COMMON_KEYS)

    def causes_with(self, ports: Mapping[str, Binding]) -> tuple[Cause | Family, ...]:
        """Return the causes with which the node may fail under this wiring."""
        needed = self.flow.fails_with if isinstance(self.flow, LeafFlow) else ""
        return self.causes if not needed or needed in ports else ()

    def hand_with(self, ports: Mapping[str, Binding]) -> tuple[Hand, tuple[Hand, ...]]:
        """Return the hand's content after success under this wiring, and all contents after any end."""
        if not isinstance(self.flow, LeafFlow) or not self.flow.hand_by:
            return self.hand_after, ("unchanged", self.hand_after)
        key, hands = self.flow.hand_by
        bound, declared = ports.get(key), self.port(key)
        if bound is not None and not isinstance(bound, Constant):
            return self.hand_after, (self.hand_after, *hands.values())
        value = bound.value if bound is not None else declared.default if declared is not None else None
        success = hands.get(value, self.hand_after)
        return success, (self.hand_after, success)


class NodeBody(Protocol):
    """Class body of a node, as far as its declaration comes from it."""

    @property
    def node_id(self) -> str: ...
    @property
    def kind(self) -> Kind: ...
    @property
    def causes(self) -> tuple[Cause | Family, ...]: ...
    @property
    def uses(self) -> tuple[Resource, ...]: ...
    @property
    def shares(self) -> tuple[Resource, ...]: ...
    @property
    def hand_after(self) -> Hand: ...
    @property
    def example(self) -> str: ...


def declare(node: type, body: NodeBody, reserved: Collection[str]) -> NodeDeclaration:
    """Read the declaration from the class body; ports become descriptors.

    reserved: names of attributes that every node has.

    Raises PicktreeError when the class cannot be a node.
    """
    identity = body.node_id or node.__name__
    if not IDENTIFIER.fullmatch(identity):
        raise PicktreeError(f"node {identity!r}: an ID is a letter or '_', then letters, digits and '_'")
    doc = inspect.getdoc(node) if node.__doc__ else None
    if not doc:
        raise PicktreeError(f"node {identity}: the class needs a docstring, for the reference of nodes")
    make_descriptors(node, identity, reserved)
    ports = tuple(d.declaration for d in _members(node) if isinstance(d, In | Out))
    slots = tuple(d.declaration for d in _members(node) if isinstance(d, Slot))
    keys = [*(p.key for p in ports), *(s.key for s in slots)]
    twice = sorted({key for key in keys if keys.count(key) > 1})
    if twice:
        raise PicktreeError(f"node {identity}: the key {twice[0]!r} is declared twice")
    inputs = [p.key for p in ports if p.direction == "in"]
    for passed in (p.like or p.each_of for p in ports):
        if passed is not None and passed not in inputs:
            raise PicktreeError(f"node {identity}: the class has no input {passed!r} to pass on")
    return NodeDeclaration(
        identity,
        doc,
        body.kind,
        ports,
        body.causes,
        body.uses,
        slots,
        body.hand_after,
        inspect.cleandoc(body.example),
        body.shares,
        _flow_of(node),
    )


def _flow_of(node: type) -> Flow | None:
    """Return the flow of the class; None where `on_tick` is overridden without it."""
    base = next(base for base in node.__mro__ if {"flow", "on_tick"} & vars(base).keys())
    flow: object = vars(base).get("flow")
    return flow if isinstance(flow, LeafFlow | ChildFlow) else None


def make_descriptors(node: type, identity: str, reserved: Collection[str]) -> None:
    """Replace the ports of a class body by descriptors. Raises PicktreeError for an invalid port."""
    specs = {name: value for name, value in vars(node).items() if isinstance(value, PortDeclaration)}
    slots = [name for name, value in vars(node).items() if isinstance(value, Slot)]
    for name in (*specs, *slots):
        if name in reserved:
            raise PicktreeError(
                f"node {identity}: {name!r} would hide an attribute that every node has; "
                f"use another attribute, and key={name!r} if the file must say {name!r}"
            )
    if specs:
        annotations = _annotations(node, tuple(specs), identity)
        for name, spec in specs.items():
            setattr(node, name, _descriptor(f"{identity}.{name}", name, spec, annotations.get(name)))


def _descriptor(where: str, attribute: str, spec: PortDeclaration, annotation: object) -> object:
    direction, args = typing.get_origin(annotation), typing.get_args(annotation)
    if direction not in (In, Out) or len(args) != 1:
        raise PicktreeError(f"port {where}: annotate it as In[...] or Out[...]")
    try:
        kind, choices = PortType.of(args[0])
    except TypeError as error:
        raise PicktreeError(f"port {where}: {error}") from None
    key = spec.key or attribute
    if not IDENTIFIER.fullmatch(key) or key.startswith("_") or key == "name":
        raise PicktreeError(f"port {where}: {key!r} cannot be a key")
    choices = spec.choices if spec.choices is not None else choices
    default = spec.default
    # The empty default of an id or a choice means "not given" and need not convert.
    if not isinstance(default, Required) and default != "":
        try:
            default = convert_literal(default, kind, spec.unit, choices, spec.within)
        except ValueError as error:
            raise PicktreeError(f"port {where}: its default: {error}") from None
    side: Literal["in", "out"] = "in" if direction is In else "out"
    declaration = replace(
        spec, key=key, attribute=attribute, direction=side, type=kind, default=default, choices=choices
    )
    return In[object](declaration) if side == "in" else Out[object](declaration)


def _annotations(node: type, names: tuple[str, ...], identity: str) -> dict[str, object]:
    # Only the ports' own annotations: a port named `list` must not change the meaning of `list` in the next
    # line.
    texts = {name: node.__annotations__[name] for name in names if name in node.__annotations__}
    carrier = type(node.__name__, (), {"__annotations__": texts, "__module__": node.__module__})
    try:
        return typing.get_type_hints(carrier, globalns=vars(sys.modules[node.__module__]))
    except (NameError, KeyError, TypeError) as error:
        raise PicktreeError(f"node {identity}: the type of a port cannot be read: {error}") from None


def _members(node: type) -> list[object]:
    """Return ports and slots in the order of declaration, those of base classes first."""
    found: dict[str, object] = {}
    for cls in reversed(node.__mro__):
        for name, value in vars(cls).items():
            if isinstance(value, In | Out | Slot):
                found[name] = value
    return [value for name, value in found.items() if getattr(node, name) is value]


@cache
def reserved_names(node: type) -> frozenset[str]:
    """Return the names of the attributes that every node has, by their base class."""

    class Plainest(Behaviour):
        def update(self) -> Status:
            return Status.SUCCESS

    attributes = {name for name in node.__annotations__ if not name.startswith("_")}
    return frozenset(dir(node)) | frozenset(vars(Plainest(""))) | attributes
