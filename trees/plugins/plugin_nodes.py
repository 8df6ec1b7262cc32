"""What a plug-in offers: its NODES, each looked at before a mission uses it."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from types import ModuleType
from typing import TypeGuard, cast, get_args

from ...world.causes import OUR_PREFIXES, Cause, Family, known_causes
from ..declaration import Hand, Kind, NodeDeclaration, Resource
from ..node import Node
from .plugin_import import PluginError


def offered(module: ModuleType, plugin: str, attribute: str) -> tuple[type[Node], ...]:
    """The node classes that the plug-in's module names. Raises PluginError for what is no good node."""
    nodes: object = getattr(module, attribute, None)
    if not isinstance(nodes, tuple | list):
        what = "has no" if nodes is None else "has something else as"
        own = dict.fromkeys(v.__name__ for v in vars(module).values() if _is_node(v, module))
        hint = f"write '{attribute} = ({', '.join(own)},)'" if own else f"as '{attribute} = (Wave,)'"
        raise PluginError(
            f"the plug-in {plugin!r} {what} {attribute}, a tuple of node classes", hint, code="P253"
        )
    if not nodes:
        raise PluginError(f"the plug-in {plugin!r} offers no node: its {attribute} is empty", code="P253")
    for node in cast("tuple[object, ...]", nodes):
        if not _is_node(node):
            raise PluginError(
                f"the plug-in {plugin!r}: {_shown(node)} in {attribute} is not a node class",
                "a class derived from Skill, ConditionNode or Control",
                code="P253",
            )
        _check(node, plugin)
    return cast("tuple[type[Node], ...]", tuple(cast("tuple[object, ...]", nodes)))


def _is_node(value: object, module: ModuleType | None = None) -> TypeGuard[type[Node]]:
    """Whether it is a class of nodes, and of that module's own making."""
    if not (isinstance(value, type) and issubclass(value, Node)):
        return False
    own = module is None or value.__module__ == module.__name__
    return own and isinstance(vars(value).get("declaration"), NodeDeclaration)


def _shown(value: object) -> str:
    name = value.__name__ if isinstance(value, type) else type(value).__name__
    article = "an" if name[0] in "aeiouAEIOU" else "a"
    return name if isinstance(value, type) else f"{article} {name}"


def _check(node: type[Node], plugin: str) -> None:
    """What would otherwise come out when the mission is built, or at the node's first failure."""
    declaration = node.declaration

    def wrong(message: str, hint: str = "") -> PluginError:
        return PluginError(f"the plug-in {plugin!r}: node {declaration.id}: {message}", hint, code="P254")

    unwritten = sorted(getattr(node, "__abstractmethods__", ()))
    if unwritten:
        raise wrong(f"it has no {unwritten[0]!r}", "as 'def run(self, world): ...', with a 'yield' in it")
    if node.on_tick is Node.on_tick:
        raise wrong("it has no 'on_tick'", "derive it from Skill and write 'run', or write 'on_tick'")
    if declaration.kind not in get_args(Kind):
        raise wrong(f"its kind {declaration.kind!r} is unknown", _one_of(Kind))
    if declaration.hand_after not in get_args(Hand):
        raise wrong(f"its hand_after {declaration.hand_after!r} is unknown", _one_of(Hand))
    if not _are(declaration.uses, Resource):
        raise wrong("'uses' is a tuple of resources", "as 'uses = (ARM, GRIPPER)'")
    if not _are(declaration.causes, Cause, Family):
        raise wrong("'causes' is a tuple of causes", "as 'causes = (grasp.MISSED, planning.ANY)'")
    try:
        inspect.signature(node).bind("wiring", "runtime")
    except TypeError:
        hint = "leave it out; what a node begins with is set in 'on_start'"
        raise wrong("its '__init__' does not take (wiring, runtime)", hint) from None
    for cause in declaration.causes:
        _check_cause(cause, plugin, declaration.id)


def _one_of(words: object) -> str:
    return f"one of {', '.join(get_args(words))}"


def _are(values: object, *kinds: type) -> bool:
    return isinstance(values, tuple) and all(isinstance(v, kinds) for v in cast("Iterable[object]", values))


def _check_cause(cause: Cause | Family, plugin: str, node: str) -> None:
    known = known_causes()
    where = f"the plug-in {plugin!r}: node {node}"
    if isinstance(cause, Family):
        if not any(name.startswith(f"{cause.name}.") for name in known):
            raise PluginError(f"{where}: no cause of the family '{cause}' is registered", code="P255")
    elif cause.name not in known:
        prefix = cause.name.split(".")[0]
        hint = "write 'register_cause(Cause(...))'"
        if prefix in OUR_PREFIXES:
            hint = f"the prefix {prefix!r} belongs to picktree; register it under one of your own"
        raise PluginError(f"{where}: the cause '{cause}' is not registered", hint, code="P255")
    elif known[cause.name] != cause:
        meaning = known[cause.name].sentence
        message = f"{where}: the cause '{cause}' is registered with another meaning ({meaning!r})"
        raise PluginError(message, "use what 'register_cause' returns", code="P255")
