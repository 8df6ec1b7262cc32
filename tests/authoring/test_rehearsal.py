"""Rehearsals: the real tree is ticked, its leaves answer as the case says."""

from __future__ import annotations

import pytest

from ..trees.rehearsing import play, play_one, runs, said

PICK = """
Main:
  Recover:
    attempts: 3
    do: {Pick: {object: a}}
    when: {grasp.missed: [Go]}
"""


def test_a_leaf_without_an_answer_succeeds_in_its_first_tick() -> None:
    case = play_one("Main: {Sequence: [Go, {Go: {name: further}}]}", "expect: {status: SUCCESS, ticks: 1}")
    assert case.passed
    assert (case.status, case.ticks, case.seconds) == ("SUCCESS", 1, 0.05)
    assert runs(case) == ["1-1 Go SUCCESS", "1-1 further SUCCESS"]


def test_answers_come_in_turn_and_the_last_comes_again() -> None:
    case = play_one(
        "Main: {Repeat: {num_cycles: 4, do: {ForceSuccess: {Go: {}}}}}",
        """
        leaves: {Go: [{ticks: 1}, {status: RUNNING}]}
        expect: {status: RUNNING, ticks: 6}
        """,
    )
    assert case.passed
    assert runs(case) == ["1-2 Go SUCCESS", "3-None Go RUNNING"]


def test_else_is_what_comes_when_the_answers_are_used_up() -> None:
    case = play_one(
        PICK,
        """
        objects: {a: {}}
        leaves: {Pick: {answers: [grasp.missed, grasp.missed], else: SUCCESS}}
        expect: {status: SUCCESS}
        """,
    )
    assert case.passed
    assert runs(case) == [
        "1-1 Pick grasp.missed",
        "2-2 Go SUCCESS",
        "3-3 Pick grasp.missed",
        "4-4 Go SUCCESS",
        "5-5 Pick SUCCESS",
    ]


def test_the_first_pattern_that_fits_is_used_and_counts_all_nodes_that_fit() -> None:
    case = play_one(
        "Main: {Sequence: [{Fallback: [Go, {Go: {name: near}}]}, {Go: {name: far}}]}",
        """
        leaves:
          near: [safety.stop]
          "*": [safety.force_limit, safety.workspace]
        expect: {status: FAILURE, cause: safety.stop}
        """,
    )
    assert case.passed
    assert runs(case) == ["1-1 Go safety.force_limit", "1-1 near safety.stop"]


def test_time_is_simulated_and_a_timeout_halts_the_leaf() -> None:
    case = play_one(
        "Main: {Timeout: {msec: 200, do: Go}}",
        """
        leaves: {Go: RUNNING}
        expect: {status: FAILURE, cause: tree.timeout, order: [{Go: HALTED}]}
        """,
    )
    assert case.passed
    # The fourth tick is at 0.15 s, the fifth at 0.2 s.
    assert (case.ticks, runs(case)) == (5, ["1-5 Go HALTED"])


