"""The trace of a case as people read it."""

from __future__ import annotations

from picktree.authoring.rehearsal import to_json
from picktree.authoring.rehearsal.rehearsal import show, to_text
from picktree.files import short_names

from ..trees.rehearsing import play


def traced(trees: str, case: str) -> str:
    """The lines between a case's name and its verdict."""
    text = to_text(play(trees, "cases:\n  it: " + case))
    return text.partition("it\n")[2].partition("passed  it")[0]


def test_start_and_end_in_one_line_only_where_nothing_comes_between() -> None:
    trees = """
    Main:
      Parallel:
        - Go: {name: a}
        - Go: {name: b}
        - Delay: {delay_msec: 150, do: {Go: {name: c}}}
    """
    assert traced(trees, "{leaves: {a: {ticks: 4}, b: {ticks: 1}}, expect: {status: SUCCESS}}") == (
        "    1  a  starts\n  1–2  b  SUCCESS\n    4  c  SUCCESS\n    5  a  SUCCESS\n"
    )


def test_conditions_are_told_when_they_change_their_answer() -> None:
    trees = """
    Main:
      ReactiveSequence:
        - Condition: {if: "time < 0.12", name: early}
        - Go: {_skipIf: holding}
        - Go: {name: last}
    """
    assert traced(trees, "{facts: {holding: true}, leaves: {last: RUNNING}, expect: {status: FAILURE}}") == (
        "  1  early  SUCCESS\n"
        "  1  Go     SKIPPED\n"
        "  1  last   starts\n"
        "  2  Go     SKIPPED\n"
        "  3  Go     SKIPPED\n"
        "  4  early  FAILURE\n"
        "  4  last   HALTED\n"
    )


def test_outputs_stand_with_their_leaf_and_other_writes_alone() -> None:
    trees = """
    Main:
      Sequence:
        - Weigh: {weight: "{w}", sort: "{s}", _onSuccess: n := 3}
        - SetBlackboard: {value: [1, {a: true}], output_key: "{list}"}
        - Log: {message: weighed, value: "{w}"}
        - Timeout: {msec: 100, do: {Go: {}}}
    """
    answers = "{Weigh: {ticks: 1, outputs: {weight: 2, sort: light}}, Go: RUNNING}"
    assert traced(trees, f"{{leaves: {answers}, expect: {{status: FAILURE}}}}") == (
        "  1–2  Weigh          SUCCESS  w = 2.0, s = light, n = 3\n"
        "    2  SetBlackboard  list = [1, {a: true}]\n"
        "    2  Log            weighed: 2.0\n"
        "  2–4  Go             HALTED\n"
        "    4  Timeout        FAILURE tree.timeout: Go still ran after 0.1 s\n"
    )


def test_programs_are_told_the_same_events() -> None:
    rehearsal = play("Main: {Log: {message: hello}}", "cases: {it: {expect: {status: SUCCESS}}}")
    assert to_json(rehearsal)["cases"][0]["events"] == [
        {"tick": 1, "kind": "noted", "node": "Main/Log", "about": "log", "message": "hello"}
    ]


def test_names_are_as_short_as_they_can_be() -> None:
    paths = ["Main", "Main/A/Go", "Main/A/Go#2", "Main/B/A/Go", "Main/B/Look"]
    assert short_names(paths) == {
        "Main": "Main",
        "Main/A/Go": "Main/A/Go",
        "Main/A/Go#2": "Go#2",
        "Main/B/A/Go": "B/A/Go",
        "Main/B/Look": "Look",
    }


def test_values_in_one_line() -> None:
    assert show(None) == "null"
    assert show([True, 1, 0.5, "a b", {"x": []}]) == "[true, 1, 0.5, a b, {x: []}]"
    assert show("x" * 61) == "x" * 57 + "..."
