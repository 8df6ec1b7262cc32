"""Causes that end the mission with nothing having been tried, and handlers that are never needed."""

from __future__ import annotations

import pytest

from .linting import lint, main

HOME = "Fallback: [{GoTo: {pose: home}}, SafeRetreat]"


def hint(node: str) -> str:
    recover = f"Recover: {{do: {{{node}: …}}, otherwise: SafeRetreat}}"
    return f"(write '{recover}' in its place, or handlers by cause in 'when')"


def test_each_source_is_named_with_its_causes() -> None:
    text = main(
        HOME,
        "Timeout: {msec: 3 s, do: {Observe: {camera: overhead, expect: red}}}",
        "OpenGripper",
    )
    assert lint(text) == [
        f"P310 5:9 Main/Sequence/Timeout: nothing handles tree.timeout: such a failure ends the mission "
        f"{hint('Timeout')}",
        "P310 5:35 Main/Sequence/Timeout/Observe: nothing handles perception.not_found, perception.no_image: "
        f"such a failure ends the mission {hint('Observe')}",
        "P310 6:9 Main/Sequence/OpenGripper: nothing handles control.gripper: such a failure ends the "
        f"mission {hint('OpenGripper')}",
    ]


def test_a_mission_that_handles_nothing_is_told_once() -> None:
    assert lint(main("GoTo: {pose: home}", "SafeRetreat")) == [
        "P310 2:3 Main: whatever fails ends the mission: nothing in it handles a cause "
        "(of GoTo, SafeRetreat) (put a Recover around the work, with 'otherwise: [SafeRetreat]' to "
        "begin with)"
    ]
    assert lint("trees: {Main: {GoTo: {pose: home}}}") == []


@pytest.mark.parametrize(
    "handled",
    [
        "Recover: {do: {GoTo: {pose: home}}, otherwise: SafeRetreat}",
        "Recover: {do: {GoTo: {pose: home}}, when: {planning.*: SafeRetreat, control.*: SafeRetreat, "
        "safety.*: SafeRetreat}}",
        "Recover: {do: {GoTo: {pose: home}}, when: {grasp.*: SafeRetreat, '*': SafeRetreat}}",
        "Recover: {do: {GoTo: {pose: home}}, when: {planning.*: SafeRetreat}, give_up: SafeRetreat}",
        "RecoveryNode: [{GoTo: {pose: home}}, SafeRetreat]",
        "RetryUntilSuccessful: {num_attempts: 2, do: {GoTo: {pose: home}}}",
        "Fallback: [{GoTo: {pose: home}}, SafeRetreat]",
        "ReactiveFallback: [{Recover: {do: {GoTo: {pose: home}}, otherwise: SafeRetreat}}, SafeRetreat]",
        "RoundRobin: [{GoTo: {pose: home}}, SafeRetreat]",
        "IfThenElse: [{GoTo: {pose: home}}, AlwaysSuccess, {Log: {message: a}}]",
        "ForceSuccess: {OpenGripper: {}}",
        "Inverter: {Inverter: {OpenGripper: {}}}",
        "ForEach: {in: [1], on_failure: continue, do: {OpenGripper: {}}}",
        "Condition: {if: holding}",
        "Observe: {camera: overhead}",
    ],
)
def test_what_is_handled_tried_again_or_passed_over(handled: str) -> None:
    assert lint(main(HOME, handled), "P310") == []


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("Recover: {do: {OpenGripper: {}}, when: {grasp.*: SafeRetreat}}", "control.gripper"),
        ("Recover: {attempts: 1, do: {OpenGripper: {}}, otherwise: SafeRetreat}", "control.gripper"),
        ("RetryUntilSuccessful: {num_attempts: 1, do: {OpenGripper: {}}}", "control.gripper"),
        ("Fallback: [{Condition: {if: holding}}, OpenGripper]", "control.gripper"),
        ("ForceSuccess: {GoTo: {pose: home}}", "safety.*"),
        ("Inverter: {GoTo: {pose: home}}", "safety.*"),
        ("ForEach: {in: [1], on_failure: continue, do: {GoTo: {pose: home}}}", "safety.*"),
        ("Parallel: [OpenGripper, {Observe: {camera: overhead}}]", "control.gripper"),
        ("IfThenElse: [OpenGripper, AlwaysSuccess]", "control.gripper"),
        ("WhileDoElse: [AlwaysSuccess, OpenGripper]", "control.gripper"),
        ("RunOnce: {OpenGripper: {}}", "control.gripper"),
        ("Sub: {}", "control.gripper"),
    ],
)
def test_what_still_comes_through(text: str, cause: str) -> None:
    sub = "  Sub: {Repeat: {num_cycles: 2, do: OpenGripper}}" if "Sub" in text else ""
    (finding,) = lint(main(HOME, text) + sub, "P310")
    assert f": nothing handles {cause}: such a failure ends the mission" in finding


def test_a_switch_without_a_default_and_an_attribute_of_an_object() -> None:
    text = """
    trees:
      Main:
        Sequence:
          - Fallback: [{GoTo: {pose: home}}, SafeRetreat]
          - Observe: {camera: overhead, objects: "{items}"}
          - ForEach:
              in: "{items}"
              out: "{item}"
              do: {Switch: {variable: "{item.colour}", cases: {red: AlwaysSuccess}}}
    """
    assert lint(text, "P310") == [
        "P310 9:16 Main/Sequence/ForEach/Switch: nothing handles world.unknown_object, tree.no_case: "
        f"such a failure ends the mission {hint('Switch')}"
    ]


