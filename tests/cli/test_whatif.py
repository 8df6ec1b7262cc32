"""`picktree whatif`: what it asks for, and what it answers to the shell."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from picktree.analysis import RunChanges
from picktree.analysis.compare import RunOutcome
from picktree.analysis.compare.message_differences import MessageDifference
from picktree.analysis.whatif import Continuation, NodeTransfers
from picktree.apps.cli import answer
from picktree.files import Diagnostic, Mark

OUTCOME = RunOutcome(
    log=Path("/runs/one/log.mcap"),
    recovered="",
    status="failure",
    message="missed",
    end=10.0,
    items_total=4,
    items_sorted=2,
    items_done=2,
    picks_tried=3,
    picks_held=2,
    failures={"grasp.missed": 1},
    recoveries=0,
    digest="0",
)
FOUND = Continuation(
    log=Path("/runs/one/log.mcap"),
    at_tick=200,
    at=10.0,
    checkpoint="checkpoint-0001.json",
    start_tick=120,
    start=6.0,
    items_done=2,
    changes=("mission line 3: `attempts: 2` instead of `attempts: 1`",),
    nodes=NodeTransfers(9, ("Main/Sequence/Extra",), ()),
    cut=False,
    ticks=70,
    recorded_ticks=80,
    exact=True,
    difference=MessageDifference(191, 9.55, "/events", "", False, "kind", "", "log", "recovery"),
    recorded=OUTCOME,
    now=replace(OUTCOME, status="success", items_sorted=4, items_done=4, end=14.5, recoveries=1),
    status="success",
    parting=("the runs diverge at 9.55 s: Grasp ends differently", "  A  Main/Grasp", "  B  Main/Grasp"),
    arithmetic="",
    warnings=(Diagnostic(Mark("other.yaml", 3, 1), "", "mind this", code="P310", severity="warning"),),
    new_log=Path("/out/one/log.mcap"),
)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Callable[[Continuation], list[dict[str, Any]]]:
    """Lets the command meet this result; what it asked for."""

    def meet(found: Continuation) -> list[dict[str, Any]]:
        orders: list[dict[str, Any]] = []

        def what_if(log: str, at: str, **options: Any) -> Continuation:
            options.pop("observers")
            orders.append({"log": log, "at": at, **options})
            return found

        monkeypatch.setattr("picktree.analysis.what_if", what_if)
        return orders

    return meet


def test_both_outcomes_side_by_side(asked: Callable[..., Any], capfd: pytest.CaptureFixture[str]) -> None:
    orders = asked(FOUND)
    line = ["whatif", "last", "--at", "10 s", "--mission", "other.yaml", "--set", "a=1", "--no-faults"]
    assert answer([*line, "--out", "/out"]) == 0
    told = capfd.readouterr()
    assert told.out.startswith(
        "what if     /runs/one/log.mcap\n"
        "goes on     from checkpoint-0001, the last checkpoint before tick 200 (10.00 s): "
        "tick 120, 6.00 s, 2 items done\n"
        "changed     mission line 3: `attempts: 2` instead of `attempts: 1`\n"
        "nodes       9 keep their state, 1 start without a state, 0 are gone\n"
        "  anew      Main/Sequence/Extra\n"
        "\n"
        "                         recorded  what if\n"
        "status                   failure   success\n"
    )
    assert told.out.endswith(
        "\n"
        "the runs diverge at 9.55 s (A: recorded, B: what if): Grasp ends differently\n"
        "  A  Main/Grasp\n"
        "  B  Main/Grasp\n"
        "different from tick 191 on, 9.55 s: /events kind\n"
        "  recorded  log\n"
        "  now       recovery\n"
        "new log     /out/one/log.mcap\n"
    )
    assert told.err.startswith("other.yaml:3:1: warning P310: mind this")
    changes = RunChanges(Path("other.yaml"), None, {"a": "1"}, None, True)
    assert orders == [{"log": "last", "at": "10 s", "changes": changes, "out": Path("/out")}]


def test_nothing_changed(asked: Callable[..., Any], capfd: pytest.CaptureFixture[str]) -> None:
    same = replace(
        FOUND,
        start_tick=200,
        changes=(),
        nodes=None,
        difference=None,
        now=OUTCOME,
        status="failure",
        warnings=(),
    )
    asked(same)
    assert answer(["whatif", "last", "--at", "200"]) == 1
    assert capfd.readouterr().out.splitlines()[1:4] == [
        "goes on     from checkpoint-0001, the requested tick: tick 200, 6.00 s, 2 items done",
        "changed     nothing",
        "identical continuation: 70 ticks, byte for byte",
    ]


def test_an_interrupt_is_130(asked: Callable[..., Any]) -> None:
    asked(replace(FOUND, status="interrupted"))
    assert answer(["whatif", "last", "--at", "200"]) == 130


def test_json_is_one_object(asked: Callable[..., Any], capfd: pytest.CaptureFixture[str]) -> None:
    asked(FOUND)
    assert answer(["whatif", "last", "--at", "200", "--json"]) == 0
    said = json.loads(capfd.readouterr().out)
    assert said["start"] == {"checkpoint": "checkpoint-0001.json", "tick": 120, "time": 6.0, "items_done": 2}
    assert (said["recorded"]["status"], said["now"]["status"]) == ("failure", "success")
    assert said["nodes"] == {"kept": 9, "fresh": ["Main/Sequence/Extra"], "gone": []}


def test_bad_input(capfd: pytest.CaptureFixture[str]) -> None:
    assert answer(["whatif", "last"]) == 2
    assert "Missing option '--at'" in capfd.readouterr().err