PASSING = {  # trees, and a case that passes
    "what still runs is halted where the case says so": (
        'Main: {Sequence: [Go, {Go: {name: far, _onHalted: "left := true"}}]}',
        """
        leaves: {far: RUNNING}
        halt_after: 4
        expect: {status: IDLE, order: [Go, {far: HALTED}], blackboard: {left: true}, ticks: 4}
        """,
    ),
    "an assignment to a key that is not there fails as in a run": (
        "Main: {Go: {_onSuccess: n = 1}}",
        "expect: {status: FAILURE}",
    ),
    "what succeeds fills and empties the hand": (
        "Main: {Sequence: [Look: {objects: '{o}'}, ForEach: {in: '{o}', out: '{i}', do: ["
        "{Pick: {object: '{i}'}}, {Condition: {if: holding and held_object == i}}, "
        "{Put: {object: '{i}', into: '{i.destination}'}}, {Condition: {if: not holding}}]}]}",
        """
        objects: {a: {colour: red}, b: {colour: blue, destination: green_bin}, c: {role: obstacle}}
        expect:
          status: SUCCESS
          order: [Look, Pick, Put, Pick, Put]
          facts: {items_left: false, items_to_do: 0, held_object: ""}
          objects: {a: {place: red_bin}, b: {place: green_bin, destination: green_bin}, d: null}
          blackboard: {o: [a, b]}
        """,
    ),
    "what is missed or slips is no longer in the hand": (
        """
        Main:
          Fallback:
            - Sequence: [{Pick: {object: a}}, {Put: {object: a}}]
            - Condition: {if: holding}
        """,
        """
        objects: {a: {}}
        leaves: {Put: grasp.slipped}
        expect: {status: FAILURE, cause: grasp.slipped, facts: {holding: false}, objects: {a: {place: table}}}
        """,
    ),
    "what a leaf leaves in the hand may depend on its inputs": (
        """
        Main:
          Sequence:
            - Pick: {object: a}
            - Retreat
            - Condition: {if: holding}
            - SetBlackboard: {value: true, output_key: "{drop}"}
            - Retreat: {drop: "{drop}"}
            - Condition: {if: not holding}
        """,
        "{objects: {a: {}}, expect: {status: SUCCESS, objects: {a: {place: table}}}}",
    ),
    "what an answer says of the world comes after what follows by itself": (
        "Main: {Sequence: [{Pick: {object: a}}, {Condition: {if: not holding}}, Go, "
        "{Condition: {if: held_object == 'b'}}, {Go: {name: last}}]}",
        """
        objects: {a: {}}
        leaves:
          Pick: {then: {hand: empty}}
          Go: [{then: {objects: {a: null, b: {colour: red}}, hand: b, facts: {items_to_do: 7}}}]
          last: {then: {facts: {items_to_do: null}}}
        expect: {status: SUCCESS, objects: {a: null, b: {colour: red, place: hand}}, facts: {items_to_do: 1}}
        """,
    ),
    "a leaf that nobody answers for fails for an object that is not there": (
        "Main: {Pick: {object: a}}",
        "expect: {status: FAILURE, cause: world.unknown_object, order: [{Pick: FAILURE}]}",
    ),
    "missing inputs fail as in a run": (
        "Main: {Pick: {object: '{a}'}}",
        "expect: {status: FAILURE, cause: tree.missing_input}",
    ),
    "outputs are written as their ports are typed": (
        """
        Main:
          Sequence:
            - Weigh: {weight: "{w}", sort: "{s}"}
            - Condition: {if: w > 2 and s == 'heavy'}
        """,
        """
        leaves: {Weigh: {outputs: {weight: 2500 mN, sort: heavy}}}
        expect: {status: SUCCESS, blackboard: {w: 2.5}}
        """,
    ),
    "conditions and leaves of their own kind answer too": (
        "Main: {Sequence: [{IfThenElse: [Ready, AlwaysFailure, Go]}, Maybe, {Go: {name: last}}]}",
        """
        leaves: {Ready: FAILURE, Maybe: SKIPPED}
        expect: {status: SUCCESS, order: [{Ready: FAILURE}, Go, {Maybe: SKIPPED}, last]}
        """,
    ),
    "preconditions are asked, and who does not start is not in the order": (
        "Main: {Sequence: [{Go: {_skipIf: holding}}, {Go: {name: last, _successIf: not holding}}]}",
        "{facts: {holding: true}, expect: {status: SUCCESS, order: [last], never: [Go]}}",
    ),
    "each attempt of a retry takes a failure up": (
        "Main: {RetryUntilSuccessful: {num_attempts: 3, do: Go}}",
        """
        leaves: {Go: [planning.no_path, planning.no_path, SUCCESS]}
        expect: {status: SUCCESS, handled: [{cause: planning.*, by: RetryUntilSuccessful, times: 2}]}
        """,
    ),
    "a number that cannot be is a failure with a cause and no fault": (
        "Main: {Sequence: [{SetBlackboard: {value: 3, output_key: '{n}'}}, "
        "{Parallel: {success_count: '{n}', do: [Go, {Go: {name: b}}]}}]}",
        "expect: {status: FAILURE, cause: tree.missing_input, order: []}",
    ),
    "a stop that the case sets by itself is as good as any": (
        "Main: {Sequence: [Retreat, Go]}",
        "{facts: {stopped: true}, expect: {status: SUCCESS}}",
    ),
    "a bin that the scene does not have is not placed into": (
        "Main: {Sequence: [{Pick: {object: a}}, {Put: {object: a, into: lost_bin}}]}",
        "{objects: {a: {}}, expect: {status: FAILURE, cause: world.unknown_object}}",
    ),
}


@pytest.mark.parametrize("name", PASSING)
def test_a_case_passes(name: str) -> None:
    trees, case = PASSING[name]
    assert said(play_one(trees, case, head="scene: three_bins\n")) == []


def test_without_a_scene_nobody_knows_the_bins() -> None:
    trees = "Main: {Sequence: [{Pick: {object: a}}, {Put: {object: a, into: lost_bin}}]}"
    case = "{objects: {a: {}}, expect: {status: SUCCESS, objects: {a: {place: lost_bin}}}}"
    assert said(play_one(trees, case)) == []


def test_a_case_ends_after_its_ticks_and_says_that_the_mission_still_runs() -> None:
    case = play_one("Main: {KeepRunningUntilFailure: {Go: {}}}", "expect: {status: SUCCESS, ticks: 7}")
    assert said(case) == ["expect.status: SUCCESS is expected, but the mission is RUNNING (tick 7)"]
    case = play_one("Main: {KeepRunningUntilFailure: {Go: {}}}", "expect: {ticks: 7}")
    assert said(case) == ["expect.ticks: the mission still runs (tick 7)"]