def test_a_safe_retreat_is_not_proposed_against_its_own_failure() -> None:
    (finding,) = lint(main(HOME, "SafeRetreat"), "P310")
    assert finding.endswith("(write 'Fallback: [SafeRetreat, {AskForHelp: {reason: …}}]' in its place)")


def test_what_comes_out_of_an_included_tree_is_said_where_it_is_used() -> None:
    text = """
    include: [library/recovery]
    trees:
      Main:
        Sequence:
          - Fallback: [{GoTo: {pose: home}}, SafeRetreat]
          - RetreatAndLook
    """
    assert lint(text) == [
        "P310 6:9 Main/Sequence/RetreatAndLook: nothing handles grasp.slipped, place.occupied, "
        f"control.*, safety.* from inside: such a failure ends the mission {hint('RetreatAndLook')}"
    ]


def handlers(do: str, *patterns: str) -> list[str]:
    lines = "".join(f"        {pattern}: SafeRetreat\n" for pattern in patterns)
    text = f"trees:\n  Main:\n    Recover:\n      do: {do}\n      when:\n{lines}"
    found = lint(text, "P311", "P312", "P320")
    return [finding.replace("Main/Recover: ", "") for finding in found]


def test_a_handler_for_a_cause_that_the_child_does_not_fail_with() -> None:
    assert handlers("{GoTo: {pose: home}}", "planning.*", "perception.*", "tree.attempts") == [
        "P311 7:9 'perception.*' is never used: GoTo never fails with this cause "
        "(it may with planning.*, control.*, safety.*)",
        "P311 8:9 'tree.attempts' is never used: GoTo never fails with this cause "
        "(it may with planning.*, control.*, safety.*)",
    ]
    assert handlers("{Observe: {camera: overhead}}", "perception.not_found") == [
        "P311 6:9 'perception.not_found' is never used: Observe never fails with this cause "
        "(it may with perception.no_image)"
    ]
    assert handlers("{Observe: {camera: overhead, expect: red}}", "perception.not_found") == []
    assert handlers("{ForceSuccess: {GoTo: {pose: home}}}", "planning.*", "safety.*") == [
        "P311 6:9 'planning.*' is never used: ForceSuccess never fails with this cause (it may with safety.*)"
    ]


def test_a_fault_of_the_program_may_be_handled_by_whoever_names_it() -> None:
    assert handlers("{GoTo: {pose: home}}", "internal.error", "'*'") == []
    assert handlers("{GoTo: {pose: home}}", "internal.*", "internal.error") == [
        "P312 7:9 'internal.error' is never used: the earlier pattern 'internal.*' takes its causes "
        "(the first pattern that fits is used)"
    ]


def test_a_condition_that_does_not_hold_counts_as_used_up_attempts() -> None:
    assert handlers("{Condition: {if: holding}}", "tree.attempts") == []
    assert handlers("{Sequence: [{Inverter: {Observe: {camera: overhead}}}]}", "tree.attempts") == []


def test_causes_that_no_node_declares_may_occur_all_the_same() -> None:
    assert handlers("{Observe: {camera: overhead}}", "world.unknown_object", "tree.missing_input") == []
    assert handlers("{Log: {message: a}}", "'*'") == [
        "P311 6:9 '*' is never used: Log never fails with this cause"
    ]


def test_a_handler_behind_a_pattern_that_takes_its_causes() -> None:
    assert handlers("{GoTo: {pose: home}}", "planning.*", "planning.no_path", "'*'", "control.*") == [
        "P312 7:9 'planning.no_path' is never used: the earlier pattern 'planning.*' takes its causes "
        "(the first pattern that fits is used)",
        "P312 9:9 'control.*' is never used: the earlier pattern '*' takes its causes (the first "
        "pattern that fits is used)",
    ]
    assert handlers("{GoTo: {pose: home}}", "planning.no_path", "planning.*", "control.*", "'*'") == []
    assert handlers("{OpenGripper: {}}", "control.gripper", "control.*") == [
        "P312 7:9 'control.*' is never used: earlier patterns take all its possible causes"
    ]


def test_handlers_of_one_attempt_and_an_otherwise_that_nothing_is_left_for() -> None:
    text = """
    trees:
      Main:
        Recover:
          attempts: 1
          do: {GoTo: {pose: home}}
          when: {planning.*: SafeRetreat}
    """
    assert lint(text, "P311", "P312", "P320") == [
        "P320 6:26 Main/Recover/SafeRetreat: this node is never reached: "
        "GoTo may run only once, so no second run follows"
    ]
    text = """
    trees:
      Main:
        Recover:
          do: {GoTo: {pose: home}}
          when: {"*": SafeRetreat}
          otherwise: SafeRetreat
    """
    assert lint(text) == [
        "P320 6:18 Main/Recover/SafeRetreat#2: this node is never reached: GoTo never fails with "
        "another cause"
    ]


def test_a_handler_that_one_use_of_the_sub_tree_needs_is_needed() -> None:
    text = """
    trees:
      Main:
        Sequence: [{Try: {carefully: true}}, {Try: {carefully: false}}]
      Try:
        ports: {carefully: bool}
        Recover:
          do: {IfThenElse: [{Condition: {if: carefully}}, {Observe: {expect: red}}, AlwaysSuccess]}
          when: {perception.*: SafeRetreat}
    """
    assert lint(text) == []
