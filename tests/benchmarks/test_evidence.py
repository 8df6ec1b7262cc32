"""Page of figures: what campaigns print is read again, and the page says what is old and what is missed."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st

Program = Callable[[str], ModuleType]

PRINTED = """\
with pushes: 50 runs, 0 crashed
  items sorted                    299 of 300    99.67 %   95 % interval 98.1 … 99.9 %
  medians a scene: 20 s simulated
  by form
    can                             9 of 10     90.00 %   95 % interval 59.6 … 98.2 %
without pushes: 50 runs
  items sorted                    150 of 300    50.00 %   95 % interval 44.4 … 55.6 %

runs above the limit                0 of 0         –     95 % interval 0.0 … 100.0 %
"""


CUT_OFF = "Cut off: 3 of 40 runs have a result.\n\n"


def test_a_rate_is_named_by_the_lines_above_it(program: Program) -> None:
    found = program("_campaign").figures(PRINTED)
    assert {name: (each.hits, each.n) for name, each in found.items()} == {
        "with pushes, items sorted": (299, 300),
        "with pushes, by form, can": (9, 10),
        "without pushes, items sorted": (150, 300),
        "runs above the limit": (0, 0),
    }


@given(
    name=st.text("abc def:0123456789", min_size=1).map(str.strip).filter(bool),
    n=st.integers(0, 10**6),
    data=st.data(),
)
def test_a_printed_rate_is_read_again(name: str, n: int, data: st.DataObject) -> None:
    campaign = _campaign()
    hits = data.draw(st.integers(0, n))
    (found,) = campaign.figures(campaign.rate(name, hits, n)).values()
    assert (found.name, found.hits, found.n) == (name, hits, n)


def _campaign() -> ModuleType:
    import sys

    return sys.modules["_campaign"]


@pytest.mark.parametrize(
    ("target", "hits", "n", "met"),
    [
        ("at least 97 %", 97, 100, True),
        ("at least 97 %", 96, 100, False),
        ("at most 0 %", 0, 100, True),
        ("at most 0 %", 1, 100, False),
        ("interval above 91 %", 128, 139, False),  # 92.1 %, from 86 % on
        ("interval above 91 %", 400, 410, True),
        ("about 90 %", 90, 100, None),
    ],
)
def test_targets(program: Program, target: str, hits: int, n: int, met: bool | None) -> None:
    evidence, campaign = program("_evidence"), program("_campaign")
    assert evidence.met(target, campaign.Figure("x", hits, n)) is met


def test_time_goes_to_what_has_no_figure_then_to_old_then_to_uncertain(
    program: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence = program("_evidence")
    repeats = program("_campaign_results").Repeats
    names = ("certain", "alike", "uncertain", "older", "old", "new")
    counts = {"alike": (3, 3, "c", True), "older": (2, 3, "c", True), "old": (3, 3, "c", False)}
    monkeypatch.setattr(evidence, "repeated", lambda folder, commit: repeats(*counts[folder.name]))
    table = [evidence.Campaign(name, name, "", "sorting.py", 10) for name in names]
    now, before = evidence.with_contents(["benchmarks/sorting.py"]), "benchmarks/sorting.py:another"
    line = program("_campaign").rate
    records = {
        "certain": evidence.Record("c", "2026-01-03", line("x", 99, 100), now),
        "uncertain": evidence.Record("c", "2026-01-03", line("x", 5, 10), now),
        "alike": evidence.Record("c", "2026-01-01", line("x", 99, 100), before),
        "older": evidence.Record("c", "2026-01-01", line("x", 99, 100), before),
        "old": evidence.Record("c", "2026-01-02", line("x", 5, 10), before),
    }
    order = [one.name for one in evidence.in_order(table, records)]
    assert order == [
        "new",
        "older",
        "old",
        "alike",
        "uncertain",
        "certain",
    ]


def test_the_page_marks_what_is_old_and_what_is_missed(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence, rate = program("_evidence"), program("_campaign").rate
    table = [
        evidence.Campaign(
            "a", "Pushes", "Words.", "singulating.py", 50, {"with pushes, items sorted": "at least 99 %"}
        ),
        evidence.Campaign("b", "Kits", "Words.", "sorting.py", 40, {"items sorted": "at least 99 %"}),
        evidence.Campaign("c", "Not yet", "Words.", "sorting.py", 40),
    ]
    files = evidence.with_contents(["benchmarks/sorting.py", "benchmarks/singulating.py"])
    changed = files + " benchmarks/pushing.py:1 gone/a.py:2 gone/b.py:3 gone/c.py:4"
    records = {
        "a": evidence.Record("c0ffee", "2026-01-01 10:00", PRINTED, files),
        "b": evidence.Record("c0ffee", "2026-01-01 10:00", CUT_OFF + rate("items sorted", 9, 10), changed),
    }
    evidence.write(records, tmp_path / "kept.json")
    assert evidence.read(tmp_path / "kept.json") == records
    repeats = program("_campaign_results").Repeats(11, 12, "cafe", hold=False)
    monkeypatch.setattr(evidence, "repeated", lambda folder, commit: repeats)
    targets, pushes, kits, missing = evidence.to_page(table, records).split("\n## ")[1:]
    name = "with pushes, items sorted"
    row = f"| [Pushes](#pushes) | {name} | 299 of 300, 99.7 % | 98.1 … 99.9 % | at least 99 % | met |"
    assert row in targets
    row = (
        "| [Kits](#kits) | items sorted | 9 of 10, 90.0 % | 59.6 … 98.2 % | at least 99 % | **missed**, old "
    )
    assert row + "(11 of 12 same at cafe) |" in targets
    assert (
        "| with pushes, items sorted | 299 of 300 | 99.7 % | 98.1 … 99.9 % | at least 99 %: met |" in pushes
    )
    assert "`python benchmarks/singulating.py --runs 50`, commit c0ffee" in pushes
    assert "| runs above the limit | 0 of 0 | – | – |  |" in pushes
    assert "Old" not in pushes
    assert "Cut off" not in pushes
    assert "UTC. Cut off: 3 of 40 runs have a result. **Old" in kits
    assert "at least 99 %: **missed**" in kits
    assert "**Old: `benchmarks/pushing.py`, `gone/a.py`, `gone/b.py` and 1 more changed since; " in kits
    assert "since; 11 of 12 runs came out the same when they were repeated at cafe.**" in kits
    assert missing == "Not yet\n\nWords. `python benchmarks/sorting.py --runs 40`: not measured yet.\n"


@pytest.mark.parametrize(
    ("n", "file", "alike", "replaced"),
    [
        (99, "", False, False),
        (100, "", False, True),
        (25, ":another", False, True),
        (24, ":another", False, False),
        (99, ":another", True, False),
        (100, ":another", True, True),
    ],
)
def test_a_result_that_holds_is_not_replaced_by_one_of_fewer_runs(
    program: Program, n: int, file: str, alike: bool, replaced: bool
) -> None:
    evidence, rate = program("_evidence"), program("_campaign").rate
    files = evidence.with_contents(["benchmarks/sorting.py"])
    kept = evidence.Record("a", "2026-01-01 10:00", rate("items sorted", 90, 100), files + file)
    new = evidence.Record("b", "2026-01-02 10:00", rate("items sorted", n, n), files)
    assert new.replaces(kept, alike=alike) is replaced


def test_the_page_in_docs_is_made_of_what_is_kept(program: Program) -> None:
    evidence = program("_evidence")
    root = Path(__file__).parents[2]
    kept, page = evidence.read(), (root / "docs" / "figures.md").read_text(encoding="utf-8")
    made = evidence.to_page(evidence.campaigns(), kept)
    assert _without_marks(page) == _without_marks(made), "python benchmarks/evidence.py --page"


def _without_marks(page: str) -> str:
    return re.sub(r" \*\*Old: .*\*\*|, old( \([^|]*\))?(?= \|)", "", page)


def test_each_campaign_of_the_table_is_a_program(program: Program) -> None:
    for one in program("_evidence").campaigns():
        assert one.program.is_file(), one.name