def test_a_safety_stop_holds_the_arm_until_a_retreat_acknowledges_it() -> None:
    trees = """
    Main:
      Recover:
        do: {Pick: {object: a}}
        when: {safety.*: [{Condition: {if: stopped}}, HOW, {Condition: {if: not stopped}}]}
    """
    case = """
    objects: {a: {}}
    leaves: {Pick: [safety.force_limit, SUCCESS]}
    expect: {status: SUCCESS, handled: [{cause: safety.*, by: Recover, handler: safety.*, times: 1}]}
    """
    retreated = play_one(trees.replace("HOW", "Retreat"), case)
    assert retreated.passed, said(retreated)
    # A leaf that nobody answers for is refused, as the controller refuses it.
    moved = play_one(trees.replace("HOW", "Go"), case)
    assert runs(moved) == ["1-1 Pick safety.force_limit", "2-2 Go safety.stop"]
    # One that the case moves all the same is a mistake of the case.
    told = play_one(trees.replace("HOW", "Go"), case.replace("SUCCESS]}", "SUCCESS], Go: SUCCESS}"))
    assert said(told)[0] == (
        "it: this cannot be: Main/Recover/safety.*/Go: Go moves the arm, which a safety stop holds (tick 2)"
    )


@pytest.mark.parametrize(
    ("trees", "case", "what"),
    [
        (
            "Main: {Sequence: [{Pick: {object: a}}, {Pick: {object: b}}]}",
            "{objects: {a: {}, b: {}}, expect: {status: SUCCESS}}",
            "Main/Sequence/Pick#2: Pick takes 'b' while the hand holds 'a'",
        ),
        (
            "Main: {Sequence: [{Pick: {object: a}}]}",
            "{leaves: {Pick: SUCCESS}, expect: {status: SUCCESS}}",
            "Main/Sequence/Pick: Pick takes 'a', which is not in the belief",
        ),
        (
            "Main: {Put: {object: a}}",
            "{objects: {a: {}}, expect: {status: SUCCESS}}",
            "Main/Put: Put lets go of 'a' while the hand is empty",
        ),
        (
            "Main: {Go: {}}",
            "{leaves: {Go: {then: {hand: a}}}, expect: {status: SUCCESS}}",
            "Main/Go: the hand is to hold 'a', which is not in the belief",
        ),
    ],
)
def test_what_cannot_be_ends_the_case(trees: str, case: str, what: str) -> None:
    result = play_one(trees, case)
    assert said(result) == [f"it: this cannot be: {what} (tick 1)"]


def test_parameters_and_what_holds_for_all_cases() -> None:
    trees = """
    Main:
      ports: {pause: {type: float, unit: ms}, who: {type: object, default: a}}
      Sequence: [{Delay: {delay_msec: "{pause}", do: Go}}, {Pick: {object: "{who}"}}]
    """
    rehearsal = play(
        trees,
        """
        parameters: {pause: 50 ms}
        objects: {a: {}, b: {}}
        leaves: {Go: {ticks: 1}}
        cases:
          first: {expect: {ticks: 3, objects: {a: {place: hand}}}}
          other:
            parameters: {pause: 0, who: b}
            objects: {a: null}
            leaves: {Go: SUCCESS}
            expect: {ticks: 1, objects: {b: {place: hand}, a: null}}
        """,
    )
    assert [(case.name, case.ticks, said(case)) for case in rehearsal.cases] == [
        ("first", 3, []),
        ("other", 1, []),
    ]


def test_who_takes_a_failure_up_is_seen_whatever_node_it_is() -> None:
    case = play_one(
        "Main: {Sequence: [{Fallback: [Go, {Go: {name: b}}]}, {ForceSuccess: {Go: {name: c}}}, "
        "{Go: {name: d}}]}",
        """
        leaves: {/Main/Sequence/Fallback/Go: planning.no_path, c: safety.workspace}
        expect: {status: FAILURE, cause: safety.workspace}
        """,
    )
    assert case.passed, said(case)
    assert [(h.cause, h.failed, h.by, h.handler) for h in case.handled] == [
        ("planning.no_path", "Main/Sequence/Fallback/Go", "Main/Sequence/Fallback", "")
    ]


def test_a_recovery_that_gives_up_has_handled_nothing() -> None:
    case = play_one(
        "Main: {Recover: {attempts: 1, do: {Pick: {object: a}}, otherwise: [Go], give_up: [Go]}}",
        """
        objects: {a: {}}
        leaves: {Pick: grasp.missed, give_up/Go: {ticks: 2}}
        expect: {status: FAILURE, cause: grasp.missed, handled: [grasp.missed]}
        """,
    )
    assert said(case) == ["expect.handled[0]: grasp.missed is not taken up: nobody takes it up"]


def test_a_fault_of_the_program_fails_the_case() -> None:
    case = play_one("Main: {Peek: {Go: {}}}", "expect: {status: FAILURE, cause: internal.error}")
    (told,) = said(case)
    assert told.startswith(
        "it: a fault of the program: AttributeError while Peek was ticked: in a rehearsal there is no "
        "world.control: no robot is simulated (rehearsing.py, line "
    )
    assert told.endswith(") (tick 1)")


def test_answers_that_nobody_gave_are_told() -> None:
    rehearsal = play(
        "Main: {Sequence: [Go]}",
        """
        leaves: {Go: [SUCCESS, SUCCESS]}
        cases:
          it:
            leaves: {Go: [SUCCESS, safety.stop]}
            expect: {status: SUCCESS}
        """,
    )
    assert [str(mark) for mark in rehearsal.cases[0].unused] == ["cases.yaml:7:28"]
