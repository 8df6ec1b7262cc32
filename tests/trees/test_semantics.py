"""Control nodes tick by tick against the table in semantics.yaml, and the reference that is made of it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import cast

import pytest
import yaml

from picktree import recovery
from picktree.files.yaml import resolve
from picktree.trees import Mission, Node, NodeStatus, control_nodes
from picktree.trees.loading import NodeRegistry, parse_mission

from .scripted import FILE, AnyFacts, FakeWorld, Run, run_of

ANSWERS = {
    "S": NodeStatus.SUCCESS,
    "F": NodeStatus.FAILURE,
    "R": NodeStatus.RUNNING,
    "K": NodeStatus.SKIPPED,
}
LEAF = re.compile("[A-Z]")
HERE = Path(__file__).parent
DOCS = HERE.parents[1] / "docs" / "control-nodes.md"
CASES: dict[str, dict[str, object]] = yaml.load(
    (HERE / "semantics.yaml").read_text(encoding="utf-8"), yaml.CSafeLoader
)


@dataclass
class ToldWorld(FakeWorld):
    """What each leaf answers at its successive ticks, by its name."""

    answers: str = ""

    def answer(self, name: str) -> str:
        given = re.findall(rf"\b{name}:([SFRK])", self.answers)
        asked = sum(event.startswith(f"{name}:") for event in self.trace)
        return given[asked] if asked < len(given) else "?"


class Told(Node):
    """A leaf that answers as the case says; asked more often than that it runs, and the trace shows `?`."""

    kind = "action"

    def on_tick(self) -> NodeStatus:
        world = cast("ToldWorld", self.world)
        letter = world.answer(self.name)
        world.trace.append(f"{self.name}:{letter}")
        return ANSWERS.get(letter, NodeStatus.RUNNING)

    def on_halt(self) -> None:
        cast("ToldWorld", self.world).trace.append(f"halt {self.name}")


def with_leaves(tree: object) -> object:
    """`A` and `{A: {…}}` as leaves of that name."""
    match tree:
        case str() if LEAF.fullmatch(tree):
            return {"Told": {"name": tree}}
        case dict():
            return dict(_entry(str(key), value) for key, value in cast("dict[object, object]", tree).items())
        case list():
            return [with_leaves(item) for item in cast("list[object]", tree)]
        case _:
            return tree


def _entry(key: str, value: object) -> tuple[str, object]:
    if LEAF.fullmatch(key):
        return "Told", {"name": key, **cast("dict[str, object]", value)}
    return key, with_leaves(value)


@cache
def mission(name: str) -> Mission:
    case = CASES[name]
    trees = {"Main": with_leaves(case["tree"]), **cast("dict[str, object]", with_leaves(case.get("sub", {})))}
    text = f"picktree: 1\nkind: mission\ntrees: {json.dumps(trees)}\n"
    registry = NodeRegistry((Told, *recovery.NODES), installed=False)
    return parse_mission(text, FILE, registry, facts=AnyFacts())


def ticks_of(name: str) -> list[str]:
    return cast("list[str]", CASES[name]["ticks"])


def started(name: str) -> Run:
    return run_of(mission(name), ToldWorld(answers=" ".join(ticks_of(name))))


def step(run: Run, line: str) -> str:
    """Do what stands before the bar, and tick; return the line as it should be."""
    before, bar, _ = line.rpartition("| ")
    done = len(run.trace)
    if before == "halt ":
        run.tree.halt()
    else:
        for word in before.split():
            key, _, value = word.partition("=")
            run.tree.blackboard.write(f"Main/{key}", resolve(value), "test")
        run.tick()
    return before + bar + " ".join([*run.trace[done:], "->", str(run.tree.status)])


@pytest.mark.parametrize("name", CASES)
def test_the_table_holds(name: str) -> None:
    run = started(name)
    assert [step(run, line) for line in ticks_of(name)] == ticks_of(name)


@pytest.mark.parametrize("name", CASES)
def test_whatever_happens_nothing_runs_below_what_does_not(name: str) -> None:
    run = started(name)
    for line in ticks_of(name):
        step(run, line)
        for node in run.tree.nodes:
            if node.state is not NodeStatus.RUNNING:
                assert [below.path for below in node.below if below.state is NodeStatus.RUNNING] == []


REMEMBERING = re.compile("round-robin|run-once|with-memory|was-entry|unset|unwritten|literal-once")
"""Cases of nodes that a halt does not make forget, and of keys that nothing has written yet."""


@pytest.mark.parametrize("name", CASES)
def test_halted_after_any_tick_everything_is_idle_and_a_new_start_is_like_the_first(name: str) -> None:
    for ticks in range(1, len(ticks_of(name)) + 1):
        run = started(name)
        for line in ticks_of(name)[:ticks]:
            step(run, line)
        running = [node.name for node in run.tree.nodes if node.state is NodeStatus.RUNNING]
        run.trace.clear()
        report = run.tree.halt()
        assert run.trace == [f"halt {leaf}" for leaf in running if LEAF.fullmatch(leaf)]
        assert {node.status for node in report.nodes} == {NodeStatus.IDLE}
        assert not any(node.cause for node in report.nodes)
        run.trace.clear()
        if not REMEMBERING.search(name):
            assert [step(run, line) for line in ticks_of(name)] == ticks_of(name)


def test_a_case_is_a_sentence_a_tree_and_its_ticks() -> None:
    for name, case in CASES.items():
        assert set(case) - {"differs", "sub"} == {"shows", "tree", "ticks"}, name
        assert str(case["shows"]).endswith("."), name


# The reference in docs/control-nodes.md.


@dataclass(frozen=True)
class Rule:
    node: str
    text: str
    held_by: tuple[str, ...]


def rules() -> Iterator[Rule]:
    """Each item of the lists under the headings: the rule, and the names in back-ticks at its end."""
    node = ""
    for block in re.split(r"\n(?=#|- |\n)", DOCS.read_text(encoding="utf-8")):
        line = " ".join(block.split())
        if line.startswith("#"):
            node = line.lstrip("# ").strip("`")
        elif line.startswith("- "):
            held = re.search(r"\(((?:`[\w-]+`(?:, )?)+)\)$", line)
            assert held, f"nothing holds this rule: {line}"
            yield Rule(node, line[2 : held.start()].strip(), tuple(re.findall(r"`([\w-]+)`", held[1])))


def names_of_tests() -> set[str]:
    """Names of the test functions about trees, recovery and skills."""
    files = [
        file for room in ("trees", "recovery", "skills") for file in (HERE.parent / room).glob("test_*.py")
    ]
    return {name for file in files for name in re.findall(r"^def (test_\w+)", file.read_text("utf-8"), re.M)}


def test_every_rule_is_one_sentence_held_by_a_case_or_a_test() -> None:
    known = {*CASES, *names_of_tests()}
    found = list(rules())
    assert len(found) >= 100
    for rule in found:
        assert rule.text.endswith("."), rule.text
        assert set(rule.held_by) <= known, rule


def test_every_case_holds_a_rule() -> None:
    named = {name for rule in rules() for name in rule.held_by}
    assert set(CASES) - named == set()


def test_every_node_of_the_language_has_rules() -> None:
    curing = [node for node in recovery.NODES if node.declaration.slots]
    nodes = {node.declaration.id for node in (*control_nodes.NODES, *curing)}
    assert nodes - {rule.node for rule in rules()} == set()


def test_where_we_differ_the_reference_says_so() -> None:
    text = " ".join(DOCS.read_text(encoding="utf-8").split())
    differing = {name for name, case in CASES.items() if "differs" in case}
    said = set(re.findall(r"`([\w-]+)`", text.partition("## Differences from BT.CPP and Nav2")[2]))
    assert differing == said & set(CASES)
