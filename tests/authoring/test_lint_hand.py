"""Objects that are left in the hand, and two users of the arm at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from .linting import lint, main

PICK = "{Grasp: {object: a}}, {Place: {object: a, into: red_bin}}"
AFTER = "(put it down afterwards, by a Place or 'SafeRetreat: {hand: open}')"
GIVE_UP = "give_up: {SafeRetreat: {hand: open}}"
RECOVER = f"Recover: {{do: […], otherwise: SafeRetreat, {GIVE_UP}}}"
AROUND = f"(write '{RECOVER}' around it and the nodes up to its Place)"


def held(*nodes: str, rest: str = "") -> list[str]:
    found = lint(main(*nodes) + rest, "P330")
    return [finding.split("P330 ")[1].replace("Main/Sequence/", "") for finding in found]


SAYS = "the hand may still hold the object of Grasp at the end of the mission"


def test_a_mission_that_succeeds_with_something_in_the_hand() -> None:
    assert held("Grasp: {object: a}", "GoTo: {pose: home}") == [
        f"4:9 Grasp: {SAYS}, when it succeeds {AFTER}"
    ]


def test_a_place_that_fails_leaves_it_in_the_hand() -> None:
    assert held(f"Sequence: [{PICK}]") == [f"4:21 Sequence/Grasp: {SAYS}, when Grasp or Place fails {AROUND}"]
    assert held(f"Recover: {{do: [{PICK}], otherwise: {{Observe: {{camera: overhead}}}}}}") == [
        f"4:25 Recover/Sequence/Grasp: {SAYS}, when Grasp or Place fails "
        f"(write '{GIVE_UP}' in the Recover, line 6)"
    ]
    assert held(f"ForceSuccess: {{Sequence: [{PICK}]}}") == [
        f"4:36 ForceSuccess/Sequence/Grasp: {SAYS}, when Grasp or Place fails and the mission continues "
        f"{AROUND}"
    ]


def test_nodes_of_one_name_are_told_apart() -> None:
    other = "ForceSuccess: {Place: {object: b, into: red_bin}}"
    (finding,) = held(f"ForceSuccess: {{Sequence: [{PICK}]}}", other)
    assert "when Grasp or Sequence/Place fails" in finding


@pytest.mark.parametrize(
    "node",
    [
        f"Recover: {{do: [{PICK}], otherwise: {{Observe: {{camera: overhead}}}}, give_up: SafeRetreat}}",
        f"Recover: {{do: [{PICK}], otherwise: SafeRetreat, give_up: {{SafeRetreat: {{hand: open}}}}}}",
        f"Fallback: [{{Sequence: [{PICK}]}}, {{SafeRetreat: {{hand: open}}}}]",
        f"Fallback: [{{Sequence: [{PICK}]}}, SafeRetreat]",  # kept, but in a safe place
        f"Parallel: [{{Fallback: [{{Sequence: [{PICK}]}}, SafeRetreat]}}, {{Observe: {{camera: overhead}}}}]",
    ],
)
def test_a_retreat_sees_to_it(node: str) -> None:
    assert held(node) == []


def test_a_hand_that_is_asked_first() -> None:
    pick = f"ForceSuccess: {{Sequence: [{PICK}]}}"
    retreat = "{SafeRetreat: {hand: open}}"
    # Grasp or Place may still end the mission, by a safety stop.
    ends_by_itself = [finding for finding in held(pick) if "continues" in finding]
    assert len(ends_by_itself) == 1
    for guarded in (
        f"IfThenElse: [{{Condition: {{if: holding}}}}, {retreat}, AlwaysSuccess]",
        "SafeRetreat: {hand: open, _skipIf: not holding}",
        f"Fallback: [{{Condition: {{if: not holding and not stopped}}}}, {retreat}]",
    ):
        assert [finding for finding in held(pick, guarded) if "continues" in finding] == []
    for useless in (
        f"IfThenElse: [{{Condition: {{if: not holding}}}}, {retreat}, AlwaysSuccess]",
        "SafeRetreat: {hand: open, _skipIf: stopped}",
    ):
        assert [finding for finding in held(pick, useless) if "continues" in finding] != []


def test_what_a_handler_opens_is_empty_and_what_another_round_takes_is_not() -> None:
    assert held(f"Recover: {{do: [{PICK}], otherwise: {{SafeRetreat: {{hand: open}}}}}}") == [
        f"4:25 Recover/Sequence/Grasp: {SAYS}, when Grasp or Place fails "
        f"(write '{GIVE_UP}' in the Recover, line 6)"
    ]


def test_trees_of_other_files_are_judged_where_they_are_used() -> None:
    text = "include: [library/sorting]\ntrees: {Main: {PickAndPlace: {item: a}}}"
    assert lint(text, "P330") == []
    sub = "  Take: {Grasp: {object: a}}\n"
    assert held("Take", "GoTo: {pose: home}", rest=sub) == [
        f"6:10 Take/Grasp: {SAYS}, when it succeeds {AFTER}"
    ]


def users(*nodes: str, rest: str = "") -> list[str]:
    found = lint(main(*nodes) + rest, "P331", "P332")
    return [finding.replace("Main/Sequence/", "") for finding in found]


@pytest.mark.parametrize("kind", ["Parallel", "ParallelAll"])
def test_two_users_of_the_arm_in_a_parallel_are_an_error(kind: str) -> None:
    text = f"""
    trees:
      Main:
        {kind}:
          - GoTo: {{pose: home}}
          - Sequence: [{{Observe: {{camera: overhead}}}}, Retreat]
          - Delay: {{delay_msec: 1 s, do: {{Grasp: {{object: a}}}}}}
      Retreat: SafeRetreat
    """
    assert lint(text, "P331") == [
        f"P331 5:9 Main/{kind}/Sequence: Retreat and GoTo use the arm at the same time "
        "(run one after the other, in a Sequence)",
        f"P331 6:9 Main/{kind}/Delay: Grasp and GoTo use the arm at the same time "
        "(run one after the other, in a Sequence)",
    ]


@pytest.mark.parametrize(
    "node",
    [
        "Parallel: [{GoTo: {pose: home}}, {Observe: {camera: overhead}}, OpenGripper]",
        "Parallel: [{GoTo: {pose: home}}, {Sequence: [AlwaysFailure, SafeRetreat]}]",
        "Parallel: [{Sequence: [{GoTo: {pose: home}}, SafeRetreat]}, {Log: {message: a}}]",
        "ReactiveFallback: [{Sequence: [{Condition: {if: stopped}}, SafeRetreat]}, {GoTo: {pose: home}}]",
        "ReactiveSequence: [{Log: {message: a}}, {Condition: {if: not stopped}}, {GoTo: {pose: home}}]",
        "ReactiveSequence: [{Observe: {camera: overhead}}, {GoTo: {pose: home}}]",
        "ReactiveSequence: [{GoTo: {pose: home, _skipIf: holding}}, {Grasp: {object: a}}]",
        "ReactiveSequence: [{RunOnce: {GoTo: {pose: home}}}, {Grasp: {object: a}}]",
        "ReactiveSequence: [{Fallback: [{Condition: {if: holding}}, {Grasp: {object: a}}]}, "
        "{Place: {object: a, into: red_bin}}]",
        "Sequence: [{GoTo: {pose: home}}, SafeRetreat]",
        "SequenceWithMemory: [{GoTo: {pose: home}}, SafeRetreat]",
        "PipelineSequence: [{RateController: {hz: 1, do: OpenGripper}}, {GoTo: {pose: home}}]",
    ],
)
def test_users_that_do_not_meet(node: str) -> None:
    assert users(node) == []


@pytest.mark.parametrize(
    ("node", "finding"),
    [
        ("ReactiveSequence: [{GoTo: {pose: home}}, {Grasp: {object: a}}]",
         "P332 4:29 ReactiveSequence/GoTo: GoTo is started anew at each tick and takes the arm from Grasp "
         "(put a condition before it, or use Sequence instead of ReactiveSequence)"),
        ("ReactiveFallback: [{Sequence: [{Log: {message: a}}, Go]}, {Recover: {do: Go, otherwise: Go}}]",
         "P332 4:29 ReactiveFallback/Sequence: GoTo is started anew at each tick and takes the arm from Go "
         "(put a condition before it, or use Fallback instead of ReactiveFallback)"),
        ("PipelineSequence: [{GoTo: {pose: home}}, {Grasp: {object: a}}]",
         "P332 4:29 PipelineSequence/GoTo: GoTo is started anew at each tick and takes the arm from Grasp "
         "(put a condition before it, or use Sequence instead of PipelineSequence)"),
        ("PipelineSequence: [{RateController: {do: {GoTo: {pose: home}}}}, {Grasp: {object: a}}]",
         "P332 4:29 PipelineSequence/RateController: GoTo is started anew at each tick and takes the arm "
         "from Grasp (put a condition before it, or use Sequence instead of PipelineSequence)"),
    ],
)  # fmt: skip
def test_a_skill_that_a_reactive_node_starts_at_each_tick(node: str, finding: str) -> None:
    assert users(node, rest="  Go: {GoTo: {pose: home}}\n" if "Go}" in node else "") == [finding]


def test_objects_of_a_scene_without_a_catalogue_are_things() -> None:
    def place(name: str) -> list[str]:
        nodes = 'PickAny: {from: tote, out: "{thing}"}', f"Place: {{object: {name}, into: red_bin}}"
        return lint("scene: tote\n" + main(*nodes), "P346")

    assert place("thing_1") == []
    assert place("nonsense_7") == [
        "P346 6:25 Main/Sequence/Place: port 'object': no object of the scene 'tote' gets the name "
        "'nonsense_7' (a name is 'thing' and a number; or a key, as '{item}')"
    ]


def test_a_clean_up_on_a_halt_uses_no_robot() -> None:
    text = """
    trees:
      Main:
        TryCatch:
          catch_on_halt: {}
          do: [{{GoTo: {{pose: observe}}}}, {{Sequence: [{{GoTo: {{pose: home}}}}]}}]
    """
    assert lint(text.format("true"), "P334") == [
        "P334 5:38 Main/TryCatch/Sequence: a halt ticks GoTo once, while another node has the arm "
        "that GoTo uses "
        "(let a node after the TryCatch move, for example a handler of a Recover around it)"
    ]
    assert lint(text.format("false"), "P334") == []


WAVE = """
from picktree.trees import ARM, Skill


