"""Operators' figures: each against an example that is computed by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from picktree.logs import (
    Activity,
    CellMotion,
    FigureCounter,
    FigureCounts,
    OperatorFigures,
    RunRecord,
    poisson_interval,
)
from picktree.logs.operator_figures import TimeToDone, added_counts
from picktree.logs.run_account import figures_during
from picktree.session import tally_of
from picktree.world import JournalEvent, event_types

REST, MOVE = CellMotion("Hold", 0.04), CellMotion("Track", 0.04)
RECOVER, GRASP, WAIT = "Main/Recover", "Main/Recover/Grasp", "Main/AwaitItems"


def node(path: str, *children: str) -> Any:
    id_, parent = path.rsplit("/", 1)[-1], path.rpartition("/")[0]
    return SimpleNamespace(path=path, id=id_, parent=parent, children=children)


def change(path: str, status: str) -> Any:
    return SimpleNamespace(path=path, status=status)


def counted(*ticks: tuple[float, CellMotion, Sequence[JournalEvent], Sequence[Any]]) -> FigureCounter:
    counter = FigureCounter()
    counter.follow([node("Main", RECOVER, WAIT), node(RECOVER, GRASP), node(GRASP), node(WAIT)])
    for time, motion, entries, changes in ticks:
        decisions = [entry for entry in entries if isinstance(entry, event_types.EpisodeEvent)]
        counter.take(time, entries, decisions, changes, motion)
    return counter


def pick(item: str, *, held: bool = True) -> JournalEvent:
    return event_types.PickEvent("", object=item, held=held)


def done(item: str) -> JournalEvent:
    return event_types.ItemDoneEvent("", object=item, into="bin")


def aside(item: str) -> JournalEvent:
    return event_types.SetAsideEvent("", object=item)


def given_up(item: str) -> JournalEvent:
    return event_types.EpisodeEvent(
        "", cause="grasp.missed", item=item, times=(1.0,), end="given_up", ended=2.0, by="", handler="",
        tried=(), tries=1, seconds=1.0,
    )  # fmt: skip


def test_units_failures_and_first_pass_are_counted_by_item() -> None:
    """Five items: two at once, one after a grasp in vain, one set aside and done later, one given up."""
    found = counted(
        (1.0, MOVE, [pick("a")], ()),
        (3.0, MOVE, [done("a"), pick("b", held=False)], ()),
        (5.0, MOVE, [pick("b")], ()),
        (8.0, MOVE, [done("b"), aside("c")], ()),
        (10.0, MOVE, [pick("d"), done("d")], ()),
        (12.0, MOVE, [given_up("e")], ()),
        (20.0, MOVE, [pick("c"), done("c")], ()),
        (21.0, MOVE, [event_types.BinEmptiedEvent("", bin="bin", objects=("a", "b"))], ()),
    ).counts(36.0)
    assert (found.units, found.entered, found.first_pass) == (4, 5, 3)
    assert (found.set_aside, found.given_up, found.failures) == (0, 1, 1)
    assert found.times == (3.0, 5.0, 2.0, 8.0)
    figures = OperatorFigures((found,))
    assert figures.units_an_hour.value == pytest.approx(4 / 36 * 3600)
    assert figures.mtbf.value == 36.0
    assert figures.mtbf.low == pytest.approx(36.0 / poisson_interval(1).high)
    assert figures.first_pass_yield.share == 0.6
    # 4 of 5 are ever done, so 90 % never are.
    curve = figures.time_to_done
    assert curve.curve() == ((2.0, 0.2), (3.0, 0.4), (5.0, 0.6), (8.0, 0.8))
    assert (curve.within(0.5), curve.within(0.9), curve.share(4.9)) == (5.0, None, 0.4)


def test_a_tote_that_is_given_up_is_a_failure_but_no_item() -> None:
    counter = counted((1.0, MOVE, [pick("a"), done("a")], ()), (2.0, MOVE, [given_up("tote")], ()))
    counter.fixed = frozenset({"tote"})
    found = counter.counts(2.0)
    assert (found.entered, found.first_pass, found.failures) == (1, 1, 1)


def test_assists_are_actions_of_a_person() -> None:
    answer = event_types.OperatorAnswerEvent("", "Main/Ask", question="?", answer="go on")
    counter = counted(
        (1.0, REST, [answer, event_types.BinExchangedEvent("", bin="b", items=3, number=1, by="person")], ()),
        (2.0, REST, [answer, event_types.BinExchangedEvent("", bin="b", items=3, number=2)], ()),
    )
    counter.assist("pause")
    figures = OperatorFigures((counter.counts(1800.0),))
    assert figures.total.assists == {"answer": 2, "exchange": 1, "pause": 1}
    assert (figures.assists_an_hour.value, figures.mtbf.value, figures.mtbf_a.value) == (8.0, None, 450.0)
    assert dict(figures.lines())["MTBF/A"] == (
        "7.5 min (2.9 min … 27.5 min): 2 answers, 1 bin exchanged by hand, 1 pause"
    )


def test_time_is_charged_to_the_first_use_that_applies() -> None:
    recovery = event_types.RecoveryEvent("", RECOVER, cause="grasp.missed", failed=GRASP)
    ask = event_types.HelpWantedEvent("", WAIT, reason="?", choices=("yes",), object="", situation="")
    found = counted(
        (0.0, MOVE, (), [change(GRASP, "RUNNING")]),
        (1.0, REST, (), ()),
        (3.0, CellMotion("Hold", 0.08), (), ()),  # the fingers have opened since
        (4.0, CellMotion("Track", 0.08), [recovery], [change(GRASP, "FAILURE")]),
        (8.0, REST, (), [change(GRASP, "RUNNING")]),
        (9.0, REST, (), [change(WAIT, "RUNNING")]),
        (14.0, REST, [ask], ()),
        (20.0, MOVE, (), [change(WAIT, "SUCCESS")]),
    ).counts(22.0)
    assert found.activities == {"moving": 5, "thinking": 2, "recovering": 4, "feed": 5, "person": 6}
    shares = OperatorFigures((found,)).utilisation
    assert sum(each.value or 0.0 for each in shares.values()) == pytest.approx(1.0)


def test_counts_of_several_runs_add_up_and_the_interval_is_by_run() -> None:
    runs = tuple(FigureCounts(seconds=3600.0, units=100 + 10 * n, entered=100 + 10 * n) for n in range(5))
    figures = OperatorFigures(runs)
    assert figures.total.units == 600
    low, value, high = (figures.units_an_hour.low, figures.units_an_hour.value, figures.units_an_hour.high)
    assert low is not None and high is not None
    assert value == 120.0
    assert 100.0 < low < 120.0 < high < 140.0
    # A few runs tell too little about their spread.
    few = OperatorFigures(runs[:4]).units_an_hour
    assert few.low == pytest.approx(poisson_interval(460).low / 4)


def test_counts_of_a_period_are_those_since_the_one_before() -> None:
    before = FigureCounts(seconds=10.0, units=2, given_up=1, assists={"answer": 1}, times=(1.0, 2.0))
    later = FigureCounts(seconds=30.0, units=5, assists={"answer": 3}, times=(1.0, 2.0, 4.0))
    since = later.minus(before)
    assert (since.seconds, since.units, since.given_up, since.assists, since.times) == (
        20.0, 3, 0, {"answer": 2}, (4.0,),
    )  # fmt: skip


def test_a_log_gives_the_figures_of_its_result(troubled_log: Path) -> None:
    """Scored and counted from the log's ticks they are the same, also after a checkpoint and by periods."""
    with RunRecord(troubled_log) as run:
        assert run.result is not None
        scored = run.result.figures
        assert scored is not None
        (counted_again,) = figures_during(run.log, run.events, run.motions)
        assert counted_again == replace(scored, misplaced=0, crushed=0)
        state = tally_of(run, run.end).state().figures
        assert state.counts(scored.seconds) == counted_again
        halves = run.operator_figures_by(scored.seconds / 2)
        assert added_counts(each.total for each in halves).times == scored.times
        assert run.operator_figures.total == scored


def test_the_band_of_the_curve_is_that_of_massart() -> None:
    assert TimeToDone((1.0,) * 50, 50).band == pytest.approx(math.sqrt(math.log(40) / 100))
    assert TimeToDone((), 0).share(1.0) is None


@pytest.mark.parametrize("events", [0, 1, 7, 600])
def test_the_poisson_interval_is_that_of_scipy(events: int) -> None:
    from scipy.stats import distributions  # loading takes half a second

    stats: Any = distributions

    found = poisson_interval(events)
    low = stats.chi2.ppf(0.025, 2 * events) / 2 if events else 0.0
    assert (found.low, found.high) == pytest.approx(
        (low, stats.chi2.ppf(0.975, 2 * events + 2) / 2), rel=1e-8
    )


def test_counts_read_back_from_json() -> None:
    uses: dict[Activity, float] = {"moving": 20.0}
    counts = FigureCounts(20.0, 3, 4, 2, given_up=1, assists={"pause": 1}, activities=uses, times=(3.0,))
    assert FigureCounts.from_json(counts.to_json() | OperatorFigures((counts,)).to_json()) == counts
