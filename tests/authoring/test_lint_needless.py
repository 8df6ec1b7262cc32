"""What has no effect: decorators, defaults, trees, ports and files that nothing uses, breakpoints."""

from __future__ import annotations

from pathlib import Path

import pytest

from .linting import MISSION, lint, main


def found(node: str, *codes: str) -> list[str]:
    return [finding.replace("Main/Sequence/", "") for finding in lint(main(node), *codes)]


@pytest.mark.parametrize(
    ("node", "finding"),
    [
        ("ForceSuccess: {Log: {message: a}}",
         "4:9 ForceSuccess: ForceSuccess has no effect: Log never fails"),
        ("ForceFailure: AlwaysFailure",
         "4:9 ForceFailure: ForceFailure has no effect: AlwaysFailure never succeeds"),
        ("Timeout: {msec: 0, do: {GoTo: {pose: home}}}",
         "4:25 Timeout: Timeout has no effect: a time of 0 means no limit"),
        ("Timeout: {msec: 5 s, do: {Condition: {if: holding}}}",
         "4:9 Timeout: Timeout has no effect: Condition always ends in its first tick"),
        ("Delay: {delay_msec: 0, do: AlwaysSuccess}", "4:29 Delay: Delay has no effect: a delay of 0 does "
        "not "
        "wait"),
        ("RetryUntilSuccessful: {num_attempts: 1, do: OpenGripper}",
         "4:46 RetryUntilSuccessful: RetryUntilSuccessful has no effect: one attempt is no retry"),
        ("RetryUntilSuccessful: {num_attempts: 5, do: {Log: {message: a}}}",
         "4:9 RetryUntilSuccessful: RetryUntilSuccessful has no effect: Log never fails"),
    ],
)  # fmt: skip
def test_a_decorator_without_effect(node: str, finding: str) -> None:
    assert found(node, "P324") == [f"P324 {finding}"]


@pytest.mark.parametrize(
    "node",
    [
        "ForceSuccess: {Observe: {camera: overhead}}",
        "ForceFailure: {Log: {message: a}}",
        "Timeout: {msec: 5 s, do: {Sequence: [{Condition: {if: holding}}, OpenGripper]}}",
        "Delay: {delay_msec: 1 s, do: AlwaysSuccess}",
        "RetryUntilSuccessful: {num_attempts: 5, do: OpenGripper}",
        "ForceSuccess: {Log: {message: a, _failureIf: holding}}",
    ],
)
def test_a_decorator_with_effect(node: str) -> None:
    assert found(node, "P324") == []


def switch(port: str, cases: str, default: str = ", default: AlwaysSuccess") -> list[str]:
    return lint(
        f"trees:\n  Main:\n    ports: {{mode: {port}}}\n"
        f"    Switch: {{variable: '{{mode}}', cases: {{{cases}}}{default}}}\n",
        "P326",
    )


def test_a_default_that_is_never_used() -> None:
    both = "true: AlwaysSuccess, false: AlwaysSuccess"
    assert switch("{type: bool, default: true}", both) == [
        "P326 4:95 Main/Switch: the default is never used: {mode} is one of true, false "
        "(each of them has a case)"
    ]
    colours = "red: AlwaysSuccess, blue: AlwaysSuccess"
    choices = "{type: string, choices: [red, blue], default: red}"
    assert [finding.split(": ", 2)[2] for finding in switch(choices, colours)] == [
        "{mode} is one of red, blue (each of them has a case)"
    ]
    assert switch("{type: bool, default: true}", both, "") == []
    assert switch("{type: bool, default: true}", "true: AlwaysSuccess") == []
    assert switch("{type: string, choices: [red, blue, green], default: red}", colours) == []
    assert switch("{type: string, default: red}", colours) == []


def test_a_default_for_an_object_that_is_held_or_not() -> None:
    text = """
    trees:
      Main:
        ports: {item: object}
        Switch:
          variable: "{item.attached}"
          cases: {true: AlwaysSuccess, false: AlwaysSuccess}
          default: AlwaysSuccess
    """
    (finding,) = lint(text, "P326")
    assert "{item.attached} is one of true, false" in finding


TREES = """
trees:
  Main: {Used: {n: 1, k: 2}}
  Used:
    ports: {n: {type: int, doc: a number}, k: any, out: {type: any, direction: out}}
    Inner: {m: "{n}"}
  Inner:
    ports: {m: int}
    Log: {message: a}
  Alone: Below
  Below: {Log: {message: a}}
"""


def test_trees_and_ports_that_nothing_uses() -> None:
    hint = "('library: true' makes a file of sub-trees for others)"
    assert lint(TREES) == [
        "P341 4:47 trees.Used.ports.k: nothing in the tree 'Used' reads its input 'k'",
        "P342 4:57 trees.Used.ports.out: nothing in the tree 'Used' writes its output 'out'",
        "P341 7:16 trees.Inner.ports.m: nothing in the tree 'Inner' reads its input 'm'",
        f"P340 9:3 trees.Alone: nothing uses the sub-tree 'Alone' {hint}",
        f"P340 10:3 trees.Below: nothing uses the sub-tree 'Below' but Alone, which nothing uses {hint}",
    ]


def test_parameters_of_the_mission_that_nothing_reads() -> None:
    text = "trees:\n  Main:\n    ports: {rounds: {type: int, default: 3}}\n    %s"
    assert lint(text % "Log: {message: a}") == [
        "P341 3:21 trees.Main.ports.rounds: nothing in the mission reads its input 'rounds'"
    ]
    assert lint(text % "Condition: {if: rounds > 3}") == []


def test_a_library_is_there_for_others_to_use() -> None:
    library = MISSION + "library: true\n"
    text = """
    trees:
      One:
        ports: {n: int, found: {type: list of object, direction: out}, left: {type: int, direction: out}}
        Sequence:
          - Observe: {camera: overhead, objects: "{found}"}
          - Grasp: {object: red}
          - Log: {message: a, value: "{nn}"}
      Two: {Sequence: [AlwaysFailure, {Repeat: {num_cycles: -1, do: AlwaysSuccess}}]}
    """
    assert lint(text, head=library) == [
        "P341 3:16 trees.One.ports.n: nothing in the tree 'One' reads its input 'n'",
        "P342 3:74 trees.One.ports.left: nothing in the tree 'One' writes its output 'left'",
        "P301 7:34 One/Sequence/Log: port 'value': nothing has written 'nn' when it is read "
        "(did you mean 'n'?)",
        "P320 8:36 Two/Sequence/Repeat: this node is never reached: AlwaysFailure before it never succeeds",
    ]


def test_included_files_that_nothing_uses(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(
        f"{MISSION}library: true\ninclude: [library/recovery]\ntrees: {{Mine: {{LookAgain: {{}}}}}}\n"
    )
    head = f"{MISSION}include: [library/sorting, own.yaml]\n"

    def unused(root: str) -> list[str]:
        return lint(f"trees: {{Main: {root}}}", "P343", head=head, folder=tmp_path)

    sorting = "P343 0:11 include[0]: nothing uses a tree of 'library/sorting'"
    assert unused("AlwaysSuccess") == [sorting, "P343 0:28 include[1]: nothing uses a tree of 'own.yaml'"]
    assert unused("{Mine: {}}") == [sorting]
    # A tree of `library/recovery` comes with both.
    assert unused("{LookAgain: {}}") == []


def test_a_breakpoint_that_was_left() -> None:
    assert found("Log: {message: a, breakpoint: after}") == [
        "P344 4:39 Log: a breakpoint is set here, after Log (only 'run --debug' stops at it)"
    ]