class Wave(Skill):
    \"\"\"Waves.\"\"\"

    uses = (ARM,)

    def run(self, world):
        yield


class Beep(Skill):
    \"\"\"Beeps.\"\"\"

    def run(self, world):
        yield


NODES = (Wave, Beep)
"""


@pytest.mark.parametrize(("node", "named"), [("Wave", "Clean"), ("Beep", "")])
def test_a_clean_up_on_a_halt_is_followed_into_sub_trees_and_plug_ins(
    node: str, named: str, tmp_path: Path
) -> None:
    (tmp_path / "waving.py").write_text(WAVE)
    text = f"""
    plugins: [waving.py]
    trees:
      Main: {{Sequence: [Work]}}
      Work:
        TryCatch: {{catch_on_halt: "{{= 1 < 2}}", do: [{{GoTo: {{pose: home}}}}, Clean]}}
      Clean: {{Fallback: [{{Condition: {{if: holding}}}}, Deeper]}}
      Deeper: {{ForceSuccess: {node}}}
    """
    hint = "(let a node after the TryCatch move, for example a handler of a Recover around it)"
    assert lint(text, "P334", folder=tmp_path) == [
        f"P334 5:71 Work/TryCatch/{each}: a halt ticks {each} once, while another node has the arm "
        f"that {each} uses "
        f"{hint}"
        for each in ([named] if named else [])
    ]


def test_the_end_of_a_clean_up() -> None:
    text = """
    trees:
      Main: {TryCatch: [{Grasp: {object: a}}, %s]}
    """
    # Whatever the last child does, the mission fails, and with what was there before.
    assert lint(text % "{Place: {object: a, into: red_bin}}", "P330", "P333") == [
        "P330 2:22 Main/TryCatch/Grasp: the hand may still hold the object of Grasp at the end of the "
        f"mission, when it succeeds {AFTER}"
    ]
