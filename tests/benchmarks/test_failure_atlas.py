"""Which runs of a campaign are the worst."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

from picktree.simulation.fault_entries import FaultExpectation

Program = Callable[[str], ModuleType]


def test_items_lost_count_before_time_and_time_before_force_and_two_of_a_fault_are_enough(
    program: Program,
) -> None:
    measure = program("_fault_measures").Measure

    def run(
        fault: str, seed: int, sorted_: int, seconds: float, force: float, recovery: bool = True
    ) -> object:
        struck = None if fault == "none" else 1.0
        return measure(
            f"{fault}-{seed}-{recovery}", fault, recovery, seed, "success", "", struck,
            total=4, sorted=sorted_, seconds=seconds, force=force,
        )  # fmt: skip

    measures = [
        run("none", 0, 4, 15.0, 10.0),
        run("none", 1, 4, 25.0, 10.0),
        run("slip", 0, 2, 20.0, 10.0),
        run("slip", 1, 1, 20.0, 10.0),
        run("slip", 2, 1, 30.0, 10.0),
        run("vanish", 0, 3, 90.0, 10.0),  # one is beyond reach: nothing lost
        run("bump", 0, 4, 40.0, 50.0),  # 25 s late
        run("bump", 1, 4, 50.0, 20.0),  # 25 s late
        run("bump", 2, 0, 50.0, 20.0, recovery=False),
    ]
    chosen = program("_atlas_page").worst(measures, {"vanish": FaultExpectation((), 1)}, 5)
    assert [(e.measure.fault, e.measure.seed, e.badness.lost, e.badness.late) for e in chosen] == [
        ("slip", 2, 3, 10.0),  # against 20 s, the mean of the calm runs
        ("slip", 1, 3, -5.0),
        ("vanish", 0, 0, 75.0),
        ("bump", 0, 0, 25.0),
        ("bump", 1, 0, 25.0),
    ]
