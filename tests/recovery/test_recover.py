"""Recover with scripted leaves: which handler runs, in which tick, and what the node fails with."""

from __future__ import annotations

from textwrap import indent

from picktree.trees import NodeStatus

from ..trees.scripted import FakeWorld, Run, letters
from . import scripted_recovery


def start(body: str, world: FakeWorld | None = None) -> Run:
    return scripted_recovery.start("Recover:\n" + indent(body, "  "), world)


TABLE = """\
attempts: 3
do: {Scripted: {name: Do, script: "%s"}}
when:
  grasp.missed: [{Scripted: {name: Look, script: "%s"}}]
  grasp.*: [{Scripted: {name: Away, script: S}}, {Scripted: {name: Home, script: S}}]
otherwise: [{Scripted: {name: Else, script: S}}]
"""


def test_the_first_pattern_that_matches_is_used_then_do_runs_again() -> None:
    run = start(TABLE % ("R grasp.missed|R S", "R S"))
    assert letters(run.to_end()) == "RRRRRS"
    assert [line for line in run.trace if line.startswith("start")] == ["start Do", "start Look", "start Do"]
    events = run.notes("recovery")
    assert [e.message for e in events] == [
        "grasp.missed in Main/Recover/Do: grasp.missed is tried (attempt 1 of 3)"
    ]


def test_a_family_then_the_rest_and_the_list_is_a_sequence() -> None:
    run = start(TABLE % ("grasp.slipped|control.timeout|S", "S"))
    assert run.to_end()[-1] is NodeStatus.SUCCESS
    assert [line for line in run.trace if line.startswith("start")] == [
        "start Do", "start Away", "start Home", "start Do", "start Else", "start Do",
    ]  # fmt: skip
    told = [(e.data["cause"], e.data["attempt"]) for e in run.notes("recovery")]
    assert told == [("grasp.slipped", 1), ("control.timeout", 2)]


def test_when_all_attempts_are_used_up_the_last_cause_goes_up_with_the_others() -> None:
    run = start(TABLE % ("grasp.missed|grasp.slipped|grasp.missed", "S"))
    assert run.to_end()[-1] is NodeStatus.FAILURE
    report = run.tree.failure
    assert (str(report.cause), report.node) == ("grasp.missed", "Main/Recover/Do")
    assert [str(other.cause) for other in report.attached] == ["grasp.missed", "grasp.slipped"]
    assert run.trace.count("start Do") == 3
    assert run.trace.count("start Look") == 1


def test_a_failed_handler_ends_the_node_with_the_original_cause() -> None:
    run = start(TABLE % ("grasp.missed", "perception.not_found"))
    assert letters(run.to_end()) == "RF"
    report = run.tree.failure
    assert str(report.cause) == "grasp.missed"
    assert [str(other.cause) for other in report.attached] == ["perception.not_found"]


def test_a_fault_of_the_program_is_never_handled() -> None:
    run = start(TABLE % ("crash", "S"))
    assert letters(run.to_end()) == "F"
    report = run.tree.failure
    assert str(report.cause) == "internal.error"
    assert "start Else" not in run.trace


def test_a_fault_of_the_program_is_handled_where_when_names_it() -> None:
    body = """\
attempts: 3
do: {Scripted: {name: Do, script: "%s"}}
when: {"*": AlwaysSuccess, %s: {Scripted: {name: Mend}}}
give_up: {Scripted: {name: Leave}}
"""
    for named in ("internal.error", "internal.*"):
        run = start(body % ("crash|S", named))
        assert letters(run.to_end()) == "RRS"
        assert run.trace.count("start Mend") == 1
        assert [e.data["cause"] for e in run.notes("recovery")] == ["internal.error"]
    run = start(body % ("crash", "internal.error"))
    assert letters(run.to_end())[-1] == "F"
    assert run.trace.count("start Do") == 3
    assert run.trace.count("start Leave") == 1
    assert str(run.tree.failure.cause) == "internal.error"


TOLD = """\
attempts: 3
attempt: "{attempt}"
cause: "{cause}"
message: "{message}"
failed: "{failed}"
do:
  - Log: {message: do, value: "{attempt}"}
  - Log: {message: after, value: "{cause}"}
  - Scripted: {name: Do, script: "grasp.missed|control.timeout|S"}
otherwise:
  - Log: {message: handler, value: "{attempt}"}
  - Log: {message: because, value: "{cause}"}
  - Log: {message: said, value: "{message}"}
  - Log: {message: by, value: "{failed}"}
"""


def test_do_and_handlers_read_which_attempt_it_is_and_what_is_handled() -> None:
    run = start(TOLD)
    assert run.to_end()[-1] is NodeStatus.SUCCESS
    by = "Main/Recover/Sequence/Do"
    assert [e.message for e in run.notes("log")] == [
        "do: 1", "after: ''",
        "handler: 1", "because: 'grasp.missed'", "said: 'Do was told to'", f"by: '{by}'",
        "do: 2", "after: 'grasp.missed'",
        "handler: 2", "because: 'control.timeout'", "said: 'Do was told to'", f"by: '{by}'",
        "do: 3", "after: 'control.timeout'",
    ]  # fmt: skip


