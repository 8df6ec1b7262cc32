"""Effort of fixed runs: as many function calls as were recorded."""

from __future__ import annotations

import pytest

from picktree.files.quantities import parse_quantity

from .calls import OF_LIBRARIES, TOLERANCE, CallCounter, CallRecord, changes, in_fresh_process, updated
from .runs import differing, libraries

CHANGED = """\
the effort is another than tests/golden/calls.json records. {}. Where more is meant, or less was achieved, \
`make calls` records the counts again; more than 5 % more needs a line in CHANGELOG.md"""


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


def test_recorded_counts_are_within_what_the_changelog_has_explained() -> None:
    record = CallRecord.read()
    for name, rooms in record.calls.items():
        assert sum(rooms.values()) <= (1 + TOLERANCE) * record.limit_from(name), name


CHANGELOG = """\
# Changelog

## [Unreleased]

### Changed
- Something else: 1,101 calls.
- A pick looks twice
  (`pick` makes 1,100 calls).

## [1.0.0]
- `pick` makes 1,200 calls.
"""


@pytest.mark.parametrize(
    ("now", "refused"),
    [
        (1050, ""),
        (1100, ""),  # the changelog says why
        (1101, "`pick` makes 1,101 calls, +10.1% from 1,000: CHANGELOG.md, Unreleased, needs a line with "
               "`pick` and 1,101 calls that says why"),
        (1200, "`pick` makes 1,200 calls, +20.0% from 1,000: CHANGELOG.md, Unreleased, needs a line with "
               "`pick` and 1,200 calls that says why"),  # said of an older version
    ],
)  # fmt: skip
def test_growth_is_recorded_with_a_line_in_the_changelog_alone(now: int, refused: str) -> None:
    before = CallRecord({}, {"pick": {"control": 600, "logs": 400}})
    calls = {"pick": {"control": now}, "new": {"logs": 5}}
    if refused:
        with pytest.raises(ValueError) as error:
            updated(before, calls, {}, CHANGELOG)
        assert str(error.value) == refused
    else:
        assert updated(before, calls, {}, CHANGELOG).calls == calls


def test_growth_is_counted_from_the_smallest_count_since_it_was_explained() -> None:
    record = CallRecord({}, {"pick": {"control": 1000}})
    for now in (1040, 960, 1000):
        record = updated(record, {"pick": {"control": now}}, {}, "")
    assert record.least == {"pick": 960}
    with pytest.raises(ValueError, match=r"makes 1,009 calls, \+5.1% from 960"):
        updated(record, {"pick": {"control": 1009}}, {}, "")
    record = updated(record, {"pick": {"control": 1100}}, {}, CHANGELOG)
    assert record.least == {"pick": 1100}
