"""The table of `make bench`: what is measured in which order, and what the table says of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest


@pytest.fixture(scope="module")
def speed(program: Callable[[str], ModuleType]) -> ModuleType:
    return program("speed")


def row(seed: int, reference: float, cpu: float, before: float) -> dict[str, Any]:
    run = {"cpu": cpu + 1.0, "log": "log.mcap", "simulated": 30.0, "run_cpu": cpu}
    former = {**run, "cpu": before, "simulated": 40.0}
    return {
        "seed": seed,
        "measured": {
            "dense": {"reference": reference, "here": run, "there": former},
            "check": {"reference": reference, "here": {"cpu": cpu}, "there": {"cpu": before}},
        },
    }


def test_the_table_has_medians_ranges_and_ratios_of_each_round(speed: ModuleType) -> None:
    rows = [row(0, 0.5, 2.0, 4.0), row(1, 1.0, 5.0, 4.0), row(2, 2.0, 3.0, 3.0)]
    assert speed.table(rows, ["dense", "check"], against=True) == (
        "|  | CPU s | range | × reference | simulated s | simulated s a CPU s "
        "| CPU × other | simulated × other |\n"
        "|---|---|---|---|---|---|---|---|\n"
        "| dense | 4.00 | 3.00 … 6.00 | 6.00 | 30.00 | 10.0 | 1.333 | 0.750 |\n"
        "| check | 3.00 | 2.00 … 5.00 | 4.00 |  |  | 1.000 |  |"
    )
    assert speed.table(rows, ["check"], against=False) == (
        "|  | CPU s | range | × reference | simulated s | simulated s a CPU s |\n"
        "|---|---|---|---|---|---|\n"
        "| check | 3.00 | 2.00 … 5.00 | 4.00 |  |  |"
    )


def test_a_command_that_reads_a_log_brings_the_run_that_writes_it(speed: ModuleType) -> None:
    assert speed.needed(["check", "help"]) == ("help", "check")
    assert speed.needed(["explain"]) == ("sort_by_colour", "explain")
    assert speed.needed([]) == tuple(command.name for command in speed.MEASURED)
    with pytest.raises(ValueError, match=r"^there is no chekc; known: sort_by_colour, dense, "):
        speed.needed(["chekc"])


def test_checkouts_alternate_and_each_reads_its_own_log(
    speed: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    done: list[str] = []

    def measure(command: Any, checkout: Path, values: dict[str, object]) -> dict[str, Any]:
        done.append(f"{command.name} in {checkout.name} with {values['seed']} {values['log']}".rstrip())
        return {"cpu": 1.0, **({"log": f"log of {checkout.name}"} if command.runs else {})}

    monkeypatch.setattr(speed, "ROOT", tmp_path / "after")
    monkeypatch.setattr(speed, "measure", measure)
    monkeypatch.setattr(
        speed, "reference", lambda: done.append("reference") or float(done.count("reference"))
    )
    names = ("sort_by_colour", "explain")
    found = speed.one(speed.Round(7, names, str(tmp_path / "before"), "1a2b3c"), tmp_path)
    assert done == [
        "reference",
        "sort_by_colour in after with 7",
        "sort_by_colour in before with 7",
        "reference",
        "explain in after with 7 log of after",
        "explain in before with 7 log of before",
        "reference",
    ]
    assert [each["reference"] for each in found["measured"].values()] == [1.5, 2.5]
    assert speed.cpu_of(found) == 8.0


def test_a_command_that_breaks_off_is_no_measurement(speed: ModuleType) -> None:
    missing = speed.Measured("check", ("check", "{out}/gone.yaml"), 1.0)
    with pytest.raises(RuntimeError, match=r"^picktree check /nowhere/gone.yaml: exit code 2\n"):
        speed.measure(missing, speed.ROOT, {"out": "/nowhere"})


def test_the_second_table_has_the_parts_of_the_runs_alone(speed: ModuleType) -> None:
    parts = dict.fromkeys(speed.PARTS, 0.5)
    rows = [
        {"measured": {"dense": {"here": {"parts": {**parts, "physics": physics}}}, "check": {"here": {}}}}
        for physics in (1.0, 4.0, 2.0)
    ]
    assert speed.parts_table(rows, ["dense", "check"]).splitlines()[2:] == [
        "| dense | 2.00 | 0.50 | 0.50 | 0.50 | 0.50 | 0.50 | 0.50 | 0.50 |"
    ]
    assert speed.parts_table(rows, ["check"]) == ""


def tick_round(cores: int, wall: list[float], cpu: list[float]) -> dict[str, Any]:
    measured = {"wall": {"wall": sum(wall), "ticks": wall}, "cpu": {"wall": sum(cpu), "ticks": cpu}}
    return {"job": {"cores": cores}, "measured": {"dense": measured}}


def test_the_table_of_ticks_has_a_line_for_each_number_of_cores(speed: ModuleType) -> None:
    rows = [
        tick_round(2, [0.01, 0.06], [0.01, 0.021]),
        tick_round(1, [0.03, 0.07, 1.0], [0.01, 0.02, 0.04]),
        tick_round(1, [0.01, 0.05, 0.04], [0.03, 0.03, 0.06]),
    ]
    assert speed.tick_table(rows, ["dense"]) == (
        "|  | cores | wall s | ticks above 20 ms, wall | longest, ms, wall | ticks above 20 ms, CPU "
        "| longest, ms, CPU |\n"
        "|---|---|---|---|---|---|---|\n"
        "| dense | 1 | 0.6 | 2 of 3 | 525 | 2 of 3 | 50 |\n"
        "| dense | 2 | 0.1 | 1 of 2 | 60 | 1 of 2 | 21 |"
    )
