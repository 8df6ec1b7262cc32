"""Whatever stands in a mission is read in bounded time, with as many faults as anyone reads."""

from __future__ import annotations

from pathlib import Path

import pytest

from picktree.files.yaml import read_document
from picktree.trees.loading import MissionReadResult, NodeRegistry, examine
from picktree.trees.mission import MAX_NODES
from picktree.trees.mission_diagnostics import MAX_FAULTS

from ..effort import counted

REGISTRY = NodeRegistry()


def read(body: str) -> MissionReadResult:
    text = f"picktree: 1\nkind: mission\n{body}\n"
    return examine(read_document(Path("m.yaml"), "mission", text), REGISTRY)


def faults(body: str) -> list[str]:
    return [f"{fault.code} {str(fault).removeprefix('m.yaml:')}" for fault in read(body).faults]


def many(node: str, times: int) -> str:
    return f"trees: {{Main: {{Sequence: [{', '.join(node.replace('#', str(n)) for n in range(times))}]}}}}"


def test_thousands_of_faults_are_counted() -> None:
    found = faults(many("Nothing#", 1000))
    assert len(found) == MAX_FAULTS + 1
    assert found[0] == (
        "P207 3:27: Main/Sequence: unknown node 'Nothing0' (`picktree nodes` lists all nodes)"
    )
    assert found[-1].endswith(": and 800 more faults (mend those above first)")


def test_no_more_nodes_are_read_than_can_be_built() -> None:
    reading = read(many("AlwaysSuccess", MAX_NODES + 500))
    (fault,) = reading.faults
    assert fault.message == "here is node number 10001 of the mission"
    assert fault.hint == "at most 10000 nodes"


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("trees: {Main: {" + "A" * 900 + ": {}}}",
         f"P208 3:16: Main: '{'A' * 56}... is not an ID (an ID is a letter or '_', then letters, "
         "digits and '_')"),
        ("trees: {Main: {Log: {message: a, value: '{" + "a" * 900 + "}'}}}",
         "P221 3:41: Main/Log: port 'value': '{" + "a" * 55 + "... is not a reference "
         '(a reference is "{key}" or "{key.attribute}")'),
        ("trees: {Main: {Log: {message: [" + "1, " * 2000 + "]}}}",
         f"P220 3:31: Main/Log: port 'message': {'[' + '1, ' * 18}1,... is not a text "
         "(the sentence for the record)"),
        ("trees: {Main: " + "{Inverter: " * 130 + "AlwaysSuccess" + "}" * 130 + "}",
         "P236 3:9: trees.Main: with its sub-trees written out the mission has 131 nodes, 131 deep (at "
         "most 10000 nodes, 120 deep)"),
        ("trees: {Main: {Condition: {if: '" + "(" * 900 + "'}}}",
         "P225 3:73: Main/Condition: port 'if': the expression is nested more than 40 deep"),
        ("trees: {Main: {AlwaysSuccess: {_post: '" + ";" * 5000 + "'}}}",
         "P225 3:40: Main/AlwaysSuccess: _post: the assignments are longer than 4000 characters"),
    ],
)  # fmt: skip
def test_what_is_too_large_is_shown_in_part(body: str, fault: str) -> None:
    assert faults(body) == [fault]


def test_a_long_circle_is_shown_in_part() -> None:
    trees = ", ".join(f"T{n}: T{(n + 1) % 50}" for n in range(50))
    (fault,) = faults(f"trees: {{Main: T0, {trees}}}")
    assert fault == (
        "P235 3:23: trees.T0: the sub-trees call each other in a circle: "
        "T0 → T1 → T2 → T3 → T4 → T5 → … → T46 → T47 → T48 → T49 → T0 (a loop is Repeat or ForEach)"
    )


@pytest.mark.parametrize(
    "body",
    [
        many("{SetBlackboard: {value: '{k#}', output_key: '{k}', _post: 'a := a + b; b := a'}}", 350),
        many("{Condition: {if: 'zzz# > len(yyy) and items_left'}}", 500),
        many("{Log: {mesage: 'a', value: {a: [1, 2, {b: #}]}}}", 500),
        many("{Recover: {do: AlwaysSuccess, when: {grasp.mised: AlwaysSuccess, c#: Foo}}}", 350),
        "trees: {Main: {T0: {p: x, q: '{r}'}}, "
        + ", ".join(
            f"T{n}: {{ports: {{p: any, q: {{direction: out}}}}, T{n + 1}: {{p: '{{p}}', q: '{{q}}'}}}}"
            for n in range(1000)
        )
        + "}",
    ],
)
def test_hundreds_of_nodes_are_read_with_bounded_effort(body: str) -> None:
    _, calls = counted(lambda: read(body))
    assert calls < 1_500_000
