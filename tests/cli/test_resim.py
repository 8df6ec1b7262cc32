"""`picktree resim`: what it asks for, prints, and answers to the shell."""

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
from picktree.analysis.resim import Reason, Resimulation
from picktree.apps.cli import answer

GRASP = "Main/Sequence/Grasp"
SAME = Resimulation(
    log=Path("/runs/one/log.mcap"),
    recovered="",
    cut=False,
    changes=(),
    until=None,
    last_tick=115,
    ticks=116,
    recorded_ticks=116,
    seconds=5.75,
    digest="0123456789abcdef" * 4,
    exact=True,
    difference=None,
    trees=None,
    reasons=(),
    notes=(),
    parting=(),
    outcomes=None,
    warnings="",
    kept=None,
)
OTHER = replace(
    SAME,
    ticks=40,
    seconds=1.95,
    difference=MessageDifference(
        40, 2.0, "/bt/tick", "", False, "nodes[3].status", GRASP, "SUCCESS", "FAILURE"
    ),
    reasons=(
        Reason("recorded with other arithmetic (glibc 2.36, here 2.41): the runs may diverge", "", ""),
        Reason("mcap", "1.3.0", "1.6.0"),
    ),
)
OUTCOME = RunOutcome(
    log=Path("/runs/one/log.mcap"),
    recovered="",
    status="success",
    message="",
    end=5.75,
    items_total=4,
    items_sorted=4,
    items_done=4,
    picks_tried=5,
    picks_held=4,
    failures={"grasp.missed": 1},
    recoveries=1,
    digest="0",
)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Callable[[Resimulation], list[dict[str, Any]]]:
    """Lets the command meet this result; what it asked for."""

    def meet(found: Resimulation) -> list[dict[str, Any]]:
        orders: list[dict[str, Any]] = []

        def resimulate(log: str, **options: Any) -> Resimulation:
            options.pop("progress")(1.0, 5.0)
            orders.append({"log": log, **options})
            return found

        monkeypatch.setattr("picktree.analysis.resimulate", resimulate)
        return orders

    return meet


def test_identical(asked: Callable[..., Any], capfd: pytest.CaptureFixture[str]) -> None:
    orders = asked(SAME)
    assert answer(["resim", "last", "--until", "116"]) == 0
    assert capfd.readouterr() == ("identical: 116 ticks, 5.75 simulated s, digest 0123456789abcdef\n", "")
    assert orders == [{"log": "last", "changes": RunChanges(), "until": "116", "out": None}]


def test_a_difference_with_its_likely_reason(
    asked: Callable[..., Any], capfd: pytest.CaptureFixture[str]
) -> None:
    asked(OTHER)
    assert answer(["resim", "last"]) == 1
    assert capfd.readouterr().out == (
        "different from tick 40 on, 2.00 s: /bt/tick nodes[3].status (Main/Sequence/Grasp)\n"
        "  recorded  SUCCESS\n"
        "  now       FAILURE\n"
        "the 40 earlier ticks are the same\n"
        "likely why  recorded with other arithmetic (glibc 2.36, here 2.41): the runs may diverge\n"
        "            mcap: 1.3.0 then, 1.6.0 now\n"
    )


@pytest.mark.parametrize(
    ("missing", "words", "where"),
    [("a", "only the new run has this message", "recorded"),
     ("b", "only the recorded run has this message", "now")],
)  # fmt: skip
def test_a_missing_message_is_told_by_its_side(
    missing: Any, words: str, where: str, asked: Callable[..., Any], capfd: pytest.CaptureFixture[str]
) -> None:
    asked(replace(OTHER, difference=MessageDifference(40, 2.0, "/plan", missing, False, "", "", None, None)))
    assert answer(["resim", "last"]) == 1
    assert f"/plan\n  {words}\n" in capfd.readouterr().out
    assert answer(["resim", "last", "--json"]) == 1
    assert json.loads(capfd.readouterr().out)["difference"]["missing"] == where


def test_a_difference_without_any_reason(
    asked: Callable[..., Any], capfd: pytest.CaptureFixture[str]
) -> None:
    asked(replace(OTHER, reasons=()))
    assert answer(["resim", "last"]) == 1
    assert capfd.readouterr().out.endswith(
        "likely why  unknown: picktree, its libraries and the arithmetic are those of the log.\n"
        "            Possible causes: a clock, the order of a set or a global generator in a\n"
        "            plug-in, or a fault of picktree\n"
    )


