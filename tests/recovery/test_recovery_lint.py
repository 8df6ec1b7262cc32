"""What the linter takes nodes of recovery for: whether they pass time, and leave their child alone."""

from __future__ import annotations

import pytest

from ..authoring.linting import lint

LOOP = "{Repeat: {num_cycles: -1, do: {GoTo: {pose: home}}}}"
ENDLESS = "the loop ends only when GoTo fails: num_cycles is -1 and there is no 'while'"


def found(node: str) -> list[str]:
    """The findings about loops, without their place."""
    text = f"trees:\n  Main:\n    ports: {{cause: {{type: string}}}}\n    Sequence:\n      - {node}\n"
    return [line.split(": ", 1)[1].rpartition(" (")[0] for line in lint(text, "P321", "P322", "P323")]


@pytest.mark.parametrize(
    "node",
    [
        f"Recover: {{do: {LOOP}, otherwise: SafeRetreat}}",
        f"Recover: {{do: {{GoTo: {{pose: home}}}}, otherwise: {LOOP}}}",
        f"RecoveryNode: [{LOOP}, SafeRetreat]",
        f"Budget: {{tries: 1, do: {LOOP}}}",
        f"PlanWith: {{seed: 1, do: {LOOP}}}",
        f"WatchScene: {{do: {LOOP}}}",
    ],
)
def test_what_runs_below_is_stopped_by_nobody(node: str) -> None:
    assert found(node) == [ENDLESS]


def test_another_value_for_each_attempt_lets_no_time_pass() -> None:
    assert found("Repeat: {while: holding, do: {ForAttempt: {attempt: 1, values: [1], value: '{v}'}}}") == [
        "nothing in ForAttempt changes 'holding': once begun, the loop never ends"
    ]


@pytest.mark.parametrize(
    ("node", "name"),
    [
        ("PlanWith: {seed: 1, do: {Condition: {if: holding}}}", "PlanWith"),
        ("WouldLookingHelp: {cause: '{cause}'}", "WouldLookingHelp"),
        ("CauseIs: {cause: '{cause}', of: [grasp.missed]}", "CauseIs"),
        (
            "Sequence: [{ForAttempt: {attempt: 1, values: [1], value: '{v}'}}, {Condition: {if: holding}}]",
            "Sequence",
        ),
    ],
)
def test_what_answers_alike_each_time_is_not_tried_again(node: str, name: str) -> None:
    tried = found(f"RetryUntilSuccessful: {{num_attempts: 3, do: {{{node}}}}}")
    assert tried == [f"another attempt changes nothing: {name} gives the same result each time"]


def test_what_is_set_aside_keeps_no_loop_going() -> None:
    text = """\
trees:
  Main:
    Repeat:
      num_cycles: -1
      while: items_to_do > 0
      do:
        - Observe: {camera: overhead, objects: "{items}"}
        - ForEach:
            in: "{items}"
            out: "{item}"
            on_failure: continue
            do: {Fallback: [{Grasp: {object: "{item}"}}, %s]}
"""
    assert lint(text % "{SetAside: {object: '{item}'}}", "P325") == []
    assert [line[:4] for line in lint(text % "SafeRetreat", "P325")] == ["P325"]


def heard(*handlers: str) -> list[str]:
    """The findings about handlers and the hand, without place and hint."""
    given = ("\n" + " " * 14).join(handlers)
    text = f"""\
trees:
  Main:
    Sequence:
      - Observe: {{camera: overhead, objects: "{{items}}"}}
      - ForEach:
          in: "{{items}}"
          out: "{{item}}"
          on_failure: continue
          do:
            Recover:
              do: [{{Grasp: {{object: "{{item}}"}}}}, {{Place: {{object: "{{item}}", into: red_bin}}}}]
              {given}
              give_up: {{SafeRetreat: {{hand: open}}}}
"""
    return [line.split(": ", 2)[1].partition(" (")[0] for line in lint(text, "P311", "P312", "P330")]


REJECT = "{SafeRetreat: {hand: open}}"


def test_what_is_done_instead_comes_before_other_handlers_and_may_succeed() -> None:
    assert heard("otherwise: SafeRetreat") == []
    assert heard(f"instead: {{place.full: {REJECT}}}", "otherwise: SafeRetreat") == []
    assert heard(
        f"instead: {{place.*: {REJECT}}}", "when: {place.full: SafeRetreat}", "otherwise: SafeRetreat"
    ) == ["'place.full' is never used"]
    assert heard("instead: {place.full: {Log: {message: full}}}", "otherwise: SafeRetreat") == [
        "the hand may still hold the object of Grasp at the end of the mission, "
        "when Grasp or Place fails and the mission continues"
    ]
