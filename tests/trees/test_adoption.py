"""An edited mission goes on where the old one stood: which nodes keep what, and which begin anew."""

from __future__ import annotations

import json
from typing import cast

import pytest

from picktree.trees import NODES, NodeStatus
from picktree.trees.runner import StateTransfer
from picktree.world import JournalEvent, Plain

from .scripted import Run, letters, start


def leaf(name: str, script: str = "S") -> str:
    return f"{{Scripted: {{name: {name}, script: '{script}'}}}}"


def rounds(count: int = 3, name: str = "round") -> str:
    return f"{{Repeat: {{num_cycles: {count}, do: {leaf(name)}}}}}"


def edited(before: str, after: str, ticks: int = 1) -> tuple[Run, StateTransfer]:
    """`before` for some ticks, then `after` in its place; the trace begins at the edit."""
    old = start(before)
    for _ in range(ticks):
        assert old.tick() is NodeStatus.RUNNING
    saved: dict[str, Plain] = json.loads(json.dumps(old.tree.save()))
    new = start(after, old.world)
    adoption = new.tree.adopt(saved)
    new.world.trace.clear()
    return new, adoption


def starts(run: Run) -> str:
    """The leaves that start until the mission ends, in their order."""
    run.to_end()
    assert not [
        e for e in run.world.journal.take() if isinstance(e, JournalEvent) and e.kind == "internal_error"
    ]
    return " ".join(line.removeprefix("start ") for line in run.trace if line.startswith("start "))


def sequence(*parts: str) -> str:
    return f"Main: {{Sequence: [{', '.join(parts)}]}}"


EDITS = {
    "nothing": (sequence(leaf("A"), rounds(), leaf("B")), "round round B"),
    "one more before": (sequence(leaf("new"), leaf("A"), rounds(), leaf("B")), "round round B"),
    "one more behind": (sequence(leaf("A"), rounds(), leaf("new"), leaf("B")), "round round new B"),
    "one less before": (sequence(rounds(), leaf("B")), "round round B"),
    "one less behind": (sequence(leaf("A"), rounds()), "round round"),
    "another order": (sequence(leaf("B"), rounds(), leaf("A")), "round round A"),
    "where it stood is gone": (sequence(leaf("A"), leaf("B")), "A B"),
    "where it stood is of another type": (
        sequence(leaf("A"), "{Inverter: {name: Repeat, do: AlwaysFailure}}", leaf("B")),
        "B",
    ),
    "more rounds": (sequence(leaf("A"), rounds(5), leaf("B")), "round round round round B"),
    "fewer rounds than were done": (sequence(leaf("A"), rounds(1), leaf("B")), "B"),
    "another body of the loop": (
        sequence(leaf("A"), rounds(name="other"), leaf("B")),
        "other other B",
    ),
    "a node between": (
        f"Main: {{Timeout: {{msec: 900, do: {{Sequence: [{leaf('A')}, {rounds()}]}}}}}}",
        "A round round round",
    ),
    "all is new": (f"Main: {leaf('C')}", "C"),
}  # fmt: skip


@pytest.mark.parametrize("edit", EDITS)
def test_a_sequence_goes_on_at_the_child_where_it_stood(edit: str) -> None:
    after, expected = EDITS[edit]
    run, _ = edited(sequence(leaf("A"), rounds(), leaf("B")), after)
    assert starts(run) == expected


def test_what_became_of_the_nodes_is_told() -> None:
    _, adoption = edited(
        sequence(leaf("A"), rounds(), leaf("B")),
        sequence(leaf("new"), leaf("A"), "{Repeat: {num_cycles: 3, do: AlwaysSuccess}}"),
    )
    assert adoption == StateTransfer(
        kept=("Main", "Main/Sequence", "Main/Sequence/A", "Main/Sequence/Repeat"),
        fresh=("Main/Sequence/new", "Main/Sequence/Repeat/AlwaysSuccess"),
        gone=("Main/Sequence/Repeat/round", "Main/Sequence/B"),
    )


def test_below_a_node_that_begins_anew_nothing_runs() -> None:
    inner = f"{{Sequence: {{name: inner, do: [{rounds()}, {leaf('B')}]}}}}"
    run, adoption = edited(
        sequence(leaf("A"), inner), sequence(leaf("A"), inner.replace("Sequence", "Fallback"))
    )
    assert adoption.fresh == (
        "Main/Sequence/inner", "Main/Sequence/inner/Repeat"
    )  # fmt: skip
    assert run.status("Main/Sequence/inner/Repeat") is NodeStatus.IDLE
    assert starts(run) == "round round round"


@pytest.mark.parametrize(
    ("after", "expected"),
    [
        (f"[{leaf('A', 'grasp.missed')}, {rounds()}, {leaf('C')}]", "round round"),
        (f"[{leaf('new')}, {leaf('A', 'grasp.missed')}, {rounds()}]", "round round"),
        (f"[{leaf('A', 'grasp.missed')}, {leaf('C')}]", "A C"),
    ],
)
def test_a_fallback_goes_on_at_the_child_where_it_stood(after: str, expected: str) -> None:
    run, _ = edited(
        f"Main: {{Fallback: [{leaf('A', 'grasp.missed')}, {rounds()}]}}", f"Main: {{Fallback: {after}}}"
    )
    assert starts(run) == expected


@pytest.mark.parametrize(
    ("after", "expected"),
    [
        (f"{rounds()}, {leaf('A')}", "round round"),
        (f"{leaf('A')}, {rounds()}, {leaf('new')}", "round new round"),
        (rounds(), "round round round"),
    ],
)
def test_a_parallel_knows_which_children_have_ended(after: str, expected: str) -> None:
    run, _ = edited(f"Main: {{Parallel: [{leaf('A')}, {rounds()}]}}", f"Main: {{Parallel: [{after}]}}")
    assert starts(run) == expected


