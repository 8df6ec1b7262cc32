"""Effort of fixed runs: as many function calls as were recorded."""

from __future__ import annotations

import pytest

from picktree.files.quantities import parse_quantity

from .calls import OF_LIBRARIES, TOLERANCE, CallCounter, CallRecord, changes, in_fresh_process
from .runs import differing, libraries

CHANGED = """\
the effort is another than tests/golden/calls.json records. {}. Where more is meant, or less was achieved, \
`make calls` records the counts again; say in CHANGELOG.md why"""


@pytest.mark.slow
def test_runs_and_commands_make_as_many_calls_as_recorded() -> None:
    record = CallRecord.read()
    if others := differing(record.libraries, libraries()):
        pytest.skip(f"the calls were counted with other libraries; here is {others}")
    changed = changes(record.calls, in_fresh_process())
    assert not changed, CHANGED.format("; ".join(changed))


def test_calls_count_for_the_room_that_makes_them() -> None:
    def calls(times: int) -> dict[str, int]:
        counter = CallCounter()
        counter.start()
        for _ in range(times):
            parse_quantity("90 min", "s")
        counter.stop()
        return counter.by_room()

    calls(1)
    one, three = calls(1), calls(3)
    assert one["files"] >= 2
    assert three["files"] == 3 * one["files"]
    assert set(three) <= {"files", OF_LIBRARIES}


def test_only_what_leaves_the_tolerance_is_named_with_the_rooms_that_changed() -> None:
    recorded = {"pick": {"control": 600, "logs": 300, "trees": 100}, "gone": {"logs": 5}}
    assert TOLERANCE == 0.05
    assert changes(recorded, {**recorded, "pick": {"control": 650, "logs": 300, "trees": 100}}) == []
    assert changes(recorded, {**recorded, "pick": {"control": 550, "logs": 300, "trees": 100}}) == []
    assert changes(
        recorded,
        {"pick": {"control": 700, "logs": 250, "trees": 100, "files": 1100}, "new": {"logs": 3}},
    ) == [
        "pick: 2,150 calls instead of 1,000, +115.0% (files +1,100, control +100, logs -50)",
        "gone is recorded only",
        "new is counted only",
    ]
    assert changes(recorded, {**recorded, "pick": {"control": 540, "logs": 300, "trees": 100}}) == [
        "pick: 940 calls instead of 1,000, -6.0% (control -60)"
    ]
