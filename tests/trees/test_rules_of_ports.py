"""Rules about several keys and about values, held when a mission is read; declarations of a tree's ports."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent, indent

import pytest

from picktree.files import FileError
from picktree.trees import PortType, Range, convert_literal
from picktree.trees.loading import NodeRegistry, parse_mission
from picktree.trees.port_types import accept_value


def faults(trees: str) -> list[str]:
    text = f"picktree: 1\nkind: mission\ntrees:\n{indent(dedent(trees).strip(), '  ')}\n"
    try:
        parse_mission(text, Path("m.yaml"), NodeRegistry())
    except FileError as error:
        return [f"{fault.code} {str(fault).removeprefix('m.yaml:')}" for fault in error.faults]
    return []


def doc_of(node: str, key: str) -> str:
    found = NodeRegistry().find(node)
    port = found.declaration.port(key) if found is not None else None
    assert port is not None
    return port.doc


@pytest.mark.parametrize(
    ("node", "fault"),
    [
        ("Parallel: {success_count: 3, do: [AlwaysSuccess, AlwaysFailure]}", "P234 4:36: Parallel: port "
         "'success_count': 3 of 2 children cannot be counted (1 to 2, or -1 to -2)"),
        ("Parallel: {failure_count: 0, do: [AlwaysSuccess, AlwaysFailure]}", "P234 4:36: Parallel: port "
         "'failure_count': 0 of 2 children cannot be counted (1 to 2, or -1 to -2)"),
        ("Parallel: {success_count: -3, do: [AlwaysSuccess, AlwaysFailure]}", "P234 4:36: Parallel: port "
         "'success_count': -3 of 2 children cannot be counted (1 to 2, or -1 to -2)"),
        ("RetryUntilSuccessful: {num_attempts: 0, do: AlwaysFailure}", "P234 4:47: RetryUntilSuccessful: "
         "port 'num_attempts': with 0 attempts the child never runs (at least 1, or -1)"),
        ("RetryUntilSuccessful: {num_attempts: -2, do: AlwaysFailure}",
         "P220 4:47: RetryUntilSuccessful: port 'num_attempts': -2 is less than -1 "
         f"({doc_of('RetryUntilSuccessful', 'num_attempts')})"),
        ("Recover: {attempts: 0, do: AlwaysSuccess, otherwise: SafeRetreat}",
         "P220 4:30: Recover: port 'attempts': 0 is less than 1 (maximum number of runs of `do`; second "
         "tries within a skill, as of `Grasp`, do not count)"),
        ("ForEach: {in: [a], out: '{x}', most: 0, do: AlwaysSuccess}",
         "P234 4:47: ForEach: port 'most': with 0 elements the child never runs (at least 1, or -1 for all)"),
        ("Timeout: {msec: -5 s, do: AlwaysSuccess}",
         f"P220 4:26: Timeout: port 'msec': -5 s is less than 0 s ({doc_of('Timeout', 'msec')})"),
        ("GoTo: {pose: home, speed: 150 %}",
         f"P220 4:36: GoTo: port 'speed': 150 % is more than 100 % ({doc_of('GoTo', 'speed')})"),
        ("GoTo: {pose: home, speed: 0}",
         f"P220 4:36: GoTo: port 'speed': 0 is not more than 0 ({doc_of('GoTo', 'speed')})"),
        ("GoTo: {pose: home, speed: 50 mm}",
         f"P220 4:36: GoTo: port 'speed': '50 mm' is not a number ({doc_of('GoTo', 'speed')})"),
        ("GoTo: {pose: home, speed: half %}",
         "P220 4:36: GoTo: port 'speed': 'half %' is not a number without a unit (as 0.5) "
         f"({doc_of('GoTo', 'speed')})"),
        ("Observe: {objects: '{= items}'}",
         "P223 4:29: Observe: port 'objects' is an output: it needs a key to write to (as \"{key}\")"),
        ("Place: {object: a}", "P234 4:10: Place: one of 'into' and 'at' must be given, and not both"),
        ("Place: {object: a, into: red_bin, at: [0.5, 0, 0]}",
         "P234 4:10: Place: one of 'into' and 'at' must be given, and not both"),
        ("Place: {object: a, at: [0.5, 0]}",
         "P234 4:33: Place: port 'at': three numbers x, y, z are wanted, not 2"),
        ("Repeat: {do: AlwaysSuccess}",
         "P234 4:10: Repeat: one of 'num_cycles' and 'while' must be given, or the loop would never end"),
        ("Recover: {do: AlwaysSuccess}", "P234 4:10: Recover: without `when`, `otherwise` or `instead` "
         "nothing is recovered; use RetryUntilSuccessful to retry"),
    ],
)  # fmt: skip
def test_values_that_make_no_sense(node: str, fault: str) -> None:
    (found,) = faults(f"Main: {{{node}}}")
    assert found.replace(": Main/", ": ", 1) == fault


@pytest.mark.parametrize(
    "node",
    [
        "Parallel: {success_count: 1, failure_count: -2, do: [AlwaysSuccess, AlwaysFailure]}",
        "RetryUntilSuccessful: {num_attempts: -1, do: AlwaysFailure}",
        "Repeat: {num_cycles: 0, do: AlwaysSuccess}",
        "Timeout: {msec: 0, do: AlwaysSuccess}",
        "Place: {object: a, at: [0.5, 0, 0.1]}",
        "GoTo: {pose: home, speed: 50 %}",
        "GoTo: {pose: home, speed: '{= 1 / 2}'}",
    ],
)
def test_values_that_make_sense(node: str) -> None:
    assert faults(f"Main: {{{node}}}") == []


def test_a_bound_holds_for_each_element_and_for_what_is_written_at_run_time() -> None:
    share = Range(above=0, most=1)
    with pytest.raises(ValueError, match="2 is more than 1"):
        convert_literal([0.5, 2], PortType("float", many=True), None, None, share)
    with pytest.raises(ValueError, match="0 is not more than 0"):
        accept_value(0, PortType("float"), None, share)
    assert accept_value(1, PortType("float"), None, share) == 1.0


def test_cases_for_the_same_value() -> None:
    assert faults(
        """
          Main:
            ports: {n: {type: int, default: 1}}
            Switch: {variable: "{n}", cases: {1: Sub, 01: Sub, 1.0: Sub, 2: Sub}}
          Sub: AlwaysSuccess
        """
    ) == [
        "P234 6:47: Main/Switch: the cases '1' and '01' are the same value",
        "P234 6:56: Main/Switch: the cases '1' and '1.0' are the same value",
    ]


PORT = "Main: AlwaysSuccess\nSub:\n  ports: {p: %s}\n  AlwaysSuccess: {}"


@pytest.mark.parametrize(
    ("declared", "fault"),
    [
        ("3", "P211 6:16: p: a port is a mapping (as '{type: object}')"),
        ("{typ: int}", "P211 6:17: p.typ: a port has no key 'typ' (did you mean 'type'?)"),
        ("{type: [int]}", "P212 6:23: p.type: unknown type \"['int']\" (did you mean 'int'?)"),
        ("{type: float, unit: feet}", "P211 6:36: p.unit: unknown unit 'feet' (known: m, cm, mm, um, rad, "
         "mrad, deg, s, ms, us, min, h, kg, g, N, mN, kN, Nm, mNm, Ns, m/s, cm/s, mm/s, rad/s, deg/s, …)"),
        ("{type: int, unit: m}", "P211 6:34: p.unit: 'int' has no unit (it is for 'float')"),
        ("{type: string, doc: 3}", "P211 6:36: p.doc: 'doc' is a text, not 3"),
        ("{type: int, choices: 3}", "P211 6:37: p.choices: 'choices' is a list (as '[left, right]')"),
        ("{type: int, choices: [1, two]}",
         "P211 6:41: p.choices[1]: the choice: 'two' is not a whole number"),
        ("{type: string, choices: [a, b], default: c}",
         "P213 6:57: p.default: the default: 'c' is not a choice; known: a, b"),
        ("{direction: up}", "P211 6:28: p.direction: the direction is 'in' or 'out', not 'up'"),
        ("{type: int, direction: out, default: 3}",
         "P211 6:44: p.default: an output has no default: the nodes inside write it"),
    ],
)  # fmt: skip
def test_declarations_of_a_port_that_are_none(declared: str, fault: str) -> None:
    (found,) = faults(PORT % declared)
    assert found.replace("trees.Sub.ports.", "", 1) == fault


@pytest.mark.parametrize(
    "declared",
    [
        "{type: float, unit: m, default: 30 mm}",
        "{type: string, choices: [left, right], default: left}",
        "{type: list of float, unit: N, default: [3, 20 N]}",
        "{type: list of float, default: [1, 20 %]}",
    ],
)
def test_declarations_of_a_port(declared: str) -> None:
    assert faults(PORT % declared) == []


def test_a_port_that_is_declared_badly_is_one_fault_wherever_it_is_used() -> None:
    assert faults(
        """
        Main: {Sequence: [{Sub: {a: 1, b: x}}, {Sub: {a: word, c: 3}}]}
        Sub:
          ports: {a: {type: nothing}, b: 7, c: {type: int, default: one}}
          Log: {message: said, value: "{b}"}
        """
    ) == [
        "P212 6:23: trees.Sub.ports.a.type: unknown type 'nothing' (did you mean 'string'?)",
        "P211 6:36: trees.Sub.ports.b: a port is a mapping (as '{type: object}')",
        "P213 6:63: trees.Sub.ports.c.default: the default: 'one' is not a whole number",
    ]


@pytest.mark.parametrize("name", ["name", "breakpoint", "_skipIf", "two words", "é"])
def test_names_that_no_port_can_have(name: str) -> None:
    (fault,) = faults(f"Main: AlwaysSuccess\nSub: {{ports: {{{name}: int}}, AlwaysSuccess: {{}}}}")
    assert fault == f"P214 5:17: trees.Sub.ports.{name}: {name!r} cannot be the name of a port"
