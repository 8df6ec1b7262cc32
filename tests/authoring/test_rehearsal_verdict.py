"""What is said when something is otherwise than expected."""

from __future__ import annotations

from pathlib import Path

import pytest

from ..trees.rehearsing import play, play_one, said

TREES = """
Main:
  Sequence:
    - SetBlackboard: {value: [1, 2], output_key: "{list}"}
    - ForEach: {in: [a], out: "{item}", do: {One: {item: "{item}"}}}
    - Fallback: [{Go: {}}, {Go: {name: other}}]
    - Log: {message: "done", value: "{never_written}", _skipIf: "true"}
One:
  ports: {item: {type: object}}
  Sequence:
    - SetBlackboard: {value: 1, output_key: "{count}"}
    - Pick: {object: "{item}"}
"""
CASE = "objects: {a: {colour: red, place: table}}\nleaves: {/Main/Sequence/Fallback/Go: planning.no_path}\n"


@pytest.mark.parametrize(
    "expect",
    [
        "{order: [Pick, {Go: planning.*}, {other: SUCCESS}], never: [Log]}",
        "{facts: {time: 0, holding: true, held_object: a, items_to_do: 0}}",
        "{objects: {a: {colour: red, place: hand, destination: null, confidence: 1}, b: null}}",
        "{blackboard: {list: [1, 2], One/count: 1.0, One/item: a, item: a}}",
        "{handled: [planning.no_path, {cause: planning.*, by: Fallback, times: 1}]}",
    ],
)
def test_it_holds(expect: str) -> None:
    case = play_one(TREES, f"{CASE}expect: {expect}")
    assert said(case) == []


@pytest.mark.parametrize(
    ("expect", "difference"),
    [
        ("{status: FAILURE}", "expect.status: FAILURE is expected, but the mission is SUCCESS (tick 1)"),
        ("{cause: grasp.missed}", "expect.cause: grasp.missed is expected, but it is SUCCESS (tick 1)"),
        ("{never: [Pick, other]}",
         "expect.never[0]: Main/Sequence/ForEach/One/Sequence/Pick has started (tick 1)"),
        ("{facts: {holding: false}}", "expect.facts.holding: it is true, not false"),
        ("{facts: {held_object: b}}", "expect.facts.held_object: it is 'a', not 'b'"),
        ("{objects: {a: {place: table}}}", "expect.objects.a.place: it is 'hand', not 'table'"),
        ("{objects: {a: {destination: bin}}}", "expect.objects.a.destination: it is null, not 'bin'"),
        ("{objects: {a: null}}", "expect.objects.a: 'a' is still in the belief"),
        ("{objects: {b: {place: table}}}", "expect.objects.b: 'b' is not in the belief"),
        ("{blackboard: {list: [1]}}", "expect.blackboard.list: it is [1, 2], not [1]"),
        ("{blackboard: {list: [1, 3]}}", "expect.blackboard.list: it is [1, 2], not [1, 3]"),
        ("{blackboard: {list: 1}}", "expect.blackboard.list: it is [1, 2], not 1"),
        ("{blackboard: {One/count: true}}", "expect.blackboard.One/count: it is 1, not true"),
        ("{blackboard: {never_written: 1}}",
         "expect.blackboard.never_written: nothing has written 'never_written'"),
        ("{handled: [grasp.missed]}", "expect.handled[0]: grasp.missed is not taken up: nobody takes it up"),
        ("{handled: [{cause: planning.*, by: ForEach}]}", "expect.handled[0]: planning.* is not taken up by "
         "ForEach: Main/Sequence/Fallback takes it up (tick 1)"),
        ("{handled: [{cause: planning.*, by: Fallback, times: 2}]}",
         "expect.handled[0]: planning.* is taken up by Fallback once, not 2 times (tick 1)"),
    ],
)  # fmt: skip
def test_it_does_not(expect: str, difference: str) -> None:
    assert said(play_one(TREES, f"{CASE}expect: {expect}"))[0] == difference


def test_the_handler_of_a_recovery_is_told() -> None:
    trees = "Main: {Recover: {do: {Pick: {object: a}}, when: {grasp.missed: [Go], grasp.*: [Go]}}}"
    case = """
    objects: {a: {}}
    leaves: {Pick: [grasp.slipped, SUCCESS]}
    expect: {handled: [{cause: grasp.slipped, handler: grasp.missed}]}
    """
    assert said(play_one(trees, case)) == [
        "expect.handled[0]: grasp.slipped is not taken up with 'grasp.missed': "
        "Main/Recover takes it up with 'grasp.*' (tick 1)"
    ]


def test_a_condition_that_does_not_hold_is_a_failure_without_a_cause() -> None:
    case = play_one("Main: {Condition: {if: holding}}", "expect: {cause: grasp.missed}")
    assert said(case) == [
        "expect.cause: grasp.missed is expected, but it is FAILURE without a cause (tick 1)"
    ]


def test_every_difference_has_its_place_in_the_file() -> None:
    rehearsal = play(
        "Main: {Go: {}}",
        """\
        cases:
          it:
            expect:
              status: FAILURE
              order: [Go, Go]
              facts: {holding: true}
        """,
    )
    marks = [str(difference.mark) for difference in rehearsal.cases[0].differences]
    assert marks == ["cases.yaml:6:15", "cases.yaml:7:19", "cases.yaml:8:24"]


def test_what_the_hand_holds_comes_first_among_what_is_to_be_done() -> None:
    case = play_one(
        "Main: {Look: {objects: '{o}'}}",
        """
        objects: {a: {destination: x}, b: {destination: x, place: hand}, c: {}, d: {destination: x, place: x}}
        expect: {blackboard: {o: [b, a]}}
        """,
    )
    assert said(case) == []


@pytest.mark.parametrize("given", [True, False])
def test_an_item_whose_rule_asks_for_a_mass_that_the_case_does_not_give(tmp_path: Path, given: bool) -> None:
    (tmp_path / "scene.yaml").write_text(
        "picktree: 1\nkind: scene\nbase: sort_small\ndestinations:\n"
        "  - {where: mass < 0.07, to: green_bin}\n  - {where: \"colour == 'blue'\", to: blue_bin}\n"
    )
    answer = ", then: {objects: {a: {mass: 50 g}}}" if given else ""
    case = play_one(
        """
        Main:
          Repeat:
            while: items_left
            num_cycles: 2
            do:
              - Look: {objects: "{o}"}
              - Pick: {object: a}
              - Fallback: [Weigh, {Put: {object: a, into: green_bin}}]
        """,
        f"""
        objects: {{a: {{kind: block, colour: blue}}}}
        leaves: {{Weigh: {{cause: perception.stale{answer}}}}}
        expect: {{order: [Look, Pick, Weigh, Put]}}
        """,
        head=f"scene: {tmp_path}/scene.yaml\n",
    )
    if given:
        assert said(case) == []
        return
    (told,) = said(case)
    assert told.startswith("expect.order: the order ends, but Main/Repeat/Sequence/Look starts; a lies in ")
    assert "the scene's rules ask for its mass, which the case does not give" in told
    assert "('then: {objects: {a: {mass: …}}}' in an answer)" in told
