"""What no case reaches: nodes, branches, both answers of each expression and condition."""

from __future__ import annotations

from picktree.authoring.rehearsal.rehearsal import Coverage
from picktree.world import all_causes

from ..trees.rehearsing import play

MISSION = """\
Main:
  Sequence:
    - Repeat: {while: items_left, num_cycles: 2, do: {SortOne: {item: a}}}
    - Switch:
        variable: "{mode}"
        cases: {quick: Go, slow: [Go, {SortOne: {item: b}}]}
        default: AlwaysFailure
        _skipIf: holding
SortOne:
  ports: {item: {type: object}}
  Recover:
    attempts: 2
    do: {Pick: {object: "{item}", _onFailure: tried = true}}
    when: {grasp.missed: [Go], "*": [{IfThenElse: [Ready, Go, {Go: {name: else}}]}]}
    give_up: [Go]
Unused: Go
"""


def missed(coverage: Coverage) -> list[str]:
    return [f"{point.mark.line - 2} {point.node}: {point.missed}" for point in coverage.missed]


def test_one_case_reaches_what_it_runs_through() -> None:
    rehearsal = play(
        MISSION,
        """
        cases:
          it:
            objects: {a: {destination: red_bin}}
            leaves: {Pick: [grasp.missed, SUCCESS]}
            expect: {status: SUCCESS}
        """,
    )
    coverage = rehearsal.coverage
    assert rehearsal.cases[0].status == "SUCCESS"
    assert missed(coverage) == [
        "4 Main/Sequence/Repeat: 'while: items_left' is never false",
        "5 Main/Sequence/Switch: never starts",
        "7 Main/Sequence/Switch/Go: 'cases quick' is never used",
        "7 Main/Sequence/Switch/slow: 'cases slow' is never used",
        "7 Main/Sequence/Switch/slow/Go: never starts",
        "7 Main/Sequence/Switch/slow/SortOne: never starts",
        "8 Main/Sequence/Switch/AlwaysFailure: 'default' is never used",
        "9 Main/Sequence/Switch: '_skipIf: holding' is never false",
        "15 SortOne/Recover/*: 'when *' is never used",
        "15 SortOne/Recover/*/IfThenElse: never starts",
        "15 SortOne/Recover/*/IfThenElse/Ready: never starts",
        "15 SortOne/Recover/*/IfThenElse/Ready: never SUCCESS",
        "15 SortOne/Recover/*/IfThenElse/Ready: never FAILURE",
        "15 SortOne/Recover/*/IfThenElse/Go: never starts",
        "15 SortOne/Recover/*/IfThenElse/else: never starts",
        "16 SortOne/Recover/give_up: 'give_up' is never used",
        "16 SortOne/Recover/give_up/Go: never starts",
    ]
    # 20 nodes without the unused tree; two answers of two expressions and of Ready; the one _onFailure.
    assert len(coverage.points) == 20 + 2 * 3 + 1
    assert coverage.percent == 100 * (len(coverage.points) - 17) // len(coverage.points)
    assert not coverage.full


def test_cases_together_reach_everything() -> None:
    rehearsal = play(
        MISSION,
        """
        objects: {a: {destination: red_bin}, b: {}}
        facts: {holding: false}
        cases:
          missed: {leaves: {Pick: [grasp.missed, SUCCESS]}, expect: {cause: tree.missing_input}}
          nothing: {facts: {items_left: false}, expect: {status: FAILURE}}
          held: {facts: {holding: true}, expect: {status: SUCCESS}}
          ready: {leaves: {Pick: [grasp.slipped, SUCCESS]}, expect: {status: FAILURE}}
          busy: {leaves: {Pick: grasp.slipped, Ready: FAILURE}, expect: {cause: grasp.slipped}}
        """,
    )
    assert [case.name for case in rehearsal.failed] == []
    assert missed(rehearsal.coverage) == [
        "7 Main/Sequence/Switch/Go: 'cases quick' is never used",
        "7 Main/Sequence/Switch/slow: 'cases slow' is never used",
        "7 Main/Sequence/Switch/slow/Go: never starts",
        "7 Main/Sequence/Switch/slow/SortOne: never starts",
        "8 Main/Sequence/Switch/AlwaysFailure: 'default' is never used",
    ]
    assert rehearsal.coverage.percent == 81


def test_all_is_100_percent_and_nothing_less() -> None:
    rehearsal = play("Main: {Sequence: [Go]}", "cases: {it: {expect: {status: SUCCESS}}}")
    assert rehearsal.coverage.full
    assert rehearsal.coverage.percent == 100
    # 199 of 200 are 99 %, not 100 % rounded.
    trees = "Main: {Sequence: [" + "Go, " * 197 + "{Fallback: [Go, Go]}]}"
    rehearsal = play(trees, "cases: {it: {expect: {status: SUCCESS}}}")
    assert len(rehearsal.coverage.points) == 201
    assert rehearsal.coverage.percent == 99


def test_assignments_of_a_script_are_covered_when_they_run() -> None:
    script = "{Script: {code: 'held := holding'}}"
    trees = f"Main: {{Fallback: [{{Sequence: [{script}, Go]}}, {script}]}}"
    rehearsal = play(trees, "cases: {it: {expect: {status: SUCCESS}}}")
    assert missed(rehearsal.coverage) == [
        "2 Main/Fallback/Script: never starts",
        "2 Main/Fallback/Script: 'code' never runs",
    ]


def test_causes_that_leaves_declare() -> None:
    rehearsal = play(
        "Main: {Fallback: [{Pick: {object: a}}, {Put: {object: a}}]}",
        """
        cases:
          it:
            leaves: {Pick: grasp.missed, Put: place.full}
            expect: {status: FAILURE}
        """,
    )
    raised = [cause.cause for cause in rehearsal.coverage.causes if cause.raised]
    others = {f"{c.node} {c.cause}" for c in rehearsal.coverage.causes if not c.raised}
    assert raised == ["grasp.missed", "place.full"]
    assert {"Main/Fallback/Pick grasp.slipped", "Main/Fallback/Put grasp.slipped"} < others
    families = {cause.name for cause in all_causes() if cause.name.startswith("safety.")}
    assert {other.split()[1] for other in others} == {"grasp.slipped", *families}