def test_what_is_handled_is_saved_and_restored_with_the_keys() -> None:
    world = FakeWorld()
    run = start(TOLD, world)
    run.tick()
    saved = run.tree.save()
    other = start(TOLD, world)
    other.tree.restore(saved)
    other.to_end()
    said = [e.message for e in other.notes("log") if e.message.startswith("because")]
    assert said == ["because: 'grasp.missed'", "because: 'control.timeout'"]


def test_without_a_handler_the_cause_goes_up_at_once() -> None:
    run = start("do: {Scripted: {name: Do, script: safety.stop}}\nwhen: {grasp.*: [AlwaysSuccess]}\n")
    assert letters(run.to_end()) == "F"
    assert str(run.tree.failure.cause) == "safety.stop"


GIVE_UP = """\
attempts: 2
do: {Scripted: {name: Do, script: grasp.missed}}
otherwise: [AlwaysSuccess]
give_up: [{Scripted: {name: Leave, script: "%s"}}]
"""


def test_give_up_runs_before_the_node_fails_for_good() -> None:
    run = start(GIVE_UP % "RR S")
    assert letters(run.to_end()) == "RRRRF"
    assert run.trace.count("start Leave") == 1
    assert str(run.tree.failure.cause) == "grasp.missed"


def test_a_failed_give_up_is_attached() -> None:
    run = start(GIVE_UP % "control.timeout")
    run.to_end()
    assert [str(r.cause) for r in run.tree.failure.attached] == ["grasp.missed", "control.timeout"]


def test_halting_while_a_handler_runs_leaves_nothing_running_and_a_fresh_start() -> None:
    run = start(TABLE % ("grasp.missed|S", "RRRR S"))
    for _ in range(3):
        run.tick()
    assert run.status("Main/Recover/grasp.missed/Look") is NodeStatus.RUNNING
    run.tree.halt()
    assert {node.state for node in run.tree.nodes} == {NodeStatus.IDLE}
    assert "leave Look" in run.trace
    assert letters(run.to_end()) == "S"


def test_saved_between_two_attempts_it_goes_on_with_the_count() -> None:
    world = FakeWorld()
    run = start(TABLE % ("grasp.missed|grasp.missed|grasp.missed|S", "S"), world)
    run.tick()
    run.tick()
    assert run.tree.quiescent
    saved = run.tree.save()
    other = start(TABLE % ("grasp.missed|grasp.missed|grasp.missed|S", "S"), world)
    other.tree.restore(saved)
    assert other.to_end()[-1] is NodeStatus.FAILURE
    assert world.trace.count("start Do") == 3


INSTEAD = """\
attempts: 2
do: {Scripted: {name: Do, script: "%s"}}
instead:
  grasp.double: [{Scripted: {name: Reject, script: "%s"}}]
when:
  grasp.*: [{Scripted: {name: Look, script: S}}]
give_up: [{Scripted: {name: Resort, script: S}}]
"""


def begun(run: Run) -> list[str]:
    return [line.removeprefix("start ") for line in run.trace if line.startswith("start")]


def test_what_is_done_instead_ends_the_node_and_nothing_is_tried_again() -> None:
    run = start(INSTEAD % ("grasp.double", "R S"))
    assert letters(run.to_end()) == "RRS"
    assert begun(run) == ["Do", "Reject"]
    (event,) = run.notes("recovery")
    assert event.message == "grasp.double in Main/Recover/Do: grasp.double is done instead"
    assert (event.data["handler"], event.data["ends"]) == ("grasp.double", True)


def test_it_is_done_after_the_last_attempt_too() -> None:
    run = start(INSTEAD % ("grasp.missed|grasp.double", "S"))
    assert run.to_end()[-1] is NodeStatus.SUCCESS
    assert begun(run) == ["Do", "Look", "Do", "Reject"]


def test_where_it_fails_or_has_nothing_to_do_the_failure_stands() -> None:
    for script in ("perception.not_found", "K"):
        run = start(INSTEAD % ("grasp.double", script) if script != "K" else SKIPPED)
        assert run.to_end()[-1] is NodeStatus.FAILURE
        report = run.tree.failure
        assert report is not None and str(report.cause) == "grasp.double"
        assert begun(run) == (["Do", "Reject"] if script != "K" else ["Do"])


SKIPPED = INSTEAD.replace('script: "%s"}}]', "script: S, _skipIf: true}}]").replace("%s", "grasp.double")


def test_an_object_that_was_given_up_is_not_tried_again() -> None:
    """The look after a miss shows its place empty, so a second look of the same handler changes nothing."""
    run = start(
        "attempts: 9\ndo: {Scripted: {name: Do, script: grasp.missed|world.unknown_object}}\n"
        "otherwise: [{Scripted: {name: Look, script: S}}]\n"
    )
    assert run.to_end()[-1] is NodeStatus.FAILURE
    assert begun(run) == ["Do", "Look", "Do"]


def test_an_unknown_object_is_looked_for_once_by_the_handler_of_its_cause() -> None:
    run = start(
        "attempts: 9\ndo: {Scripted: {name: Do, script: grasp.missed|world.unknown_object}}\n"
        "when: {world.unknown_object: {Scripted: {name: Find, script: S}}}\n"
        "otherwise: [{Scripted: {name: Look, script: S}}]\n"
    )
    assert run.to_end()[-1] is NodeStatus.FAILURE
    assert begun(run) == ["Do", "Look", "Do", "Find", "Do"]