def test_an_if_keeps_its_choice() -> None:
    before = f"Main: {{IfThenElse: [{leaf('yes')}, {rounds()}, {leaf('no')}]}}"
    run, _ = edited(before, before.replace("num_cycles: 3", "num_cycles: 2"))
    assert starts(run) == "round"
    run, _ = edited(
        before, before.replace("Repeat", "KeepRunningUntilFailure").replace("num_cycles: 3, ", "")
    )
    assert run.tick() is NodeStatus.RUNNING
    assert run.trace[0] == "start yes"


def test_a_loop_keeps_its_list_and_its_place() -> None:
    before = f"Main: {{ForEach: {{in: [1, 2, 3, 4], out: '{{n}}', do: {leaf('A')}}}}}"
    after = (
        f"Main: {{ForEach: {{in: [7, 8], out: '{{m}}', do: "
        f"{{Sequence: [{leaf('B')}, {{Log: {{message: is, value: '{{m}}'}}}}]}}}}}}"
    )
    run, _ = edited(before, after, ticks=2)
    assert starts(run) == "B B"
    assert cast("int", run.tree.blackboard.read("Main/m")) == 4


def test_attempts_that_were_made_are_kept() -> None:
    def retry(most: int) -> str:
        return f"Main: {{RetryUntilSuccessful: {{num_attempts: {most}, do: {leaf('A', 'grasp.missed')}}}}}"

    run, _ = edited(retry(3), retry(5), ticks=2)
    assert starts(run) == "A A A"
    report = run.tree.failure
    assert report is not None and len(report.attached) == 4


def test_the_first_answer_of_a_run_once_outlives_its_parent() -> None:
    once = f"{{RunOnce: {{name: once, do: {leaf('A')}}}}}"
    before = f"Main: {{Sequence: {{name: all, do: [{once}, {rounds()}]}}}}"
    after = f"Main: {{Fallback: {{name: all, do: [{once}, {rounds()}]}}}}"
    run, adoption = edited(before, after)
    assert adoption.fresh == ("Main/all", "Main/all/Repeat")
    assert starts(run) == "round round round"


def test_a_sub_tree_that_runs_sees_the_edited_literals_and_new_ports() -> None:
    def text(call: str, ports: str) -> str:
        body = "{Repeat: {num_cycles: 2, do: {SetBlackboard: {value: '{speed}', output_key: '{last}'}}}}"
        return f"Main: {{Sequence: [{{Part: {call}}}]}}\nPart: {{ports: {ports}, {body[1:-1]}}}"

    one = "{speed: {type: float}}"
    run, _ = edited(text("{speed: 1.0}", one), text("{speed: 2.5}", one))
    run.to_end()
    part = "Main/Sequence/Part"
    assert run.tree.blackboard.read(f"{part}/last") == 2.5
    two = "{speed: {type: float}, force: {type: float, default: 7.0}}"
    run, _ = edited(text("{speed: 1.0}", one), text("{speed: 1.0}", two))
    assert run.tree.blackboard.read(f"{part}/force") == 7.0


def test_an_input_is_read_anew_when_the_text_says_another() -> None:
    def text(count: str) -> str:
        return sequence(
            "{SetBlackboard: {value: 2, output_key: '{two}'}}",
            f"{{Repeat: {{num_cycles: {count}, do: {leaf('A')}}}}}",
        )

    for before, after, more in (
        ("4", "'{two}'", "A"), ("'{two}'", "4", "A A A"), ("4", "'{none}'", ""), ("'{two}'", "'{two}'", "A"),
    ):  # fmt: skip
        run, _ = edited(text(before), text(after))
        assert starts(run) == more
    assert run.tree.failure is None
    run, adoption = edited(text("4"), text("'{none}'"))
    assert "Main/Sequence/Repeat" in adoption.fresh
    run.to_end()
    assert run.tree.failure is not None and str(run.tree.failure.cause) == "tree.missing_input"


def test_a_skipped_child_that_is_gone_is_not_counted() -> None:
    skipped = "{AlwaysSuccess: {_skipIf: 'true'}}"
    run, _ = edited(sequence(skipped, rounds()), sequence(rounds()))
    assert letters(run.to_end())[-1] == "S"


WITHOUT_A_PLACE = {
    "ForEach", "Repeat", "RetryUntilSuccessful", "RunOnce", "Timeout", "Delay", "Sleep", "RateController",
    "SkipUnlessUpdated", "WaitValueUpdate", "WasEntryUpdated",
}  # fmt: skip
"""They remember, but not at which child they stand: they have one or none."""


def test_a_round_robin_keeps_whose_turn_it_is() -> None:
    def text(*parts: str) -> str:
        return f"Main: {{RoundRobin: [{', '.join(parts)}]}}"

    failing = leaf("A", "grasp.missed")
    before = text(failing, rounds(), leaf("C"))
    assert starts(edited(before, text(failing, leaf("new"), rounds(), leaf("C")))[0]) == "round round"
    assert starts(edited(before, text(leaf("B"), rounds()))[0]) == "B"  # of A, which failed, it kept a count


def test_every_node_that_remembers_says_which_of_it_points_at_children() -> None:
    remembering = {node.declaration.id: node for node in NODES if node.remembers}
    assert {name for name, node in remembering.items() if not node.positions} == WITHOUT_A_PLACE
    for node in remembering.values():
        assert set(node.positions) <= set(node.remembers)
