"""How a node that recovers may go, as the linter sees it: ends, keys, what the hand holds, causes."""

from __future__ import annotations

from textwrap import dedent

import pytest

from ..trees.ways import ways

WAYS: dict[str, tuple[str, dict[str, list[str]]]] = {
    "the only attempt is given up": (
        """\
        Recover:
          attempts: 1
          attempt: "{n}"
          do: Pick
          otherwise: Mend
          give_up: {Drop: {}}
        """,
        {
            "success": ["n | full"],
            "failure": [
                "n | empty/full: grasp.missed, grasp.slipped",
                "n | empty: grasp.missed, grasp.slipped",
            ],
            "running": ["n | empty/full"],
            "never": ["Mend: Pick may run only once, so no second run follows"],
        },
    ),
    "two attempts, and one cause of two is cured": (
        """\
        Recover:
          attempts: 2
          attempt: "{n}"
          cause: "{why}"
          do: Pick
          when: {grasp.missed: {Mend: {mended: "{m}"}}, perception.not_found: Drop}
          give_up: Drop
        """,
        {
            "success": ["n why m | full", "n why | full"],
            "failure": [
                "n why m | empty/full: grasp.missed, grasp.slipped",
                "n why m | empty: grasp.missed, grasp.slipped",
                "n why m? | empty/full!: grasp.missed",
                "n why | empty/full: grasp.slipped",
                "n why | empty: grasp.slipped",
            ],
            "running": ["n why m? | empty/full"],
            "never": ["Drop: Pick never fails with another cause"],
            "handled": ["grasp.missed"],
        },
    ),
    "a number of attempts that nobody knows": (
        """\
        Sequence:
          - ForAttempt: {attempt: 1, values: [1], value: "{n}"}
          - Recover:
              attempts: "{n}"
              do: Pick
              otherwise: {Mend: {mended: "{m}"}}
              give_up: Drop
        """,
        {
            "success": ["n m | full", "n | full"],
            "failure": [
                "n m? | empty/full!: grasp.missed, grasp.slipped",
                "n m? | empty/full: grasp.missed, grasp.slipped",
                "n m? | empty: grasp.missed, grasp.slipped",
                "n | empty!: ",
                "n? | empty!: ",
            ],
            "running": ["n m? | empty/full"],
            "handled": ["otherwise"],
        },
    ),
    "a condition, and a cure that takes no time": (
        """\
        Recover:
          attempts: 2
          do: {CauseIs: {cause: x, of: [grasp.missed]}}
          otherwise: {ForAttempt: {attempt: 1, values: [1], value: "{v}"}}
          give_up: {Mend: {mended: "{m}"}}
        """,
        {
            "success": ["v | empty", "| empty"],
            "failure": [
                "v m | empty: tree.attempts",
                "v m? | empty!: tree.attempts",
                "v? | empty!: tree.attempts",
            ],
            "running": ["v m? | empty", "| empty"],
            "handled": ["otherwise"],
        },
    ),
    "a cure that leaves everything as it was": (
        """\
        Recover:
          do: {CauseIs: {cause: x, of: [grasp.missed]}}
          otherwise: AlwaysSuccess
        """,
        {
            "success": ["| empty"],
            "failure": ["| empty: tree.attempts"],
            "running": ["| empty"],
            "handled": ["otherwise"],
        },
    ),
    "what never fails": (
        """\
        Recover:
          do: {ForAttempt: {attempt: 1, values: [1], value: "{v}"}}
          when: {grasp.missed: Drop, control.*: Pick}
          give_up: {Look: {seen: "{s}"}}
        """,
        {
            "success": ["v | empty"],
            "failure": ["v? s | empty!: ", "v? s? | empty!: "],
            "running": ["v? s? | empty!"],
            "never": ["Drop: ForAttempt never fails", "Pick: ForAttempt never fails with another cause"],
        },
    ),
    "a fault of the program": (
        """\
        Recover:
          attempts: 2
          do: Pick
          when: {internal.error: {Mend: {mended: "{m}"}}}
          give_up: {Look: {seen: "{s}"}}
        """,
        {
            "success": ["m | full!", "| full"],
            "failure": [
                "m s | empty/full!: grasp.missed, grasp.slipped, ~internal.error",
                "m s? | empty/full!: grasp.missed, grasp.slipped, ~internal.error",
                "m? | empty/full!: ~internal.error",
                "s | empty/full: grasp.missed, grasp.slipped",
                "s? | empty/full: grasp.missed, grasp.slipped",
            ],
            "running": ["m s? | empty/full!", "m? | empty/full!", "s? | empty/full"],
            "handled": ["internal.error"],
        },
    ),
    "what is skipped": (
        """\
        Recover:
          attempts: 2
          do: {Pick: {_skipIf: "time > 2"}}
          otherwise: {Drop: {_skipIf: "time > 1"}}
          give_up: {Mend: {mended: "{m}", _skipIf: "time > 1"}}
        """,
        {
            "success": ["| full"],
            "failure": [
                "m | empty/full: grasp.missed, grasp.slipped",
                "m? | empty/full!: grasp.missed, grasp.slipped",
                "| empty/full!: grasp.missed, grasp.slipped",
                "| empty/full: grasp.missed, grasp.slipped",
            ],
            "skipped": ["| empty/full"],
            "running": ["m? | empty/full"],
            "handled": ["otherwise"],
        },
    ),
    "a retry as of Nav2": (
        """\
        RecoveryNode:
          number_of_retries: 1
          do: [Pick, {Look: {seen: "{s}"}}]
        """,
        {
            "success": ["s | full", "| full"],
            "failure": [
                "s | empty/full: grasp.missed, grasp.slipped",
                "s? | empty/full: grasp.missed, grasp.slipped",
            ],
            "running": ["s? | empty/full"],
            "handled": ["Look"],
        },
    ),
    "no retry": (
        """\
        RecoveryNode:
          number_of_retries: 0
          do: [Pick, Look]
        """,
        {
            "success": ["| full"],
            "failure": ["| empty/full: grasp.missed, grasp.slipped"],
            "running": ["| empty/full"],
            "never": ["Look: Pick may run only once, so no second run follows"],
        },
    ),
    "a cure that is skipped ends a retry": (
        """\
        RecoveryNode:
          do: [{Look: {seen: "{s}"}}, {Pick: {_skipIf: "time > 1"}}]
        """,
        {
            "success": ["s | empty", "s | full"],
            "failure": [
                "s? | empty!: perception.not_found",
                "s? | empty/full: perception.not_found",
                "s? | empty: perception.not_found",
                "s? | full: perception.not_found",
            ],
            "running": ["s? | empty/full"],
            "handled": ["Pick"],
        },
    ),
    "a budget": (
        """\
        Budget:
          tries: 2
          do: {Recover: {attempts: 2, do: {Look: {_skipIf: "time > 2"}}, otherwise: {Pick: {}}}}
        """,
        {
            "success": ["| empty", "| full"],
            "failure": [
                "| empty/full: perception.not_found, tree.budget",
                "| full!: tree.budget",
                "| full: perception.not_found, tree.budget",
            ],
            "skipped": ["| empty", "| full"],
            "running": ["| empty/full"],
            "handled": ["otherwise"],
        },
    ),
    "a manner of planning": (
        """\
        PlanWith: {seed: 1, do: {Look: {seen: "{s}", _skipIf: "time > 2"}}}
        """,
        {
            "success": ["s | empty"],
            "failure": ["s? | empty: perception.not_found", "| empty!: "],
            "skipped": ["| empty"],
            "running": ["s? | empty"],
        },
    ),
    "a watched branch": (
        """\
        WatchScene: {do: {Pick: {_skipIf: "time > 2"}}}
        """,
        {
            "success": ["| full"],
            "failure": [
                "| empty!: ",
                "| empty/full: perception.not_found, perception.no_image, grasp.missed, grasp.slipped",
                "| empty: perception.not_found, perception.no_image",
            ],
            "skipped": ["| empty"],
            "running": ["| empty/full"],
        },
    ),
    "an item set aside": (
        """\
        SetAside: {object: x}
        """,
        {
            "success": ["| empty"],
            "failure": ["| empty: place.missed"],
        },
    ),
    "a question": (
        """\
        AskForHelp: {reason: why, answer: "{a}"}
        """,
        {
            "success": ["a | empty"],
            "failure": ["a? | empty: control.tracking, control.timeout, control.gripper, tree.given_up"],
            "running": ["a? | empty"],
        },
    ),
}


@pytest.mark.parametrize("what", WAYS)
def test_how_it_may_go(what: str) -> None:
    body, expected = WAYS[what]
    found = {end: states for end, states in ways(dedent(body)).items() if states}
    assert found == expected
