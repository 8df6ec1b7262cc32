"""Missions of everything that the language has, for the round trip over XML; and what two missions share."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TypeAlias, cast

from hypothesis import strategies as st

from picktree import recovery
from picktree.authoring.xml import XmlText
from picktree.authoring.xml.literal_text import is_pointer
from picktree.authoring.xml.mission_import import import_xml
from picktree.authoring.xml.scripts import expression_text
from picktree.files import Expression
from picktree.trees import Mission, NodeSpec
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.trees.references import Binding, Constant

from ..trees.scripted import FILE, NODES

Tree: TypeAlias = "str | dict[str, object]"
Nodes: TypeAlias = "st.SearchStrategy[Tree]"
Ports: TypeAlias = "st.SearchStrategy[dict[str, object]]"

CHARACTERS = st.characters(max_codepoint=0x17F, exclude_categories=["Cc"])
STRANGE = [
    "true", "null", "3", "1e-3", "json:[1]", "a;b", " padded ", "two\nlines", "tab\there", "it's \"so\"",
    "operator's bin", "\\", "=", "a: b", "# no comment", "- dash", "{", "<&>", "\U0001f916",
]  # fmt: skip


def no_reference(text: str) -> bool:
    return not is_pointer(text) and not (text[:1] == "{" and text[-1:] == "}")


TEXTS = (st.text(CHARACTERS, max_size=12) | st.sampled_from(STRANGE)).filter(no_reference)
NAMES = st.text(
    st.characters(max_codepoint=0x17F, exclude_categories=["Cc"], exclude_characters="/#"),
    min_size=1,
    max_size=9,
)
BEYOND = [2**53 - 1, 2**53, 2**53 + 1, -(2**53) - 1, 10**17 + 1]
NUMBERS = st.integers(-1000, 1000) | st.floats(-1e6, 1e6) | st.sampled_from(BEYOND)
PLAIN = st.recursive(
    TEXTS | NUMBERS | st.booleans() | st.none(), lambda inner: st.lists(inner, max_size=3), max_leaves=4
)
# Each tree has these keys as ports, and writes only to others, so that all values fit where they arrive.
KEY_PORTS: dict[str, object] = {
    "a": {"type": "int", "default": 1},
    "b": {"type": "int", "default": 2},
    "t": {"type": "float", "default": 100},
    "done": {"type": "bool", "default": False},
    "colour": {"type": "string", "default": "red"},
    "thing": {"type": "object", "default": "red_1"},
    "things": {"type": "list of object", "default": []},
    "x": {"type": "any", "default": None},
}
INTS, OBJECTS = st.sampled_from(["{a}", "{b}", "{@a}"]), st.just("{thing}")
LISTS, ANYS = st.just("{things}"), st.sampled_from(["{x}", "{a}", "{thing}", "{@x}"])
CONDITIONS = st.sampled_from(
    [
        "a > 3", "not done", "done and (a == 1 or not done)", "colour == 'red'", "a < b <= 3", "true",
        "thing.colour == 'red'", "items_left", "len(things) > 1 and holding", "a in [1, 2]", "x == null",
        "done if a > b else a == 2", "-a * 2 < b", "colour == 'grün'", "colour == \"it's red\"",
        "a < 9007199254740993", "@a > 3 and not @done",
    ]
)  # fmt: skip
ASSIGNMENTS = st.sampled_from(
    [
        "n := 1",
        "n := 1; n = n + 1; m := true",
        "last := thing.colour",
        "count := items_to_do",
        "text := 'a;b'",
        'text := "operator\'s bin"',
        "n := 9007199254740993; m := -9007199254740993",
        "@m := a; @m += 2",
    ]
)
COMMON = st.fixed_dictionaries(
    {},
    optional={
        "name": NAMES,
        "_failureIf": CONDITIONS, "_successIf": CONDITIONS, "_skipIf": CONDITIONS, "_while": CONDITIONS,
        "_onHalted": ASSIGNMENTS, "_onFailure": ASSIGNMENTS, "_onSuccess": ASSIGNMENTS, "_post": ASSIGNMENTS,
        "breakpoint": st.sampled_from(["before", "after"]),
    },
)  # fmt: skip
SOME = st.just(dict[str, object]()) | st.just(dict[str, object]()) | COMMON


def given_ports(
    required: dict[str, st.SearchStrategy[object]], **optional: st.SearchStrategy[object]
) -> Ports:
    return st.fixed_dictionaries(required, optional=optional)


def node(identity: str, ports: Ports) -> Nodes:
    """`{ID: {ports and what may stand at every node}}`.

    Slots stand in their usual order: names that are used twice are numbered in the order of the file.
    """
    slots = ("do", "when", "cases", "otherwise", "default", "give_up")

    def joined(own: dict[str, object], common: dict[str, object]) -> Tree:
        ports = {key: value for key, value in own.items() if key not in slots}
        return {identity: {**ports, **common, **{key: own[key] for key in slots if key in own}}}

    return st.builds(joined, ports, SOME)


LEAVES: Nodes = st.one_of(
    st.sampled_from(["AlwaysSuccess", "AlwaysFailure"]),
    node("AlwaysSuccess", given_ports({})),
    node("Condition", given_ports({"if": CONDITIONS})),
    node("SetBlackboard", given_ports({"value": ANYS | PLAIN, "output_key": st.just("{written}")})),
    node("Log", given_ports({"message": TEXTS}, value=ANYS | PLAIN)),
    node("Script", given_ports({"code": ASSIGNMENTS})),
    node("Sleep", given_ports({"msec": st.sampled_from([100, "0.1 s", "{t}"])})),
    node("WasEntryUpdated", given_ports({"entry": st.just("{x}")})),
    node(
        "Take",
        given_ports(
            {"object": OBJECTS | TEXTS},
            force=st.sampled_from([20, 1.5, "20 N", "{t}"]),
            colour=st.just("{thing.colour}") | TEXTS,
            hand=st.sampled_from(["left", "right"]),
        ),
    ),
    node("Find", given_ports({"ids": st.lists(TEXTS, max_size=3), "found": st.just("{seen}")})),
)


def above(inner: Nodes) -> Nodes:
    """Control nodes and decorators over others."""
    several, two = st.lists(inner, min_size=1, max_size=3), st.lists(inner, min_size=2, max_size=2)
    branches = st.lists(inner, min_size=2, max_size=3)
    one = inner | branches
    labels = st.sampled_from(["red", "1", "a;b=c", "x\\y", "true"])
    table = st.dictionaries(labels, one, min_size=1, max_size=4)
    causes = st.sampled_from(["grasp.missed", "grasp.*", "control.timeout", "*"])
    handlers = st.dictionaries(causes, one, min_size=1, max_size=3)
    count = st.integers(1, 5)

    def control(identity: str, **ports: st.SearchStrategy[object]) -> Nodes:
        return node(identity, given_ports({"do": several}, **ports))

    def decorator(identity: str, required: dict[str, st.SearchStrategy[object]] | None = None) -> Nodes:
        return node(identity, given_ports({"do": one, **(required or {})}))

    return st.one_of(
        *(control(name) for name in ("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback")),
        control("Parallel", success_count=st.just(1), failure_count=st.just(1)),
        control("RoundRobin", wrap_around=st.booleans()),
        *(control(name) for name in ("SequenceWithMemory", "PipelineSequence")),
        control("ParallelAll", max_failures=st.just(1)),
        *(decorator(name, {"entry": st.just("{x}")}) for name in ("SkipUnlessUpdated", "WaitValueUpdate")),
        decorator("RateController", {"hz": st.sampled_from([10, 0.5])}),
        node("IfThenElse", given_ports({"do": branches})),
        node("WhileDoElse", given_ports({"do": branches})),
        node("RecoveryNode", given_ports({"do": two}, number_of_retries=count)),
        *(decorator(name) for name in ("Inverter", "ForceSuccess", "ForceFailure")),
        decorator("KeepRunningUntilFailure"),
        decorator("Repeat", {"num_cycles": count | INTS}),
        decorator("Repeat", {"while": CONDITIONS}),
        decorator("RetryUntilSuccessful", {"num_attempts": count}),
        decorator("Timeout", {"msec": st.sampled_from([100, "0.1 s", "{t}"])}),
        decorator("Delay", {"delay_msec": count}),
        decorator("RunOnce", {"then_skip": st.booleans()}),
        decorator("ForEach", {"in": LISTS | st.lists(PLAIN, max_size=3), "out": st.just("{element}")}),
        node("Switch", given_ports({"variable": st.just("{x}"), "cases": table}, default=one)),
        node(
            "Recover", given_ports({"do": one, "when": handlers}, otherwise=one, give_up=one, attempts=count)
        ),
    )


def deep(leaves: Nodes, levels: int) -> Nodes:
    """Trees of at most so many levels above their leaves."""
    return leaves if levels == 0 else leaves | above(deep(leaves, levels - 1))


SUB_PORTS: dict[str, object] = {
    "item": {"type": "object", "doc": 'what <it> "is"'},
    "empty": {"type": "string", "default": ""},
    "size": {"type": "float", "unit": "m", "default": "30 mm"},
    "hand": {"type": "string", "default": "left", "choices": ["left", "right"]},
    "ids": {"type": "list of string", "default": ["a;b", "c"]},
    "anything": {"type": "any", "default": None},
    "found": {"type": "list of object", "direction": "out"},
}
CALLS: Nodes = node(
    "Sub",
    given_ports(
        {"item": OBJECTS | TEXTS},
        empty=TEXTS,
        size=NUMBERS | INTS,
        found=st.just("{seen}"),
        anything=PLAIN | ANYS,
    ),
)
SHARING: Nodes = node("Shared", given_ports({"_autoremap": st.just(True)}, a=INTS, colour=TEXTS))
MAINS, SUBS = deep(LEAVES | CALLS | SHARING, 3), deep(LEAVES | SHARING, 2)


@st.composite
def missions(draw: st.DrawFn) -> str:
    """The text of a mission."""
    data: dict[str, object] = {
        "picktree": 1,
        "kind": "mission",
        "name": draw(TEXTS.filter(bool)),
        "trees": {
            # Without a call that shares its keys, those of the tree `Shared` would be unknown.
            "Main": _tree(KEY_PORTS, {"Sequence": {"do": [draw(SHARING), draw(MAINS)]}}),
            "Sub": _tree({**KEY_PORTS, **SUB_PORTS}, draw(SUBS)),
            "Shared": _tree(
                draw(st.sampled_from([KEY_PORTS, {"a": "int", "colour": "string"}])), draw(deep(LEAVES, 1))
            ),
        },
    }
    if draw(st.booleans()):
        data["goal"] = "misplaced == 0 and left <= 1"
    return json.dumps(data, ensure_ascii=False)


def _tree(ports: dict[str, object], root: Tree) -> dict[str, object]:
    return {"ports": ports, **({root: {}} if isinstance(root, str) else root)}


def registry() -> NodeRegistry:
    return NodeRegistry((*NODES, *recovery.NODES), installed=False)


def parsed(text: str) -> Mission:
    return parse_mission(text, FILE, registry())


# What two missions share: all but the places.


def essence(mission: Mission) -> object:
    trees = {
        name: ([_port(port) for port in tree.ports], _node(tree.root)) for name, tree in mission.trees.items()
    }
    head = {key: mission.document.data.get(key) for key in ("name", "scene", "include", "plugins", "library")}
    return (head, mission.goal.text if mission.goal else None, trees)


def _port(port: object) -> object:
    names = ("key", "direction", "type", "doc", "unit", "default", "choices")
    return tuple(_typed(getattr(port, name)) for name in names)


def _node(spec: NodeSpec) -> object:
    post = spec.postconditions.items()
    return (
        spec.id,
        spec.name,
        spec.node,
        {key: _bound(bound) for key, bound in spec.ports.items() if key not in spec.postconditions},
        {key: [(label, _node(below)) for label, below in filled] for key, filled in spec.slots.items()},
        {key: _expression(value) for key, value in spec.preconditions.items()},
        {key: [(a.key, a.new, _expression(a.value)) for a in value] for key, value in post},
        spec.breakpoint,
        spec.autoremap,
    )


def _bound(bound: Binding) -> object:
    return ("literal", _typed(bound.value)) if isinstance(bound, Constant) else str(bound)


def _typed(value: object) -> object:
    """1, 1.0 and true are not the same."""
    if isinstance(value, Expression):
        return _expression(value)
    if isinstance(value, list):
        return [_typed(item) for item in cast("list[object]", value)]
    return (type(value).__name__, value)


def _expression(expression: Expression) -> str:
    return expression_text(expression.root)


def xml_to_mission(text: str, path: Path, known: NodeRegistry) -> str:
    """The mission file of one XML file, which lies at the path."""
    return import_xml([XmlText(text, path)], known).text
