"""What a soak's diary tells."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from types import ModuleType

import pytest

Program = Callable[[str], ModuleType]


def test_growth_is_told_from_half_an_hour_on(program: Program) -> None:
    soaking = program("_soaking")
    minutes = [
        soaking.Minute(60.0 * n, 60.0 * n, 30.0 * n, 300.0 + min(n, 30) + 0.1 * n, 80.0, 10 * n, 10 * n, 1)
        for n in range(1, 121)
    ]
    grown = soaking.growth(minutes)
    assert (grown.first, grown.last) == (pytest.approx(333.0), pytest.approx(342.0))
    assert grown.share == pytest.approx(9 / 333)
    assert grown.an_hour == pytest.approx(6.0)  # 0.1 MB a minute
    assert grown.an_item == pytest.approx(10.0)  # kB, ten items a minute
    assert grown.heap_an_item == pytest.approx(0.0)
    assert soaking.growth(minutes[:29]) is None
    later = [soaking.Minute(**{**asdict(minute), "part": 2}) for minute in minutes[100:150]]
    assert soaking.growth([*minutes[:100], *later]) == soaking.growth(minutes[:100])  # the longest process


def test_a_diary_that_was_cut_off_tells_what_it_knew(
    program: Program, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soaking = program("_soaking")
    minute = soaking.Minute(60.0, 50.0, 40.0, 300.0, 80.0, 12, 20, 1)
    ticks = soaking.quarter(900.0, [0.001] * 95 + [0.1] * 5, 1)
    rows = [{"folder": "a", "part": 1}, {"minute": asdict(minute)}, {"quarter": asdict(ticks)}]
    path = tmp_path / "diary.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    told = soaking.Soak.read(path)
    assert (told.minutes, told.quarters, told.folders) == ((minute,), (ticks,), (tmp_path / "a",))
    assert (told.result, told.crash) == (None, "")
    assert (ticks.median, ticks.mean, ticks.ticks) == (1.0, pytest.approx(5.95), 100)
    with path.open("a") as diary:
        diary.write(json.dumps({"minute": asdict(replace(minute, time=120.0, cpu=5.0, part=2))}) + "\n")
    assert program("_soak_report").report(path, 1.0) == 1
    assert "0.03 h in 45 CPU s, 2 process(es)" in capsys.readouterr().out


def test_the_first_hour_is_held_against_the_last(program: Program, tmp_path: Path) -> None:
    soaking = program("_soaking")
    minutes = tuple(
        soaking.Minute(60.0 * n, 60.0 * n, 30.0 * n, 300.0 if n <= 120 else 312.0, 80.0, n, n, 1)
        for n in range(1, 181)
    )
    quarters = tuple(
        soaking.Quarter(900.0 * n, 18000, 1.0, 2.0, 100.0 if n < 12 else 120.0, 1.5, 1) for n in range(1, 13)
    )
    soak = soaking.Soak(minutes, quarters, (), (), None, "")
    steady = soaking.steadiness(soak)
    assert steady.memory == (300.0, 312.0)
    assert steady.p999 == (100.0, 105.0)
    assert steady.minutes == (60, 120)
    assert steady.quarters == (7, 8)
    then = tuple(replace(minute, time=minute.time + 10800.0, memory=400.0, part=2) for minute in minutes[:60])
    slower = tuple(replace(each, time=each.time + 10800.0, p999=200.0, part=2) for each in quarters[:4])
    longer = soaking.steadiness(soaking.Soak(minutes + then, quarters + slower, (), (), None, ""))
    assert (longer.memory, longer.p999) == (steady.memory, (100.0, 200.0))
    assert (longer.minutes, longer.quarters) == (steady.minutes, (7, 12))
    assert soaking.steadiness(soaking.Soak(minutes[:90], quarters[:6], (), (), None, "")) is None
    program("_soak_report").draw(soak, tmp_path / "soak.svg")
    assert "<svg" in (tmp_path / "soak.svg").read_text()