def test_a_record_that_was_cut_off(asked: Callable[..., Any], capfd: pytest.CaptureFixture[str]) -> None:
    asked(
        replace(
            SAME, cut=True, until=5.75, recovered="the log was not finished", notes=("m.yaml was edited",)
        )
    )
    assert answer(["resim", "last"]) == 0
    assert capfd.readouterr().out == (
        "the log     the log was not finished\n"
        "identical up to where the recorded run was cut off: 116 ticks, 5.75 simulated s, "
        "digest 0123456789abcdef\n"
        "note        m.yaml was edited\n"
    )


def test_something_changed(asked: Callable[..., Any], capfd: pytest.CaptureFixture[str]) -> None:
    orders = asked(
        replace(
            OTHER,
            changes=("set rounds: 2",),
            reasons=(),
            outcomes=(OUTCOME, replace(OUTCOME, status="incomplete", items_sorted=3, failures={})),
            parting=("the runs diverge at 2.00 s: Grasp ends differently",),
            warnings="other.yaml:1:1: warning P310: mind this",
            kept=Path("/out/one/log.mcap"),
        )
    )
    line = ["resim", "last", "--mission", "other.yaml", "--set", "rounds=2", "--scene", "s", "--seed", "4"]
    assert answer([*line, "--no-faults", "--out", "/out"]) == 1
    told = capfd.readouterr()
    assert told.err == "other.yaml:1:1: warning P310: mind this\n"
    assert told.out == (
        "changed     set rounds: 2\n"
        "different from tick 40 on, 2.00 s: /bt/tick nodes[3].status (Main/Sequence/Grasp)\n"
        "  recorded  SUCCESS\n"
        "  now       FAILURE\n"
        "the 40 earlier ticks are the same\n"
        "\n"
        "                         recorded  now\n"
        "status                   success   incomplete\n"
        "items sorted             4 of 4    3 of 4\n"
        "items done, as believed  4         4\n"
        "grasps held              4 of 5    4 of 5\n"
        "simulated time           5.75 s    5.75 s\n"
        "handler runs             1         1\n"
        "failures                 1         0\n"
        "  grasp.missed           1         0\n"
        "the runs diverge at 2.00 s: Grasp ends differently\n"
        "new log     /out/one/log.mcap\n"
    )
    changes = RunChanges(Path("other.yaml"), "s", {"rounds": "2"}, None, True, 4)
    assert orders == [{"log": "last", "changes": changes, "until": None, "out": Path("/out")}]


def test_json_is_one_object(asked: Callable[..., Any], capfd: pytest.CaptureFixture[str]) -> None:
    asked(OTHER)
    assert answer(["resim", "last", "--json"]) == 1
    said = json.loads(capfd.readouterr().out)
    assert (said["identical"], said["ticks"]) == (False, 40)
    assert said["difference"] == {
        "tick": 40, "time": 2.0, "topic": "/bt/tick", "missing": "", "field": "nodes[3].status", "of": GRASP,
        "recorded": "SUCCESS", "now": "FAILURE",
    }  # fmt: skip
    assert said["reasons"][1] == {"what": "mcap", "recorded": "1.3.0", "now": "1.6.0"}


def test_bad_input(capfd: pytest.CaptureFixture[str]) -> None:
    assert answer(["resim", "last", "--faults", "f.yaml", "--no-faults"]) == 2
    assert capfd.readouterr().err == "--faults and --no-faults exclude each other\n"


def test_values_are_shown_where_they_differ(
    asked: Callable[..., Any], capfd: pytest.CaptureFixture[str]
) -> None:
    long = [0.1] * 60
    other = [*long[:50], 0.2, *long[51:]]
    asked(replace(OTHER, difference=MessageDifference(1, 0.05, "/plan", "", False, "path", "", long, other)))
    answer(["resim", "last"])
    recorded, now = capfd.readouterr().out.splitlines()[1:3]
    assert recorded.startswith("  recorded  …") and "0.1, 0.1" in recorded
    assert "0.2" in now
    assert len(now) < 120
